"""The verbs that score a method: run, tracks, score."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from typer import Exit, Option

import dfdbench
from dfdbench.blur.tracks import TRACKS
from dfdbench.cli import options
from dfdbench.cli.screen import GOES_ON, WITHOUT_FRESH, command, progress, say, show
from dfdbench.errors import InputError, refuse_both
from dfdbench.statuses import NO
from dfdbench.tables.table import Format, counted

if TYPE_CHECKING:
    from dfdbench.results.record import Result


def run(
    method: options.Method,
    dataset: options.DataSet = "middlebury",
    split: options.Split = "test",
    protocol: options.Protocol = None,
    param: options.Params = None,
    images: Annotated[
        str | None, Option(metavar="I,J", help="Of stacks: the pair's images, from 0.")
    ] = None,
    fitted: options.Fitted = None,
    out: options.Out = None,
    limit: Annotated[
        int | None, Option(min=1, help="Run only this many pairs, from the first.")
    ] = None,
    format: options.Printed = Format.table,
    tables: options.EveryTable = False,
    no_predictions: Annotated[
        bool, Option("--no-predictions", help="Save no depth maps and no figures.")
    ] = False,
    no_figures: Annotated[
        bool, Option("--no-figures", help="Draw no figures; `report` can later.")
    ] = False,
    fresh: options.Fresh = False,
    seed: options.Seed = 0,
    workers: Annotated[
        int | None,
        Option(
            min=1, max=1024, help="How many pairs to run at once; times are then not comparable."
        ),
    ] = None,
    scheduler: options.Scheduler = None,
    cache: options.Cache = None,
    figure_format: options.FigureFormats = None,
    submit: options.Submit = False,
) -> None:
    """Run a method on a data set and print its tables; a stopped run is resumed."""
    bare = {"--no-predictions": no_predictions, "--no-figures": no_figures}
    refuse_both(bare, {"--figure-format": figure_format})
    data = dfdbench.open_dataset(dataset, cache=cache)
    param = [*(param or ()), *([f"images={images}"] if images else ())]
    with progress(f"running {method}", WITHOUT_FRESH if fresh else GOES_ON) as step:
        done = dfdbench.run(
            method,
            data,
            split,
            parameters=options.values_of(param, "--param"),
            protocol=protocol,
            limit=limit,
            seed=seed,
            out=out or Path("results", f"{data.path.stem}-{split}", folder_name(method, param)),
            keep_predictions=not no_predictions,
            fresh=fresh,
            fitted=fitted,
            pool=options.pool_of_processes(workers, scheduler),
            for_board=submit,
            on_pair=step,
        )
    then = ""
    if limit is not None and not done.result.complete and not done.failed:
        given: dict[str, object] = {"dataset": dataset, "split": split, "method": method}
        given |= {"param": param, "protocol": protocol, "fitted": fitted, "seed": seed or None}
        given |= {"out": out, "workers": workers, "scheduler": scheduler, "cache": cache}
        then = command("run", *["--no-predictions"] * no_predictions, **given)
    _show(done, format, None if any(bare.values()) else figure_format or (), submit, tables, then)


def tracks(
    method: options.Method,
    param: options.Params = None,
    dataset: Annotated[
        str, Option(help="The name of a set with synthetic blur.", autocompletion=options.data_sets)
    ] = "demo",
    split: options.Split = "test",
    track: Annotated[
        list[str] | None, Option(help=f"Only this track; repeatable: {', '.join(TRACKS)}.")
    ] = None,
    protocol: Annotated[str, Option(help="Scoring protocol of the table.")] = "valid",
    source: Annotated[
        Path | None, Option(help="Folder of the set's files, to build what is not built.")
    ] = None,
    out: options.Out = None,
    format: options.Printed = Format.table,
    given_blur: Annotated[
        bool, Option("--given-blur", help="Give it each track's blur; then it has no rank.")
    ] = False,
    fresh: options.Fresh = False,
    seed: options.Seed = 0,
    cache: options.Cache = None,
    figure_format: options.FigureFormats = None,
    submit: options.Submit = False,
) -> None:
    """Run a method over all tracks and severities; a stopped call is resumed."""
    # Imported here because it loads pandas, which other verbs of this module may not need.
    from dfdbench.evaluation.evaluate import without_track

    stem = without_track(dataset, cache).file_stem
    name = folder_name(method, param) + "-given-blur" * given_blur
    done = dfdbench.run_tracks(
        method,
        dataset,
        split,
        parameters=options.values_of(param, "--param"),
        tracks=track or None,
        given_blur=given_blur,
        protocol=protocol,
        source=source,
        fresh=fresh,
        seed=seed,
        out=out or Path("results", f"{stem}-tracks-{split}", name),
        for_board=submit,
        cache=cache,
        on_result=lambda label, result: _say_score(label, result, protocol),
        shown=lambda what: progress(what, WITHOUT_FRESH if fresh else GOES_ON),
    )
    _show(done, format, figure_format or (), submit)


def transfer(
    method: options.Method,
    dataset: Annotated[
        list[str], Option(help="A data set that is built; name two or more, each by its own.")
    ],
    param: options.Params = None,
    split: options.Split = "test",
    protocol: Annotated[str, Option(help="Scoring protocol of the table.")] = "valid",
    out: options.Out = None,
    format: options.Printed = Format.table,
    seed: options.Seed = 0,
    cache: options.Cache = None,
    figure_format: options.FigureFormats = None,
) -> None:
    """Fit a method on each of several data sets and test every fit on all of them."""
    done = dfdbench.run_transfer(
        method,
        dataset,
        split,
        parameters=options.values_of(param, "--param"),
        protocol=protocol,
        seed=seed,
        out=out or Path("results", f"transfer-{split}", folder_name(method, param)),
        cache=cache,
        on_result=lambda label, result: _say_score(label, result, protocol),
        shown=progress,
    )
    done.draw(("png", *(figure_format or ())))
    show(format, [done.as_table()], folder=done.folder)
    say(f"results      {done.folder}")


def tune(
    method: options.Method,
    dataset: options.DataSet,
    range: Annotated[
        list[str] | None,
        Option(metavar="NAME=A,B,C", help="Values to try; repeatable. Default: the method's own."),
    ] = None,
    param: options.Params = None,
    protocol: options.Protocol = None,
    limit: Annotated[
        int | None,
        Option(min=1, help="Score at most so many captures, drawn at random with the seed."),
    ] = None,
    format: options.Printed = Format.table,
    seed: options.Seed = 0,
    cache: options.Cache = None,
) -> None:
    """Try parameters on the training captures, by cross-validation over their groups."""
    from dfdbench.evaluation.evaluate import best_settings, tried_table  # imports zarr

    given = options.values_of(range, "--range")
    if len(given) < len(range or ()):
        fix = "name all values together: --range NAME=A,B,C"
        raise InputError("a parameter is named twice", where="--range", fix=fix)
    ranges = {name: options.several(values, f"--range {name}") for name, values in given.items()}
    with progress(f"tuning {method}", "the same command begins anew") as step:
        found = dfdbench.tune(
            method,
            dataset,
            ranges or None,
            parameters=options.values_of(param, "--param"),
            protocol=protocol,
            limit=limit,
            seed=seed,
            cache=cache,
            on_pair=step,
        )
    others = [each for each in param or () if each.partition("=")[0] not in found.index.names]
    again = {"param": [*others, *best_settings(found)], "seed": seed or None, "cache": cache}
    then = command("run", dataset=dataset, method=method, **again)
    show(format, [tried_table(found, f"{method} on training captures of {dataset}")], next=then)
    say(f"next         {then}")


def score(
    predictions: Annotated[
        Path,
        Option(
            metavar="DIR",
            help="Folder of depth maps, npy, npz, PNG or TIFF: one file per pair, named as "
            "`dfdbench info NAME --pairs SPLIT` lists them.",
        ),
    ],
    dataset: options.DataSet,
    split: options.Split = "test",
    unit: Annotated[
        Literal["levels", "metres"],
        Option(
            help="What arrays and TIFF files of floats hold. 8-bit images hold levels; 16-bit "
            "images levels times 256 or, with metres, millimetres."
        ),
    ] = "levels",
    method: Annotated[
        str | None, Option(help="The method's name in tables; default: the folder's name.")
    ] = None,
    protocol: options.Protocol = None,
    out: options.Out = None,
    format: options.Printed = Format.table,
    tables: options.EveryTable = False,
    cache: options.Cache = None,
    figure_format: options.FigureFormats = None,
    submit: options.Submit = False,
) -> None:
    """Score depth maps that were made elsewhere, one file per pair; nothing is run."""
    data = dfdbench.open_dataset(dataset, cache=cache)
    name = method or os.path.basename(os.path.realpath(predictions))
    place = Path("results", f"{data.path.stem}-{split}", f"{folder_name(name, None)}-scored")
    with progress(f"scoring {name}", "the same command scores all of them anew") as step:
        done = dfdbench.score(
            predictions,
            data,
            split,
            unit=unit,
            method=name,
            protocol=protocol,
            out=out or place,
            for_board=submit,
            on_pair=step,
        )
    _show(done, format, figure_format or (), submit, tables)


def folder_name(method: str, param: list[str] | None) -> str:
    """Return what the folder of a method's run is called."""
    place, _, attribute = method.rpartition(":")
    attribute = Path(attribute).name if attribute.endswith(".onnx") else attribute
    parts = [Path(place).stem if place.endswith(".py") else place, attribute, *(param or [])]
    name = "-".join(part for part in parts if part)
    return "".join(c if c.isalnum() or c in "-_.=" else "_" for c in name)


def _show(
    done: dfdbench.Run,
    format: Format,
    also: Sequence[str] | None,
    submit: bool,
    every: bool = False,
    then: str = "",
) -> None:
    """Draw and print a run, put it on the board, say what it comes to; status 1 if pairs failed.

    `also` names forms of its figures beside PNG; None for no figures. `every` prints all tables,
    `then` is the command that goes on from a part of the pairs.
    """
    from dfdbench.report.verdict import verdict_text  # imports xarray

    for note in done.notes:
        say(note)
    if also is not None:
        done.draw(("png", *also))
    tables = done.tables() if every else done.tables()[:1]
    facts: dict[str, Any] = {"folder": done.folder, "failed": done.failed}
    if format is not Format.json:
        show(format, tables)
    if done.failed:
        again = "it" if done.failed == 1 else "them"
        say(f"{counted(done.failed, 'pair')} failed; the same command tries {again} again")
    if submit:
        facts["submission"] = done.submit()
        say(f"submission   {facts['submission']}")
        if not all(result.complete for result in done.results.values()):
            say("not every pair was evaluated: the leaderboard lists this run without a rank")
    if len(done.results) == 1:
        facts["verdict"] = done.verdict_facts()
        method = done.result.method
        own = method.entry.startswith("dfdbench.")
        if done.failed and not done.result.evaluated and not method.scored and not own:
            then = command("check-method", method.entry)
        facts["next"] = then or command("report", done.folder)
        say(verdict_text(facts["verdict"]))
        say(f"next         {facts['next']}")
    else:
        say(f"results      {done.folder}")
    if format is Format.json:
        show(format, tables, **facts)
    if done.failed and not done.result.method.scored:
        raise Exit(NO)


def _say_score(label: str, result: Result, protocol: str) -> None:
    from dfdbench.metrics.protocol import metrics_of, ranked_by
    from dfdbench.results.wording import score_text

    metric = ranked_by(protocol)[0]
    score = score_text(result.mean(protocol, metric))
    say(f"{label:<12} {metrics_of(protocol)[metric].title} {score}")
