"""The verbs that look: list, info, verify, cache, doctor."""

from __future__ import annotations

import json
import os
import shutil
import sys
from collections.abc import Iterator
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from rich.filesize import decimal
from typer import Argument, Context, Exit, Option, confirm

from dfdbench.blur.tracks import TRACKS, find_degradation
from dfdbench.cli.options import Cache, DataSetArgument, Facts, Printed, Workers, data_sets, pool_of
from dfdbench.cli.screen import command, progress, say, show
from dfdbench.datasets import catalog
from dfdbench.datasets.manifest import Manifest
from dfdbench.errors import DfdbenchError, InputError, spelt_out, unknown_name
from dfdbench.statuses import NO
from dfdbench.system.cache import KINDS, cache_entries, cache_folder, remove_entries
from dfdbench.system.packages import EXTRAS
from dfdbench.tables.table import Format, Table, counted

if TYPE_CHECKING:
    from dfdbench.datasets.dataset import Dataset
    from dfdbench.results.record import Environment


def list_datasets(
    cache: Cache = None,
    entries: Annotated[
        bool, Option("--entries", help="Show where each method is defined instead.")
    ] = False,
    format: Facts = "table",
) -> None:
    """List the data sets, their tracks and the registered methods."""
    from dfdbench.methods.registry import method_words, registered_methods

    sets = [
        _listed(heading, heading.short, catalog.default_store(heading, cache).exists())
        for heading in catalog.released_headings()
    ]
    sets += _own(cache)
    heads = ("name", "scenes", "pairs", "built", "")
    tracks = [
        {"track": f"{track.name}-{severity}", "step": step, "title": track.title}
        for track in TRACKS.values()
        for severity, step in enumerate(track.steps, 1)
    ]
    rows = tuple(
        (at["track"], at["step"], at["title"] if at["track"].endswith("-1") else "")
        for at in tracks
    )
    note = "Of any set with synthetic blur: dfdbench build demo@noise-1"
    found = registered_methods() if entries else method_words()
    columns = ("name", "entry" if entries else "what it is")
    tables = (
        Table("data sets", heads, tuple(map(_cells, sets)), "lrrll", records=tuple(sets)),
        Table("tracks", ("track", "", ""), rows, "lll", (note,), records=tuple(tracks)),
        Table("methods", columns, tuple(sorted(found.items())), "ll"),
    )
    show(format, tables)


def _listed(manifest: catalog.Heading | Manifest, name: str, built: bool) -> dict[str, object]:
    counts = {"scenes": manifest.scene_count, "pairs": manifest.pair_count, "built": built}
    return {"name": name, "manifest": manifest.stem, **counts, "title": manifest.title}


def _cells(record: dict[str, object]) -> tuple[str, ...]:
    words = {True: "yes", False: "no", None: ""}
    told = (value for key, value in record.items() if key != "manifest")
    return tuple(words[v] if v is None or isinstance(v, bool) else str(v) for v in told)


def _own(cache: Path | None) -> list[dict[str, object]]:
    """Return records of the user's own sets in the cache."""
    # As for released sets, tracks are not listed one by one.
    found = {name: path for name, path in catalog.own_stores(cache).items() if "@" not in name}
    if not found:
        return []
    from dfdbench.datasets.dataset import Dataset

    rows = []
    # Of a store's two names, show the one without a version, which users type.
    shortest = {found[name]: name for name in sorted(found, key=len, reverse=True)}
    for path, name in sorted(shortest.items()):
        try:
            rows.append(_listed(Dataset(path).manifest, name, built=True))
        except DfdbenchError as error:
            broken = {"name": name, "manifest": path.stem, "scenes": None, "pairs": None}
            rows.append(broken | {"built": True, "title": error.problems[0].what})
    return rows


def verify(
    name: DataSetArgument, workers: Workers = None, format: Facts = "table", cache: Cache = None
) -> None:
    """Recompute a store's fingerprint and compare it with the recorded one."""
    from dfdbench.datasets.dataset import open_dataset
    from dfdbench.datasets.fingerprint import verify_store

    store = open_dataset(name, cache=cache)
    with progress("reading scenes", "nothing was written") as step:
        found = verify_store(store, pool_of(workers), step)
    lines = [
        f"store        {store.path}",
        f"read         {counted(found.arrays, 'array')} of {counted(found.scenes, 'scene')}",
        f"recorded     {found.recorded}",
        f"recomputed   {found.recomputed or 'not possible: an array cannot be read'}",
        *(f"differs      {each.place}: {each.what}" for each in found.differences),
        *["sound        the store holds what was built"] * found.sound,
    ]
    show(format, text="\n".join(lines), store=store.path, sound=found.sound, **asdict(found))
    if not found.sound:
        usual = str(store.path) == str(catalog.default_store(store.manifest, cache))
        place = None if usual else store.path
        build = command("build", store.manifest.short, store=place, cache=cache)
        say(
            f"error: the store is not what was built\n"
            f"  fix       {build}, with the options it was "
            "built with, writes the scenes that differ again"
        )
        raise Exit(NO)


def cache_verb(context: Context, format: Printed = Format.table, cache: Cache = None) -> None:
    """List what is in the cache: downloads and built data sets; `clear` removes it."""
    if context.invoked_subcommand is not None:
        return
    folder = cache_folder(cache)
    entries = cache_entries(folder)
    rows = tuple((each.kind, each.name, str(each.files), decimal(each.size)) for each in entries)
    total = sum(entry.size for entry in entries)
    title = f"{folder}: {decimal(total)}"
    records = tuple(map(asdict, entries))
    table = Table(title, ("kind", "name", "files", "size"), rows, "llrr", records=records)
    show(format, [table], folder=folder, size=total)


def clear_cache(
    names: Annotated[
        list[str] | None, Argument(help="downloads, stores, or names that are listed.")
    ] = None,
    yes: Annotated[bool, Option("--yes", help="Do not ask.")] = False,
    format: Facts = "table",
    cache: Cache = None,
) -> None:
    """Remove downloads or built data sets from the cache; all of them if none is named."""
    entries = cache_entries(cache_folder(cache))
    stems = {heading.short: heading.stem for heading in catalog.released_headings()}
    known = {*KINDS, *stems, *(entry.name for entry in entries)}
    chosen = []
    for name in names or KINDS:
        on_track = name not in known and catalog.part_name(name)[1]
        stem = catalog.find_manifest(name).stem if on_track else stems.get(name, name)
        # The user's own sets may be named without their version, too.
        found = [e for e in entries if name in (e.kind, e.name, e.stem.rpartition("-")[0])]
        found += [e for e in entries if e.stem == stem]
        if not (found or on_track or name in known):
            raise unknown_name("entry of the cache", name, known)
        chosen += found
    chosen = list(dict.fromkeys(chosen))
    for entry in chosen:
        say(f"  {entry.path}  {counted(entry.files, 'file')}, {decimal(entry.size)}")
    if chosen and not yes:
        if not sys.stdin.isatty():
            raise InputError(
                "cannot ask: no terminal", where="dfdbench cache clear", fix="say --yes"
            )
        confirm("Remove them?", abort=True, err=True)
    remove_entries(tuple(chosen))
    size = sum(entry.size for entry in chosen)
    text = f"removed {len(chosen)} entries, {decimal(size)}" if chosen else "nothing to remove"
    show(format, text=text, removed=[entry.path for entry in chosen], size=size)


def info(
    name: Annotated[
        str,
        Argument(
            help="A data set's name, with its track, a manifest's path, or a store's place.",
            autocompletion=data_sets,
        ),
    ],
    pairs: Annotated[
        str | None, Option(help="List the pairs of this split, fold or scene, one per line.")
    ] = None,
    croissant: Annotated[
        bool, Option("--croissant", help="Print its description in Croissant 1.1, JSON-LD.")
    ] = False,
    format: Facts = "table",
    cache: Cache = None,
) -> None:
    """Show what a data set consists of, or what a built one holds."""
    store = None
    place = catalog.place_of(name, cache)
    if place is None and catalog.find_manifest(name).find_scenes:
        # Only the store knows its scenes.
        usual = catalog.default_store(catalog.find_manifest(name), cache)
        place = usual if usual.exists() else None
    if place:
        # A manifest can be shown without the libraries that read arrays.
        from dfdbench.datasets.dataset import Dataset

        store = Dataset(place)
    manifest = store.manifest if store else catalog.find_manifest(name)
    if croissant:
        from dfdbench.datasets.croissant import croissant_text

        print(croissant_text(manifest), end="")
    elif pairs is not None:
        ids = [pair.id for pair in (store or manifest).pairs(pairs)]
        show(format, text="\n".join(ids), pairs=ids)
    elif store:
        _show_store(store, format)
    else:
        _show_manifest(manifest, format, cache)


def _as_data(manifest: Manifest) -> dict[str, Any]:
    content = manifest.model_dump(mode="json", exclude={"toml", "checksums"}, exclude_none=True)
    return {"sha256": manifest.sha256, **content}


def _show_store(store: Dataset, format: str) -> None:
    from dfdbench.system.location import size_of

    attributes = store.attributes
    options = ", ".join(_option(*item) for item in attributes["options"].items() if item[1])
    recipe = attributes["recipe"]
    parameters = ", ".join(f"{key} {value}" for key, value in recipe["parameters"].items())
    missing, size = attributes.get("missing_pairs", []), size_of(store.path)
    lines = [
        f"{store.manifest.title}",
        f"  store        {store.path}",
        f"  size         {decimal(size) if size else 'not known'}",
        f"  fingerprint  {store.fingerprint}",
        f"  manifest     {store.manifest.stem}  sha256 {attributes['manifest_sha256']}",
        f"  recipe       {recipe['name']}: {parameters}"
        if recipe["name"]
        else f"  recipe       {_without_recipe(store.manifest)}",
        f"  degradation  {_degradation_text(store.manifest)}",
        f"  depth        {store.manifest.depth.text}",
        f"  options      {options or 'none'}",
        f"  built by     dfdbench {attributes['dfdbench_version']}",
        f"  pairs        {len(store.pairs('all'))} of {store.manifest.pair_count}, "
        f"{len(missing)} missing",
    ]
    if format == Format.table:
        print(spelt_out("\n".join(lines)))
    facts = {"path": store.path, "built": True, "size": size_of(store.path)}
    facts |= {name: value for name, value in attributes.items() if name != "manifest"}
    show(format, _scene_tables(store), manifest=_as_data(store.manifest), store=facts)


def _scene_tables(store: Dataset) -> list[Table]:
    from dfdbench.datasets.fingerprint import scene_record

    rows, records = [], []
    others: list[tuple[str, str, str]] = []
    for scene in store.scenes:
        record = scene_record(store.to_xarray(scene).attrs, f"{store.path}, {scene}")
        for name, value in record.found.items():
            others.append((scene, name, json.dumps(value, ensure_ascii=False)))
        size, pairs = store.shape_of(scene), len(store.pairs(scene))
        source, digest = record.source_sha256, record.digest
        rows.append((scene, " × ".join(map(str, size)), str(pairs), source[:16], digest[:16]))
        facts = {"scene": scene, "size": size, "pairs": pairs, "found": record.found}
        records.append(facts | {"made_from": source, "digest": digest})
    heading = ("scene", "y × x", "pairs", "made from", "digest")
    tables = [Table("scenes", heading, tuple(rows), "lrrll", records=tuple(records))]
    if others:
        columns = ("scene", "what", "value")
        tables.append(Table("what the source found out", columns, tuple(others), "lll"))
    return tables


def _without_recipe(manifest: Manifest) -> str:
    if manifest.on_track:
        return "not given: a track"
    captured = "SIMULATED captures" if manifest.simulated else "captured"
    return f"none: the images are {captured}"


def _degradation_text(manifest: Manifest) -> str:
    if not manifest.on_track:
        return manifest.degradation
    found = find_degradation(manifest.degradation)
    return f"{found.label}, version {found.track.version}: {found.text}"


def _option(name: str, value: Any) -> str:
    if isinstance(value, dict):
        value = ", ".join(f"{key} {inner}" for key, inner in value.items())
    return f"{name.replace('_', ' ')} {value}"


def _show_manifest(manifest: Manifest, format: str, cache: Path | None) -> None:
    lines = [
        f"{manifest.title}",
        f"  manifest   {manifest.stem}  sha256 {manifest.sha256}",
        f"  scenes     {manifest.scene_count}",
        f"  pairs      {manifest.pair_count}",
        f"  recipe     {(not manifest.on_track and manifest.recipe) or _without_recipe(manifest)}",
        f"  images     {_degradation_text(manifest)}",
        f"  depth      {manifest.depth.text}",
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
    place = catalog.default_store(manifest, cache)
    built = place.exists()
    lines.append(f"  store      {place} ({'built' if built else 'not built'})")
    store = {"path": place, "built": built}
    show(format, text="\n".join(lines), manifest=_as_data(manifest), store=store)


#: Environment variables that change how libraries and dfdbench itself work.
_VARIABLES = (
    "DFDBENCH_CACHE", "DFDBENCH_SHARED_DATA", "OMP_NUM_THREADS", "NUMBA_CACHE_DIR",
    "NUMBA_NUM_THREADS", "NUMBA_DISABLE_JIT", "CUDA_VISIBLE_DEVICES",
)  # fmt: skip


def doctor(
    format: Printed = Format.table,
    warm: Annotated[
        bool, Option("--warm", help="First compile all that is compiled, for later commands.")
    ] = False,
    cache: Cache = None,
) -> None:
    """Say what is installed here and what the machine can do: for bug reports."""
    if warm:
        from dfdbench.evaluation.check import warm_up

        with progress("compiling", "the same command compiles what is left") as step:
            warm_up(step)
    from dfdbench.results.environment import describe_environment

    nets = list(_nets())
    # PyTorch is imported by now, so its threads and GPU are shown.
    found = describe_environment()
    rows = [*_system(found), *nets, *_extras(), *_place(cache_folder(cache))]
    rows += [_compiled(), *((name, os.environ[name]) for name in _VARIABLES if name in os.environ)]
    show(format, [Table("dfdbench, here", ("what", "found"), tuple(rows), "ll")])


def _system(found: Environment) -> Iterator[tuple[str, str]]:
    commit = f", commit {found.git}" if found.git else ""
    yield "dfdbench", f"{found.versions['dfdbench']}{commit}"
    yield "python", f"{found.python}, {found.platform}"
    yield "processor", f"{found.cpu}, {found.cpu_count} cores"
    yield "threads", ", ".join(f"{name} {count}" for name, count in found.threads.items())
    libraries = [f"{name} {v}" for name, v in found.versions.items() if name != "dfdbench"]
    yield "libraries", ", ".join(libraries)


def _nets() -> Iterator[tuple[str, str]]:
    try:
        import torch

        from dfdbench.training.configuration import precision_for
    except ModuleNotFoundError:
        return
    devices = [torch.device("cpu")] + [torch.device("cuda")] * torch.cuda.is_available()
    for device in devices:
        precision, reason = precision_for(device)
        yield f"trains on {device.type} in", f"{precision}: {reason}"
    yield "gpu", torch.cuda.get_device_name() if torch.cuda.is_available() else "none"


def _extras() -> Iterator[tuple[str, str]]:
    for extra, modules in EXTRAS.items():
        try:
            there = ", ".join(f"{module} {version(module)}" for module in modules)
        except PackageNotFoundError:
            there = f"absent: pip install 'dfdbench[{extra}]'"
        yield f"extra {extra}", there


def _place(folder: Path) -> Iterator[tuple[str, str]]:
    entries = cache_entries(folder)
    size = sum(entry.size for entry in entries)
    above = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    free = shutil.disk_usage(above).free
    writable = "" if os.access(above, os.W_OK) else ", cannot be written"
    yield "cache", f"{folder}: {decimal(size)}, {decimal(free)} free{writable}"
    stores = [entry.path.stem for entry in entries if entry.path.match("stores/*.zarr")]
    yield "built", ", ".join(stores) or "nothing"


def _compiled() -> tuple[str, str]:
    from dfdbench.metrics.similarity import mean_similarity

    # One module's: unless a variable says otherwise, numba has a folder for each.
    place = mean_similarity.stats.cache_path
    return "compiled code", place or "not cached, so each command compiles: set DFDBENCH_CACHE"
