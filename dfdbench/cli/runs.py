"""The verbs that score a method: run, tracks, score."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from dfdbench.blur.tracks import TRACKS
from dfdbench.cli.options import (
    Cache,
    FigureFormats,
    Replace,
    Scheduler,
    Submit,
    data_sets,
    methods,
    pool_of_processes,
    values_of,
)
from dfdbench.cli.screen import print_table, progress, save_figure, say
from dfdbench.errors import InputError
from dfdbench.metrics.protocol import metrics_of, ranked_by
from dfdbench.results.output_place import output_place
from dfdbench.results.wording import score_text
from dfdbench.tables.table import Format
from dfdbench.tables.wording import counted, listed

if TYPE_CHECKING:
    from dfdbench.datasets.dataset import Dataset
    from dfdbench.datasets.manifest import Manifest
    from dfdbench.evaluation.run import Run
    from dfdbench.methods.method import Method
    from dfdbench.results.record import Result
    from dfdbench.results.summary import RunSummary


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


def tracks(
    method: Annotated[
        str,
        typer.Option(
            help="A registered name, file.py:function or module:function.", autocompletion=methods
        ),
    ],
    param: Params = None,
    dataset: Annotated[
        str,
        typer.Option(
            help="A synthetic data set's name, without a track.", autocompletion=data_sets
        ),
    ] = "demo",
    split: Annotated[str, typer.Option(help="A split, a fold or a scene.")] = "test",
    track: Annotated[
        list[str] | None, typer.Option(help=f"Only this track; repeatable: {', '.join(TRACKS)}.")
    ] = None,
    protocol: Annotated[str, typer.Option(help="Scoring protocol of the table.")] = "valid",
    source: Annotated[
        Path | None, typer.Option(help="Folder of the set's files, to build what is not built.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder; default: results/DATASET-tracks-SPLIT/METHOD.")
    ] = None,
    format: Annotated[Format, typer.Option(help="How the table is printed.")] = Format.table,
    told: Annotated[
        bool,
        typer.Option("--told", help="Give the method each track's blur; such a row has no rank."),
    ] = False,
    seed: Annotated[
        int, typer.Option(min=0, max=2**32 - 1, help="Seed for methods that use random numbers.")
    ] = 0,
    cache: Cache = None,
    figure_format: FigureFormats = None,
    submit: Submit = False,
    replace: Replace = False,
) -> None:
    """Run a method over all tracks and severities; a stopped call is resumed."""
    from dfdbench.evaluation.tracks import run_over_tracks, without_track
    from dfdbench.metrics.protocol import find_protocol

    shown = find_protocol(protocol).label
    plain = without_track(dataset)
    require_shown(shown, plain)
    name = folder_name(method, param) + ("-told" if told else "")
    if submit:
        refuse_what_cannot_be_submitted(None)
    default = Path("results") / f"{plain.file_stem}-tracks-{split}" / name
    place = output_place(out or default, source)

    def check(loaded: Method, store: Dataset) -> None:
        if submit:
            refuse_unfit_to_submit(loaded, store, split)

    runs = run_over_tracks(
        method,
        dataset,
        place,
        split,
        parameters=values_of(param, "--param"),
        tracks=track,
        given_blur=told,
        source=source,
        seed=seed,
        cache=cache,
        check=check,
        on_result=lambda label, result: _tell_score(label, result, shown),
        shown=progress,
    )
    results = {label: run.result for label, run in runs.items()}
    _show(results, shown, format, method, place, ("png", *(figure_format or ())))
    say(f"results      {place}")
    if submit:
        submit_runs(list(results.values()), replace)
    if any(pair.status == "failed" for result in results.values() for pair in result.pairs):
        raise typer.Exit(1)


def _show(
    results: dict[str, Result],
    protocol: str,
    format: Format,
    method: str,
    folder: Path,
    forms: Sequence[str],
) -> None:
    from dfdbench.figures.comparisons import tracks_figure
    from dfdbench.results.frame import scores_of
    from dfdbench.results.track_tables import track_means, tracks_table
    from dfdbench.tables.render import render

    table = tracks_table(list(results.values()), protocol)
    print_table(table) if format is Format.table else print(render([table], format), end="")
    metric = ranked_by(protocol)[0]
    means = track_means(scores_of(list(results.values())), protocol, metric)
    figure = tracks_figure({method: means}, metric, table.title)
    for form in forms:
        save_figure(figure, folder / f"tracks.{form}")


def _tell_score(label: str, result: Result, protocol: str) -> None:
    metric = ranked_by(protocol)[0]
    score = (result.averages or {}).get(protocol, {}).get(metric)
    say(f"{label:<12} {metrics_of(protocol)[metric].title} {score_text(score)}")


def score(
    predictions: Annotated[
        Path,
        typer.Option(
            metavar="DIR",
            help="Folder of depth maps, npy, npz, PNG or TIFF: one file per pair, named as "
            "`dfdbench info NAME --pairs SPLIT` lists them.",
        ),
    ],
    dataset: Annotated[
        str, typer.Option(help="A data set's name or a store's path.", autocompletion=data_sets)
    ],
    split: Annotated[str, typer.Option(help="A split, a fold, a scene, or all.")] = "test",
    unit: Annotated[
        Literal["levels", "metres"],
        typer.Option(
            help="What arrays and TIFF files of floats hold. 8-bit images hold levels; 16-bit "
            "images levels times 256 or, with metres, millimetres."
        ),
    ] = "levels",
    method: Annotated[
        str | None, typer.Option(help="The method's name in tables; default: the folder's name.")
    ] = None,
    protocol: Annotated[
        str | None,
        typer.Option(
            help="Scoring protocol of the printed table; default: the data set's usual one."
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder; default: results/DATASET-SPLIT/METHOD-scored.")
    ] = None,
    format: Annotated[Format, typer.Option(help="How the tables are printed.")] = Format.table,
    cache: Cache = None,
    figure_format: FigureFormats = None,
    submit: Submit = False,
    replace: Replace = False,
) -> None:
    """Score depth maps that were made elsewhere, one file per pair; nothing is run."""
    from dfdbench.board.board import LEADERBOARD, require_leaderboard
    from dfdbench.datasets.dataset import open_dataset
    from dfdbench.datasets.integrity import require_sound
    from dfdbench.evaluation.scored import score_predictions
    from dfdbench.figures.runs import draw_run
    from dfdbench.metrics.protocol import find_protocol
    from dfdbench.results.summary import summarise

    asked = find_protocol(protocol).label if protocol else None
    if submit:
        require_leaderboard(LEADERBOARD)
    data = open_dataset(dataset, cache=cache)
    data.manifest.scenes_of(split)
    if submit:
        require_sound(data)
    shown = protocol_of_tables(asked, data)
    name = method or os.path.basename(os.path.realpath(predictions))
    default = Path("results") / f"{data.path.stem}-{split}" / f"{folder_name(name, None)}-scored"
    folder = output_place(out or default, predictions, str(data.path), replaces=True)
    with progress(f"scoring {name}", "the same command scores all of them anew") as step:
        done = score_predictions(predictions, data, split, folder, name, unit, step)
    if done.set_aside:
        say(f"what lay there was moved to {done.set_aside}")
    summary = summarise(done.result, shown)
    draw_run(data, summary, folder, also=figure_format or ())
    print_run_tables(summary, data.manifest, format)
    tell_where_it_lies(done, figures=True)
    if submit:
        submit_runs([done.result], replace)
    tell_overall(summary)


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


def tell_what_was_reused(done: Run) -> None:
    """Say what of an earlier call was kept, and where one of other settings lies."""
    if done.because:
        say(f"started over: {listed(done.because, most=5)}")
    if done.set_aside:
        say(f"the earlier run was moved to {done.set_aside}")
    if done.reused:
        pairs = counted(done.reused, "pair")
        say(f"{pairs} taken over from an earlier call (--fresh evaluates anew)")


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
        again = "it" if failed == 1 else "them"
        say(f"{counted(failed, 'pair')} failed; the same command tries {again} again")


def tell_overall(summary: RunSummary) -> None:
    """Say last what one wants first: a run's scores over all pairs, or that it has none."""
    from dfdbench.metrics.metric import find_metric
    from dfdbench.results.wording import score_text

    data = summary.result.dataset
    under = f"protocol {summary.protocol}, split {data.split}"
    averages = (summary.result.averages or {}).get(summary.protocol)
    if averages is None:
        done = f"{data.evaluated} of {counted(data.expected, 'pair')}"
        missing = sum(pair.status == "missing" for pair in summary.result.pairs)
        why = f"; {counted(missing, 'pair')} not in the store" if missing else ""
        say(f"overall      no score: {done} were evaluated{why}  ({under})")
        return
    scores = "  ".join(f"{find_metric(n).title} {score_text(v)}" for n, v in averages.items())
    say(f"overall      {scores}  ({under}, {counted(data.expected, 'pair')})")
