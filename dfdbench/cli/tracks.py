"""The verb that runs a method over tracks: tracks."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dfdbench.blur.tracks import TRACKS
from dfdbench.cli.completion import data_sets, methods
from dfdbench.cli.methods import (
    Params,
    folder_name,
    refuse_unfit_to_submit,
    refuse_what_cannot_be_submitted,
    require_shown,
    submit_runs,
)
from dfdbench.cli.options import Cache, FigureFormats, Replace, Submit, values_of
from dfdbench.cli.screen import print_table, progress, save_figure, say
from dfdbench.metrics.protocol import metrics_of, ranked_by
from dfdbench.results.output_place import output_place
from dfdbench.results.wording import score_text
from dfdbench.tables.table import Format

if TYPE_CHECKING:
    from dfdbench.datasets.dataset import Dataset
    from dfdbench.methods.method import Method
    from dfdbench.results.record import Result


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
