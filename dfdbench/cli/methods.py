"""The verbs for methods: run, check-method."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dfdbench.blur.recipe import RECIPES
from dfdbench.cli.options import Cache, Scheduler, pool_of_processes, values_of
from dfdbench.cli.screen import print_table, progress, say
from dfdbench.errors import InputError
from dfdbench.tables.table import Format, Table

if TYPE_CHECKING:
    from dfdbench.datasets.manifest import Manifest
    from dfdbench.datasets.store import Store
    from dfdbench.evaluation.run import Run
    from dfdbench.methods.method import Method
    from dfdbench.results.record import Result
    from dfdbench.results.summary import RunSummary

Params = Annotated[
    list[str] | None, typer.Option("--param", help="NAME=VALUE for the method; repeatable.")
]


def run(
    method: Annotated[
        str, typer.Option(help="A registered name, module:attribute or file.py:attribute.")
    ],
    dataset: Annotated[
        str, typer.Option(help="A data set's name or a store's path.")
    ] = "middlebury",
    split: Annotated[str, typer.Option(help="A split, a fold, a scene, or all.")] = "test",
    protocol: Annotated[
        str | None,
        typer.Option(
            help="Under which the table is shown; default: thesis, of own captures valid."
        ),
    ] = None,
    param: Params = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder; default: results/DATASET-SPLIT/METHOD.")
    ] = None,
    limit: Annotated[int | None, typer.Option(min=1, help="Only the first N pairs.")] = None,
    format: Annotated[Format, typer.Option(help="How the tables are printed.")] = Format.table,
    no_predictions: Annotated[
        bool, typer.Option("--no-predictions", help="Keep no depth maps, draw no figures.")
    ] = False,
    fresh: Annotated[
        bool, typer.Option("--fresh", help="Evaluate anew, set an earlier run aside.")
    ] = False,
    seed: Annotated[
        int, typer.Option(min=0, max=2**32 - 1, help="For methods that draw random numbers.")
    ] = 0,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Pairs at once; their times are not comparable.")
    ] = None,
    scheduler: Scheduler = None,
    cache: Cache = None,
    submit: Annotated[
        bool, typer.Option("--submit", help="Write it into leaderboard/, for a pull request.")
    ] = False,
) -> None:
    """Run a method on a data set and print its tables; a stopped run goes on."""
    from dfdbench.audit.trained_on import coverage_warnings
    from dfdbench.datasets.store import open_store
    from dfdbench.evaluation.fitting import training_scenes
    from dfdbench.evaluation.loading import load_for
    from dfdbench.evaluation.plan import RunOptions
    from dfdbench.evaluation.run import run_method
    from dfdbench.figures.runs import draw_run
    from dfdbench.metrics.protocol import find_protocol
    from dfdbench.results.summary import summarise

    asked = find_protocol(protocol).label if protocol else None
    if submit:
        refuse_what_cannot_be_submitted(limit)
    data = open_store(dataset, cache=cache)
    data.manifest.scenes_of(split)
    shown = protocol_of_tables(asked, data)
    loaded = load_for(data, method, values_of(param, "--param"), seed)
    if submit:
        refuse_what_was_trained_on(loaded, data.manifest, split)
    folder = out or Path("results") / f"{data.path.stem}-{split}" / folder_name(method, param)
    options = RunOptions(limit, not no_predictions, fresh, seed)
    pool = pool_of_processes(workers, scheduler)
    saw = [loaded.trained_on]
    if loaded.fit is not None:
        saw.append(training_scenes(data.manifest, split)[0])
    warnings = [
        text for name in dict.fromkeys(saw) for text in coverage_warnings(name, data, split)
    ]
    with progress(f"running {method}") as step:
        done = run_method(data, loaded, split, folder, options, pool, warnings, step)
    _tell_what_was_reused(done)
    summary = summarise(done.result, shown)
    if not no_predictions:
        draw_run(data, summary, folder)
    _keep_law(loaded.predict, folder, figure=not no_predictions)
    print_run_tables(summary, data.manifest, format)
    tell_where_it_lies(done, figures=not no_predictions)
    if submit:
        submit_run(done.result)
    if any(pair.status == "failed" for pair in done.result.pairs):
        raise typer.Exit(1)


def protocol_of_tables(asked: str | None, data: Store) -> str:
    """Return the protocol that was asked for, or the data set's own first one."""
    from dfdbench.results.first_table import first_protocol

    known = data.manifest
    shown = asked or first_protocol(known.short, data.recipe_name, known.degradation)
    require_shown(shown, known)
    return shown


def require_shown(protocol: str, manifest: Manifest) -> None:
    """Refuse a protocol that a data set's runs are not scored under, before hours are spent."""
    from dfdbench.metrics.of_protocol import protocols_of
    from dfdbench.metrics.protocol import require_scored

    there = protocols_of(manifest.depth.scale is not None)
    require_scored(protocol, there, f"runs on {manifest.stem}")


def _keep_law(predict: Any, folder: Path, figure: bool) -> None:
    calibration = getattr(predict, "calibration", None)
    if calibration is None:
        return
    from dfdbench.figures.calibration import law_figure
    from dfdbench.figures.style import write_figure
    from dfdbench.methods.calibration import Calibration
    from dfdbench.system.files import write_whole

    # Another's method may have something else of that name.
    if isinstance(calibration, Calibration):
        write_whole(folder / "law.toml", calibration.law.as_toml())
        if figure:
            write_figure(law_figure(calibration), folder / "figures" / "law.png")


def _tell_what_was_reused(done: Run) -> None:
    if done.set_aside:
        say(f"an earlier run with other settings was moved to {done.set_aside}")
    if done.reused:
        say(f"{done.reused} pairs taken over from an earlier call (--fresh evaluates anew)")


def print_run_tables(summary: RunSummary, manifest: Manifest, format: Format) -> None:
    """Print a run's tables in a format."""
    from dfdbench.results.run_data import run_as_csv, run_as_json
    from dfdbench.results.scene_tables import all_tables
    from dfdbench.results.summary import scene_labels
    from dfdbench.tables.render import render

    if format is Format.csv:
        print(run_as_csv(summary, scene_labels(manifest.scenes)), end="")
        return
    if format is Format.json:
        print(run_as_json(summary, scene_labels(manifest.scenes)), end="")
        return
    tables = all_tables(summary, manifest.scenes, manifest.splits)
    if format is Format.table:
        for table in tables:
            print_table(table)
    else:
        print(render(tables, format), end="")


def tell_where_it_lies(done: Run, figures: bool) -> None:
    """Say where a run's files lie, and what failed."""
    from dfdbench.results.record_file import RESULT

    method = done.result.method
    if method.fitted_on:
        say(f"fitted       on {method.fitted_on}, in {method.fit_seconds:.1f} s")
    say(f"result       {done.folder / RESULT}")
    if figures:
        say(f"figures      {done.folder / 'figures'}")
    failed = sum(pair.status == "failed" for pair in done.result.pairs)
    if failed:
        say(f"{failed} pairs failed; the same command tries them again")


def check_method_command(
    method: Annotated[str, typer.Argument(help="As for run --method.")], param: Params = None
) -> None:
    """Try a method on awkward inputs and say what is wrong, before an hour is spent."""
    from dfdbench.datasets.depth_scale import Rig
    from dfdbench.methods.check import check_method
    from dfdbench.methods.registry import load_method

    offers: dict[str, Callable[[], Any]] = {
        "recipe": lambda: RECIPES["published"],
        "recipe_name": lambda: "published",
        "training_mean": lambda: 128.0,
        "seed": lambda: 0,
        "rig": Rig,
    }
    # A class with a fit has to find out the blur, so that the fit is tried too.
    for_fits = {"recipe": lambda: None}
    trials = check_method(load_method(method, values_of(param, "--param"), offers, for_fits))
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
    print_table(Table(f"{method} on awkward inputs", columns, rows, "llrl"))
    failed = sum(bool(trial.error) for trial in trials)
    print(f"{failed} of {len(trials)} trials failed" if failed else "fit for a run")
    if failed:
        raise typer.Exit(1)


def refuse_what_cannot_be_submitted(limit: int | None) -> None:
    """Refuse a run that the leaderboard would refuse, and a place without a leaderboard."""
    from dfdbench.leaderboard.folder import LEADERBOARD, require_leaderboard

    # Before the run: it may take hours.
    if limit:
        raise InputError(
            "a limited run cannot be submitted",
            where=f"--limit {limit} --submit",
            expected="every pair of the split",
            fix="leave out --limit; pairs that were run already are taken over",
        )
    require_leaderboard(LEADERBOARD)


def refuse_what_was_trained_on(method: Method, manifest: Manifest, split: str) -> None:
    """Refuse a method whose weights were trained on scenes of the test."""
    from dfdbench.leaderboard.training_problems import training_problems

    trained_on, weights = method.trained_on, method.weights_sha256
    problems = training_problems(trained_on, weights, manifest.stem, split, f"--split {split}")
    if problems:
        raise InputError.of(problems)


def submit_run(result: Result) -> None:
    """Write a run into the leaderboard of the clone that this is called in."""
    from dfdbench.leaderboard.folder import LEADERBOARD
    from dfdbench.leaderboard.submission import submit

    for path in submit(result, LEADERBOARD):
        say(f"submission   {path}")
    if not result.complete:
        say("not every pair was evaluated: the leaderboard lists this run without a rank")


def folder_name(method: str, param: list[str] | None) -> str:
    """Return what the folder of a method's run is called."""
    place, _, attribute = method.rpartition(":")
    parts = [Path(place).stem if place.endswith(".py") else place, attribute, *(param or [])]
    name = "-".join(part for part in parts if part)
    return "".join(c if c.isalnum() or c in "-_.=" else "_" for c in name)
