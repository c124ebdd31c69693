import csv
import io
import json
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dfdbench.tables import render
from dfdbench.tables.table import Format, Link, Marked, Table

TABLE = Table(
    "T & co",
    ("method", "NRMSE ↓"),
    (("a_b", "0.1"), (Link("r|x", "results/a b(1).json"), "–")),
    "lr",
    ("a note, 50 %",),
    frozenset({0}),
    ({"method": "a_b", "nrmse": 0.123456789}, {"method": "r|x", "nrmse": None}),
)


def test_every_form_comes_from_one_place() -> None:
    assert "| a\\_b | 0.1 |" in render.render([TABLE], Format.markdown)
    rows = list(csv.DictReader(io.StringIO(render.render([TABLE], Format.csv))))
    assert (rows[0], rows[1]["nrmse"]) == ({"method": "a_b", "nrmse": "0.123456789"}, "")
    (table,) = json.loads(render.render([TABLE], Format.json))["tables"]
    assert table["rows"][0]["nrmse"] == 0.123456789


def test_tables_with_other_columns_share_one_csv_heading() -> None:
    other = Table("U", ("pair",), (("p",),), "l")
    rows = list(csv.DictReader(io.StringIO(render.render([TABLE, other], Format.csv))))
    assert [row["pair"] for row in rows] == ["", "", "p"]


def test_latex_is_escaped_and_ruled() -> None:
    text = render.as_latex(Table("50 % & \\x", ("{a}", "#"), (("$_^~", "<|>"),), "lr"))
    assert r"\caption{50 \% \& \textbackslash{}x}" in text
    assert r"\{a\} & \# \\" in text
    assert r"\$\_\textasciicircum{}\textasciitilde{} & $<$$|$$>$ \\" in text
    assert render.as_latex(TABLE).count(r"\midrule") == 2


def test_latex_has_a_label_notes_to_the_left_and_parts_one_below_the_other() -> None:
    text = render.as_latex(replace(TABLE, parts=((0,), (0, 1))))
    assert r"\caption{T \& co}\label{tab:t-co}" in text
    assert r"{\raggedright\footnotesize a note, 50 \%.\par}" in text
    assert re.findall(r"\\begin\{tabular\}\{@\{\}(.*?)@", text) == ["l", "lr"]
    assert text.count(r"\toprule") == text.count(r"\end{tabular}}") == 2


def test_what_stands_out_does_so_where_the_form_can_show_it() -> None:
    cells = (Marked("0.1_", "best"), Marked("0.2", "second"))
    table = Table("t", ("a", "b"), (cells,), "rr")
    assert r"\textbf{0.1\_} & \underline{0.2} \\" in render.as_latex(table)
    assert r"| <b>0.1\_</b> | <u>0.2</u> |" in render.as_markdown(table)
    assert render.render([table], Format.csv) == "a,b\n0.1_,0.2\n"
    assert "0.1_   0.2" in render.render([table], Format.table)


@given(st.text(max_size=30))
def test_any_text_keeps_a_markdown_table_whole(text: str) -> None:
    lines = render.as_markdown(Table("t", ("a", "b"), ((text, "1"),), "lr")).split("\n")
    assert len(lines) == 6
    assert len(re.findall(r"(?<!\\)\|", lines[4].replace("\\\\", ""))) == 3
    assert "<" not in lines[4]


_INJECTED = (
    "nice paper {: onmouseover=alert(1) style=position:fixed }",
    "<b onclick=alert(1)>x</b>",
    "[x](javascript:alert(1))",
    '<div markdown="1" onclick=alert(1)>',
    "!!! danger",
)


@pytest.mark.parametrize("text", _INJECTED)
def test_no_text_makes_an_element_or_an_attribute_on_the_site(text: str) -> None:
    markdown = pytest.importorskip("markdown")
    pytest.importorskip("pymdownx")
    configuration = Path("mkdocs.yml").read_text("utf-8").partition("markdown_extensions:")[2]
    listed = re.findall(r"^  - ([\w.]+):?$", configuration.partition("\nvalidation:")[0], re.M)
    assert {"attr_list", "md_in_html", "tables", "admonition"} <= {*listed}

    def page(text: str) -> str:
        table = Table(text, ("a", text), ((text, "1"), ("b", text)), "lr", (text,))
        found: str = markdown.markdown(render.as_markdown(table), extensions=listed)
        return re.sub(r">[^<>]+<", ">words<", found)

    # The same elements and attributes as plain words have, and nothing else.
    assert page(text) == page("plain words")


def test_a_note_begins_no_block() -> None:
    for note in ("# a", "- a", "+ a", "1. a", "12) a", "!!! a", "    a", "=== a"):
        last = render.as_markdown(Table("t", ("a",), (), "l", (note,))).splitlines()[-1]
        assert re.match(r"[&a]", last), last


@pytest.mark.parametrize("format", Format)
def test_what_cannot_be_seen_is_spelt_out_in_every_form(format: Format) -> None:
    text = "a\x1b[2J\x07\x9b\u202e\u2066\u200b\u2028b"
    shown = render.render([Table(text, (text,), ((text,),), "l", (text,))], format)
    assert all(letter.isprintable() or letter == "\n" for letter in shown)
    if format is Format.json:
        assert json.loads(shown)["tables"][0]["rows"] == [{text: text}]


def test_a_spreadsheet_takes_no_text_for_a_formula() -> None:
    cells = ("=cmd|calc:x", "+1+1", "-1+1", "@a", " =1", "-2.5", "+3", "plain")
    table = Table("t", ("a",), tuple((cell,) for cell in cells), "l", records=({"a": -0.5},))
    lines = render.render([replace(table, records=())], Format.csv).splitlines()[1:]
    assert lines == ["'=cmd|calc:x", "'+1+1", "'-1+1", "'@a", "' =1", "-2.5", "+3", "plain"]
    assert render.render([table], Format.csv) == "a\n-0.5\n"


NAMES = ("Łódź's Übung", "🐟 fish", "日本", "a_b%&#$~^\\{}", "[3pt]", "-0.5 to -.25", "\u200bx\x07")


def test_minus_signs_and_foreign_letters() -> None:
    for text, shown in (
        ("-0.5 (-0.1 to +0.2)", "$-$0.5 ($-$0.1 to +0.2)"),
        ("demo-1, 2005-2006, 1e-3", "demo-1, 2005-2006, 1e-3"),
        ("δ < 1.25², 1.25³", r"$\delta$ $<$ 1.25$^2$, 1.25$^3$"),
        ("in 90 % intervals → 0.9", r"in 90 \% intervals $\to$ 0.9"),
        ("é ß ą 🐟", "é ß {[}U+0105{]} {[}U+1F41F{]}"),
    ):
        assert render.latex_text(text) == shown


@given(st.text(max_size=40))
def test_nothing_is_left_that_latex_takes_for_a_command(text: str) -> None:
    found = render.latex_text(text)
    assert all(letter == " " or letter.isprintable() for letter in found)
    assert max(found, default=" ") <= "\u017e"
    bare = re.sub(
        r"\\[a-z]+\{\}|\$\\?[a-z<>|-]+\$|\$\^(?:\\circ|[23])\$|\\[{}$&#%_]|\{\[\}|\{\]\}", "", found
    )
    assert not set(bare) & set("\\{}$&#%_^~")


@pytest.mark.skipif(not shutil.which("pdflatex"), reason="no pdflatex here")
def test_latex_takes_any_name_and_no_table_is_too_wide(tmp_path: Path) -> None:
    table = Table(
        "\\input{x} & co",
        ("name", "long"),
        tuple((Marked(name, mark), "w " * 60) for name in NAMES for mark in ("best", "second")),
        "lr",
        ("a note, 50 %",),
        parts=((0,), (0, 1)),
    )
    text = render.as_latex(table)
    packages = re.findall(r"% \\usepackage\{(.*)\}", text)[0]
    (tmp_path / "t.tex").write_text(
        rf"\documentclass{{article}}\usepackage{{{packages}}}\begin{{document}}{text}\end{{document}}",
        encoding="utf-8",
    )
    command = ("pdflatex", "-interaction=nonstopmode", "-halt-on-error", "t.tex")
    ran = subprocess.run(command, cwd=tmp_path, capture_output=True, check=False)
    told = ran.stdout.decode("utf-8", "replace")
    assert ran.returncode == 0, told
    assert "Overfull" not in told
