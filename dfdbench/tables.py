"""A table of text, and the forms it can be shown in."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass, field

from rich import box
from rich.table import Table as RichTable
from rich.text import Text


@dataclass(frozen=True)
class Table:
    """Rows of text under headings.

    `align` has a letter a column, ``l`` or ``r``; `rules` are the rows after which a line is
    drawn.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    align: str
    notes: tuple[str, ...] = ()
    rules: frozenset[int] = field(default_factory=frozenset)


def as_rich(table: Table) -> RichTable:
    """Return the table for a terminal; text in it is shown as it is, never as markup."""
    caption = Text("\n".join(table.notes)) if table.notes else None
    shown = RichTable(
        title=Text(table.title, style="bold"), caption=caption, box=box.SIMPLE_HEAD,
        title_justify="left", caption_justify="left",
    )  # fmt: skip
    for column, side in zip(table.columns, table.align, strict=True):
        right = side == "r"
        shown.add_column(
            Text(column), justify="right" if right else "left", no_wrap=right, overflow="fold"
        )
    for number, row in enumerate(table.rows):
        shown.add_row(*(Text(cell) for cell in row), end_section=number in table.rules)
    return shown


def as_markdown(table: Table) -> str:
    r"""Return the table in Markdown; what Markdown or HTML would take for markup is escaped.

    Examples
    --------
    >>> print(as_markdown(Table("T", ("a|b", "n"), (("<x>", "1"),), "lr")))
    **T**
    <BLANKLINE>
    | a\|b | n |
    |:---|---:|
    | &lt;x&gt; | 1 |
    <BLANKLINE>
    """
    lines = [f"**{_escaped(table.title)}**", ""]
    lines.append("| " + " | ".join(map(_escaped, table.columns)) + " |")
    marks = ["---:" if side == "r" else ":---" for side in table.align]
    lines.append("|" + "|".join(marks) + "|")
    lines += ["| " + " | ".join(map(_escaped, row)) + " |" for row in table.rows]
    for note in table.notes:
        lines += ["", _escaped(note)]
    return "\n".join(lines) + "\n"


def as_csv(columns: tuple[str, ...], rows: list[tuple[object, ...]]) -> str:
    r"""Return rows as comma-separated values; None is an empty field.

    Examples
    --------
    >>> as_csv(("a", "b"), [(1, None), ("x,y", 2.5)])
    'a,b\n1,\n"x,y",2.5\n'
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(rows)
    return text.getvalue()


def percent(share: float) -> str:
    """Return a share as text; what is not nothing never reads 0.

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


def _escaped(text: str) -> str:
    for mark, instead in (("&", "&amp;"), ("<", "&lt;"), (">", "&gt;"), ("\n", " ")):
        text = text.replace(mark, instead)
    for mark in "\\|*_`[]":
        text = text.replace(mark, "\\" + mark)
    return text
