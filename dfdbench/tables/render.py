"""A table in each of its forms: terminal, Markdown, LaTeX, CSV, JSON."""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Mapping, Sequence
from urllib.parse import quote

from rich import box
from rich.console import Console
from rich.table import Table as RichTable
from rich.text import Text

from dfdbench.tables.latex_text import latex_label, latex_text
from dfdbench.tables.shown_text import spelt_out, spelt_out_json
from dfdbench.tables.table import Format, Link, Marked, Table

# What a spreadsheet takes for the beginning of a formula.
_FORMULA = tuple("=+-@")
# GitHub takes dollars for formulas and tildes for struck-out text, escaped or not; the site takes
# braces for attributes, escaped or not.
_ENTITIES = {
    "&": "&amp;",
    "<": "&lt;",
    ">": "&gt;",
    "$": "&#36;",
    "~": "&#126;",
    "{": "&#123;",
    "}": "&#125;",
}
# What begins a block where a line begins with it: a heading, a list, an admonition, a rule.
_BLOCK = re.compile(r"[#+\-=!:]|\d+[.)]")


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
                for part in as_rich(table):
                    console.print(part)
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
        text = json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False)
        return spelt_out_json(text) + "\n"
    write = as_latex if format is Format.latex else as_markdown
    return "\n".join(write(table) for table in tables)


def _records(table: Table) -> list[Mapping[str, object]]:
    if table.records:
        return list(table.records)
    return [dict(zip(table.columns, row, strict=True)) for row in table.rows]


def as_rich(table: Table) -> tuple[Text | RichTable, ...]:
    """Return title, table and notes for a terminal; text is shown as it is, never as markup.

    They stand apart, for Rich would break a title and a caption at the table's width.
    """
    notes = [Text(spelt_out(note), style="dim italic") for note in table.notes]
    shown = RichTable(box=box.SIMPLE_HEAD)
    for column, side in zip(table.columns, table.align, strict=True):
        right = side == "r"
        shown.add_column(
            Text(spelt_out(column)),
            justify="right" if right else "left",
            no_wrap=right,
            overflow="fold",
        )
    for number, row in enumerate(table.rows):
        shown.add_row(*map(_rich_cell, row), end_section=number in table.rules)
    return Text(spelt_out(table.title), style="bold italic"), shown, *notes


def _rich_cell(text: str) -> Text:
    styles = {"best": "bold", "second": "underline"}
    return Text(spelt_out(text), styles[text.mark] if isinstance(text, Marked) else "")


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
        lines += ["", _markdown_line(note)]
    return "\n".join(lines) + "\n"


def as_csv(columns: tuple[str, ...], rows: list[tuple[object, ...]]) -> str:
    r"""Return rows as comma-separated values; None is an empty field.

    Text that a spreadsheet would take for a formula has an apostrophe before it, as OWASP advises
    (CSV injection); numbers have none.

    Examples
    --------
    >>> as_csv(("a", "b"), [(1, None), ("x,y", -2.5), ("=1+1", "-2.5")])
    'a,b\n1,\n"x,y",-2.5\n\'=1+1,-2.5\n'
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(map(_csv_cell, columns))
    writer.writerows(map(_csv_cell, row) for row in rows)
    return text.getvalue()


def _csv_cell(value: object) -> object:
    if not isinstance(value, str):
        return value
    # Blanks before it do not keep a spreadsheet from it.
    formula = value.lstrip().startswith(_FORMULA) and not _is_number(value)
    return ("'" if formula else "") + spelt_out(value)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


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
    label = latex_label(table.label or table.title)
    lines = [
        r"% \usepackage{booktabs,graphicx}",
        r"\begin{table}",
        r"  \centering\small\setlength{\tabcolsep}{4pt}",
        rf"  \caption{{{latex_text(table.title)}}}\label{{{label}}}",
    ]
    for number, part in enumerate(table.parts or (tuple(range(len(table.columns))),)):
        lines += [r"  \par\medskip"] * (number > 0) + _tabular(table, part)
    if table.notes:
        notes = " ".join(latex_text(_sentence(note)) for note in table.notes)
        lines.append(rf"  \par\smallskip{{\raggedright\footnotesize {notes}\par}}")
    return "\n".join([*lines, r"\end{table}"]) + "\n"


def _tabular(table: Table, part: Sequence[int]) -> list[str]:
    def line(cells: Sequence[str]) -> str:
        return "    " + " & ".join(_latex_cell(cells[column]) for column in part) + r" \\"

    align = "".join(table.align[column] for column in part)
    lines = [r"  \resizebox{\ifdim\width>\linewidth\linewidth\else\width\fi}{!}{%"]
    lines += [rf"  \begin{{tabular}}{{@{{}}{align}@{{}}}}", r"    \toprule"]
    lines += [line(table.columns), r"    \midrule"]
    for number, row in enumerate(table.rows):
        lines.append(line(row))
        if number in table.rules and number < len(table.rows) - 1:
            lines.append(r"    \midrule")
    return [*lines, r"    \bottomrule", r"  \end{tabular}}"]


def _latex_cell(text: str) -> str:
    commands = {"best": r"\textbf", "second": r"\underline"}
    shown = latex_text(text)
    return f"{commands[text.mark]}{{{shown}}}" if isinstance(text, Marked) else shown


def _sentence(note: str) -> str:
    return note if note.endswith((".", ";")) else f"{note}."


def _markdown_cell(text: str) -> str:
    if isinstance(text, Link):
        return f"[{escape_markdown(text)}]({quote(text.target, safe='/#:.-_=')})"
    if isinstance(text, Marked):
        tag = {"best": "b", "second": "u"}[text.mark]
        return f"<{tag}>{escape_markdown(text)}</{tag}>"
    return escape_markdown(text)


def _markdown_line(text: str) -> str:
    line = escape_markdown(text).lstrip()
    return f"&#{ord(line[0])};{line[1:]}" if _BLOCK.match(line) else line


def escape_markdown(text: str) -> str:
    r"""Return text on one line, with what Markdown or HTML would take for markup escaped.

    Markdown is GitHub's and the documentation site's, whose braces give attributes to what stands
    before them. A plain address stays one, which both may show as the link that it is.

    Examples
    --------
    >>> escape_markdown("<b>a|b</b>")
    '&lt;b&gt;a\\|b&lt;/b&gt;'
    >>> escape_markdown("a {: onclick=f }")
    'a &#123;: onclick=f &#125;'
    """
    text = spelt_out(" ".join(text.splitlines()))
    for mark, instead in _ENTITIES.items():
        text = text.replace(mark, instead)
    for mark in "\\|*_`[]":
        text = text.replace(mark, "\\" + mark)
    return text
