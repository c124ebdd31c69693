"""Read a manifest from TOML and check it whole, so that one problem hides no other."""

import hashlib
import re
from collections import Counter
from collections.abc import Callable, Iterator
from functools import cache
from importlib import resources
from pathlib import Path, PurePosixPath
from typing import Annotated, Any

from pydantic import TypeAdapter, ValidationError

from dfdbench.datasets.captured_files import (
    BY_IMAGE,
    IMAGE,
    OF_CAMERA,
    CapturedFiles,
    fill_known,
    places_in,
)
from dfdbench.datasets.manifest import (
    ALL_PAIRS,
    FOLDER,
    Manifest,
    Pair,
    excluded_pairs,
    grid_of_pairs,
)
from dfdbench.errors import ManifestError, Problem, unknown_name
from dfdbench.system.files import read_as
from dfdbench.system.strict import problems_of
from dfdbench.system.text import parse_toml
from dfdbench.tables.table import listed

_AXIS = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
# What the arrays and dimensions of a scene in a store are called, besides the axes.
_STORE_NAMES = (
    *("available", "channel", "depth", "image", "images", "role", "x", "y"),
    *(*BY_IMAGE, *OF_CAMERA),
)
# In the folder of a store, beside the scenes' own.
_STORE_FILE = "zarr.json"
#: A field, and what is wrong with it.
Finding = tuple[str, str]


def check_sections(sections: dict[str, Any], file: str) -> Iterator[Problem]:
    """Yield what contradicts itself in a manifest, as far as its sections are sound."""
    for check, needs in _CHECKS:
        if all(need in sections for need in needs):
            yield from (Problem(what, where=f"{file}: {field}") for field, what in check(sections))


def _unknown(field: str, kind: str, got: str, known: list[str]) -> Finding:
    near = unknown_name(kind, got, known).problems[0]
    return field, f"unknown {kind} {got}: {near.fix or near.expected}"


def _names_of(sections: dict[str, Any]) -> list[str]:
    return [scene.name for scene in sections["scenes"]]


def _check_scenes(sections: dict[str, Any]) -> Iterator[Finding]:
    names = _names_of(sections)
    for name, times in Counter(names).items():
        if times > 1:
            yield "scenes", f"scene {name} is listed twice"
        if name.casefold() == _STORE_FILE:
            yield "scenes", f"scene {name} is named as a file of the store"
    sources = [source.name for source in sections["sources"]]
    for number, scene in enumerate(sections["scenes"]):
        if scene.source not in sources:
            yield _unknown(f"scenes[{number}].source", "source", scene.source, sources)
    if len(names) != sections["scene_count"]:
        yield "scene_count", f"{len(names)} scenes are listed, not {sections['scene_count']}"


def _check_axes(sections: dict[str, Any]) -> Iterator[Finding]:
    axes = sections["axes"]
    for axis, values in axes.items():
        if axis in _STORE_NAMES or not _AXIS.fullmatch(axis):
            others = ", ".join(_STORE_NAMES)
            yield "axes", f"{axis!r} is no name for an axis: a letter, then letters, digits and _, "
            f"and none of {others}"
        if len(set(values)) != len(values):
            yield f"axes.{axis}", f"a value is listed twice: {values}"
    table = sections["table"]
    named = [("depth.axes", axis) for axis in sections["depth"].axes]
    named += [("table.blocks", table.blocks)]
    named += [("table.rows", table.rows)] if table.rows else []
    named += [("default_lighting", axis) for axis in sections["default_lighting"] or {}]
    for field, axis in named:
        if axis not in axes:
            yield _unknown(field, "axis", axis, list(axes))
    for axis, value in (sections["default_lighting"] or {}).items():
        if value not in axes.get(axis, [value]):
            yield f"default_lighting.{axis}", f"no such value: {value}, only {axes[axis]}"


def _check_exclusions(sections: dict[str, Any]) -> Iterator[Finding]:
    axes = sections["axes"]
    real = set(grid_of_pairs(tuple(_names_of(sections)), axes))
    seen: set[Pair] = set()
    for number, exclusion in enumerate(sections["exclusions"]):
        field = f"exclusions[{number}]"
        for axis in exclusion.coordinates:
            if axis not in axes:
                yield _unknown(f"{field}.coordinates", "axis", axis, list(axes))
        pairs = list(excluded_pairs([exclusion], axes))
        for pair in pairs:
            if pair not in real:
                yield field, f"excluded pair {pair.id} does not exist"
            elif pair in seen:
                yield field, f"pair is excluded twice: {pair.id}"
        seen.update(pairs)
        if len(pairs) != exclusion.pairs:
            yield f"{field}.pairs", f"{len(pairs)} pairs are excluded, not {exclusion.pairs}"
    if len(real - seen) != sections["pair_count"]:
        left, stated = len(real - seen), sections["pair_count"]
        yield "pair_count", f"{left} pairs are left after the exclusions, not {stated}"


def _check_splits(sections: dict[str, Any]) -> Iterator[Finding]:
    axes, scenes = sections["axes"], _names_of(sections)
    excluded = Counter(pair.scene for pair in excluded_pairs(sections["exclusions"], axes))
    grid = Counter(pair.scene for pair in grid_of_pairs(tuple(scenes), axes))
    taken: dict[tuple[str, str], str] = {}
    names: set[str] = {ALL_PAIRS, *scenes}
    for number, split in enumerate(sections["splits"]):
        field = f"splits[{number}]"
        if split.name in names:
            yield f"{field}.name", f"split name is taken: {split.name}"
        names.add(split.name)
        for scene in split.scenes:
            if scene not in scenes:
                yield _unknown(f"{field}.scenes", "scene", scene, scenes)
            other = taken.setdefault((split.partition, scene), split.name)
            if other != split.name:
                both = f"{other} and {split.name}, of partition {split.partition}"
                yield f"{field}.scenes", f"scene {scene} is in two splits, {both}"
        if len(set(split.scenes)) != len(split.scenes):
            yield f"{field}.scenes", "a scene is listed twice"
        pairs = sum(grid[scene] - excluded[scene] for scene in set(split.scenes))
        if pairs != split.pairs:
            yield f"{field}.pairs", f"{pairs} pairs, not {split.pairs}"


def _check_folds(sections: dict[str, Any]) -> Iterator[Finding]:
    if not sections["folds"]:
        return
    scenes = _names_of(sections)
    tested = Counter(scene for fold in sections["folds"] for scene in fold.test_scenes)
    for scene in tested:
        if scene not in scenes:
            yield _unknown("folds", "scene", scene, scenes)
    for scene in scenes:
        if tested[scene] != 1:
            yield "folds", f"{scene} is not in one fold, but in {tested[scene]}"
    names = {split.name for split in sections["splits"]} | {ALL_PAIRS, *scenes}
    for number, fold in enumerate(sections["folds"]):
        if fold.name in names:
            yield f"folds[{number}].name", f"name is taken: {fold.name}"
        names.add(fold.name)


def _check_checksums(sections: dict[str, Any]) -> Iterator[Finding]:
    scenes = _names_of(sections)
    for path in sections["checksums"]:
        if path.split("/")[0] not in scenes:
            yield _unknown(f'checksums."{path}"', "scene", path.split("/")[0], scenes)


def _check_metres(sections: dict[str, Any]) -> Iterator[Finding]:
    depth, rig, files = sections["depth"], sections["rig"], sections["files"]
    scale, given = depth.scale, files is not None and files.depth_unit is not None
    for field, bounds in (("depth.scale", scale), ("rig", rig)):
        if bounds and bounds.near and bounds.far and bounds.near >= bounds.far:
            what = f"near {bounds.near:g}, far {bounds.far:g}"
            yield field, f"near is not before far: {what} m"
    if files and scale is None and (depth.kind == "metres" or given):
        what = "nothing says how metres become levels: state near and far under [depth.scale]"
        yield "depth", f"{what}, or leave out files.depth_unit if the files hold levels"
    ends = files.depth_ends if files else None
    if ends and (depth.kind == "metres" or given or ends[0] == ends[1]):
        what = "two values that differ, of files that hold neither levels nor metres"
        yield "files.depth_ends", f"depth_ends are the values of two levels: {what}; got {ends}"
    if scale is None:
        return
    levels = f"near_level {scale.near_level}, far_level {scale.far_level}"
    above = scale.near_level > scale.far_level
    if scale.near_level == scale.far_level or above != (depth.grows_with == "nearness"):
        yield "depth.scale", f"levels go another way than depth.grows_with says: {levels}"
    low, high = sorted((scale.near_level, scale.far_level))
    if low <= depth.unknown <= high:
        what = f"the level for unknown depth, {depth.unknown}, stands for a distance as well"
        yield "depth.scale", f"{what}: {levels}"


def _check_files(sections: dict[str, Any]) -> Iterator[Finding]:
    files: CapturedFiles | None = sections["files"]
    if sections["reader"] != FOLDER:
        return
    if files is None:
        yield "files", "section is missing"
        return
    if sections["recipe"] is not None:
        yield "recipe", f"captured defocus has no blur recipe: leave out {sections['recipe']}"
    there = set(files.patterns)
    if ("images" in there) == ("defocus" in there) or not {"images", "infocus"} & there:
        got = listed(sorted(there))
        yield "files", f"neither a pair, infocus and defocus, nor a stack, images; got {got}"
    if "images" not in there:
        return
    if files.metadata is not None and files.image:
        yield "files", "two tables of the images, metadata and [[files.image]]"
    if files.moved == "infocus":
        yield "files.moved", "images of a stack are laid on the first"
    places = set(places_in(files.images or ""))
    columns = files.table_columns
    if not places & {IMAGE, *(places if columns is None else columns)} - {"scene"}:
        what = f"the pattern names one file: it needs {{{IMAGE}}} or a column of the table"
        yield "files.images", f"{what}; got {files.images}"


def _check_patterns(sections: dict[str, Any]) -> Iterator[Finding]:
    """Yield the patterns that lead outside the folder, to nothing known, or to one file twice."""
    files: CapturedFiles | None = sections["files"]
    if files is None:
        return
    paths = files.patterns | ({"inside": files.inside} if files.inside else {})
    found = [
        (f"files.{name}", f"the path leads outside the folder: {path}")
        for name, path in paths.items()
        if PurePosixPath(path).is_absolute()
        or ".." in PurePosixPath(path).parts
        or re.match(r".*\\|\w:", path)
    ]
    facts = {name: str(getattr(files, name) or "") for name in BY_IMAGE}
    for name, pattern in (files.patterns | facts).items():
        found += _unknown_places(sections, name, pattern)
    for axis in files.axis_names:
        if axis not in sections["axes"]:
            found.append(("files.axis_names", f"no such axis: {axis}"))
    for number, scene in enumerate(sections["scenes"]):
        for name in {"scene", *sections["axes"]} & set(scene.names):
            found.append((f"scenes[{number}].names", f"{name} stands for something else"))
    yield from found or _shared_files(sections)


def _unknown_places(sections: dict[str, Any], what: str, pattern: str) -> Iterator[Finding]:
    axes = sections["depth"].axes if what == "depth" else sections["axes"]
    columns: set[str] | None = set()
    if what in ("images", *BY_IMAGE):
        columns = sections["files"].table_columns
    known = {"scene", *axes, *(columns or ())} | ({IMAGE} if what == "images" else set())
    for name in dict.fromkeys(places_in(pattern)):
        lacking = [scene.name for scene in sections["scenes"] if name not in scene.names]
        if columns is not None and name not in known and lacking:
            kind = "an axis of the depth" if what == "depth" else "an axis"
            need = f"it is neither {kind} nor a name that each scene gives under names"
            without = f"{len(lacking)} scenes without it: {listed(lacking, 3)}"
            yield f"files.{what}", f"nothing is known by the name {{{name}}}: {need}; {without}"


def _shared_files(sections: dict[str, Any]) -> Iterator[Finding]:
    # Two captures of the same images would count one twice.
    seen: dict[tuple[str, ...], str] = {}
    patterns = [p for n, p in sections["files"].patterns.items() if n not in ("depth", "metadata")]
    for scene in sections["scenes"]:
        for pair in grid_of_pairs((scene.name,), sections["axes"]):
            values = sections["files"].values_of(scene.name, scene.names, pair.at)
            images = tuple(fill_known(pattern, values) for pattern in patterns)
            if len(set(images)) < len(images):
                yield f"files, {pair.id}", f"in-focus and defocus image are one file, {images[0]}"
                return
            other = seen.setdefault(images, pair.id)
            if other != pair.id:
                what = f"{other} and {pair.id} have the same images, {' and '.join(images)}"
                yield "files", f"{what}: patterns need {{scene}} and each axis with several values"
                return


#: Each check, and the sections that it needs to be sound.
_CHECKS: tuple[tuple[Callable[[dict[str, Any]], Iterator[Finding]], tuple[str, ...]], ...] = (
    (_check_scenes, ("scenes", "sources", "scene_count")),
    (_check_axes, ("axes", "depth", "table", "default_lighting")),
    (_check_exclusions, ("axes", "scenes", "exclusions", "pair_count")),
    (_check_splits, ("axes", "scenes", "exclusions", "splits")),
    (_check_folds, ("scenes", "splits", "folds")),
    (_check_metres, ("depth", "rig", "files")),
    (_check_files, ("reader", "files", "recipe")),
    (_check_patterns, ("files", "scenes", "axes", "depth")),
    (_check_checksums, ("scenes", "checksums")),
)


def read_manifest(path: str | Path) -> Manifest:
    """Read a manifest file and check it whole.

    Parameters
    ----------
    path : str or Path
        A TOML file.

    Returns
    -------
    Manifest
        Frozen; its `sha256` is that of the file.

    Raises
    ------
    ManifestError
        With every problem found: file, field, expected, got.

    Examples
    --------
    >>> from dfdbench.datasets.catalog import find_manifest
    >>> len(find_manifest("middlebury").pairs("test"))
    54
    """
    return parse_manifest(read_as(ManifestError, Path(path), "the manifest"), Path(path).name)


def parse_manifest(content: bytes, file: str) -> Manifest:
    """Check a manifest's bytes and return it; `file` is the name that problems give.

    Raises
    ------
    ManifestError
        With every problem found: file, field, expected, got.
    """
    try:
        text = content.decode("utf-8")
        raw = parse_toml(text)
    except ValueError as error:
        raise ManifestError("not a TOML file", where=file, got=str(error)) from error
    raw["toml"] = text
    sections, problems = _validate_sections(raw, file)
    problems += check_sections(sections, file)
    ManifestError.raise_if(problems)
    return Manifest.model_construct(None, **sections)


def released_sha256(manifest: Manifest) -> str | None:
    """Return the SHA-256 of the released manifest of this name and version; None if there is none.

    Examples
    --------
    >>> from dfdbench.datasets.catalog import find_manifest
    >>> demo = find_manifest("demo")
    >>> released_sha256(demo) == demo.sha256
    True
    """
    # Not from `released_manifests`: every worker opens stores, and parsing all of them takes long.
    file = resources.files("dfdbench.manifests") / f"{manifest.file_stem}.toml"
    return hashlib.sha256(file.read_bytes()).hexdigest() if file.is_file() else None


def _validate_sections(raw: dict[str, Any], file: str) -> tuple[dict[str, Any], list[Problem]]:
    # Section by section, so that one broken field does not hide what is wrong in the others.
    sections: dict[str, Any] = {}
    problems: list[Problem] = []
    for name, field in Manifest.model_fields.items():
        if name not in raw:
            if field.is_required():
                problems.append(Problem("field is missing", where=f"{file}: {name}"))
            else:
                sections[name] = field.get_default(call_default_factory=True)
            continue
        try:
            sections[name] = _adapter(name).validate_python(raw[name], strict=True)
        except ValidationError as error:
            problems += problems_of(error, "wrong value", file=file, section=name)
    problems += [
        Problem("unknown field", where=f"{file}: {name}")
        for name in raw
        if name not in Manifest.model_fields
    ]
    return sections, problems


@cache
def _adapter(field: str) -> TypeAdapter[Any]:
    known = Manifest.model_fields[field]
    annotation: Any = Annotated[known.annotation, known]
    return TypeAdapter(annotation)
