"""A table: columns, rows, notes; and the names of the forms it can be shown in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum


class Format(StrEnum):
    """How tables are printed."""

    table = "table"
    markdown = "markdown"
    latex = "latex"
    csv = "csv"
    json = "json"


class Link(str):
    """A cell's text with the address that it leads to, where the form can show one."""

    target: str

    def __new__(cls, text: str, target: str) -> Link:
        """Return the text, bearing its address."""
        link = super().__new__(cls, text)
        link.target = target
        return link


class Marked(str):
    """A cell's text that stands out where the form can show it: best bold, second underlined."""

    mark: str

    def __new__(cls, text: str, mark: str) -> Marked:
        """Return the text, bearing ``best`` or ``second``."""
        marked = super().__new__(cls, text)
        marked.mark = mark
        return marked


@dataclass(frozen=True)
class Table:
    """Rows of text under headings.

    `align` has a letter a column, ``l`` or ``r``; `rules` are the rows after which a line is
    drawn. `records` are the same rows as data, numbers in full, for CSV and JSON; where there
    are none, those show the text. `parts` are the columns that stand together where a page is too
    narrow for all of them. `label` is what it is referred to by in LaTeX, its title by default.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    align: str
    notes: tuple[str, ...] = ()
    rules: frozenset[int] = field(default_factory=frozenset)
    records: tuple[Mapping[str, object], ...] = ()
    parts: tuple[tuple[int, ...], ...] = ()
    label: str = ""


def least_width(table: Table) -> int:
    """Return the characters that a terminal must have for no word of the cells to be broken.

    Examples
    --------
    >>> least_width(Table("T", ("scenes", "n"), (("Art and Books", "1 000"),), "lr"))
    18
    """
    cells = list(zip(table.columns, *table.rows, strict=True))
    whole = [max(map(len, column)) for column in cells]
    left = [side != "r" for side in table.align]
    words = [
        max((len(word) for cell in column for word in cell.split()), default=0)
        for column, wraps in zip(cells, left, strict=True)
        if wraps
    ]
    # Columns that wrap are narrowed alike, the widest first, down to the longest word of any.
    widest = max(words, default=0)
    widths = [
        min(width, widest) if wraps else width for width, wraps in zip(whole, left, strict=True)
    ]
    return sum(widths) + 3 * len(widths) + 1
