"""The verb that estimates depth from photographs: predict."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dfdbench.cli.completion import methods
from dfdbench.cli.methods import Params
from dfdbench.cli.options import values_of
from dfdbench.cli.screen import progress, say
from dfdbench.errors import InputError
from dfdbench.tables.wording import counted


def predict(
    images: Annotated[
        list[Path],
        typer.Argument(
            help="The in-focus and the defocus photograph, or a folder of pairs: NAME.png beside "
            "NAME_defocus.png."
        ),
    ],
    out: Annotated[
        Path,
        typer.Option(
            help="The depth map: .npy, or .png of 16 bit, level times 256. Of a folder: a folder."
        ),
    ],
    method: Annotated[
        str | None,
        typer.Option(
            help="As for `run`; default with --fitted: the method of that run.",
            autocompletion=methods,
        ),
    ] = None,
    param: Params = None,
    fitted: Annotated[
        Path | None,
        typer.Option(
            metavar="RUN", help="A run's folder: use what its fit learned of the camera's blur."
        ),
    ] = None,
    lens: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="TOML file of the lens, or of a blur recipe or law."),
    ] = None,
    weights: Annotated[
        str | None, typer.Option(metavar="NAME", help="A network's weights, by name or file.")
    ] = None,
    no_align: Annotated[
        bool, typer.Option("--no-align", help="The photographs lie on each other as they are.")
    ] = False,
    picture: Annotated[
        Path | None,
        typer.Option(metavar="FILE.png", help="Draw photographs and depth in colour, too."),
    ] = None,
    seed: Annotated[
        int, typer.Option(min=0, max=2**32 - 1, help="Seed for methods that use random numbers.")
    ] = 0,
) -> None:
    """Estimate depth from two photographs, or from a folder of pairs; no data set is needed."""
    from dfdbench.evaluation.predict import Predictor, pairs_in, read_image, write_depth

    if fitted and lens:
        raise InputError(
            "both a fit and a lens are named", where="--fitted, --lens", fix="name one"
        )
    folder = len(images) == 1 and images[0].is_dir()
    if not folder and len(images) != 2:
        raise InputError(
            f"two photographs are needed, or a folder of pairs; got {counted(len(images), 'path')}",
            fix="dfdbench predict sharp.png blurred.png --out depth.png",
        )
    if folder and picture:
        raise InputError("a picture is drawn of one pair", where="--picture", fix="leave it out")
    pairs = list(pairs_in(images[0])) if folder else []
    if folder and not pairs:
        raise InputError(
            "no pair in this folder",
            where=str(images[0]),
            fix="name photographs NAME.png and NAME_defocus.png, as `dfdbench export` does",
        )
    parameters = values_of(param, "--param") | ({"weights": weights} if weights else {})
    predictor = Predictor(method, fitted or lens, parameters, not no_align, seed)
    if not folder:
        sharp, blurred = map(read_image, images)
        with progress("estimating depth", "nothing was written"):
            estimate = predictor(sharp, blurred)
        write_depth(out, estimate.depth)
        say(f"matched      {estimate.found or 'nothing to do: the photographs are in register'}")
        say(f"time         {estimate.seconds:.1f} s")
        print(f"depth        {out}: {predictor.meaning}")
        if picture:
            from dfdbench.cli.screen import save_figure
            from dfdbench.figures.pairs import depth_figure

            save_figure(depth_figure(sharp, blurred, estimate.depth), picture)
        return
    with progress("estimating depth") as step:
        for number, (name, infocus, defocus) in enumerate(pairs, 1):
            target = out / f"{name}.npy"
            if not target.exists():
                write_depth(target, predictor(read_image(infocus), read_image(defocus)).depth)
            step(number, len(pairs))
    print(f"depth        {out}: {counted(len(pairs), 'map')} of {predictor.meaning}")
