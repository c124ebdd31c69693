"""The verb that runs a method: run."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dfdbench.cli.completion import data_sets, methods
from dfdbench.cli.options import (
    Cache,
    FigureFormats,
    Replace,
    Scheduler,
    Submit,
    pool_of_processes,
    values_of,
)
from dfdbench.cli.run_answer import (
    print_run_tables,
    tell_overall,
    tell_what_was_reused,
    tell_where_it_lies,
)
from dfdbench.cli.screen import progress, say
from dfdbench.errors import InputError
from dfdbench.results.output_place import output_place
from dfdbench.tables.table import Format

if TYPE_CHECKING:
    from dfdbench.datasets.dataset import Dataset
    from dfdbench.datasets.manifest import Manifest
    from dfdbench.methods.method import Method
    from dfdbench.results.record import Result

Params = Annotated[
    list[str] | None,
    typer.Option("--param", help="A parameter of the method, NAME=VALUE; repeatable."),
]


def run(
    method: Annotated[
        str,
        typer.Option(
            help="A registered name, file.py:function or module:function.", autocompletion=methods
        ),
    ],
    dataset: Annotated[
        str, typer.Option(help="A data set's name or a store's path.", autocompletion=data_sets)
    ] = "middlebury",
    split: Annotated[
        str, typer.Option(help="Which pairs: a split, a fold, a scene, or all.")
    ] = "test",
    protocol: Annotated[
        str | None,
        typer.Option(
            help="Scoring protocol of the printed table; default: the data set's usual one."
        ),
    ] = None,
    param: Params = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder to write into; default: results/DATASET-SPLIT/METHOD."),
    ] = None,
    limit: Annotated[
        int | None, typer.Option(min=1, help="Run only this many pairs, from the first.")
    ] = None,
    format: Annotated[Format, typer.Option(help="How the tables are printed.")] = Format.table,
    no_predictions: Annotated[
        bool, typer.Option("--no-predictions", help="Save no depth maps and no figures.")
    ] = False,
    no_figures: Annotated[
        bool,
        typer.Option(
            "--no-figures", help="Draw no figures; `dfdbench report` can draw them later."
        ),
    ] = False,
    fresh: Annotated[
        bool, typer.Option("--fresh", help="Start over; an earlier run is kept as `.previous`.")
    ] = False,
    seed: Annotated[
        int, typer.Option(min=0, max=2**32 - 1, help="Seed for methods that use random numbers.")
    ] = 0,
    workers: Annotated[
        int | None,
        typer.Option(
            min=1, max=1024, help="Run so many pairs at once; times are then not comparable."
        ),
    ] = None,
    scheduler: Scheduler = None,
    cache: Cache = None,
    figure_format: FigureFormats = None,
    submit: Submit = False,
    replace: Replace = False,
) -> None:
    """Run a method on a data set and print its tables; a stopped run is resumed."""
    from dfdbench.datasets.dataset import open_dataset
    from dfdbench.evaluation.loading import depth_warnings, load_for
    from dfdbench.evaluation.plan import RunOptions
    from dfdbench.evaluation.run import run_method
    from dfdbench.figures.runs import draw_run
    from dfdbench.metrics.protocol import find_protocol
    from dfdbench.results.summary import summarise

    asked = find_protocol(protocol).label if protocol else None
    forms = _forms_of(figure_format, no_predictions, no_figures)
    if submit:
        refuse_what_cannot_be_submitted(limit)
    data = open_dataset(dataset, cache=cache)
    data.manifest.scenes_of(split)
    shown = protocol_of_tables(asked, data)
    default = Path("results") / f"{data.path.stem}-{split}" / folder_name(method, param)
    folder = output_place(out or default, str(data.path), replaces=True)
    loaded = load_for(data, method, values_of(param, "--param"), seed)
    if submit:
        refuse_unfit_to_submit(loaded, data, split)
    options = RunOptions(limit, not no_predictions, fresh, seed)
    pool = pool_of_processes(workers, scheduler)
    warnings = depth_warnings(loaded, data, split)
    with progress(f"running {method}") as step:
        done = run_method(data, loaded, split, folder, options, pool, warnings, step)
    tell_what_was_reused(done)
    summary = summarise(done.result, shown)
    if forms:
        draw_run(data, summary, folder, also=forms)
    _keep_law(loaded.attribute("calibration"), folder, forms)
    print_run_tables(summary, data.manifest, format)
    tell_where_it_lies(done, figures=bool(forms))
    if submit:
        submit_runs([done.result], replace)
    tell_overall(summary)
    if any(pair.status == "failed" for pair in done.result.pairs):
        raise typer.Exit(1)


def protocol_of_tables(asked: str | None, data: Dataset) -> str:
    """Return the protocol that was asked for, or the data set's own first one."""
    from dfdbench.results.first_table import first_protocol

    known = data.manifest
    shown = asked or first_protocol(known.short)
    require_shown(shown, known)
    return shown


def require_shown(protocol: str, manifest: Manifest) -> None:
    """Refuse a protocol that a data set's runs are not scored under, before a long run."""
    from dfdbench.metrics.protocol import protocols_of, require_scored

    there = protocols_of(manifest.depth.scale is not None)
    require_scored(protocol, there, f"runs on {manifest.stem}")


def _forms_of(
    asked: Sequence[str] | None, no_predictions: bool, no_figures: bool
) -> tuple[str, ...]:
    if not no_predictions and not no_figures:
        return ("png", *(asked or ()))
    if asked:
        said = "--no-predictions" if no_predictions else "--no-figures"
        raise InputError(
            f"no figures are drawn with {said}",
            where="--figure-format",
            fix=f"leave out one of --figure-format and {said}",
        )
    return ()


def _keep_law(calibration: Any, folder: Path, forms: Sequence[str]) -> None:
    if calibration is None:
        return
    from dfdbench.figures.camera import law_figure
    from dfdbench.figures.style import write_forms
    from dfdbench.methods.calibration import Calibration
    from dfdbench.system.files import write_whole

    # Another's method may have something else of that name.
    if isinstance(calibration, Calibration):
        write_whole(folder / "law.toml", calibration.law.as_toml())
        if forms:
            write_forms(law_figure(calibration), folder / "figures", "law", forms)


def refuse_what_cannot_be_submitted(limit: int | None) -> None:
    """Refuse a run that the leaderboard would refuse, and a place without a leaderboard."""
    from dfdbench.board.board import LEADERBOARD, require_leaderboard

    # Before the run: it may take hours.
    if limit:
        raise InputError(
            "a limited run cannot be submitted",
            where=f"--limit {limit} --submit",
            expected="every pair of the split",
            fix="leave out --limit; pairs that were run already are taken over",
        )
    require_leaderboard(LEADERBOARD)


def refuse_unfit_to_submit(method: Method, store: Dataset, split: str) -> None:
    """Refuse a damaged store, and a method whose weights were trained on scenes of the test."""
    from dfdbench.board.row_file import training_problems
    from dfdbench.datasets.integrity import require_sound

    require_sound(store)
    trained_on, weights = method.trained_on, method.weights_sha256
    problems = training_problems(
        trained_on, weights, store.manifest.stem, split, f"--split {split}"
    )
    if problems:
        raise InputError.of(problems)


def submit_runs(results: Sequence[Result], replace: bool) -> None:
    """Write runs of a method into the leaderboard of the clone that this is called in."""
    from dfdbench.board.board import LEADERBOARD
    from dfdbench.board.submission import submit

    say(f"submission   {submit(results, LEADERBOARD, replace)}")
    if not all(result.complete for result in results):
        say("not every pair was evaluated: the leaderboard lists this run without a rank")


def folder_name(method: str, param: list[str] | None) -> str:
    """Return what the folder of a method's run is called."""
    place, _, attribute = method.rpartition(":")
    parts = [Path(place).stem if place.endswith(".py") else place, attribute, *(param or [])]
    name = "-".join(part for part in parts if part)
    return "".join(c if c.isalnum() or c in "-_.=" else "_" for c in name)
