"""The images of a capture: which files they are, in which order, and what is known of each."""

import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from dfdbench.building.sources.captured_images import in_unit_of
from dfdbench.building.sources.image_files import SUFFIXES
from dfdbench.datasets.captured_files import (
    ANY_ENDING,
    BY_IMAGE,
    IMAGE,
    CapturedFiles,
    fill,
    fill_known,
    places_in,
)
from dfdbench.datasets.captures import ROLES, Role
from dfdbench.datasets.manifest import Manifest
from dfdbench.errors import Problem, SourceError
from dfdbench.tables.table import listed

Row = Mapping[str, str]
_NAMED = 4


@dataclass(frozen=True)
class TakenImage:
    """An image of a capture.

    Parameters
    ----------
    path : str
        Below the folder.
    role : str
        ``infocus`` or ``defocus``.
    facts : dict of str to float
        What is known of it, by the names of `BY_IMAGE`, as it stands in the table.
    """

    path: str
    role: Role
    facts: dict[str, float]


def read_table(content: bytes, where: str, columns: Sequence[str]) -> list[dict[str, str]]:
    r"""Return the rows of a table in a file: JSON, or text with tabs, commas or blanks between.

    Parameters
    ----------
    content : bytes
        JSON holds a list of records, or lists of one length by name; text has a heading unless
        `columns` are given. Empty lines, and those that begin with ``#``, do not count.
    where : str
        The file's name, for messages.
    columns : sequence of str
        What the columns are called, for a text without a heading.

    Raises
    ------
    SourceError
        If it is no such table, or a row is too short or too long.

    Examples
    --------
    >>> read_table(b"run, focus_distance\nrun_1, 0.82", "metadata.csv", [])
    [{'run': 'run_1', 'focus_distance': '0.82'}]
    >>> read_table(b'{"views": 61, "focus_depth": [-3.1, 0.5]}', "focus.json", [])
    [{'focus_depth': '-3.1'}, {'focus_depth': '0.5'}]
    """
    try:
        text = content.decode("utf-8")
        is_json = where.endswith(".json")
        rows = _json_rows(json.loads(text)) if is_json else _text_rows(text, columns)
    except ValueError as error:
        fix = "" if columns else "a text without a heading needs `columns` under [files]"
        raise SourceError(f"no table of the images: {error}", where=where, fix=fix) from error
    if not rows:
        raise SourceError("the table of the images is empty", where=where)
    return rows


def _text_rows(text: str, columns: Sequence[str]) -> list[dict[str, str]]:
    lines = [line.strip() for line in text.splitlines()]
    lines = [line for line in lines if line and not line.startswith("#")]
    between = next((mark for mark in ("\t", ",") if any(mark in line for line in lines)), None)
    cells = [[cell.strip() for cell in line.split(between)] for line in lines]
    heading = list(columns) or (cells.pop(0) if cells else [])
    for row in cells:
        if len(row) != len(heading):
            raise ValueError(f"{' | '.join(row)}, where {', '.join(heading)} belong")
    return [dict(zip(heading, row, strict=True)) for row in cells]


def _json_rows(content: Any) -> list[dict[str, str]]:
    if isinstance(content, dict):
        lists = {name: value for name, value in content.items() if isinstance(value, list)}
        longest = max(map(len, lists.values()), default=0)
        content = [
            {name: value[number] for name, value in lists.items() if len(value) == longest}
            for number in range(longest)
        ]
    if not isinstance(content, list) or not all(isinstance(row, dict) for row in content):
        raise ValueError("neither a list of records nor lists by name")
    return [{name: str(value) for name, value in row.items()} for row in content]


def taken_images(
    manifest: Manifest,
    values: Mapping[str, str],
    table: tuple[Sequence[Row], str] | None,
    folder: Path,
) -> list[TakenImage]:
    """Return the images of a capture: in focus first, then the farthest focus first.

    Parameters
    ----------
    manifest : Manifest
        With the section `files`.
    values : mapping of str to str
        What stands in the patterns' braces.
    table : (list of dict, str) or None
        The rows of the table, and where it is.
    folder : Path
        Where the patterns begin.

    Raises
    ------
    SourceError
        With all that is wrong: numbers that are none, images that the table or the folder lacks,
        a focus twice or nearer than the focal length, one image only.
    """
    files = manifest.files or CapturedFiles()
    taken: list[TakenImage] = []
    if files.infocus is not None:
        taken.append(TakenImage(fill(files.infocus, values), "infocus", {}))
    where, problems = str(folder), list[Problem]()
    rows: Iterable[tuple[str, Row]] = [(fill(files.defocus, values), {})] if files.defocus else ()
    if files.images is not None:
        pattern = fill_known(files.images, values)
        where = table[1] if table else str(folder / pattern)
        beside = {image.path for image in taken}
        rows = list(_rows(pattern, table, folder, beside, problems))
    for path, row in rows:
        try:
            taken.append(_taken(manifest, path, {**values, **row}))
        except ValueError as error:
            problems.append(Problem(str(error), where=where, got=path))
    problems += _odd_ones(taken, where, manifest.pair_images or ())
    SourceError.raise_if(problems)
    near, far = manifest.depth.ends
    return sorted(taken, key=lambda image: _place(image, 1 if near > far else -1))


def _taken(manifest: Manifest, path: str, values: Row) -> TakenImage:
    files, facts = manifest.files or CapturedFiles(), {}
    for name in BY_IMAGE:
        stated = getattr(files, name)
        text = values.get(name, "") if stated is None else _filled(str(stated), values)
        facts[name] = _number(name, text) if text else math.nan
    focal_length = (manifest.rig and manifest.rig.focal_length) or 0.0
    if facts["focus_distance"] <= focal_length:
        focus = f"focus_distance {facts['focus_distance']:g} m"
        raise ValueError(f"{focus} is not beyond the focal length, {focal_length:g} m")
    focused = np.array(facts["focus_depth"])
    facts["focus_depth"] = float(in_unit_of(focused, files, manifest.depth))
    role = values.get("role", "defocus")
    if role not in ROLES:
        raise ValueError(f"role {role} is neither {' nor '.join(ROLES)}")
    return TakenImage(path, ROLES[ROLES.index(role)], facts)


def _filled(pattern: str, values: Row) -> str:
    lacking = [name for name in places_in(pattern) if name not in values]
    if lacking:
        raise ValueError(f"the table has no column {lacking[0]}: it has {', '.join(values)}")
    return fill(pattern, values)


def _number(name: str, text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if math.isnan(number) or (name != "focus_depth" and number <= 0):
        raise ValueError(f"{name} is {text!r}, and not a number{' above 0' * (name[-1] != 'h')}")
    return number


def _rows(
    pattern: str,
    table: tuple[Sequence[Row], str] | None,
    folder: Path,
    beside: set[str],
    problems: list[Problem],
) -> Iterator[tuple[str, Row]]:
    """Yield the files of a stack with their rows; add what does not go together to `problems`."""
    there = {path: number for path, number in _fitting(folder, pattern) if path not in beside}
    numbered = IMAGE in places_in(pattern)
    if table is None:
        yield from ((path, {IMAGE: str(number)}) for path, number in there.items())
        return
    rows, where = table
    if numbered and IMAGE not in rows[0] and len(rows) != len(there):
        what = f"the table has {len(rows)} rows, and there are {len(there)} images"
        problems.append(Problem(what, where=where, got=listed(there, _NAMED)))
        return
    in_order, by_number = list(there), {number: path for path, number in there.items()}
    named = set()
    for index, row in enumerate(rows):
        try:
            if not numbered:
                path = _filled(pattern, row)
            elif IMAGE in row:
                number = int(row[IMAGE])
                path = by_number.get(number, pattern.replace(f"{{{IMAGE}}}", row[IMAGE]))
            else:
                path = in_order[index]
        except ValueError as error:
            problems.append(Problem(str(error), where=where))
            continue
        named.add(path)
        yield path, row
    lacking = [p for p in there if not {p, str(PurePosixPath(p).with_suffix(ANY_ENDING))} & named]
    if lacking:
        what = f"images that the table does not tell of: {listed(lacking, _NAMED)}"
        problems.append(Problem(what, where=where))


def _fitting(folder: Path, pattern: str) -> list[tuple[str, int]]:
    """Return the files that a pattern may mean, whatever stands in its braces, and their number.

    Only the last part of the pattern may differ.
    """
    parent, _, name = pattern.rpartition("/")
    if places_in(parent) or not (folder / parent).is_dir():
        return []
    open_end = name.endswith(ANY_ENDING)
    expression = re.escape(name.removesuffix(ANY_ENDING))
    for place in places_in(name):
        group = r"(?P<number>\d+)" if place == IMAGE else ".+"
        expression = expression.replace(re.escape(f"{{{place}}}"), group, 1)
    found = []
    for path in sorted((folder / parent).iterdir()):
        if open_end and path.suffix.lower() not in SUFFIXES:
            continue
        match = re.fullmatch(expression, path.stem if open_end else path.name)
        if match and path.is_file():
            number = int(match.groupdict().get("number") or 0)
            found.append((f"{parent}/{path.name}".lstrip("/"), number))
    return sorted(found, key=lambda item: item[1])


def _odd_ones(taken: Sequence[TakenImage], where: str, pair: Sequence[int]) -> Iterator[Problem]:
    if max(pair, default=0) >= len(taken) > 1:
        yield Problem(f"pair_images are {pair}, and there are {len(taken)} images", where=where)
    if len(taken) < 2:
        what = f"a stack of one image, {taken[0].path}" if taken else "no image fits the pattern"
        yield Problem(what, where=where)
    seen: dict[tuple[float, ...], str] = {}
    for image in taken:
        at = tuple(image.facts.get(name, math.nan) for name in BY_IMAGE)
        if image.role == "infocus" or all(map(math.isnan, at[:2])):
            continue
        key = tuple(-1.0 if math.isnan(number) else number for number in at)
        other = seen.setdefault(key, image.path)
        if other != image.path:
            focus = at[1] if math.isnan(at[0]) else at[0]
            fix = f"leave {other} or {image.path} out of the table, or mend its focus"
            yield Problem(f"two images are focused at {focus:g}", where=where, fix=fix)


def _place(image: TakenImage, nearness: int) -> tuple[bool, float, float]:
    distance, depth = (image.facts.get(name, math.nan) for name in BY_IMAGE[:2])
    return (
        image.role != "infocus",
        0.0 if math.isnan(distance) else -distance,
        0.0 if math.isnan(depth) else nearness * depth,
    )
