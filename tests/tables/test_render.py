from __future__ import annotations

import csv
import io
import json
import re
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dfdbench.tables.render import as_latex, as_markdown, render
from dfdbench.tables.table import Format, Link, Table

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
    assert "a_b" in render([TABLE], Format.table)
    assert "a note, 50 %" in render([TABLE], Format.table)
    assert "| a\\_b | 0.1 |" in render([TABLE], Format.markdown)
    assert "\\toprule" in render([TABLE], Format.latex)
    rows = list(csv.DictReader(io.StringIO(render([TABLE], Format.csv))))
    assert rows[0] == {"method": "a_b", "nrmse": "0.123456789"}
    assert rows[1]["nrmse"] == ""
    assert json.loads(render([TABLE], Format.json))[0]["rows"][0]["nrmse"] == 0.123456789


def test_tables_with_other_columns_share_one_csv_heading() -> None:
    other = Table("U", ("pair",), (("p",),), "l")
    rows = list(csv.DictReader(io.StringIO(render([TABLE, other], Format.csv))))
    assert [row["pair"] for row in rows] == ["", "", "p"]


def test_latex_is_escaped_and_ruled() -> None:
    text = as_latex(Table("50 % & \\x", ("{a}", "#"), (("$_^~", "<|>"),), "lr"))
    assert r"\caption{50 \% \& \textbackslash{}x}" in text
    assert r"\{a\} & \# \\" in text
    assert r"\$\_\textasciicircum{}\textasciitilde{} & $<$$|$$>$ \\" in text
    assert as_latex(TABLE).count(r"\midrule") == 2


def test_latex_has_a_label_notes_to_the_left_and_parts_one_below_the_other() -> None:
    text = as_latex(replace(TABLE, parts=((0,), (0, 1))))
    assert r"\caption{T \& co}\label{tab:t-co}" in text
    assert r"{\raggedright\footnotesize a note, 50 \%.\par}" in text
    assert re.findall(r"\\begin\{tabular\}\{@\{\}(.*?)@", text) == ["l", "lr"]
    assert text.count(r"\toprule") == text.count(r"\end{tabular}}") == 2


def test_a_row_that_begins_with_a_bracket_is_no_argument_of_the_line_break() -> None:
    text = as_latex(Table("t", ("a",), (("x",), ("[3pt]",)), "l"))
    assert "{[}3pt{]}" in text


def test_a_link_leads_where_it_says_and_breaks_nothing() -> None:
    assert "[r\\|x](results/a%20b%281%29.json)" in as_markdown(TABLE)


@given(st.text(max_size=30))
def test_any_text_keeps_a_markdown_table_whole(text: str) -> None:
    lines = as_markdown(Table("t", ("a", "b"), ((text, "1"),), "lr")).split("\n")
    assert len(lines) == 6
    assert len(re.findall(r"(?<!\\)\|", lines[4].replace("\\\\", ""))) == 3
    assert "<" not in lines[4]


@pytest.mark.parametrize("text", ["$x$", "~~x~~"])
def test_github_takes_it_for_no_formula_and_strikes_nothing(text: str) -> None:
    assert text[0] not in as_markdown(Table("t", ("a",), ((text,),), "l"))


def test_a_line_break_does_not_break_the_table() -> None:
    lines = as_markdown(Table("t", ("a", "b"), (("x\ny", "1"),), "lr")).splitlines()
    assert "| x y | 1 |" in lines
