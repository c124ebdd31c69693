"""A table in each of its forms: terminal, Markdown, LaTeX, CSV, JSON."""

from __future__ import annotations

import csv
import io
import json
import re
import unicodedata
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING
from urllib.parse import quote

from dfdbench.errors import spelt_out
from dfdbench.tables.table import Format, Link, Marked, Table, least_width

if TYPE_CHECKING:
    from rich.table import Table as RichTable
    from rich.text import Text

# What a spreadsheet takes for the start of a formula.
_GROUPED = re.compile(r"\d{1,3}(,\d{3})+")
_FORMULA = tuple("=+-@")
# What Markdown and HTML would take for markup. Even escaped, GitHub takes dollars for formulas and
# tildes for struck-out text, and the site takes braces for attributes.
_MARKDOWN = {ord(mark): f"\\{mark}" for mark in "\\|*_`[]"}
_MARKDOWN |= {ord(mark): f"&#{ord(mark)};" for mark in "$~{}"}
_MARKDOWN |= {ord("&"): "&amp;", ord("<"): "&lt;", ord(">"): "&gt;"}
# What starts a block at the beginning of a line: a heading, a list, an admonition, a rule.
_BLOCK = re.compile(r"[#+\-=!:]|\d+[.)](\s|$)")
_LATEX = {mark: f"\\{mark}" for mark in "{}$&#%_"} | {mark: f"${mark}$" for mark in "<>|"}
_COMMANDS = ["times", "pm", "le", "ge", "delta", "downarrow", "uparrow", "to"]
_LATEX |= dict(zip("×±≤≥δ↓↑→", [rf"$\{command}$" for command in _COMMANDS], strict=True))
_LATEX |= dict(
    zip('[]"–—−‘’“”', ["{[}", "{]}", "''", "--", "---", "$-$", "`", "'", "``", "''"], strict=True)
)
_LATEX |= dict(zip("°²³…", [r"$^\circ$", r"$^2$", r"$^3$", r"\dots{}"], strict=True))
_LATEX |= {"\\": r"\textbackslash{}", "^": r"\textasciicircum{}", "~": r"\textasciitilde{}"}
_MINUS = re.compile(r"(?<![\w.])-(?=\.?\d)")
# The non-ASCII letters that LaTeX's own fonts are known to have.
_LETTERS = {*map(chr, range(0xC0, 0x100))} - {*"ÐðÞþ×÷"} | {*"œłıŒŁčćěńřšžČĆĚŃŘŠŽ"}


def render(tables: Sequence[Table], format: Format) -> str:
    r"""Render tables in one of the forms.

    Parameters
    ----------
    tables : sequence of Table
        The tables to show, in this order. CSV has one heading with the columns of all of them.
    format : Format
        The form.

    Examples
    --------
    >>> table = Table("T", ("a", "n"), (("x", "1"),), "lr")
    >>> render([table], Format.csv)
    'a,n\nx,1\n'
    """
    if format is Format.table:
        from rich.console import Console

        # The output is captured, so there is no terminal that lines have to fit.
        width = max(map(least_width, tables), default=0)
        console = Console(file=io.StringIO(), width=max(width, 400), color_system=None)
        with console.capture() as captured:
            for table in tables:
                for part in as_rich(table):
                    console.print(part)
        return "\n".join(line.rstrip() for line in captured.get().splitlines()) + "\n"
    if format is Format.csv:
        records = [record for table in tables for record in _records(table)]
        columns = tuple(dict.fromkeys(name for record in records for name in record))
        return as_csv(columns, [tuple(map(record.get, columns)) for record in records])
    if format is Format.json:
        return as_json(tables)
    write = as_latex if format is Format.latex else as_markdown
    return "\n".join(write(table) for table in tables)


def as_json(tables: Sequence[Table] = (), **facts: object) -> str:
    """Return facts, and tables under the name ``tables``, as one JSON document.

    Parameters
    ----------
    tables : sequence of Table
        Each becomes an object of its title, its rows as data, and its notes; may be empty.
    **facts
        Facts by name. Values that JSON cannot hold, such as paths, become text; a number that is
        not finite becomes null.

    Examples
    --------
    >>> print(as_json(store="demo-1.zarr", sound=True), end="")
    {
     "store": "demo-1.zarr",
     "sound": true
    }
    """
    if tables:
        facts["tables"] = [
            {"title": table.title, "rows": _records(table), "notes": table.notes}
            for table in tables
        ]
    text = json.dumps(facts, default=lambda one: one.item() if hasattr(one, "item") else str(one))
    found = json.loads(text, parse_constant=lambda _: None)
    return json.dumps(found, indent=1, allow_nan=False) + "\n"


def _records(table: Table) -> list[Mapping[str, object]]:
    if table.records:
        return list(table.records)
    return [dict(zip(table.columns, row, strict=True)) for row in table.rows]


def as_rich(table: Table) -> tuple[Text | RichTable, ...]:
    """Return title, table and notes for a terminal; text is never taken for markup.

    They are separate because Rich would wrap a title and a caption at the table's width.
    """
    from rich import box
    from rich.table import Table as RichTable
    from rich.text import Text

    notes = [Text(spelt_out(note), style="dim italic") for note in table.notes]
    shown = RichTable(box=box.SIMPLE_HEAD)
    for column, side, wraps in zip(table.columns, table.align, table.wraps, strict=True):
        shown.add_column(
            Text(spelt_out(column)),
            justify="right" if side == "r" else "left",
            no_wrap=not wraps,
            overflow="fold",
        )
    for number, row in enumerate(table.rows):
        shown.add_row(*map(_rich_cell, row), end_section=number in table.rules)
    title = Text(spelt_out(table.title), style="bold italic")
    return (title, shown, *notes) if table.rows else (title, *notes)


def _rich_cell(text: str) -> Text:
    from rich.text import Text

    styles = {"best": "bold", "second": "underline"}
    return Text(spelt_out(text), styles[text.mark] if isinstance(text, Marked) else "")


def as_markdown(table: Table) -> str:
    r"""Return the table in Markdown, with markup in its text escaped.

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

    An apostrophe precedes text that a spreadsheet would take for a formula, as OWASP advises
    against CSV injection. Commas between thousands are dropped.

    Examples
    --------
    >>> as_csv(("a", "b"), [(1, None), ("x,y", -2.5), ("=1+1", "60,353")])
    'a,b\n1,\n"x,y",-2.5\n\'=1+1,60353\n'
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(map(_csv_cell, columns))
    writer.writerows(map(_csv_cell, row) for row in rows)
    return text.getvalue()


def _csv_cell(value: object) -> object:
    if not isinstance(value, str):
        return value
    if _GROUPED.fullmatch(value):
        return value.replace(",", "")
    # A spreadsheet takes it for a formula even after blanks.
    formula = value.lstrip().startswith(_FORMULA) and not _is_number(value)
    return ("'" if formula else "") + spelt_out(value)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def as_latex(table: Table) -> str:
    r"""Return the table for a paper, as LaTeX with booktabs and all text escaped.

    The table's `parts` come one below the other. A table wider than the page's text is scaled down
    to it.

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
    r"""Return text on one line, with the markup of Markdown and HTML escaped.

    This covers GitHub's Markdown and that of the documentation site, where braces set attributes.
    A plain address stays as it is: both may show it as a link.

    Examples
    --------
    >>> escape_markdown("<b>a|b</b>")
    '&lt;b&gt;a\\|b&lt;/b&gt;'
    >>> escape_markdown("a {: onclick=f }")
    'a &#123;: onclick=f &#125;'
    """
    return spelt_out(" ".join(text.splitlines())).translate(_MARKDOWN)


def latex_text(text: str) -> str:
    r"""Return text as LaTeX; letters that its fonts lack appear as their code point.

    Examples
    --------
    >>> print(latex_text("a_b: -0.5 to 50 %, 🐟"))
    a\_b: $-$0.5 to 50 \%, {[}U+1F41F{]}
    """
    return "".join(map(_letter, _MINUS.sub("−", text)))


def latex_label(text: str) -> str:
    """Return a table's LaTeX label, made from the words of a text.

    Examples
    --------
    >>> latex_label("demo-1, split test, protocol thesis")
    'tab:demo-1-split-test-protocol-thesis'
    """
    return "tab:" + "-".join(re.findall(r"[a-z0-9]+", text.lower()))


def _letter(letter: str) -> str:
    if letter in _LATEX:
        return _LATEX[letter]
    category = unicodedata.category(letter)
    if category[0] in "CZ":
        return " "
    plain = letter.isascii() or letter in _LETTERS
    return letter if plain else f"{{[}}U+{ord(letter):04X}{{]}}"
