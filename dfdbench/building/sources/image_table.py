"""Read a table with a row per image: JSON, or text."""

import csv
import json
import math
import re
from collections.abc import Sequence
from pathlib import PurePath
from typing import Any

from dfdbench.building.sources.image_files import SUFFIXES
from dfdbench.datasets.captured_files import IMAGE
from dfdbench.errors import SourceError


def read_table(content: bytes, where: str, columns: Sequence[str]) -> list[dict[str, str]]:
    r"""Read a table from a file: JSON, or text separated by tabs, semicolons, commas or blanks.

    Parameters
    ----------
    content : bytes
        JSON holds a list of records, lists of one length by name, or a value by image file. Text
        has a heading unless `columns` are given. Empty lines, and lines that begin with ``#``, are
        ignored.
    where : str
        The file's name, for messages.
    columns : sequence of str
        The names of the columns, for a text without a heading.

    Raises
    ------
    SourceError
        If it is not such a table, or a row is too short or too long.

    Examples
    --------
    >>> read_table(b"run, focus_distance\nrun_1, 0.82", "metadata.csv", [])
    [{'run': 'run_1', 'focus_distance': '0.82'}]
    >>> read_table(b'{"views": 61, "focus_depth": [-3.1, 0.5]}', "focus.json", [])
    [{'focus_depth': '-3.1'}, {'focus_depth': '0.5'}]
    >>> read_table(b'{"a_1.png": 0.5}', "focus.json", [])
    [{'image': 'a_1.png', 'value': '0.5'}]
    """
    is_json = where.endswith(".json")
    try:
        text = content.decode("utf-8-sig")  # some editors begin it with a mark
        rows = _json_rows(json.loads(text)) if is_json else _text_rows(text, columns)
    except (ValueError, csv.Error) as error:
        fix = "a text without a heading needs `columns` under [files]" * (not columns)
        fix = "mend the JSON there, or fetch the file again" if is_json else fix
        raise SourceError(f"no table of the images: {error}", where=where, fix=fix) from error
    if not rows:
        raise SourceError("the table of the images is empty", where=where)
    return rows


def _text_rows(text: str, columns: Sequence[str]) -> list[dict[str, str]]:
    lines = [line.strip() for line in text.splitlines()]
    lines = [line for line in lines if line and not line.startswith("#")]
    between = next((mark for mark in "\t;," if lines and mark in lines[0]), " ")
    lines = [" ".join(line.split()) for line in lines] if between == " " else lines
    how: Any = {"delimiter": between, "skipinitialspace": True, "strict": True}
    # One by one: a quote that is not closed must not swallow the lines that follow.
    cells = [[cell.strip() for cell in row] for line in lines for row in csv.reader([line], **how)]
    if between != ",":
        # A spreadsheet that separates cells by semicolons may write 1,2 for 1.2.
        cells = [[re.sub(r"^([+-]?\d+),(\d+)$", r"\1.\2", cell) for cell in row] for row in cells]
    heading = list(columns) or (cells.pop(0) if cells else [])
    for row in cells:
        if len(row) != len(heading):
            raise ValueError(f"{' | '.join(row)}, where {', '.join(heading)} belong")
    return [dict(zip(heading, row, strict=True)) for row in cells]


def _json_rows(content: Any) -> list[dict[str, str]]:
    if isinstance(content, dict) and all(PurePath(n).suffix.lower() in SUFFIXES for n in content):
        told = ((n, v if isinstance(v, dict) else {"value": v}) for n, v in content.items())
        content = [{IMAGE: name, **values} for name, values in told]
    if isinstance(content, dict):
        # An exported stack keeps what is known of its images under `coordinates`.
        more = content.get("coordinates")
        content = {**content, **more} if isinstance(more, dict) else content
        lists = {name: value for name, value in content.items() if isinstance(value, list)}
        longest = max(map(len, lists.values()), default=0)
        content = [
            {name: value[number] for name, value in lists.items() if len(value) == longest}
            for number in range(longest)
        ]
    if not isinstance(content, list) or not all(isinstance(row, dict) for row in content):
        raise ValueError("neither a list of records nor lists by name")
    # Like an empty cell of a text: unknown.
    return [{n: "" if value is None else str(value) for n, value in row.items()} for row in content]


def number_in(text: str) -> int | float | None:
    """Return the finite number in a cell, a whole one exactly; None if there is none."""
    try:
        number = float(text)
    except ValueError:
        return None
    if not math.isfinite(number):
        return None
    return int(text) if text.strip().isdigit() else number
