"""A table in each of its forms: terminal, Markdown, LaTeX, CSV, JSON."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from urllib.parse import quote

from rich import box
from rich.console import Console
from rich.table import Table as RichTable
from rich.text import Text

from dfdbench.tables.latex_text import latex_label, latex_text
from dfdbench.tables.table import Format, Link, Table


def render(tables: Sequence[Table], format: Format, width: int | None = None) -> str:
    r"""Return tables in one of the forms.

    Parameters
    ----------
    tables : sequence of Table
        What to show, in this order. CSV holds one heading: the columns of all of them.
    format : Format
        The form.
    width : int, optional
        Of the terminal, in characters, for `Format.table`; as wide as need be where not given.

    Examples
    --------
    >>> table = Table("T", ("a", "n"), (("x", "1"),), "lr")
    >>> render([table], Format.csv)
    'a,n\nx,1\n'
    """
    if format is Format.table:
        # Captured, there is no terminal to fit: lines are as long as they need be.
        console = Console(file=io.StringIO(), width=width or 400, color_system=None)
        with console.capture() as captured:
            for table in tables:
                console.print(as_rich(table))
        return "\n".join(line.rstrip() for line in captured.get().splitlines()) + "\n"
    if format is Format.csv:
        records = [record for table in tables for record in _records(table)]
        columns = tuple(dict.fromkeys(name for record in records for name in record))
        rows: list[tuple[object, ...]] = [
            tuple(record.get(name) for name in columns) for record in records
        ]
        return as_csv(columns, rows)
    if format is Format.json:
        content = [
            {"title": table.title, "rows": _records(table), "notes": table.notes}
            for table in tables
        ]
        return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    write = as_latex if format is Format.latex else as_markdown
    return "\n".join(write(table) for table in tables)


def _records(table: Table) -> list[Mapping[str, object]]:
    if table.records:
        return list(table.records)
    return [dict(zip(table.columns, row, strict=True)) for row in table.rows]


def as_rich(table: Table) -> RichTable:
    """Return the table for a terminal; text in it is shown as it is, never as markup."""
    caption = Text("\n".join(table.notes)) if table.notes else None
    shown = RichTable(
        title=Text(table.title, style="bold"),
        caption=caption,
        box=box.SIMPLE_HEAD,
        title_justify="left",
        caption_justify="left",
    )
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
    lines = [f"**{escape_markdown(table.title)}**", ""]
    lines.append("| " + " | ".join(map(escape_markdown, table.columns)) + " |")
    marks = ["---:" if side == "r" else ":---" for side in table.align]
    lines.append("|" + "|".join(marks) + "|")
    lines += ["| " + " | ".join(map(_markdown_cell, row)) + " |" for row in table.rows]
    for note in table.notes:
        lines += ["", escape_markdown(note)]
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


def as_latex(table: Table) -> str:
    r"""Return the table for a paper: LaTeX with booktabs, whatever text it holds.

    Where the table has `parts`, they stand one below the other. What is wider than the text is
    scaled down to it.

    Examples
    --------
    >>> print(as_latex(Table("T", ("a_b", "NRMSE ↓"), (("50 %", "-0.1"),), "lr")))
    % \usepackage{booktabs,graphicx}
    \begin{table}
      \centering\small\setlength{\tabcolsep}{4pt}
      \caption{T}\label{tab:t}
      \resizebox{\ifdim\width>\linewidth\linewidth\else\width\fi}{!}{%
      \begin{tabular}{@{}lr@{}}
        \toprule
        a\_b & NRMSE $\downarrow$ \\
        \midrule
        50 \% & $-$0.1 \\
        \bottomrule
      \end{tabular}}
    \end{table}
    <BLANKLINE>
    """
    lines = [
        r"% \usepackage{booktabs,graphicx}",
        r"\begin{table}",
        r"  \centering\small\setlength{\tabcolsep}{4pt}",
        rf"  \caption{{{latex_text(table.title)}}}\label{{{latex_label(table.title)}}}",
    ]
    for number, part in enumerate(table.parts or (tuple(range(len(table.columns))),)):
        lines += [r"  \par\medskip"] * (number > 0) + _tabular(table, part)
    if table.notes:
        notes = " ".join(latex_text(_sentence(note)) for note in table.notes)
        lines.append(rf"  \par\smallskip{{\raggedright\footnotesize {notes}\par}}")
    return "\n".join([*lines, r"\end{table}"]) + "\n"


def _tabular(table: Table, part: Sequence[int]) -> list[str]:
    def line(cells: Sequence[str]) -> str:
        return "    " + " & ".join(latex_text(cells[column]) for column in part) + r" \\"

    align = "".join(table.align[column] for column in part)
    lines = [r"  \resizebox{\ifdim\width>\linewidth\linewidth\else\width\fi}{!}{%"]
    lines += [rf"  \begin{{tabular}}{{@{{}}{align}@{{}}}}", r"    \toprule"]
    lines += [line(table.columns), r"    \midrule"]
    for number, row in enumerate(table.rows):
        lines.append(line(row))
        if number in table.rules and number < len(table.rows) - 1:
            lines.append(r"    \midrule")
    return [*lines, r"    \bottomrule", r"  \end{tabular}}"]


def _sentence(note: str) -> str:
    return note if note.endswith((".", ";")) else f"{note}."


def _markdown_cell(text: str) -> str:
    if isinstance(text, Link):
        return f"[{escape_markdown(text)}]({quote(text.target, safe='/#:.-_=')})"
    return escape_markdown(text)


def escape_markdown(text: str) -> str:
    r"""Return text on one line, with what Markdown or HTML would take for markup escaped.

    Examples
    --------
    >>> escape_markdown("<b>a|b</b>")
    '&lt;b&gt;a\\|b&lt;/b&gt;'
    """
    text = " ".join(text.splitlines())
    # GitHub takes dollars for formulas and tildes for struck-out text, escaped or not.
    for mark, instead in zip("&<>$~", ("&amp;", "&lt;", "&gt;", "&#36;", "&#126;"), strict=True):
        text = text.replace(mark, instead)
    for mark in "\\|*_`[]":
        text = text.replace(mark, "\\" + mark)
    return text
