"""The verbs that make data sets and write them elsewhere: build, export."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from dfdbench.blur.recipe import RECIPES, find_recipe
from dfdbench.building.build import build_store
from dfdbench.building.export import export_png
from dfdbench.building.fetching.checksums import known_checksums
from dfdbench.building.fetching.download import SET_ASIDE
from dfdbench.building.sources import Source, download_middlebury, open_source
from dfdbench.cli.options import Cache, Scheduler, Workers, pool_of
from dfdbench.cli.screen import download_progress, progress, say
from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.manifest import Manifest, Pair
from dfdbench.datasets.store import Store, default_store, open_store
from dfdbench.errors import InputError, Problem
from dfdbench.system.cache import DOWNLOADS, cache_folder
from dfdbench.system.location import as_location


def build(
    name: Annotated[str, typer.Argument(help="A data set's name or a manifest's path.")],
    source: Annotated[
        Path | None,
        typer.Option(help="Folder with the files, in the site's layout or its zip archives."),
    ] = None,
    store: Annotated[
        str | None, typer.Option(help="Where to build, a path or a URL; default: the cache.")
    ] = None,
    recipe: Annotated[str | None, typer.Option(help=f"Blur recipe: {', '.join(RECIPES)}.")] = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    pair: Annotated[
        str | None,
        typer.Option(help="In-focus and defocus voltage step of captured pairs: 141,129."),
    ] = None,
    allow_missing: Annotated[
        bool, typer.Option("--allow-missing", help="Succeed although pairs are missing.")
    ] = False,
    mirror: Annotated[
        list[str] | None,
        typer.Option(
            metavar="URL",
            help="Ask this address before the site; repeatable; also DFDBENCH_MIRROR.",
        ),
    ] = None,
    offline: Annotated[
        bool, typer.Option("--offline", help="Fetch nothing; use what was fetched before.")
    ] = False,
    cache: Cache = None,
) -> None:
    """Build a data set; what is fetched or finished already is kept."""
    manifest = find_manifest(name)
    place = as_location(store or default_store(manifest, cache))
    if place.protocol == "memory":
        raise InputError(
            "a store in memory ends with this command",
            where="--store",
            expected="a path or a URL",
            got=str(place),
        )
    if recipe is not None:
        find_recipe(recipe)
    if recipe not in (None, manifest.recipe) and store is None:
        raise InputError(
            "another blur recipe makes another data set",
            where="--recipe",
            expected=str(manifest.recipe),
            got=str(recipe),
            fix="name its place: --store PATH",
        )
    pool = pool_of(workers, scheduler)
    steps = _voltage_steps(manifest, pair, store)
    if source is None and manifest.reader == "middlebury":
        files = _fetched(manifest, mirror, offline, cache)
    else:
        _refuse_to_fetch(manifest, source, mirror, offline)
        files = open_source(manifest, source, known_checksums(manifest), steps)
    with progress("building scenes") as step:
        report = build_store(manifest, files, place, recipe, pool, step)
    scenes = len(report.scenes_built) + len(report.scenes_kept)
    kept = f", {len(report.scenes_kept)} of them kept from before" if report.scenes_kept else ""
    print(f"built {manifest.stem}: {report.pairs} pairs of {scenes} scenes{kept}")
    print(f"store        {report.path}")
    print(f"fingerprint  {report.fingerprint}")
    if report.missing:
        say(_missing_text(manifest, report.missing, files.missing_help(report.missing)))
        if not allow_missing:
            raise typer.Exit(2)


def export(
    name: Annotated[str, typer.Argument(help="A data set's name, or a store's path or URL.")],
    png: Annotated[Path, typer.Option(metavar="DIR", help="Folder to write PNG files into.")],
    split: Annotated[str, typer.Option(help="A split, a fold, a scene, or all.")] = "all",
    cache: Cache = None,
) -> None:
    """Write the pairs as PNG files; Middlebury's are named as the thesis's."""
    store = open_store(name, cache=cache)
    store.manifest.scenes_of(split)
    with progress("writing pairs") as step:
        count = export_png(store, png, split, step)
    print(f"{count} pairs lie in {png}")


def voltage_pair_stores(
    manifest: Manifest, pairs: Sequence[Any], source: Path | None, cache: Path | None
) -> dict[str, Store]:
    """Return the set of each pair of voltage steps, ``135-141``, built where it is not there.

    They lie beside the set of the manifest's own pair, in the cache.

    Raises
    ------
    InputError
        Where one is no such pair; where a set is not built and no folder of captures is named.
    SourceError
        Where the captures lack a pair's voltage steps altogether.
    """
    steps: dict[str, tuple[int, int]] = {}
    for pair in map(str, pairs):
        parts = re.fullmatch(r"(\d+)-(\d+)", pair)
        if not parts:
            raise InputError(
                "not a pair of voltage steps",
                where="--values",
                expected="as 141-129,140-130",
                got=pair,
            )
        steps[pair] = int(parts[1]), int(parts[2])
    usual = default_store(manifest, cache)
    places = {pair: usual.with_name(f"{manifest.stem}-{pair}.zarr") for pair in steps}
    left = [pair for pair, place in places.items() if not place.exists()]
    if left and source is None:
        raise InputError(
            "the sets of these voltage steps are not built",
            where=str(usual.parent),
            got=", ".join(left),
            fix="name the folder of the captures: --source DIR",
        )
    # A step that does not exist is told before the first set is built.
    sources = {pair: open_source(manifest, source, pair=steps[pair]) for pair in left}
    for pair, files in sources.items():
        with progress(f"building {manifest.stem}, steps {pair}") as step:
            report = build_store(manifest, files, places[pair], None, pool_of(None), step)
        say(f"built        {report.path}: {report.pairs} pairs, {len(report.missing)} missing")
    return {pair: Store(place) for pair, place in places.items()}


def _voltage_steps(
    manifest: Manifest, pair: str | None, store: str | None
) -> tuple[int, int] | None:
    if pair is None:
        return None
    try:
        infocus, defocus = (int(step) for step in pair.split(","))
    except ValueError:
        raise InputError(
            "not a pair of voltage steps",
            where="--pair",
            expected="two steps, as 141,129",
            got=pair,
        ) from None
    usual = manifest.capture and (manifest.capture.infocus_step, manifest.capture.defocus_step)
    if usual not in (None, (infocus, defocus)) and store is None:
        raise InputError(
            "another pair of voltage steps makes another data set",
            where="--pair",
            expected=f"{usual}",
            got=pair,
            fix="name its place: --store PATH",
        )
    return infocus, defocus


def _fetched(
    manifest: Manifest, mirror: list[str] | None, offline: bool, cache: Path | None
) -> Source:
    mirrors = [*(mirror or ()), *os.environ.get("DFDBENCH_MIRROR", "").split()]
    _check_mirrors(mirrors)
    if offline and mirror:
        raise InputError("--offline asks nobody", where="--mirror", fix="leave one of them out")
    folder = cache_folder(cache) / DOWNLOADS / manifest.stem
    before = _count_set_aside(folder)
    try:
        with download_progress(f"fetching {manifest.short}") as step:
            done = download_middlebury(manifest, folder, mirrors, offline, step)
    finally:
        refused = _count_set_aside(folder) - before
        if refused:
            say(f"{refused} files were refused and set aside in {folder / SET_ASIDE}")
    if done.new:
        say(f"fetched {done.new} files into {folder}, {done.kept} were there")
    if done.lock:
        say(f"their checksums are kept in {done.lock}")
    if not done.new and not done.kept:
        raise InputError(
            f"no file of {manifest.short} is there",
            where=str(folder),
            got="--offline asks nobody" if offline else "the site has none of them",
            fix="build once without --offline, or name a copy: --source DIR"
            if offline
            else "name a --mirror URL, or a copy on disk: --source DIR",
        )
    return open_source(manifest, folder, known_checksums(manifest, folder))


def _count_set_aside(folder: Path) -> int:
    return sum(path.is_file() for path in (folder / SET_ASIDE).rglob("*"))


def _check_mirrors(mirrors: list[str]) -> None:
    problems = [
        Problem(
            "not an address",
            where="--mirror or DFDBENCH_MIRROR",
            expected="https://HOST/FOLDER",
            got=mirror,
        )
        for mirror in mirrors
        if not re.match(r"https?://[^/]+", mirror)
    ]
    if problems:
        raise InputError.of(problems)


def _refuse_to_fetch(
    manifest: Manifest, source: Path | None, mirror: list[str] | None, offline: bool
) -> None:
    given = [name for name, value in (("--mirror", mirror), ("--offline", offline)) if value]
    if given and source:
        raise InputError(
            "--source reads a copy on disk: nothing is fetched",
            where=" and ".join(given),
            fix="leave it out, or leave out --source",
        )
    if given:
        raise InputError(
            f"{manifest.short} is not fetched here", where=" and ".join(given), fix="leave it out"
        )


def _missing_text(manifest: Manifest, missing: tuple[Pair, ...], fix: str) -> str:
    by_scene: dict[str, list[str]] = {}
    for pair in missing:
        by_scene.setdefault(pair.scene, []).append(pair.id.partition("/")[2])
    whole = [s for s in by_scene if len(by_scene[s]) == len(manifest.pairs_of_scene(s))]
    lines = [f"missing: {len(missing)} of {manifest.pair_count} pairs, left out of the store"]
    if whole:
        lines.append(f"  no pair at all    {', '.join(_spans(whole, manifest.scene_names))}")
    alike: dict[str, list[str]] = {}
    for scene, places in by_scene.items():
        if scene not in whole:
            alike.setdefault(", ".join(places), []).append(scene)
    for listed, scenes in alike.items():
        lines.append(f"  {', '.join(scenes)}: {listed.count(',') + 1} pairs each")
        lines.append(f"    {listed}")
    lines.append(f"  fix               {fix}")
    return "\n".join(lines)


def _spans(names: list[str], known: tuple[str, ...]) -> list[str]:
    """Return names, three neighbours and more as the first and the last of them."""
    runs: list[list[str]] = []
    for name in known:
        if name in names:
            if not runs or known.index(name) != known.index(runs[-1][-1]) + 1:
                runs.append([])
            runs[-1].append(name)
    return [text for run in runs for text in ([f"{run[0]} to {run[-1]}"] if len(run) > 2 else run)]
