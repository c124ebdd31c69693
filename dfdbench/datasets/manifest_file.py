"""Read a manifest from TOML: check every field first, then the manifest as a whole."""

import re
from collections import Counter
from collections.abc import Collection, Iterable, Iterator
from pathlib import Path

from pydantic import ValidationError

from dfdbench.datasets.captured_files import BY_IMAGE, IMAGE, OF_CAMERA, fill, places_in
from dfdbench.datasets.manifest import ALL_PAIRS, FOLDER, Manifest, excluded_pairs, grid_of_pairs
from dfdbench.errors import ManifestError, Problem, unknown_name
from dfdbench.system.files import leads_outside, read_as
from dfdbench.system.strict import problems_of
from dfdbench.system.text import parse_toml
from dfdbench.tables.table import listed

_AXIS = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
# The names of the arrays and dimensions of a scene in a store, besides the axes.
_STORE_NAMES = (
    *("available", "channel", "depth", "image", "images", "role", "x", "y"),
    *(*BY_IMAGE, *OF_CAMERA),
)
_COLOURS = 3
# A file in a store's folder, beside the scenes' own.
_STORE_FILE = "zarr.json"
#: A field, and what is wrong with it.
Finding = tuple[str, str]
Known = Collection[str]


def _contradictions(manifest: Manifest) -> Iterator[Finding]:
    """Yield the contradictions in a manifest whose fields are valid."""
    named = (_check_scenes, _check_axes, _check_exclusions, _check_names, _check_splits)
    others = (_check_folds, _check_metres, _check_files, _check_patterns, _check_checksums)
    for check in named + others:
        yield from check(manifest)


def _unknown(field: str, kind: str, named: Iterable[str], known: Known) -> Iterator[Finding]:
    for name in named:
        if name not in known:
            near = unknown_name(kind, name, known).problems[0]
            yield field, f"unknown {kind} {name}: {near.fix or near.expected}"


def _check_scenes(manifest: Manifest) -> Iterator[Finding]:
    names = manifest.scene_names
    for name, times in Counter(names).items():
        if times > 1:
            yield "scenes", f"scene {name} is listed twice"
        if name.casefold() == _STORE_FILE:
            yield "scenes", f"scene {name} is named as a file of the store"
    sources = [source.name for source in manifest.sources]
    for number, scene in enumerate(manifest.scenes):
        yield from _unknown(f"scenes[{number}].source", "source", [scene.source], sources)
    if manifest.find_scenes:
        if not manifest.files or not manifest.files.infocus:
            yield "find_scenes", "nothing says where scenes are found: state files.infocus"
        return
    for field in ("scenes", "splits"):
        if not getattr(manifest, field):
            yield field, "section is missing"
    if len(names) != manifest.scene_count:
        yield "scene_count", f"{len(names)} scenes are listed, not {manifest.scene_count}"


def _check_axes(manifest: Manifest) -> Iterator[Finding]:
    axes = manifest.axes
    for axis, values in axes.items():
        if axis in _STORE_NAMES or not _AXIS.fullmatch(axis):
            others = ", ".join(_STORE_NAMES)
            yield "axes", f"{axis!r} is no name for an axis: a letter, then letters, digits and _, "
            f"and none of {others}"
        if len(set(values)) != len(values):
            yield f"axes.{axis}", f"a value is listed twice: {values}"
    yield from _unknown("depth.axes", "axis", manifest.depth.axes, axes)
    yield from _unknown("table.blocks", "axis", [manifest.table.blocks], axes)
    yield from _unknown("table.rows", "axis", filter(None, [manifest.table.rows]), axes)


def _check_exclusions(manifest: Manifest) -> Iterator[Finding]:
    axes = manifest.axes
    real = set(grid_of_pairs(manifest.scene_names, axes))
    left = set(real)
    for number, exclusion in enumerate(manifest.exclusions):
        field = f"exclusions[{number}]"
        yield from _unknown(f"{field}.coordinates", "axis", exclusion.coordinates, axes)
        pairs = list(excluded_pairs([exclusion], axes))
        for pair in pairs:
            if pair not in real:
                yield field, f"excluded pair {pair.id} does not exist"
            elif pair not in left:
                yield field, f"pair is excluded twice: {pair.id}"
        left.difference_update(pairs)
        if len(pairs) != exclusion.pairs:
            yield f"{field}.pairs", f"{len(pairs)} pairs are excluded, not {exclusion.pairs}"
    # If scenes are found, the manifest states how many pairs were published.
    stated = manifest.pair_count
    if len(left) != stated and not manifest.find_scenes:
        yield "pair_count", f"{len(left)} pairs are left after the exclusions, not {stated}"


def _check_names(manifest: Manifest) -> Iterator[Finding]:
    taken = {ALL_PAIRS, *manifest.scene_names}
    splits, folds = [s.name for s in manifest.splits], [fold.name for fold in manifest.folds]
    for kind, names in (("split", splits), ("fold", folds)):
        for number, name in enumerate(names):
            if name in taken:
                yield f"{kind}s[{number}].name", f"{kind} name is taken: {name}"
            taken.add(name)


def _check_splits(manifest: Manifest) -> Iterator[Finding]:
    axes, scenes = manifest.axes, manifest.scene_names
    excluded = Counter(pair.scene for pair in excluded_pairs(manifest.exclusions, axes))
    grid = Counter(pair.scene for pair in grid_of_pairs(scenes, axes))
    taken: dict[tuple[str, str], str] = {}
    for number, split in enumerate(manifest.splits):
        field = f"splits[{number}]"
        yield from _unknown(f"{field}.scenes", "scene", split.scenes, scenes)
        for scene in split.scenes:
            other = taken.setdefault((split.partition, scene), split.name)
            if other != split.name:
                both = f"{other} and {split.name}, of partition {split.partition}"
                yield f"{field}.scenes", f"scene {scene} is in two splits, {both}"
        if len(set(split.scenes)) != len(split.scenes):
            yield f"{field}.scenes", "a scene is listed twice"
        pairs = sum(grid[scene] - excluded[scene] for scene in set(split.scenes))
        if pairs != split.pairs:
            yield f"{field}.pairs", f"{pairs} pairs, not {split.pairs}"


def _check_folds(manifest: Manifest) -> Iterator[Finding]:
    if not manifest.folds:
        return
    scenes = manifest.scene_names
    tested = Counter(scene for fold in manifest.folds for scene in fold.test_scenes)
    yield from _unknown("folds", "scene", tested, scenes)
    for scene in scenes:
        if tested[scene] != 1:
            yield "folds", f"{scene} is not in one fold, but in {tested[scene]}"


def _check_checksums(manifest: Manifest) -> Iterator[Finding]:
    scenes = manifest.scene_names
    for path in manifest.checksums:
        yield from _unknown(f'checksums."{path}"', "scene", [path.split("/")[0]], scenes)


def _check_metres(manifest: Manifest) -> Iterator[Finding]:
    depth, rig, files = manifest.depth, manifest.rig, manifest.files
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


def _check_files(manifest: Manifest) -> Iterator[Finding]:
    files = manifest.files
    if manifest.reader != FOLDER:
        return
    if files is None:
        yield "files", "section is missing"
        return
    if files.flat_field is not None and len(files.flat_field) != _COLOURS:
        what = f"{_COLOURS} lists of the light, for red, green and blue"
        yield "files.flat_field", f"{what}; got {len(files.flat_field)}"
    there = set(files.patterns)
    if manifest.recipe is not None:
        if there != {"infocus", "depth"}:
            what = f"{manifest.recipe} blurs files.infocus by files.depth"
            yield "recipe", f"{what}, and nothing else; got {listed(sorted(there))}"
        return
    if ("images" in there) == ("defocus" in there) or not {"images", "infocus"} & there:
        got = listed(sorted(there))
        what = f"neither a pair, infocus and defocus, nor a stack, images; got {got}"
        blurred = '; recipe = "published" would blur them' * (there == {"depth", "infocus"})
        yield "files", what + blurred
    if "images" not in there:
        return
    if files.flat_field and not files.of_pairs:
        yield "files.flat_field", "it is for pairs, of two apertures, and this is a stack"
    if files.metadata is not None and files.image:
        yield "files", "two tables of the images, metadata and [[files.image]]"
    if files.moved == "infocus" and not files.of_pairs:
        yield "files.moved", "images of a stack are laid on the first"
    places = set(places_in(files.images or ""))
    columns = files.table_columns
    if not places & {IMAGE, *(places if columns is None else columns)} - {"scene"}:
        what = f"the pattern names one file: it needs {{{IMAGE}}} or a column of the table"
        yield "files.images", f"{what}; got {files.images}"


def _check_patterns(manifest: Manifest) -> Iterator[Finding]:
    """Yield patterns that leave the folder, use unknown names, or give the same file twice."""
    files = manifest.files
    if files is None:
        return
    paths = files.patterns | ({"inside": files.inside} if files.inside else {})
    found = [
        (f"files.{name}", f"the path leads outside the folder: {path}")
        for name, path in paths.items()
        if leads_outside(path)
    ]
    facts = {name: str(getattr(files, name) or "") for name in BY_IMAGE}
    numbered = {IMAGE} & {*places_in(files.images or "")}
    columns = None if files.table_columns is None else files.table_columns | numbered
    for name, pattern in (files.patterns | facts).items():
        found += _unknown_places(manifest, columns, name, pattern)
    for axis in files.axis_names:
        if axis not in manifest.axes:
            found.append(("files.axis_names", f"no such axis: {axis}"))
    for number, scene in enumerate(manifest.scenes):
        for name in {"scene", *manifest.axes} & set(scene.names):
            found.append((f"scenes[{number}].names", f"{name} stands for something else"))
    yield from found or _shared_files(manifest)


def _unknown_places(
    manifest: Manifest, columns: set[str] | None, what: str, pattern: str
) -> Iterator[Finding]:
    axes = manifest.depth.axes if what == "depth" else manifest.axes
    if what not in ("images", *BY_IMAGE):
        columns = set()
    known = {"scene", *axes, *(columns or ())}
    for name in dict.fromkeys(places_in(pattern)):
        lacking = [scene.name for scene in manifest.scenes if name not in scene.names]
        if columns is not None and name not in known and lacking:
            kind = "an axis of the depth" if what == "depth" else "an axis"
            need = f"it is neither {kind} nor a name that each scene gives under names"
            without = f"{len(lacking)} scenes without it: {listed(lacking, 3)}"
            yield f"files.{what}", f"nothing is known by the name {{{name}}}: {need}; {without}"


def _shared_files(manifest: Manifest) -> Iterator[Finding]:
    files = manifest.files
    assert files is not None  # only captured sets are asked
    # If two captures had the same images, one would be counted twice.
    seen: dict[tuple[str, ...], str] = {}
    patterns = [p for n, p in files.patterns.items() if n not in ("depth", "metadata")]
    for scene in manifest.scenes:
        for pair in grid_of_pairs((scene.name,), manifest.axes):
            values = files.values_of(scene.name, scene.names, pair.at)
            images = tuple(fill(pattern, values) for pattern in patterns)
            if len(set(images)) < len(images):
                yield f"files, {pair.id}", f"in-focus and defocus image are one file, {images[0]}"
                return
            other = seen.setdefault(images, pair.id)
            if other != pair.id:
                what = f"{other} and {pair.id} have the same images, {' and '.join(images)}"
                yield "files", f"{what}: patterns need {{scene}} and each axis with several values"
                return


def read_manifest(path: str | Path) -> Manifest:
    """Read a manifest file and check all of it.

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
    """Check a manifest's bytes and return it; problems name it `file`.

    Raises
    ------
    ManifestError
        With every problem found: file, field, expected, got.
    """
    try:
        text = content.decode("utf-8-sig")
        raw = parse_toml(text)
    except ValueError as error:
        raise ManifestError("not a TOML file", where=file, got=str(error)) from error
    raw["toml"] = text
    try:
        manifest = Manifest.model_validate(raw)
    except ValidationError as error:
        raise ManifestError.of(problems_of(error, "wrong value", file=file)) from error
    found = _contradictions(manifest)
    ManifestError.raise_if(Problem(what, where=f"{file}: {field}") for field, what in found)
    return manifest
