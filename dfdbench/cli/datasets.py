"""The verbs that look at data sets: list, info, verify, cache."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.filesize import decimal

from dfdbench.blur.tracks import TRACKS, find_degradation
from dfdbench.cli.options import Cache, Workers, pool_of
from dfdbench.cli.screen import print_table, progress, say
from dfdbench.datasets.catalog import find_manifest, released_manifests, typed_name
from dfdbench.datasets.manifest import Manifest, Pair
from dfdbench.datasets.store_place import default_store, is_place
from dfdbench.datasets.tracked import part_name
from dfdbench.errors import InputError, unknown_name
from dfdbench.system.cache import KINDS, cache_entries, cache_folder, remove_entries
from dfdbench.tables.table import Table

if TYPE_CHECKING:
    from dfdbench.datasets.store import Store

cache_app = typer.Typer(invoke_without_command=True, add_completion=False, rich_markup_mode=None)


def list_datasets(cache: Cache = None) -> None:
    """List the data sets, their tracks and the registered methods."""
    from dfdbench.methods.registry import registered_methods

    rows = tuple(
        (
            typed_name(manifest),
            manifest.stem,
            str(manifest.scene_count),
            str(manifest.pair_count),
            "yes" if default_store(manifest, cache).exists() else "no",
            manifest.title,
        )
        for manifest in released_manifests()
    )
    print_table(
        Table("data sets", ("name", "manifest", "scenes", "pairs", "built", ""), rows, "llrrll")
    )
    tracks = tuple(
        (f"{track.name}-{severity}", step, track.title if severity == 1 else "")
        for track in TRACKS.values()
        for severity, step in enumerate(track.steps, 1)
    )
    note = "Of any set with synthetic blur: dfdbench build demo@noise-1"
    print_table(Table("tracks", ("track", "", ""), tracks, "lll", (note,)))
    methods = tuple(sorted(registered_methods().items()))
    print_table(Table("methods", ("name", "entry"), methods, "ll"))


def info(
    name: Annotated[
        str,
        typer.Argument(
            help="A data set's name, with its track, a manifest's path, or a store's place."
        ),
    ],
    pairs: Annotated[
        str | None, typer.Option(help="List the pairs of this split, fold or scene, one a line.")
    ] = None,
    cache: Cache = None,
) -> None:
    """Show what a data set consists of, or what a built one holds."""
    if is_place(name):
        # A manifest tells all it knows without the libraries that read arrays.
        from dfdbench.datasets.store import Store

        store = Store(name)
        if pairs is None:
            _show_store(store)
        else:
            _list_pairs(store.pairs(pairs))
    elif pairs is None:
        _show_manifest(find_manifest(name), cache)
    else:
        _list_pairs(find_manifest(name).pairs(pairs))


def verify(
    name: Annotated[str, typer.Argument(help="A data set's name, or a store's path or URL.")],
    workers: Workers = None,
    cache: Cache = None,
) -> None:
    """Recompute a store's fingerprint and compare it with the recorded one."""
    from dfdbench.datasets.integrity import verify_store
    from dfdbench.datasets.store import open_store

    store = open_store(name, cache=cache)
    with progress("reading scenes") as step:
        found = verify_store(store, pool_of(workers), step)
    print(f"store        {store.path}")
    print(f"read         {found.arrays} arrays of {found.scenes} scenes")
    print(f"recorded     {found.recorded}")
    print(f"recomputed   {found.recomputed or 'not possible: an array cannot be read'}")
    for difference in found.differences:
        place = f"{difference.scene}/{difference.array}".rstrip("/")
        print(f"differs      {place}: {difference.what}")
    if not found.sound:
        usual = str(store.path) == str(default_store(store.manifest, cache))
        place = "" if usual else f" --store {store.path}"
        build = f"dfdbench build {typed_name(store.manifest)}{place}"
        say(
            f"error: the store is not what was built\n"
            f"  fix       {build}, with the options it was "
            "built with, writes the scenes that differ again"
        )
        raise typer.Exit(1)
    print("sound        the store holds what was built")


@cache_app.callback()
def cache_verb(context: typer.Context, cache: Cache = None) -> None:
    """List what lies in the cache: downloads and built data sets; `clear` removes it."""
    if context.invoked_subcommand is not None:
        return
    folder = cache_folder(cache)
    entries = cache_entries(folder)
    rows = tuple(
        (entry.kind, entry.name, str(entry.files), decimal(entry.size)) for entry in entries
    )
    total = sum(entry.size for entry in entries)
    title = f"{folder}: {decimal(total)}"
    print_table(Table(title, ("kind", "name", "files", "size"), rows, "llrr"))


@cache_app.command("clear")
def clear_cache(
    names: Annotated[
        list[str] | None,
        typer.Argument(help="downloads, stores, or names that `dfdbench cache` lists."),
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask.")] = False,
    cache: Cache = None,
) -> None:
    """Remove downloads or built data sets from the cache; all of them if none is named."""
    entries = cache_entries(cache_folder(cache))
    known = {*KINDS, *(entry.name for entry in entries)}
    shorts = {
        manifest.short: (manifest.stem, f"{manifest.stem}.zarr", f"{manifest.stem}.zarr.partial")
        for manifest in released_manifests()
    }
    for name in names or ():
        if name not in known | shorts.keys() and part_name(name)[1]:
            stem = find_manifest(name).stem
            shorts[name] = (stem, f"{stem}.zarr", f"{stem}.zarr.partial")
        if name not in known | shorts.keys():
            raise unknown_name("entry of the cache", name, known | shorts.keys())
    wanted = {full for name in names or KINDS for full in shorts.get(name, (name,))}
    chosen = tuple(entry for entry in entries if wanted & {entry.kind, entry.name})
    for entry in chosen:
        say(f"  {entry.path}  {entry.files} files, {decimal(entry.size)}")
    if not chosen:
        print("nothing to remove")
        return
    if not yes:
        if not sys.stdin.isatty():
            raise InputError("nobody can be asked", where="dfdbench cache clear", fix="say --yes")
        typer.confirm("Remove them?", abort=True)
    remove_entries(chosen)
    print(f"removed {len(chosen)} entries, {decimal(sum(entry.size for entry in chosen))}")


def _list_pairs(pairs: Iterable[Pair]) -> None:
    for pair in pairs:
        print(pair.id)


def _show_store(store: Store) -> None:
    from dfdbench.system.location import size_of

    attributes = store.attributes
    options = ", ".join(_option(*item) for item in attributes["options"].items() if item[1])
    recipe = attributes["recipe"]
    parameters = ", ".join(f"{key} {value}" for key, value in recipe["parameters"].items())
    missing = attributes.get("missing_pairs", [])
    lines = [
        f"{store.manifest.title}",
        f"  store        {store.path}",
        f"  size         {decimal(size_of(store.path))}",
        f"  fingerprint  {store.fingerprint}",
        f"  manifest     {store.manifest.stem}  sha256 {attributes['manifest_sha256']}",
        f"  recipe       {recipe['name']}: {parameters}"
        if recipe["name"]
        else f"  recipe       {_without_recipe(store.manifest)}",
        f"  degradation  {_degradation_text(store.manifest)}",
        f"  depth        {_depth_text(store.manifest)}",
        f"  options      {options or 'none'}",
        f"  built by     dfdbench {attributes['dfdbench_version']}",
        f"  pairs        {len(store.pairs('all'))} of {store.manifest.pair_count}, "
        f"{len(missing)} missing",
    ]
    print("\n".join(lines))
    rows = []
    told: list[tuple[str, dict[str, float]]] = []
    for scene in store.scenes:
        found = store.scene(scene).attrs
        told += found.get("found", {}).items()
        rows_, columns = store.shape_of(scene)
        pairs = str(len(store.pairs(scene)))
        rows.append(
            (
                scene,
                f"{rows_} × {columns}",
                pairs,
                found["source_sha256"][:16],
                found["digest"][:16],
            )
        )
    heading = ("scene", "y × x", "pairs", "made from", "digest")
    print_table(Table("scenes", heading, tuple(rows), "lrrll"))
    if told:
        names = tuple(told[0][1])
        matched = tuple((pair, *(f"{found[name]:g}" for name in names)) for pair, found in told)
        title = "what lays one image on the other"
        print_table(Table(title, ("pair", *names), matched, "l" + "r" * len(names)))


def _recipe_text(manifest: Manifest) -> str:
    told = None if manifest.on_track else manifest.recipe
    return told or _without_recipe(manifest)


def _without_recipe(manifest: Manifest) -> str:
    return "not told: a track" if manifest.on_track else "none: both images are captured"


def _degradation_text(manifest: Manifest) -> str:
    if not manifest.on_track:
        return manifest.degradation
    found = find_degradation(manifest.degradation)
    return f"{found.label}, version {found.track.version}: {found.text}"


def _depth_text(manifest: Manifest) -> str:
    return f"brighter is {manifest.depth.direction}; {manifest.depth.unit}"


def _option(name: str, value: Any) -> str:
    if isinstance(value, dict):
        value = ", ".join(f"{key} {inner}" for key, inner in value.items())
    return f"{name.replace('_', ' ')} {value}"


def _show_manifest(manifest: Manifest, cache: Path | None) -> None:
    lines = [
        f"{manifest.title}",
        f"  manifest   {manifest.stem}  sha256 {manifest.sha256}",
        f"  scenes     {manifest.scene_count}",
        f"  pairs      {manifest.pair_count}",
        f"  recipe     {_recipe_text(manifest)}",
        f"  images     {_degradation_text(manifest)}",
        f"  depth      {_depth_text(manifest)}",
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
    place = default_store(manifest, cache)
    lines.append(f"  store      {place} ({'built' if place.exists() else 'not built'})")
    print("\n".join(lines))
