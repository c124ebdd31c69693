"""What the sections of a manifest must be to one another: counts, names, axes, splits, folds."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any

from dfdbench.datasets.captured_checks import check_patterns, check_reader, check_rig, check_scale
from dfdbench.datasets.captured_files import BY_IMAGE, OF_CAMERA
from dfdbench.datasets.manifest import ALL_PAIRS, Pair, excluded_pairs, grid_of_pairs
from dfdbench.errors import Problem, unknown_name

_AXIS = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
# What the arrays and dimensions of a scene in a store are called, besides the axes.
_STORE_NAMES = (
    *("available", "channel", "depth", "image", "images", "role", "x", "y"),
    *(*BY_IMAGE, *OF_CAMERA),
)
# In the folder of a store, beside the scenes' own.
_STORE_FILE = "zarr.json"


def _unknown(file: str, field: str, what: str, got: str, known: list[str]) -> Problem:
    near = unknown_name(what, got, known).problems[0]
    return Problem(
        near.what, where=f"{file}: {field}", expected=near.expected, got=got, fix=near.fix
    )


def _check_scenes(sections: dict[str, Any], file: str) -> Iterator[Problem]:
    names = [scene.name for scene in sections["scenes"]]
    for name, times in Counter(names).items():
        if times > 1:
            yield Problem(
                "scene is listed twice",
                where=f"{file}: scenes",
                expected="each scene once",
                got=name,
            )
        if name.casefold() == _STORE_FILE:
            yield Problem(
                what="scene is named as a file of the store",
                where=f"{file}: scenes",
                got=name,
                fix="choose another name",
            )
    sources = [source.name for source in sections["sources"]]
    for number, scene in enumerate(sections["scenes"]):
        if scene.source not in sources:
            yield _unknown(file, f"scenes[{number}].source", "source", scene.source, sources)
    if len(names) != sections["scene_count"]:
        yield Problem(
            "scenes do not add up",
            where=f"{file}: scene_count",
            expected=str(sections["scene_count"]),
            got=f"{len(names)} scenes listed",
        )


def _check_axes(sections: dict[str, Any], file: str) -> Iterator[Problem]:
    axes = sections["axes"]
    for axis, values in axes.items():
        if axis in _STORE_NAMES or not _AXIS.fullmatch(axis):
            yield Problem(
                what="no name for an axis",
                where=f"{file}: axes",
                got=repr(axis),
                expected="letters, digits and _, a letter first, and none of "
                + ", ".join(_STORE_NAMES),
            )
        if len(set(values)) != len(values):
            yield Problem("value is listed twice", where=f"{file}: axes.{axis}", got=str(values))
    table = sections["table"]
    named = [("depth.axes", axis) for axis in sections["depth"].axes]
    named += [("table.blocks", table.blocks)]
    named += [("table.rows", table.rows)] if table.rows else []
    for field, axis in named:
        if axis not in axes:
            yield _unknown(file, field, "axis", axis, list(axes))
    for axis, value in (sections["default_lighting"] or {}).items():
        if axis not in axes:
            yield _unknown(file, "default_lighting", "axis", axis, list(axes))
        elif value not in axes[axis]:
            yield Problem(
                "no such value",
                where=f"{file}: default_lighting.{axis}",
                expected=str(axes[axis]),
                got=str(value),
            )


def _check_exclusions(sections: dict[str, Any], file: str) -> Iterator[Problem]:
    axes, scenes = sections["axes"], [scene.name for scene in sections["scenes"]]
    real = set(grid_of_pairs(tuple(scenes), axes))
    seen: set[Pair] = set()
    for number, exclusion in enumerate(sections["exclusions"]):
        field = f"exclusions[{number}]"
        for axis in exclusion.coordinates:
            if axis not in axes:
                yield _unknown(file, f"{field}.coordinates", "axis", axis, list(axes))
        pairs = list(excluded_pairs([exclusion], axes))
        for pair in pairs:
            if pair not in real:
                yield Problem(
                    "excluded pair does not exist",
                    where=f"{file}: {field}",
                    expected="a scene and values that the manifest lists",
                    got=pair.id,
                )
            elif pair in seen:
                yield Problem("pair is excluded twice", where=f"{file}: {field}", got=pair.id)
        seen.update(pairs)
        if len(pairs) != exclusion.pairs:
            yield Problem(
                "excluded pairs do not add up",
                where=f"{file}: {field}.pairs",
                expected=str(exclusion.pairs),
                got=str(len(pairs)),
            )
    left = len(real - seen)
    if left != sections["pair_count"]:
        yield Problem(
            "pairs do not add up",
            where=f"{file}: pair_count",
            expected=str(sections["pair_count"]),
            got=f"{left} after the exclusions",
        )


def _check_splits(sections: dict[str, Any], file: str) -> Iterator[Problem]:
    axes, scenes = sections["axes"], [scene.name for scene in sections["scenes"]]
    excluded = Counter(pair.scene for pair in excluded_pairs(sections["exclusions"], axes))
    grid = Counter(pair.scene for pair in grid_of_pairs(tuple(scenes), axes))
    taken: dict[tuple[str, str], str] = {}
    names: set[str] = {ALL_PAIRS, *scenes}
    for number, split in enumerate(sections["splits"]):
        field = f"splits[{number}]"
        if split.name in names:
            yield Problem("split name is taken", where=f"{file}: {field}.name", got=split.name)
        names.add(split.name)
        for scene in split.scenes:
            if scene not in scenes:
                yield _unknown(file, f"{field}.scenes", "scene", scene, scenes)
            other = taken.setdefault((split.partition, scene), split.name)
            if other != split.name:
                yield Problem(
                    "scene is in two splits",
                    where=f"{file}: {field}.scenes",
                    expected=f"{scene} in one split of partition {split.partition}",
                    got=f"in {other} and {split.name}",
                )
        if len(set(split.scenes)) != len(split.scenes):
            yield Problem(
                "scene is listed twice", where=f"{file}: {field}.scenes", expected="each scene once"
            )
        pairs = sum(grid[scene] - excluded[scene] for scene in set(split.scenes))
        if pairs != split.pairs:
            yield Problem(
                "pairs do not add up",
                where=f"{file}: {field}.pairs",
                expected=str(split.pairs),
                got=str(pairs),
            )


def _check_folds(sections: dict[str, Any], file: str) -> Iterator[Problem]:
    scenes = [scene.name for scene in sections["scenes"]]
    tested = Counter(scene for fold in sections["folds"] for scene in fold.test_scenes)
    for scene in tested:
        if scene not in scenes:
            yield _unknown(file, "folds", "scene", scene, scenes)
    if not sections["folds"]:
        return
    for scene in scenes:
        if tested[scene] != 1:
            yield Problem(
                "folds do not cover each scene once",
                where=f"{file}: folds",
                expected=f"{scene} in one fold",
                got=f"in {tested[scene]}",
            )
    names = {split.name for split in sections["splits"]} | {ALL_PAIRS, *scenes}
    for number, fold in enumerate(sections["folds"]):
        if fold.name in names:
            yield Problem("name is taken", where=f"{file}: folds[{number}].name", got=fold.name)
        names.add(fold.name)


def _check_checksums(sections: dict[str, Any], file: str) -> Iterator[Problem]:
    scenes = [scene.name for scene in sections["scenes"]]
    for path in sections["checksums"]:
        scene = path.split("/")[0]
        if scene not in scenes:
            yield _unknown(file, f'checksums."{path}"', "scene", scene, scenes)


#: Each check, and the sections that it needs to be sound.
CHECKS: tuple[tuple[Callable[[dict[str, Any], str], Iterator[Problem]], tuple[str, ...]], ...] = (
    (_check_scenes, ("scenes", "sources", "scene_count")),
    (_check_axes, ("axes", "depth", "table", "default_lighting")),
    (_check_exclusions, ("axes", "scenes", "exclusions", "pair_count")),
    (_check_splits, ("axes", "scenes", "exclusions", "splits")),
    (_check_folds, ("scenes", "splits", "folds")),
    (check_scale, ("depth",)),
    (check_rig, ("rig",)),
    (check_reader, ("reader", "files", "depth", "recipe")),
    (check_patterns, ("files", "scenes", "axes", "depth")),
    (_check_checksums, ("scenes", "checksums")),
)
