"""The verb that shows one data set: info."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.filesize import decimal

from dfdbench.blur.tracks import find_degradation
from dfdbench.cli.completion import data_sets
from dfdbench.cli.options import Cache
from dfdbench.cli.screen import print_table
from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.manifest import Manifest, Pair
from dfdbench.datasets.store_place import default_store, place_of
from dfdbench.tables.table import Table
from dfdbench.tables.wording import counted

if TYPE_CHECKING:
    from dfdbench.datasets.dataset import Dataset

# Of what a source found out about a scene, so much is shown.
_LONGEST = 100


def info(
    name: Annotated[
        str,
        typer.Argument(
            help="A data set's name, with its track, a manifest's path, or a store's place.",
            autocompletion=data_sets,
        ),
    ],
    pairs: Annotated[
        str | None, typer.Option(help="List the pairs of this split, fold or scene, one per line.")
    ] = None,
    croissant: Annotated[
        bool, typer.Option("--croissant", help="Print its description in Croissant 1.1, JSON-LD.")
    ] = False,
    cache: Cache = None,
) -> None:
    """Show what a data set consists of, or what a built one holds."""
    if croissant:
        _print_croissant(name, cache)
        return
    if place := place_of(name, cache):
        # A manifest tells all it knows without the libraries that read arrays.
        from dfdbench.datasets.dataset import Dataset

        store = Dataset(place)
        if pairs is None:
            _show_store(store)
        else:
            _list_pairs(store.pairs(pairs))
    elif pairs is None:
        _show_manifest(find_manifest(name), cache)
    else:
        _list_pairs(find_manifest(name).pairs(pairs))


def _print_croissant(name: str, cache: Path | None) -> None:
    from dfdbench.datasets.croissant import croissant_text

    if place := place_of(name, cache):
        from dfdbench.datasets.dataset import Dataset

        manifest = Dataset(place).manifest
    else:
        manifest = find_manifest(name)
    print(croissant_text(manifest), end="")


def _list_pairs(pairs: Iterable[Pair]) -> None:
    for pair in pairs:
        print(pair.id)


def _show_store(store: Dataset) -> None:
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
    _show_scenes(store)


def _show_scenes(store: Dataset) -> None:
    from dfdbench.datasets.damage import scene_record

    rows = []
    placed: list[tuple[str, dict[str, float]]] = []
    others: list[tuple[str, str, str]] = []
    for scene in store.scenes:
        record = scene_record(store.to_xarray(scene).attrs, f"{store.path}, {scene}")
        for name, value in record.found.items():
            # Other packages' sources may keep whatever fits into JSON.
            if _places(value) and (not placed or value.keys() == placed[0][1].keys()):
                placed.append((name, value))
            else:
                text = json.dumps(value, ensure_ascii=False)
                others.append((scene, name, f"{text[:_LONGEST]}…" if text[_LONGEST:] else text))
        size = " × ".join(map(str, store.shape_of(scene)))
        pairs = str(len(store.pairs(scene)))
        rows.append((scene, size, pairs, record.source_sha256[:16], record.digest[:16]))
    heading = ("scene", "y × x", "pairs", "made from", "digest")
    print_table(Table("scenes", heading, tuple(rows), "lrrll"))
    if placed:
        names = tuple(placed[0][1])
        matched = tuple((pair, *(f"{value[name]:g}" for name in names)) for pair, value in placed)
        title = "what lays one image on the other"
        print_table(Table(title, ("pair", *names), matched, "l" + "r" * len(names)))
    if others:
        columns = ("scene", "what", "value")
        print_table(Table("what the source found out", columns, tuple(others), "lll"))


def _places(value: object) -> bool:
    return (
        isinstance(value, dict)
        and bool(value)
        and all(isinstance(number, float) for number in value.values())
    )


def _recipe_text(manifest: Manifest) -> str:
    told = None if manifest.on_track else manifest.recipe
    return told or _without_recipe(manifest)


def _without_recipe(manifest: Manifest) -> str:
    if manifest.on_track:
        return "not told: a track"
    captured = "SIMULATED captures" if manifest.simulated else "captured"
    return f"none: both images are {captured}"


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
        f"  split      {split.name} ({split.partition}): {counted(split.pairs, 'pair')} of "
        f"{counted(len(split.scenes), 'scene')}"
        + (f": {', '.join(split.scenes)}" if len(split.scenes) <= 8 else "")
        for split in manifest.splits
    ]
    lines += [f"  fold       {fold.name}: {', '.join(fold.test_scenes)}" for fold in manifest.folds]
    for exclusion in manifest.exclusions:
        where = "; ".join(f"{axis} {values}" for axis, values in exclusion.coordinates.items())
        lines.append(
            f"  left out   {counted(exclusion.pairs, 'pair')} of {', '.join(exclusion.scenes)}, "
            f"{where}: {exclusion.reason}"
        )
    for source in manifest.sources:
        lines.append(f"  source     {source.name}: {source.url}")
        lines.append(f"  licence    {source.licence}")
    citations = dict.fromkeys(cite for source in manifest.sources for cite in source.citations)
    lines += [f"  cite       {citation}" for citation in citations]
    place = default_store(manifest, cache)
    lines.append(f"  store      {place} ({'built' if place.exists() else 'not built'})")
    print("\n".join(lines))
