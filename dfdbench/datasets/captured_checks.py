"""What the sections of a captured set's manifest must be to one another: patterns, metres."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import PurePosixPath
from typing import Any

from dfdbench.datasets.captured_files import BY_IMAGE, IMAGE, CapturedFiles, fill_known, places_in
from dfdbench.datasets.manifest import grid_of_pairs
from dfdbench.errors import Problem

#: The reader of sets that are described by their manifest alone.
FOLDER = "folder"


def check_scale(sections: dict[str, Any], file: str) -> Iterator[Problem]:
    """Yield what is wrong with how levels become metres."""
    depth = sections["depth"]
    scale, field = depth.scale, f"{file}: depth.scale"
    if scale is None:
        return
    if scale.near >= scale.far:
        yield _not_before(field, scale)
    above = scale.near_level > scale.far_level
    if scale.near_level == scale.far_level or above != (depth.grows_with == "nearness"):
        yield Problem(
            "levels go another way than depth.grows_with says",
            where=field,
            expected=f"the level {'near' if depth.grows_with == 'nearness' else 'far'} above the "
            "other",
            got=f"near_level {scale.near_level}, far_level {scale.far_level}",
        )
    ends = sorted((scale.near_level, scale.far_level))
    if ends[0] <= depth.unknown <= ends[1]:
        yield Problem(
            "the level for unknown depth stands for a distance as well",
            where=field,
            expected=f"levels without {depth.unknown}",
            got=f"{ends[0]} to {ends[1]}",
        )


def check_rig(sections: dict[str, Any], file: str) -> Iterator[Problem]:
    """Yield what is wrong with the facts of lens and camera."""
    rig = sections["rig"]
    if rig and rig.near and rig.far and rig.near >= rig.far:
        yield _not_before(f"{file}: rig", rig)


def check_reader(sections: dict[str, Any], file: str) -> Iterator[Problem]:
    """Yield what is lacking, or too much, for a set that is read from a folder."""
    files = sections["files"]
    if sections["reader"] != FOLDER:
        return
    if files is None:
        yield Problem("section is missing", where=f"{file}: files")
        return
    yield from _unit_problems(files, sections["depth"], file)
    yield from _image_problems(files, f"{file}: files")
    if sections["recipe"] is not None:
        yield Problem(
            "captured defocus has no blur recipe",
            where=f"{file}: recipe",
            got=sections["recipe"],
            fix="leave it out",
        )


def _unit_problems(files: CapturedFiles, depth: Any, file: str) -> Iterator[Problem]:
    metres = depth.kind == "metres"
    if depth.scale is None and (metres or files.depth_unit is not None):
        yield Problem(
            "nothing says how metres become levels",
            where=f"{file}: depth",
            expected="[depth.scale] with near and far, in metres",
            fix="state them, or leave out files.depth_unit where the files hold levels",
        )
    ends = files.depth_ends
    if ends and (metres or files.depth_unit is not None or ends[0] == ends[1]):
        yield Problem(
            "depth_ends are the values of two levels, in files that hold neither levels nor metres",
            where=f"{file}: files.depth_ends",
            expected="two values that differ, and no other unit",
            got=str(ends),
        )


def _image_problems(files: CapturedFiles, field: str) -> Iterator[Problem]:
    there = set(files.patterns)
    if ("images" in there) == ("defocus" in there) or not {"images", "infocus"} & there:
        yield Problem(
            "neither a pair nor a stack",
            where=field,
            expected="infocus and defocus, or images",
            got=", ".join(sorted(there)) or "none of them",
        )
    if "images" not in there:
        return
    if files.metadata is not None and files.image:
        yield Problem("two tables of the images", where=field, got="metadata and [[files.image]]")
    if files.moved == "infocus":
        yield Problem("images of a stack are laid on the first", where=f"{field}.moved")
    places = set(places_in(files.images or ""))
    columns = files.table_columns
    if not places & {IMAGE, *(places if columns is None else columns)} - {"scene"}:
        yield Problem(
            "the pattern names one file, and not several",
            where=f"{field}.images",
            expected=f"{{{IMAGE}}}, or a column of the table, in braces",
            got=files.images or "",
        )


def check_patterns(sections: dict[str, Any], file: str) -> Iterator[Problem]:
    """Yield the patterns that lead outside the folder, to nothing known, or to one file twice."""
    files = sections["files"]
    if files is None:
        return
    found: list[Problem] = []
    if files.inside:
        found += _outside(files.inside, f"{file}: files.inside")
    for name, pattern in files.patterns.items():
        found += _outside(pattern, f"{file}: files.{name}")
        found += _pattern_problems(sections, name, pattern, f"{file}: files.{name}")
    for name in BY_IMAGE:
        pattern = str(getattr(files, name) or "")
        found += _pattern_problems(sections, name, pattern, f"{file}: files.{name}")
    for axis in files.axis_names:
        if axis not in sections["axes"]:
            found.append(Problem("no such axis", where=f"{file}: files.axis_names", got=axis))
    for number, scene in enumerate(sections["scenes"]):
        for name in scene.names:
            if name == "scene" or name in sections["axes"]:
                found.append(
                    Problem(
                        "the name stands for something else",
                        where=f"{file}: scenes[{number}].names",
                        expected="neither scene nor an axis",
                        got=name,
                    )
                )
    yield from found
    if not found:
        yield from _shared_files(sections, file)


def _pattern_problems(
    sections: dict[str, Any], what: str, pattern: str, field: str
) -> Iterator[Problem]:
    axes = sections["depth"].axes if what == "depth" else sections["axes"]
    columns: set[str] | None = set()
    if what in ("images", *BY_IMAGE):
        columns = sections["files"].table_columns
    for name in dict.fromkeys(places_in(pattern)):
        if columns is None or name in ("scene", *axes, *columns):
            continue
        if name == IMAGE and what == "images":
            continue
        lacking = [scene.name for scene in sections["scenes"] if name not in scene.names]
        if lacking:
            yield Problem(
                f"nothing is known by the name {{{name}}}",
                where=field,
                expected=f"{{scene}}, an axis of the {'depth' if what == 'depth' else 'pairs'}, "
                "or a name that each scene gives under names",
                got=f"{len(lacking)} scenes without it: {', '.join(lacking[:3])}"
                + (" ..." if len(lacking) > 3 else ""),
            )


def _outside(pattern: str, field: str) -> Iterator[Problem]:
    path = PurePosixPath(pattern)
    if path.is_absolute() or ".." in path.parts or "\\" in pattern or re.match(r"\w:", pattern):
        yield Problem(
            "the path leads outside the folder",
            where=field,
            expected="a path below it, with / between folders",
            got=pattern,
        )


def _shared_files(sections: dict[str, Any], file: str) -> Iterator[Problem]:
    # Two captures of the same images would count one twice.
    seen: dict[tuple[str, ...], str] = {}
    patterns = [p for n, p in sections["files"].patterns.items() if n not in ("depth", "metadata")]
    for scene in sections["scenes"]:
        for pair in grid_of_pairs((scene.name,), sections["axes"]):
            values = sections["files"].values_of(scene.name, scene.names, pair.at)
            images = tuple(fill_known(pattern, values) for pattern in patterns)
            if len(set(images)) < len(images):
                yield Problem(
                    "in-focus and defocus image are one file",
                    where=f"{file}: files, {pair.id}",
                    got=images[0],
                )
                return
            other = seen.setdefault(images, pair.id)
            if other != pair.id:
                yield Problem(
                    "two pairs have the same images",
                    where=f"{file}: files, {other} and {pair.id}",
                    expected="{scene} in the patterns, and each axis that has several values",
                    got=" and ".join(images),
                )
                return


def _not_before(field: str, bounds: Any) -> Problem:
    return Problem(
        "near is not before far",
        where=field,
        expected="near < far, in metres",
        got=f"near {bounds.near:g}, far {bounds.far:g}",
    )
