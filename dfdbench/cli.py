"""The command line: parse, call one function, print."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.text import Text

from dfdbench import __version__
from dfdbench.blur import RECIPES
from dfdbench.build import BuildReport, build_store
from dfdbench.catalog import find_manifest, released_manifests
from dfdbench.check import check_method
from dfdbench.errors import DfdbenchError, InputError, Problem
from dfdbench.evaluate import RESULT, load_for, run_method
from dfdbench.figures import draw_run
from dfdbench.manifest import Manifest
from dfdbench.methods import load_method, registered_methods
from dfdbench.protocol import find_protocol
from dfdbench.report import run_as_csv, run_as_json, run_as_markdown, run_tables
from dfdbench.sources import open_source
from dfdbench.store import default_store, open_store
from dfdbench.tables import Table, as_rich

_INTERRUPTED = 130

app = typer.Typer(
    help="Build depth-from-defocus data sets, run methods on them, and compare.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


class Format(StrEnum):
    """How tables are printed."""

    table = "table"
    markdown = "markdown"
    json = "json"
    csv = "csv"


Params = Annotated[
    list[str] | None, typer.Option("--param", help="NAME=VALUE for the method; repeatable.")
]


@app.command("list")
def list_datasets() -> None:
    """List the data sets and the registered methods."""
    rows = tuple(
        (
            manifest.short, manifest.stem, str(manifest.scene_count), str(manifest.pair_count),
            "yes" if default_store(manifest).exists() else "no", manifest.title,
        )
        for manifest in released_manifests()
    )  # fmt: skip
    _print_table(
        Table("data sets", ("name", "manifest", "scenes", "pairs", "built", ""), rows, "llrrll")
    )
    methods = tuple(sorted(registered_methods().items()))
    _print_table(Table("methods", ("name", "entry"), methods, "ll"))


@app.command()
def info(
    name: Annotated[str, typer.Argument(help="A data set's name or a manifest's path.")],
    pairs: Annotated[
        str | None, typer.Option(help="List the pairs of this split, fold or scene, one a line.")
    ] = None,
) -> None:
    """Show what a data set consists of."""
    manifest = find_manifest(name)
    if pairs is not None:
        for pair in manifest.pairs(pairs):
            print(pair.id)
        return
    _show_manifest(manifest)


@app.command()
def build(
    name: Annotated[str, typer.Argument(help="A data set's name or a manifest's path.")],
    source: Annotated[
        Path | None, typer.Option(help="Folder with the files, in the site's layout.")
    ] = None,
    store: Annotated[Path | None, typer.Option(help="Where to build; default: the cache.")] = None,
    recipe: Annotated[str | None, typer.Option(help=f"Blur recipe: {', '.join(RECIPES)}.")] = None,
    workers: Annotated[int, typer.Option(min=1, help="Scenes made at once.")] = os.cpu_count() or 1,
    default_lighting: Annotated[
        bool,
        typer.Option("--default-lighting", help="Take SCENE/view1.png for Illum1/Exp2."),
    ] = False,
    allow_missing: Annotated[
        bool, typer.Option("--allow-missing", help="Succeed although pairs are missing.")
    ] = False,
) -> None:
    """Build a data set; what is finished already is kept."""
    manifest = find_manifest(name)
    place = store or default_store(manifest)
    if recipe not in (None, manifest.recipe) and store is None:
        raise InputError(
            Problem(
                "another blur recipe makes another data set", "--recipe", str(manifest.recipe),
                str(recipe), "name its place: --store PATH",
            )
        )  # fmt: skip
    files = open_source(manifest, source, default_lighting)
    with _progress("building scenes") as step:
        report = build_store(manifest, files, place, recipe, workers, step)
    kept = f", {len(report.scenes_kept)} kept from before" if report.scenes_kept else ""
    print(f"built {manifest.stem}: {report.pairs} pairs, {len(report.scenes_built)} scenes{kept}")
    print(f"store        {report.path}")
    print(f"fingerprint  {report.fingerprint}")
    if report.missing:
        _say(_missing_text(manifest, report, files.missing_help(report.missing)))
        if not allow_missing:
            raise typer.Exit(2)


@app.command()
def run(
    method: Annotated[
        str, typer.Option(help="A registered name, module:attribute or file.py:attribute.")
    ],
    dataset: Annotated[
        str, typer.Option(help="A data set's name or a store's path.")
    ] = "middlebury",
    split: Annotated[str, typer.Option(help="A split, a fold, a scene, or all.")] = "test",
    protocol: Annotated[str, typer.Option(help="Under which the table is shown.")] = "thesis",
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
    seed: Annotated[int, typer.Option(min=0, help="For methods that draw random numbers.")] = 0,
) -> None:
    """Run a method on a data set and print its tables; a stopped run goes on."""
    shown = find_protocol(protocol)
    data = open_store(dataset)
    data.manifest.scenes_of(split)
    loaded = load_for(data, method, _parameters(param), seed)
    folder = out or Path("results") / f"{data.path.stem}-{split}" / _folder_name(method, param)
    with _progress(f"running {method}") as step:
        done = run_method(data, loaded, split, folder, limit, not no_predictions, fresh, seed, step)
    if done.set_aside:
        _say(f"an earlier run with other settings was moved to {done.set_aside}")
    if done.reused:
        _say(f"{done.reused} pairs taken over from an earlier call (--fresh evaluates anew)")
    if not no_predictions:
        draw_run(data, done.result, folder, shown.name)
    if format is Format.table:
        for table in run_tables(done.result, shown.name):
            _print_table(table)
    else:
        write = {Format.markdown: run_as_markdown, Format.json: run_as_json, Format.csv: run_as_csv}
        print(write[format](done.result, shown.name), end="")
    _say(f"result       {folder / RESULT}")
    if not no_predictions:
        _say(f"figures      {folder / 'figures'}")
    failed = sum(pair.status == "failed" for pair in done.result.pairs)
    if failed:
        _say(f"{failed} pairs failed; the same command tries them again")
        raise typer.Exit(1)


@app.command("check-method")
def check_method_command(
    method: Annotated[str, typer.Argument(help="As for run --method.")],
    param: Params = None,
) -> None:
    """Try a method on awkward inputs and say what is wrong, before an hour is spent."""
    offers: dict[str, Callable[[], Any]] = {
        "recipe": lambda: RECIPES["published"],
        "training_mean": lambda: 128.0,
        "seed": lambda: 0,
    }
    trials = check_method(load_method(method, _parameters(param), offers))
    rows = tuple(
        (
            "FAIL" if trial.error else "odd" if trial.warning else "ok",
            trial.name, f"{trial.seconds:.3f} s", trial.error or trial.warning,
        )
        for trial in trials
    )  # fmt: skip
    columns = ("", "input", "time", "what is wrong")
    _print_table(Table(f"{method} on awkward inputs", columns, rows, "llrl"))
    failed = sum(bool(trial.error) for trial in trials)
    print(f"{failed} of {len(trials)} trials failed" if failed else "fit for a run")
    if failed:
        raise typer.Exit(1)


@app.callback(invoke_without_command=True)
def version_option(
    version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
) -> None:
    """Build depth-from-defocus data sets, run methods on them, and compare."""
    if version:
        print(f"dfdbench {__version__}")
        raise typer.Exit


def main() -> None:
    """Run the command line; a user's mistake ends with a message and status 2."""
    try:
        app()
    except DfdbenchError as error:
        _say(f"error: {error}")
        sys.exit(2)
    except BrokenPipeError:
        # The reader of a pipe (head, say) has enough: that is no mistake.
        sys.stderr.close()
        os._exit(0)


def _parameters(given: list[str] | None) -> dict[str, Any]:
    parameters: dict[str, Any] = {}
    problems = []
    for text in given or []:
        name, equals, value = text.partition("=")
        if not name or not equals:
            problems.append(Problem("not a parameter", "--param", "NAME=VALUE", text))
            continue
        try:
            parameters[name] = json.loads(value)
        except json.JSONDecodeError:
            parameters[name] = value
    if problems:
        raise InputError(problems)
    return parameters


def _folder_name(method: str, param: list[str] | None) -> str:
    place, _, attribute = method.rpartition(":")
    parts = [Path(place).stem if place.endswith(".py") else place, attribute, *(param or [])]
    name = "-".join(part for part in parts if part)
    return "".join(c if c.isalnum() or c in "-_.=" else "_" for c in name)


def _show_manifest(manifest: Manifest) -> None:
    lines = [
        f"{manifest.title}",
        f"  manifest   {manifest.stem}  sha256 {manifest.sha256}",
        f"  scenes     {manifest.scene_count}",
        f"  pairs      {manifest.pair_count}",
        f"  recipe     {manifest.recipe or 'none: both images are captured'}",
    ]
    lines += [
        f"  axis       {axis}: {', '.join(map(str, values))}"
        for axis, values in manifest.axes.items()
    ]
    lines += [
        f"  split      {split.name} ({split.partition}): {split.pairs} pairs of "
        f"{len(split.scenes)} scenes"
        + (f": {', '.join(split.scenes)}" if len(split.scenes) <= 8 else "")
        for split in manifest.splits
    ]
    lines += [f"  fold       {fold.name}: {', '.join(fold.test_scenes)}" for fold in manifest.folds]
    for exclusion in manifest.exclusions:
        where = "; ".join(f"{axis} {values}" for axis, values in exclusion.coordinates.items())
        lines.append(
            f"  left out   {exclusion.pairs} pairs of {', '.join(exclusion.scenes)}, {where}: "
            f"{exclusion.reason}"
        )
    for source in manifest.sources:
        lines.append(f"  source     {source.name}: {source.url}")
        lines.append(f"  licence    {source.licence}")
    citations = dict.fromkeys(cite for source in manifest.sources for cite in source.citations)
    lines += [f"  cite       {citation}" for citation in citations]
    place = default_store(manifest)
    lines.append(f"  store      {place} ({'built' if place.exists() else 'not built'})")
    print("\n".join(lines))


def _missing_text(manifest: Manifest, report: BuildReport, fix: str) -> str:
    by_scene: dict[str, list[str]] = {}
    for pair in report.missing:
        by_scene.setdefault(pair.scene, []).append(pair.id.partition("/")[2])
    whole = [s for s in by_scene if len(by_scene[s]) == len(manifest.pairs_of_scene(s))]
    lines = [
        f"missing: {len(report.missing)} of {manifest.pair_count} pairs, left out of the store"
    ]
    if whole:
        lines.append(f"  no image at all   {', '.join(whole)}")
    alike: dict[str, list[str]] = {}
    for scene, places in by_scene.items():
        if scene not in whole:
            alike.setdefault(", ".join(places), []).append(scene)
    for listed, scenes in alike.items():
        lines.append(f"  {', '.join(scenes)}: {listed.count(',') + 1} pairs each")
        lines.append(f"    {listed}")
    lines.append(f"  fix               {fix}")
    return "\n".join(lines)


def _say(text: str) -> None:
    print(text, file=sys.stderr)


def _print_table(table: Table) -> None:
    # Piped or captured there is no terminal to fit: lines are as long as they need be.
    console = Console() if sys.stdout.isatty() else Console(width=200)
    console.print(as_rich(table))


@contextmanager
def _progress(what: str) -> Iterator[Callable[[int, int], None]]:
    columns = (
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
        TextColumn("left"), TimeRemainingColumn(),
    )  # fmt: skip
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(Text(what).plain, total=None)

        def step(done: int, total: int) -> None:
            progress.update(task, completed=done, total=total)

        try:
            yield step
        except KeyboardInterrupt:
            progress.stop()
            _say("stopped; the same command goes on from here")
            raise typer.Exit(_INTERRUPTED) from None
