"""The verbs that make data sets and write them elsewhere: build, new-dataset, export."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Exit, Option

from dfdbench.blur.recipe import RECIPES
from dfdbench.cli import options
from dfdbench.cli.screen import command, progress, say, show
from dfdbench.errors import InputError
from dfdbench.results.output_place import output_place
from dfdbench.statuses import MISTAKE
from dfdbench.system.files import write_whole
from dfdbench.tables.table import counted, grouped, listed

if TYPE_CHECKING:
    from dfdbench.building.build import BuildReport
    from dfdbench.building.sources.middlebury import Download


def build(
    name: Annotated[
        str,
        Argument(
            help="A data set's name or a manifest's path; NAME@TRACK-SEVERITY on a track.",
            autocompletion=options.data_sets,
        ),
    ],
    source: Annotated[
        Path | None, Option(help="Folder with the files, as the site has them or zipped.")
    ] = None,
    store: Annotated[
        str | None, Option(help="Where to build, a path or a URL; default: the cache.")
    ] = None,
    recipe: Annotated[str | None, Option(help=f"Blur recipe: {', '.join(RECIPES)}.")] = None,
    workers: options.Workers = None,
    scheduler: options.Scheduler = None,
    pair: Annotated[
        str | None, Option(help="Voltage steps, in-focus and defocus: 141,129.")
    ] = None,
    allow_missing: Annotated[
        bool, Option("--allow-missing", help="Accept missing pairs and build the rest.")
    ] = False,
    mirror: Annotated[
        list[str] | None, Option(metavar="URL", help="Asked before the site; repeatable.")
    ] = None,
    offline: Annotated[
        bool, Option("--offline", help="Fetch nothing; use what was fetched before.")
    ] = False,
    seed: Annotated[str | None, Option(metavar="N", help="Of unseen sets: what is drawn.")] = None,
    format: options.Facts = "table",
    cache: options.Cache = None,
) -> None:
    """Build a data set; what is already downloaded or finished is kept."""
    from dfdbench.building.obtaining import build_dataset, steps_of

    if store and store.startswith("memory:"):
        # Only from Python does it outlive the call.
        raise InputError(f"a store in memory ends with this command: {store}", where="--store")
    report = build_dataset(
        name,
        source,
        store=store,
        recipe=recipe,
        steps=None if pair is None else steps_of(pair, ",", "--pair", "as 141,129"),
        mirrors=mirror or (),
        offline=offline,
        seed=seed,
        pool=options.pool_of(workers, scheduler),
        cache=cache,
        shown=progress,
        on_fetched=_tell_fetched,
    )
    _tell(report, format)
    for text in report.warnings:
        say(f"warning: {text}")
    for number, problem in enumerate(report.problems, 1):
        say(f"{number}. {problem}")
    if report.missing:
        say(_missing_text(report))
        if not allow_missing:
            raise Exit(MISTAKE)


def export(
    name: options.DataSetArgument,
    png: Annotated[Path, Option(metavar="DIR", help="Folder to write PNG files into.")],
    split: options.Split = "all",
    images_only: Annotated[
        bool, Option("--images-only", help="Write no depth, which methods must not see.")
    ] = False,
    format: options.Facts = "table",
    cache: options.Cache = None,
) -> None:
    """Export pairs as PNG files (Middlebury pairs keep the thesis's file names)."""
    from dfdbench.building.export import export_png
    from dfdbench.datasets.dataset import open_dataset

    output_place(png, option="--png")
    store = open_dataset(name, cache=cache)
    with progress("writing pairs") as step:
        count = export_png(store, png, split, step, images_only)
    text = f"{counted(count, 'pair')} written to {png}"
    show(format, text=text, pairs=count, folder=png)


def _tell_fetched(done: Download) -> None:
    if done.refused:
        count = counted(done.refused, "file")
        say(f"refused, and set aside in {done.folder / 'set-aside'}: {count}")
    for problem in done.lacking:
        say(f"warning: {problem}")
    if done.new:
        say(f"fetched {counted(done.new, 'file')} into {done.folder}, {done.kept} were there")
    if done.lock:
        say(f"their checksums are kept in {done.lock}")


def _tell(report: BuildReport, format: str) -> None:
    scenes = len(report.scenes_built) + len(report.scenes_kept)
    kept = f", {len(report.scenes_kept)} of them kept from before" if report.scenes_kept else ""
    pairs = counted(report.pairs, "pair")
    show(
        format,
        text=f"built {report.manifest.stem}: {pairs} of {counted(scenes, 'scene')}{kept}\n"
        f"store        {report.path}\n"
        f"fingerprint  {report.fingerprint}",
        dataset=report.manifest.stem,
        pairs=report.pairs,
        scenes_built=report.scenes_built,
        scenes_kept=report.scenes_kept,
        missing=[pair.id for pair in report.missing],
        store=report.path,
        fingerprint=report.fingerprint,
    )


def _missing_text(report: BuildReport) -> str:
    manifest, missing = report.manifest, report.missing
    by_scene = grouped((pair.scene, pair.id.partition("/")[2]) for pair in missing)
    whole = [s for s in by_scene if len(by_scene[s]) == len(manifest.pairs(s))]
    lines = [f"missing: {len(missing)} of {manifest.pair_count} pairs, left out of the store"]
    if whole:
        lines.append(f"  no pair at all    {listed(whole, most=8)}")
    lines += [f"  {s:<17} {listed(by_scene[s], most=8)}" for s in by_scene if s not in whole]
    lines.append(f"  fix               {report.missing_help}")
    return "\n".join(lines)


def new_dataset(
    folder: Annotated[
        Path, Argument(metavar="DIR", help="Pairs or stacks of photographs, and depth maps.")
    ],
    out: Annotated[
        Path | None, Option(help="The manifest to write; default: NAME-1.toml, here.")
    ] = None,
    name: Annotated[
        str | None,
        Option(help="The data set's name; default: from --out NAME-1.toml, or the folder's."),
    ] = None,
    format: options.Facts = "table",
) -> None:
    """Look at a folder of captures and write a manifest for a person to finish."""
    from dfdbench.building.new_manifest import new_manifest

    named = re.fullmatch(r"(.+)-1\.toml", out.name) if out else None
    written = new_manifest(folder, name or (named and named[1]))
    path = output_place(out or written.name, folder)
    if path.exists():
        what = f"a {'folder' if path.is_dir() else 'file'} of that name is there"
        raise InputError(what, where=str(path), fix="name another: --out FILE.toml")
    write_whole(path, written.toml)
    then = command("build", path, source=folder)
    lines = ("found:", *(f"  {line}" for line in written.found))
    lines += ("say yourself:", *(f"  {line}" for line in written.open))
    lines += (f"manifest     {path}", f"next         {then}")
    facts = dict[str, Any](found=written.found, say_yourself=written.open, manifest=path, next=then)
    show(format, text="\n".join(lines), **facts)
