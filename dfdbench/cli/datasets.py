"""The verbs that look at data sets and the cache: list, verify, cache."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.filesize import decimal

from dfdbench.blur.tracks import TRACKS
from dfdbench.cli.completion import data_sets
from dfdbench.cli.options import Cache, Workers, pool_of
from dfdbench.cli.screen import print_table, progress, say
from dfdbench.datasets.catalog import find_manifest, released_manifests
from dfdbench.datasets.manifest import Manifest
from dfdbench.datasets.store_place import default_store, own_stores
from dfdbench.datasets.tracked import part_name
from dfdbench.errors import DfdbenchError, InputError, unknown_name
from dfdbench.system.cache import KINDS, cache_entries, cache_folder, remove_entries
from dfdbench.tables.table import Table
from dfdbench.tables.wording import counted

cache_app = typer.Typer(invoke_without_command=True, add_completion=False, rich_markup_mode=None)


def list_datasets(
    cache: Cache = None,
    entries: Annotated[
        bool, typer.Option("--entries", help="Show where each method is defined instead.")
    ] = False,
) -> None:
    """List the data sets, their tracks and the registered methods."""
    from dfdbench.methods.registry import method_words, registered_methods

    rows = [
        _listed(manifest, manifest.short, default_store(manifest, cache).exists())
        for manifest in released_manifests()
    ]
    rows += _own(cache)
    heads = ("name", "manifest", "scenes", "pairs", "built", "")
    print_table(Table("data sets", heads, tuple(rows), "llrrll"))
    tracks = tuple(
        (f"{track.name}-{severity}", step, track.title if severity == 1 else "")
        for track in TRACKS.values()
        for severity, step in enumerate(track.steps, 1)
    )
    note = "Of any set with synthetic blur: dfdbench build demo@noise-1"
    print_table(Table("tracks", ("track", "", ""), tracks, "lll", (note,)))
    found = registered_methods() if entries else method_words()
    columns = ("name", "entry" if entries else "what it is")
    print_table(Table("methods", columns, tuple(sorted(found.items())), "ll"))


def _listed(manifest: Manifest, name: str, built: bool) -> tuple[str, ...]:
    scenes, pairs = str(manifest.scene_count), str(manifest.pair_count)
    return name, manifest.stem, scenes, pairs, "yes" if built else "no", manifest.title


def _own(cache: Path | None) -> list[tuple[str, ...]]:
    """Return the rows of the sets of one's own in the cache."""
    found = own_stores(cache)
    if not found:
        return []
    from dfdbench.datasets.dataset import Dataset

    rows = []
    # Of two names of one store the one without a version is to be typed.
    shortest = {found[name]: name for name in sorted(found, key=len, reverse=True)}
    for path, name in sorted(shortest.items()):
        try:
            rows.append(_listed(Dataset(path).manifest, name, built=True))
        except DfdbenchError as error:
            rows.append((name, path.stem, "", "", "yes", error.problems[0].what))
    return rows


def verify(
    name: Annotated[
        str,
        typer.Argument(
            help="A data set's name, or a store's path or URL.", autocompletion=data_sets
        ),
    ],
    workers: Workers = None,
    cache: Cache = None,
) -> None:
    """Recompute a store's fingerprint and compare it with the recorded one."""
    from dfdbench.datasets.dataset import open_dataset
    from dfdbench.datasets.integrity import verify_store

    store = open_dataset(name, cache=cache)
    with progress("reading scenes", "nothing was written") as step:
        found = verify_store(store, pool_of(workers), step)
    print(f"store        {store.path}")
    print(f"read         {counted(found.arrays, 'array')} of {counted(found.scenes, 'scene')}")
    print(f"recorded     {found.recorded}")
    print(f"recomputed   {found.recomputed or 'not possible: an array cannot be read'}")
    for difference in found.differences:
        place = f"{difference.scene}/{difference.array}".rstrip("/")
        print(f"differs      {place}: {difference.what}")
    if not found.sound:
        usual = str(store.path) == str(default_store(store.manifest, cache))
        place = "" if usual else f" --store {store.path}"
        build = f"dfdbench build {store.manifest.short}{place}"
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
        say(f"  {entry.path}  {counted(entry.files, 'file')}, {decimal(entry.size)}")
    if not chosen:
        print("nothing to remove")
        return
    if not yes:
        if not sys.stdin.isatty():
            raise InputError("nobody can be asked", where="dfdbench cache clear", fix="say --yes")
        typer.confirm("Remove them?", abort=True)
    remove_entries(chosen)
    print(f"removed {len(chosen)} entries, {decimal(sum(entry.size for entry in chosen))}")
