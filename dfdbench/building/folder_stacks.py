"""Find focal stacks in a folder: photographs that differ by a number or by cells of a table."""

import json
import math
import re
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from dfdbench.building.folder_facts import Facts, spread, tell_depth, tell_photographs
from dfdbench.building.folder_layout import (
    DEPTH,
    Group,
    Layout,
    folder_layouts,
    shown_files,
    single_scene,
)
from dfdbench.building.sources.image_table import read_table
from dfdbench.datasets.captured_files import BY_IMAGE, IMAGE, places_in
from dfdbench.errors import SourceError
from dfdbench.tables.table import counted, listed

#: Photographs that differ by a number alone are a stack from so many on.
_FEWEST = 3
_LOOKED_AT = 4
_TABLES = (".json", ".csv", ".tsv", ".txt")
_IN_FOCUS = re.compile(r"all.?in.?focus|aif|in.?focus|sharp|rgb")
_NUMBER = re.compile(r"\d+")
_MOST_COLUMNS, _NAMED = 16, 3
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
    def kinds(self) -> tuple[Group, ...]:
        """The stacks that every scene has."""
        return tuple(
            group
            for group in self.layout.groups
            if len(group.files) == len(self.layout.scenes)
            and all(path in self.images for path in group.files.values())
        )

    @property
    def has_depth(self) -> bool:
        """Whether a file's name says that it is a depth map."""
        return any(group.is_depth for group in self.layout.groups)


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
        None where no photographs differ so, or depth maps do, too: then the numbers are scenes.
    """
    families: dict[str, dict[int, str]] = defaultdict(dict)
    for path in paths:
        for template, number in _templates(path):
            families[template][number] = path
    if any(len(f) > 1 and DEPTH.search(template.lower()) for template, f in families.items()):
        return None
    # What tables tell goes before numbers: two may go together, as run and motor.
    by_table: dict[str, dict[int, str]] = {}
    for table in _tables(folder):
        by_table |= _named_by(table, tuple(path for path in paths if _is_below(path, table.path)))
    families = by_table or families
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
    return max(
        (stacks for each in layouts if (stacks := Stacks(_stacked(each, images), images)).kinds),
        key=lambda stacks: len(stacks.layout.scenes),
        default=None,
    )


def _stacked(layout: Layout, images: dict[str, tuple[str, ...]]) -> Layout:
    """Return a layout without the scenes that have no stack, if most have one."""
    stacks = [group.files for group in layout.groups if set(group.files.values()) & set(images)]
    with_stack = tuple(key for key in layout.scenes if any(key in files for files in stacks))
    if 2 * len(with_stack) <= len(layout.scenes):
        return layout
    return layout.of_scenes(with_stack)


def _templates(path: str) -> Iterator[tuple[str, int]]:
    place = PurePosixPath(path)
    for match in _NUMBER.finditer(place.stem):
        stem = f"{place.stem[: match.start()]}{_PLACE}{place.stem[match.end() :]}"
        yield str(place.with_name(stem + place.suffix)), int(match[0])


@dataclass(frozen=True)
class _Table:
    path: PurePosixPath
    rows: list[dict[str, str]]
    columns: list[str]


def _tables(folder: Path) -> Iterator[_Table]:
    """Yield the tables below a folder, the deepest first."""
    for path in sorted(shown_files(folder), key=lambda each: (-len(each.parts), str(each))):
        if path.suffix.lower() in _TABLES:
            rows, columns = _rows_of(folder / path)
            if len(rows) >= _FEWEST:
                yield _Table(path, rows, columns)


def _is_below(path: str, table: PurePosixPath) -> bool:
    parent = str(table.parent)
    return parent == "." or path.startswith(f"{parent}/")


def _named_by(table: _Table, paths: tuple[str, ...]) -> dict[str, dict[int, str]]:
    """Return families of files by their names with a column in braces where the row's cell is."""
    names = {path: PurePosixPath(path) for path in paths}
    stems = {place.stem for place in names.values()}
    # What stands between _ and - in a name, and two or three of them together.
    marks = {
        stem: [-1, *(m.start() for m in re.finditer("[_-]", stem)), len(stem)] for stem in stems
    }
    words = {
        stem[start + 1 : end]
        for stem, at in marks.items()
        for first, start in enumerate(at)
        for end in at[first + 1 : first + 4]
    }
    columns = [
        name
        for name in table.rows[0]
        if len({row.get(name) for row in table.rows}) == len(table.rows)
        and all(row.get(name, "") in words for row in table.rows)
    ]
    families: dict[str, dict[int, str]] = defaultdict(dict)
    for path, place in names.items() if columns else ():
        for number, row in enumerate(table.rows):
            stem = place.stem
            for name in columns:
                cell = re.escape(row[name])
                stem = re.sub(f"(?<![^_-]){cell}(?![^_-])", f"{{{name}}}", stem, count=1)
            if all(f"{{{name}}}" in stem for name in columns):
                families[str(place.with_name(stem + place.suffix))][number] = path
    return {name: found for name, found in families.items() if len(found) == len(table.rows)}


def look_into_stacks(folder: Path, stacks: Stacks) -> Facts:
    """Return what a folder's stacks seem to be.

    Raises
    ------
    SourceError
        Where a file that is looked at is damaged.
    """
    layout = stacks.layout
    stack, *more = stacks.kinds
    others = [
        group
        for group in layout.groups
        if group not in stacks.kinds and len(group.files) == len(layout.scenes)
    ]
    depths = [group for group in others if group.is_depth]
    sharp = [group for group in others if group not in depths]
    named = [g for g in sharp if _IN_FOCUS.search(PurePosixPath(g.pattern).name.lower())]
    likely = (named or (sharp if len(sharp) == 1 else []))[:1]
    facts = Facts(dict(zip(("infocus",), likely, strict=False)) | {"images": stack})
    keys = spread(layout.scenes, _LOOKED_AT)
    first = Group(stack.pattern, {key: stacks.images[stack.files[key]][0] for key in keys})
    tell_photographs(folder, [*likely, first], keys, facts)
    counts = sorted({len(stacks.images[stack.files[key]]) for key in layout.scenes})
    told = " to ".join(map(str, dict.fromkeys((counts[0], counts[-1]))))
    facts.found.append(f"stacks {stack.pattern} of {told} images")
    if named:
        facts.found.append(f"in focus all over {named[0].pattern}")
    elif likely:
        facts.open.append(f"whether {likely[0].pattern} is in focus all over")
    else:
        facts.open.append("whether an image is in focus all over: infocus")
    if depths:
        facts.roles["depth"] = depths[0]
        tell_depth(folder, list(layout.scenes), facts, metres=True)
    else:
        facts.open.append("depth: none was found, so that nothing can be scored")
    _tell_table(folder, layout, stack, stacks, facts)
    if more:
        named_more = listed((group.pattern for group in more), _NAMED)
        facts.open.append(f"whether these stacks are values of an axis: {named_more}")
    left = [g.pattern for g in layout.groups if g not in (*facts.roles.values(), *more)]
    if left:
        facts.open.append(
            f"{counted(len(left), 'kind')} of files belong to no stack: {listed(left, _NAMED)}"
        )
    return facts


def _tell_table(folder: Path, layout: Layout, stack: Group, stacks: Stacks, facts: Facts) -> None:
    """Add the table that has a row per image, in the scenes' folders or above them."""
    images = stacks.images[stack.files[layout.scenes[0]]]
    for table in _tables(folder):
        if len(table.rows) == len(images) and _is_below(images[0], table.path):
            # As deep as the table lies, folders are those of the stack's pattern.
            folders = PurePosixPath(stack.pattern).parts[: len(table.path.parts) - 1]
            pattern = str(PurePosixPath(*folders, table.path.name))
            facts.roles["metadata"] = Group(pattern, dict.fromkeys(layout.scenes, ""))
            _tell_columns(table, stack, facts)
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


def _tell_columns(table: _Table, stack: Group, facts: Facts) -> None:
    rows = table.rows
    if table.columns:
        facts.more.append(f"columns = {json.dumps(table.columns)}")
    facts.found.append(f"a table with a row per image: {facts.roles['metadata'].pattern}")
    if set(BY_IMAGE) & set(rows[0]):
        return
    in_names = places_in(stack.pattern)
    numeric = [
        name
        for name in rows[0]
        if name not in in_names and all(_is_number(row.get(name, "")) for row in rows)
    ]
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
