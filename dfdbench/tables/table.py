"""A table before it is rendered, and words for lists and counts."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from html import escape
from typing import TypeVar

Key = TypeVar("Key")
Value = TypeVar("Value")


class Format(StrEnum):
    """How tables are printed."""

    table = "table"
    markdown = "markdown"
    latex = "latex"
    csv = "csv"
    json = "json"


class Link(str):
    """A cell's text with a link, if the form can show one."""

    target: str

    def __new__(cls, text: str, target: str) -> Link:
        """Attach the address."""
        link = super().__new__(cls, text)
        link.target = target
        return link


class Marked(str):
    """A cell's text that stands out, if the form can show it: best bold, second underlined."""

    mark: str

    def __new__(cls, text: str, mark: str) -> Marked:
        """Attach the mark, ``best`` or ``second``."""
        marked = super().__new__(cls, text)
        marked.mark = mark
        return marked


@dataclass(frozen=True)
class Table:
    """Rows of text under headings.

    `align` has a letter per column, ``l`` or ``r``; further columns are aligned to the right.
    `rules` are the rows followed by a line.
    `records` are the same rows as data, numbers in full, for CSV and JSON, which show the text
    without them. `parts` groups the columns for pages too narrow for all of them. `label` names
    the table in LaTeX, by default after its title.
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

    def __post_init__(self) -> None:
        object.__setattr__(self, "align", self.align.ljust(len(self.columns), "r"))

    def __repr__(self) -> str:
        return f"<{self.title}: {counted(len(self.rows), 'row')}>"

    def _repr_html_(self) -> str:
        return as_html(self)

    @property
    def wraps(self) -> tuple[bool, ...]:
        """Whether each column may wrap, which is so if its text has several words."""
        cells = zip(self.columns, *self.rows, strict=True)
        several = (any(" " in cell for cell in column) for column in cells)
        return tuple(s and side != "r" for s, side in zip(several, self.align, strict=True))


def least_width(table: Table) -> int:
    """Return the least width, in characters, of a terminal that breaks no word of the cells.

    Examples
    --------
    >>> least_width(Table("T", ("where", "n"), (("a very long name", "1 000 000"),), "lr"))
    21

    That is the longest word, the whole number, and three characters a column for its lines.
    """
    cells = list(zip(table.columns, *table.rows, strict=True))
    whole = [max(map(len, column)) for column in cells]
    words = [max(len(word) for cell in column for word in cell.split() or [""]) for column in cells]
    # Columns that wrap are narrowed together, widest first, down to the longest word of any.
    widest = max((n for n, wraps in zip(words, table.wraps, strict=True) if wraps), default=0)
    widths = [
        min(width, widest) if wraps else width
        for width, wraps in zip(whole, table.wraps, strict=True)
    ]
    return sum(widths) + 3 * len(widths) + 1


def as_html(table: Table) -> str:
    """Return a table as HTML, its title above and its notes below.

    Examples
    --------
    >>> text = as_html(Table("T", ("a", "n"), (("<x>", "1"),), "lr"))
    >>> "<b>T</b>" in text, "&lt;x&gt;" in text
    (True, True)
    """

    def line(tag: str, cells: tuple[str, ...]) -> str:
        sides = ("right" if side == "r" else "left" for side in table.align)
        return "".join(
            f'<{tag} style="text-align:{side}">{escape(cell)}</{tag}>'
            for cell, side in zip(cells, sides, strict=True)
        )

    body = "".join(f"<tr>{line('td', row)}</tr>" for row in table.rows)
    notes = "".join(f'<p style="font-size:smaller">{escape(note)}</p>' for note in table.notes)
    return (
        f"<p><b>{escape(table.title)}</b></p><table><thead><tr>{line('th', table.columns)}</tr>"
        f"</thead><tbody>{body}</tbody></table>{notes}"
    )


def percent(share: float) -> str:
    """Format a share as a percentage; a non-zero share never prints as 0 %.

    Examples
    --------
    >>> percent(0.1234), percent(0), percent(2e-6)
    ('12.3 %', '0 %', '0.0002 %')
    """
    if share == 0:
        return "0 %"
    if share >= 0.001:
        return f"{100 * share:.1f} %"
    digits = f"{100 * share:.1g}"
    return f"{float(digits):f}".rstrip("0").rstrip(".") + " %" if share >= 1e-8 else "< 0.000001 %"


def counted(number: int, what: str) -> str:
    """Format a number of things.

    Examples
    --------
    >>> counted(1, "pair"), counted(0, "pair"), counted(1234, "scene")
    ('1 pair', '0 pairs', '1234 scenes')
    """
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


def without(table: Table, *columns: str) -> Table:
    """Return a table without the named columns."""
    kept = [at for at, name in enumerate(table.columns) if name not in columns]
    return replace(
        table,
        columns=tuple(table.columns[at] for at in kept),
        rows=tuple(tuple(row[at] for at in kept) for row in table.rows),
        align="".join(table.align[at] for at in kept),
    )


def grouped(things: Iterable[tuple[Key, Value]]) -> dict[Key, list[Value]]:
    """Group values by key, in order of appearance.

    Examples
    --------
    >>> grouped([("a", 1), ("b", 2), ("a", 3)])
    {'a': [1, 3], 'b': [2]}
    """
    found: dict[Key, list[Value]] = {}
    for key, value in things:
        found.setdefault(key, []).append(value)
    return found


def listed(things: Iterable[object], most: int | None = None) -> str:
    """Join things with commas; if there are more than `most`, count the rest.

    Examples
    --------
    >>> listed(["Art", "Books", "Dolls"]), listed(["Art", "Books", "Dolls"], most=2)
    ('Art, Books, Dolls', 'Art, Books and 1 more')
    >>> listed([], most=2), listed(["Art", "Books"], most=2)
    ('', 'Art, Books')
    """
    texts = [str(thing) for thing in things]
    left = 0 if most is None else len(texts) - most
    return ", ".join(texts[:most]) + (f" and {left} more" if left > 0 else "")
