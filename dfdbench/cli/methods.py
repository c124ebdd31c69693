"""The verbs that take a method without a data set: predict, check-method, export-onnx."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Exit, Option

from dfdbench.cli.options import Facts, Fitted, Params, Printed, Seed, methods, values_of
from dfdbench.cli.screen import GOES_ON, command, progress, require_picture, save_figure, say, show
from dfdbench.errors import DfdbenchError, InputError, MethodError, Problem, refuse_both
from dfdbench.results.output_place import output_place
from dfdbench.statuses import NO
from dfdbench.system.files import writing_folder
from dfdbench.system.parallel import one_by_one
from dfdbench.tables.table import Format, Table, counted, grouped, listed

if TYPE_CHECKING:
    from dfdbench.evaluation.map_files import KeptMaps
    from dfdbench.evaluation.predict import DepthPredictor, Estimate

#: The parameters of an exported network.
KEPT = "weights or readout"


def predict(
    images: Annotated[
        list[Path],
        Argument(
            help="In-focus and defocus photograph; or a folder of pairs, PAIR/infocus.png and "
            "PAIR/defocus.png, or of stacks, STACK/stack.json and its images."
        ),
    ],
    out: Annotated[
        Path,
        Option(
            help="A depth map, .npy, .png (16 bit: level times 256, or mm), or .npz, which holds "
            "sigma too. Of a folder: a folder, or a .zip as ZEDD's test server takes it."
        ),
    ],
    method: Annotated[
        str | None,
        Option(
            help="As for `run`; default with --fitted: the method of that run, if it is built in "
            "or installed.",
            autocompletion=methods,
        ),
    ] = None,
    param: Params = None,
    fitted: Fitted = None,
    lens: Annotated[
        Path | None, Option(metavar="FILE", help="TOML of a lens, recipe or law.")
    ] = None,
    weights: Annotated[
        str | None, Option(metavar="NAME", help="A network's weights, by name or file.")
    ] = None,
    no_align: Annotated[
        bool, Option("--no-align", help="Do not align: the photographs already match.")
    ] = False,
    figure: Annotated[
        Path | None, Option(metavar="FILE.png", help="Draw images and depth.")
    ] = None,
    seed: Seed = 0,
    format: Facts = "table",
) -> None:
    """Estimate depth from two photographs, or a folder of pairs or stacks, without a data set."""
    from dfdbench.evaluation.photographs import captures_in, lone_images
    from dfdbench.evaluation.predict import DepthPredictor

    refuse_both({"--fitted": fitted}, {"--lens": lens})
    folder = len(images) == 1 and images[0].is_dir()
    if len(images) == 1 and not images[0].exists():
        fix = "name a folder of pairs, or two photographs"
        raise InputError("no such folder", where=str(images[0]), fix=fix)
    if not folder and len(images) != 2:
        named = counted(len(images), "path")
        what = f"two photographs or a folder of pairs are needed, not {named}"
        pair = "dfdbench predict sharp.png blurred.png --method NAME --out depth.png"
        raise InputError(what, fix=pair)
    if not folder and all(map(Path.exists, images)) and images[0].samefile(images[1]):
        what = "the in-focus and the defocus photograph are one file"
        raise InputError(what, where=str(images[0]), fix="name two photographs of the scene")
    captures, lone = ({}, []) if not folder else (captures_in(images[0]), lone_images(images[0]))
    if folder and not captures:
        InputError.raise_if(lone)
        fix = "name photographs PAIR/infocus.png and PAIR/defocus.png, or export --images-only"
        raise InputError("no pair and no stack in this folder", where=str(images[0]), fix=fix)
    _check_places(out, figure, folder, [*images, fitted])
    parameters = values_of(param, "--param")
    refuse_both({"--weights": weights}, {"--param weights": "weights" in parameters})
    if weights:
        parameters["weights"] = weights
    predictor = DepthPredictor(method, fitted or lens, parameters, not no_align, seed)
    if folder:
        predictor.settle_unit(captures.values())
        _predict_folder(predictor, captures, lone, out, format)
    else:
        _predict_pair(predictor, images, out, figure, format)


def _check_places(
    out: Path, figure: Path | None, folder: bool, inputs: Sequence[Path | None]
) -> None:
    """Refuse, before the work, places that cannot be written."""
    from dfdbench.evaluation.map_files import MAPS, require_map

    refuse_both({"a folder of pairs": folder}, {"--figure": figure})
    if folder and out.suffix in MAPS:
        what = "the maps of a folder do not go into one file"
        raise InputError(what, where=f"--out {out}", fix="name a folder, or a .zip")
    if not folder:
        require_map(out)
    output_place(out, *inputs)
    if figure:
        require_picture(figure)
        output_place(figure, *inputs, option="--figure")


def _predict_pair(
    predictor: DepthPredictor, images: list[Path], out: Path, figure: Path | None, format: str
) -> None:
    import numpy as np

    from dfdbench.evaluation.map_files import write_depth

    sharp, blurred = predictor.read(images)
    with progress("estimating depth", "nothing was written"):
        estimate = predictor(sharp, blurred)
    write_depth(out, estimate.depth, predictor.unit, estimate.sigma)
    if estimate.found:
        say(f"matched      {estimate.found}")
    say(f"time         {estimate.seconds:.1f} s")
    if estimate.sigma is not None:
        where = "beside the depth" if out.suffix == ".npz" else f"not in {out.name}: --out NAME.npz"
        say(f"sigma        {float(np.nanmedian(estimate.sigma)):.3g}, the median pixel's; {where}")
    gaps = np.count_nonzero(np.isnan(estimate.depth))
    if gaps:
        say(f"no answer    in {gaps} of {estimate.depth.size} pixels, NaN there")
    for text in estimate.odd:
        say(f"odd          {text}")
    held = {"levels": "the file holds levels times 256", "metres": "the file holds millimetres"}
    inside = f" ({held[predictor.unit]})" if out.suffix.lower() == ".png" else ""
    show(
        format,
        text=f"depth        {out}: {predictor.meaning}{inside}",
        depth=out,
        unit=predictor.unit,
        meaning=predictor.meaning,
        matched=estimate.found,
        seconds=estimate.seconds,
        pixels=estimate.depth.size,
        without_answer=int(gaps),
    )
    if figure:
        from dfdbench.figures.runs import predicted_figure

        of_depth = estimate.depth, predictor.unit, predictor.grows_with
        save_figure(predicted_figure(sharp, blurred, *of_depth), figure)


def _predict_folder(
    predictor: DepthPredictor,
    captures: Mapping[str, tuple[Path, ...]],
    failed: list[Problem],
    out: Path,
    format: str,
) -> None:
    from dfdbench.evaluation.map_files import write_submission

    zipped, files, kept = out.suffix == ".zip", dict[str, Path](), list[str]()

    def estimates() -> Iterator[tuple[str, Estimate]]:
        for name, paths in one_by_one(captures.items(), step):
            if maps and (place := maps.place_of(name, paths)):
                files[name] = place
                kept.append(name)
                continue
            try:
                estimate = predictor.of_files(paths)
            except DfdbenchError as error:
                failed.extend(replace(one, where=one.where or name) for one in error.problems)
                continue
            files[name] = out
            yield name, estimate
        # A test server rejects a zip that lacks a map.
        if zipped:
            MethodError.raise_if(_together(failed))

    again = "the same command begins anew" if zipped else GOES_ON
    with writing_folder(out, "prediction", again), progress("estimating depth", again) as step:
        maps = None if zipped else _maps_in(out, predictor)
        if maps is None:
            write_submission(out, ((name, predictor.metres(e.depth)) for name, e in estimates()))
        else:
            for name, found in estimates():
                files[name] = maps.add(name, captures[name], found.depth, found.sigma)
    if kept:  # not above: that this cannot be printed says nothing of the folder
        say(f"taken over   {counted(len(kept), 'map')} from before")
    if left := maps.left(files) if maps else []:
        say(f"left         of an earlier call, and not of this one: {listed(left, most=5)}")
    if sure := sum(place.suffix == ".npz" for place in files.values()):
        say(f"sigma        beside the depth of {counted(sure, 'map')}, in .npz files")
    meaning = "distances in metres" if zipped else predictor.meaning
    text = f"depth        {out}: {counted(len(files), 'map')} of {meaning}"
    unit = "metres" if zipped else predictor.unit
    show(format, text=text, depth=out, unit=unit, meaning=meaning, maps=list(files))
    MethodError.raise_if(_together(failed))


def _maps_in(folder: Path, predictor: DepthPredictor) -> KeptMaps:
    from dfdbench.evaluation.map_files import KeptMaps

    maps = KeptMaps(folder, predictor.method, predictor.identity)
    if maps.set_aside:
        say(f"note         the maps of an earlier, other call were moved to {maps.set_aside}")
    return maps


def _together(problems: Sequence[Problem]) -> list[Problem]:
    """Return problems; those that several captures share become one."""
    places = grouped((replace(problem, where=""), problem.where) for problem in problems)
    return [replace(one, where=listed(found, most=5)) for one, found in places.items()]


def export_onnx_command(
    method: Annotated[str, Argument(help="u-net or dfd-net.", autocompletion=methods)],
    out: Annotated[Path, Option(help="NAME.onnx; its description, NAME.toml, goes beside it.")],
    param: Params = None,
    format: Facts = "table",
) -> None:
    """Write a network as an ONNX file that other programs run, and its description."""
    values = values_of(param, "--param")
    InputError.raise_if(
        Problem("an exported network has no such parameter", where=f"--param {name}", expected=KEPT)
        for name in values
        if name not in KEPT.split(" or ")
    )
    from dfdbench.methods.networks.onnx_export import export_onnx

    description = export_onnx(method, output_place(out), **values)
    text = f"model        {out}\ndescription  {description}"
    show(format, text=text, model=out, description=description)
    say(f"next         {command('check-method', out)}")


def check_method_command(
    method: Annotated[
        str,
        Argument(
            help="As for `run --method`: a name, file.py:function, module:function or model.onnx.",
            autocompletion=methods,
        ),
    ],
    param: Params = None,
    format: Printed = Format.table,
) -> None:
    """Try a method on awkward inputs and say what is wrong, before a long run."""
    from dfdbench.evaluation.check import check_method, load_to_check

    load = partial(load_to_check, method, values_of(param, "--param"))
    found, tried = load(), count(1)
    with progress(f"checking {method}") as step:
        trials = check_method(found, load, lambda name: step(next(tried), None, name))
    rows = tuple(
        (
            "FAIL" if trial.error else "odd" if trial.warning else "ok",
            trial.name,
            f"{trial.seconds:.3f} s",
            trial.error or trial.warning,
        )
        for trial in trials
    )
    columns = ("", "input", "time", "what is wrong")
    records = tuple(map(asdict, trials))
    table = Table(f"{method} on awkward inputs", columns, rows, "llrl", records=records)
    failed = sum(bool(trial.error) for trial in trials)
    odd = sum(bool(trial.warning) for trial in trials)
    text = "fit for a run" + (f", {counted(odd, 'warning')}" if odd else "")
    if failed:
        text = f"{failed} of {counted(len(trials), 'trial')} failed"
    show(format, [table], text, trials=len(trials), failed=failed, warnings=odd)
    if failed:
        raise Exit(NO)
