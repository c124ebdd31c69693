"""The verb that runs a method over tracks: tracks."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dfdbench.blur.tracks import CLEAN, TRACKS
from dfdbench.cli.building import source_of
from dfdbench.cli.completion import data_sets, methods
from dfdbench.cli.methods import (
    Isolate,
    Params,
    folder_name,
    hidden_from_isolated,
    refuse_unfit_to_submit,
    refuse_what_cannot_be_submitted,
    require_shown,
)
from dfdbench.cli.options import Cache, FigureFormats, values_of
from dfdbench.cli.screen import print_table, progress, save_figure, say
from dfdbench.datasets.catalog import find_manifest
from dfdbench.errors import InputError, StoreError, unknown_name
from dfdbench.metrics.of_protocol import metrics_of, ranked_by
from dfdbench.results.wording import score_text
from dfdbench.tables.table import Format

if TYPE_CHECKING:
    from dfdbench.datasets.manifest import Manifest
    from dfdbench.datasets.store import Store
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
        typer.Option(
            "--told", help="Tell the method each track's blur: an upper bound, not ranked."
        ),
    ] = False,
    seed: Annotated[
        int, typer.Option(min=0, max=2**32 - 1, help="Seed for methods that use random numbers.")
    ] = 0,
    isolate: Isolate = False,
    cache: Cache = None,
    figure_format: FigureFormats = None,
    submit: Annotated[
        bool,
        typer.Option("--submit", help="Write the result into leaderboard/, for a pull request."),
    ] = False,
) -> None:
    """Run a method over all tracks and severities; a stopped call is resumed."""
    from dfdbench.evaluation.loading import load_for
    from dfdbench.evaluation.plan import RunOptions
    from dfdbench.evaluation.run import run_method
    from dfdbench.methods.registry import find_entry
    from dfdbench.metrics.protocol import find_protocol

    shown = find_protocol(protocol).label
    plain = _without_track(dataset)
    plain.scenes_of(split)
    labels = _labels(track)
    name = folder_name(method, param) + ("-told" if told else "")
    if submit:
        refuse_what_cannot_be_submitted(None)
    place = out or Path("results") / f"{plain.file_stem}-tracks-{split}" / name
    given = values_of(param, "--param")
    apart_from = hidden_from_isolated(place, cache) if isolate else None
    # What cannot be run is told before the tracks are built or anything is run for long.
    find_entry(method)
    stores = {CLEAN: _built(plain, dataset, CLEAN, source, cache)}
    require_shown(shown, stores[CLEAN].manifest)
    load_for(stores[CLEAN], method, given, seed, told, apart_from)
    stores |= {label: _built(plain, dataset, label, source, cache) for label in labels}
    results = {}
    for label, store in stores.items():
        loaded = load_for(store, method, given, seed, told, apart_from)
        if submit:
            refuse_unfit_to_submit(loaded, store, split)
        options = RunOptions(keep_predictions=False, seed=seed)
        with progress(f"running {method} on {label}") as step:
            done = run_method(store, loaded, split, place / label, options, on_pair=step)
        results[label] = done.result
        _tell_score(label, done.result, shown)
    _show(results, shown, format, method, place, ("png", *(figure_format or ())))
    say(f"results      {place}")
    if submit:
        _submit(results)
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
    from dfdbench.results.track_tables import severities, tracks_table
    from dfdbench.tables.render import render

    table = tracks_table(results, protocol)
    print_table(table) if format is Format.table else print(render([table], format), end="")
    metric = ranked_by(protocol)[0]
    figure = tracks_figure({method: severities(results, protocol, metric)}, metric, table.title)
    for form in forms:
        save_figure(figure, folder / f"tracks.{form}")


def _submit(results: dict[str, Result]) -> None:
    from dfdbench.leaderboard.folder import LEADERBOARD
    from dfdbench.leaderboard.tracks_submission import submit_tracks

    say(f"submission   {submit_tracks(results, LEADERBOARD)}")


def _tell_score(label: str, result: Result, protocol: str) -> None:
    metric = ranked_by(protocol)[0]
    score = (result.averages or {}).get(protocol, {}).get(metric)
    say(f"{label:<12} {metrics_of(protocol)[metric].title} {score_text(score)}")


def _without_track(dataset: str) -> Manifest:
    manifest = find_manifest(dataset)
    if manifest.on_track:
        raise InputError(
            "this verb runs over the tracks of a data set",
            where="--dataset",
            expected=dataset.rpartition("@")[0],
            got=dataset,
            fix="leave out the track; --track NAME chooses among them",
        )
    if manifest.recipe is None:
        raise InputError(
            "no tracks: the defocus images are captured, and a track makes them",
            where="--dataset",
            expected="a data set with synthetic blur: `dfdbench list`",
            got=dataset,
        )
    return manifest


def _labels(chosen: list[str] | None) -> list[str]:
    for name in chosen or ():
        if name not in TRACKS:
            raise unknown_name("track", name, TRACKS)
    tracked = [TRACKS[name] for name in dict.fromkeys(chosen or TRACKS)]
    return [
        CLEAN,
        *(f"{track.name}-{n}" for track in tracked for n in range(1, len(track.severities) + 1)),
    ]


def _built(
    plain: Manifest, dataset: str, label: str, source: Path | None, cache: Path | None
) -> Store:
    from dfdbench.building.build import build_store
    from dfdbench.building.plan import plan_build
    from dfdbench.building.sources import is_made
    from dfdbench.datasets.store import open_store

    name = dataset if label == CLEAN else f"{dataset}@{label}"
    try:
        return open_store(name, cache=cache)
    except StoreError:
        if source is None and not is_made(plain):
            raise
    plan = plan_build(find_manifest(name), cache=cache)
    files = source_of(plan, source, [], False, cache)
    with progress(f"building {name}") as step:
        build_store(plan.manifest, files, plan.place, on_scene=step)
    return open_store(name, cache=cache)
