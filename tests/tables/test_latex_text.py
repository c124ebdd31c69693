import re
import shutil
import subprocess
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dfdbench.tables.latex_text import latex_label, latex_text
from dfdbench.tables.render import as_latex
from dfdbench.tables.table import Marked, Table

NAMES = ("Łódź's Übung", "🐟 fish", "日本", "a_b%&#$~^\\{}", "[3pt]", "-0.5 to -.25", "\u200bx\x07")


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("-0.5 (-0.1 to +0.2)", "$-$0.5 ($-$0.1 to +0.2)"),
        ("demo-1, 2005-2006, 1e-3", "demo-1, 2005-2006, 1e-3"),
        ("δ < 1.25², 1.25³", r"$\delta$ $<$ 1.25$^2$, 1.25$^3$"),
        ("é ß ą 🐟", "é ß {[}U+0105{]} {[}U+1F41F{]}"),
    ],
)
def test_minus_signs_and_foreign_letters(text: str, shown: str) -> None:
    assert latex_text(text) == shown


@given(st.text(max_size=40))
def test_nothing_is_left_that_latex_takes_for_a_command(text: str) -> None:
    found = latex_text(text)
    assert all(letter == " " or letter.isprintable() for letter in found)
    assert max(found, default=" ") <= "\u017e"
    bare = re.sub(
        r"\\[a-z]+\{\}|\$\\?[a-z<>|-]+\$|\$\^(?:\\circ|[23])\$|\\[{}$&#%_]|\{\[\}|\{\]\}", "", found
    )
    assert not set(bare) & set("\\{}$&#%_^~")


def test_a_label_is_a_word() -> None:
    assert latex_label("A: x (a=1), B: y; demo-1") == "tab:a-x-a-1-b-y-demo-1"
    assert re.fullmatch(r"tab:[a-z0-9-]*", latex_label("🐟 \\ }" * 50))


def test_a_long_label_ends_with_a_whole_word() -> None:
    assert latex_label("fingerprint " * 9) == "tab:" + "-".join(["fingerprint"] * 5)
    assert latex_label("a" * 99) == "tab:" + "a" * 60


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
    text = as_latex(table)
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
