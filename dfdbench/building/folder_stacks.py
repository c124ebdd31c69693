"""Find focal stacks in a folder: photographs that differ by a number, and what lies beside them."""

from __future__ import annotations

import math
import re
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from dfdbench.building.folder_facts import Facts, tell_depth, tell_photographs
from dfdbench.building.folder_layout import (
    DEPTH,
    Group,
    Layout,
    folder_layouts,
    shown_files,
    single_scene,
)
from dfdbench.building.sources.image_table import read_table
from dfdbench.datasets.captured_files import BY_IMAGE, IMAGE
from dfdbench.errors import SourceError

#: Photographs that differ by a number alone are a stack from so many on.
_FEWEST = 3
_LOOKED_AT = 4
_TABLES = (".json", ".csv", ".tsv", ".txt")
_IN_FOCUS = re.compile(r"all.?in.?focus|aif|in.?focus|sharp|rgb")
_NUMBER = re.compile(r"\d+")
_MOST_COLUMNS = 16
_PLACE = f"{{{IMAGE}}}"


@dataclass(frozen=True)
class Stacks:
    """The focal stacks of a folder.

    Parameters
    ----------
    layout : Layout
        How files go together; of a stack one file, with ``{image}`` for the number.
    images : dict of str to tuple of str
        The images of each stack by that name, in the order of their numbers.
    """

    layout: Layout
    images: dict[str, tuple[str, ...]]

    @property
    def has_depth(self) -> bool:
        """Whether a file's name says that it is a depth map."""
        return any(DEPTH.search(group.pattern.lower()) for group in self.layout.groups)


def find_stacks(folder: Path, paths: tuple[str, ...]) -> Stacks | None:
    """Return the focal stacks of a folder.

    Parameters
    ----------
    folder : Path
        Gives a single scene its name.
    paths : tuple of str
        Image files and depth arrays below it.

    Returns
    -------
    Stacks or None
        None where no photographs differ by a number alone, or depth maps do, too: then the numbers
        are scenes.
    """
    families: dict[str, dict[int, str]] = defaultdict(dict)
    for path in paths:
        for template, number in _templates(path):
            families[template][number] = path
    if any(len(f) > 1 and DEPTH.search(template.lower()) for template, f in families.items()):
        return None
    images: dict[str, tuple[str, ...]] = {}
    taken: set[str] = set()
    for template, found in sorted(families.items(), key=lambda item: (-len(item[1]), item[0])):
        members = tuple(found[number] for number in sorted(found))
        if len(members) < _FEWEST or taken & set(members):
            continue
        images[template] = members
        taken.update(members)
    if not images:
        return None
    left = tuple(sorted({*paths, *images} - taken))
    layouts = [single_scene(left, folder.resolve().name)] if len(images) == 1 else []
    layouts += folder_layouts(left, least=1)
    fitting = [layout for layout in layouts if _stack_of(layout)]
    if not fitting:
        return None
    return Stacks(max(fitting, key=lambda layout: len(layout.scenes)), images)


def _templates(path: str) -> Iterator[tuple[str, int]]:
    place = PurePosixPath(path)
    for match in _NUMBER.finditer(place.stem):
        stem = f"{place.stem[: match.start()]}{_PLACE}{place.stem[match.end() :]}"
        yield str(place.with_name(stem + place.suffix)), int(match[0])


def _stack_of(layout: Layout) -> Group | None:
    stacks = [group for group in layout.groups if _PLACE in group.pattern]
    return stacks[0] if stacks and len(stacks[0].files) == len(layout.scenes) else None


def look_into_stacks(folder: Path, stacks: Stacks) -> Facts:
    """Return what a folder's stacks seem to be.

    Raises
    ------
    SourceError
        Where a file that is looked at is damaged.
    """
    layout = stacks.layout
    stack = _stack_of(layout)
    assert stack is not None
    others = [g for g in layout.groups if g is not stack and len(g.files) == len(layout.scenes)]
    depths = [group for group in others if DEPTH.search(group.pattern.lower())]
    sharp = [group for group in others if group not in depths]
    named = [g for g in sharp if _IN_FOCUS.search(PurePosixPath(g.pattern).name.lower())]
    facts = Facts({"infocus": named[0]} if named else {})
    facts.roles["images"] = stack
    keys = list(layout.scenes[:: max(1, math.ceil(len(layout.scenes) / _LOOKED_AT))])
    first = Group(stack.pattern, {key: stacks.images[stack.files[key]][0] for key in keys})
    tell_photographs(folder, [*named[:1], first], keys, facts)
    counts = sorted({len(stacks.images[stack.files[key]]) for key in layout.scenes})
    told = " to ".join(map(str, {counts[0]: None, counts[-1]: None}))
    facts.found.append(f"stacks {stack.pattern} of {told} images")
    if named:
        facts.found.append(f"in focus all over {named[0].pattern}")
    else:
        facts.open.append("whether an image is in focus all over: infocus")
    if depths:
        facts.roles["depth"] = depths[0]
        tell_depth(folder, list(layout.scenes), facts, metres=True)
    else:
        facts.open.append("depth: none was found, so that nothing can be scored")
    _tell_table(folder, layout, stack, stacks, facts)
    for group in layout.groups:
        if group not in facts.roles.values():
            facts.open.append(f"what {group.pattern} is")
    return facts


def _tell_table(folder: Path, layout: Layout, stack: Group, stacks: Stacks, facts: Facts) -> None:
    """Add the table that has a row per image, in the scenes' folders or above them."""
    key = layout.scenes[0]
    images = stacks.images[stack.files[key]]
    scene_folder = str(PurePosixPath(images[0]).parent)
    for path in sorted(shown_files(folder), key=lambda each: (-len(each.parts), str(each))):
        parent = str(path.parent)
        beside = parent == "." or f"{scene_folder}/".startswith(f"{parent}/")
        if path.suffix.lower() not in _TABLES or not beside:
            continue
        rows, columns = _rows_of(folder / path)
        if len(rows) == len(images):
            pattern = _pattern_beside(path, stack)
            facts.roles["metadata"] = Group(pattern, dict.fromkeys(layout.scenes, str(path)))
            _tell_columns(rows, columns, facts)
            return
    facts.open.append(
        "focus distances: no table with a row per image was found; metadata, or [[files.image]]"
    )


def _rows_of(path: Path) -> tuple[list[dict[str, str]], list[str]]:
    """Return a table's rows, and names of its columns if it has no heading."""
    try:
        content = path.read_bytes()
    except OSError:
        return [], []
    for count in range(_MOST_COLUMNS) if path.suffix != ".json" else (0,):
        columns = [f"column_{number}" for number in range(1, count + 1)]
        try:
            rows = read_table(content, path.name, columns)
        except SourceError:
            continue
        # A heading is words.
        if columns or not any(map(_is_number, rows[0])):
            return rows, columns
    return [], []


def _pattern_beside(path: PurePosixPath, stack: Group) -> str:
    """Return a file's pattern: as deep as it lies, folders are those of the stack's pattern."""
    folders = PurePosixPath(stack.pattern).parts[: len(path.parts) - 1]
    return str(PurePosixPath(*folders, path.name))


def _tell_columns(rows: list[dict[str, str]], columns: list[str], facts: Facts) -> None:
    if columns:
        facts.more.append(f"columns = [{', '.join(map(repr, columns))}]".replace("'", '"'))
    facts.found.append(f"a table with a row per image: {facts.roles['metadata'].pattern}")
    if set(BY_IMAGE) & set(rows[0]):
        return
    numeric = [name for name in rows[0] if all(_is_number(row.get(name, "")) for row in rows)]
    told = [name for name in numeric if re.search("foc|dist|disp|depth", name.lower())]
    told = told or [name for name in numeric if len({row[name] for row in rows}) == len(rows)][-1:]
    if not told:
        facts.open.append("which column tells the focus: focus_distance or focus_depth")
        return
    name = told[0]
    positive = all(float(row[name]) > 0 for row in rows) and "disp" not in name.lower()
    field = "focus_distance" if positive else "focus_depth"
    unit = "in metres" if positive else "in the unit of the depth files"
    facts.more.append(f'{field} = "{{{name}}}" # {unit}')
    facts.open.append(f"whether {name} is the focus {unit}")


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False
