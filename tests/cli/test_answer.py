import os
import subprocess
import sys
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from dfdbench.cli.answer import Answer, AnswerFormat, give
from dfdbench.errors import ResultError
from dfdbench.tables.table import Table

TABLE = Table("a title", ("name",), (("value",),), "l", ("a note",))
ANSWER = Answer('{"a": 1}\n', (TABLE,), "the verdict")


@pytest.mark.parametrize(
    ("format", "told"),
    [
        (AnswerFormat.json, '{"a": 1}\n'),
        (AnswerFormat.markdown, "| value |"),
        (AnswerFormat.table, "─"),
    ],
)
def test_an_answer_is_printed_in_one_form_and_kept_in_all(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], format: AnswerFormat, told: str
) -> None:
    give(ANSWER, format, tmp_path / "new", {"a.json": ANSWER.content, "a.png": Figure()})
    out, err = capsys.readouterr()
    assert told in out
    assert ("the verdict" in out) == (format is not AnswerFormat.json)
    assert (tmp_path / "new/a.json").read_text() == ANSWER.content
    assert (tmp_path / "new/a.png").exists()
    assert err == f"written to   {tmp_path / 'new'}\n"


def test_a_table_without_rows_is_told_without_its_heading(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    empty = Table("nothing lacks", ("name",), (), "l", ("a note",))
    give(Answer("", (empty,)), AnswerFormat.table, tmp_path, {})
    assert capsys.readouterr().out == "nothing lacks\na note\n"


def test_an_earlier_answer_is_said_to_be_replaced_where_it_differs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for content, told in (("one", False), ("one", False), ("two", True)):
        give(ANSWER, AnswerFormat.json, tmp_path, {"a.json": content})
        assert ("in place of an earlier answer" in capsys.readouterr().err) == told


def test_a_place_that_cannot_be_written_is_told_before_anything_is_printed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("x")
    for place in (tmp_path / "file", tmp_path / "file/below"):
        with pytest.raises(ResultError, match="cannot write the answer"):
            give(ANSWER, AnswerFormat.table, place, {"a.json": "x"})
    (tmp_path / "in the way/a.json").mkdir(parents=True)
    with pytest.raises(ResultError, match=r"a\.json"):
        give(ANSWER, AnswerFormat.table, tmp_path / "in the way", {"a.json": "x"})
    assert capsys.readouterr().out == ""


SCRIPT = """
import sys
from pathlib import Path
from dfdbench.cli.answer import Answer, AnswerFormat, give
from dfdbench.tables.table import Table
rows = tuple(("value",) for _ in range(50_000))
give(Answer("", (Table("T", ("name",), rows, "l"),)), AnswerFormat(sys.argv[1]), Path("kept"),
     {"a.json": "whole"})
sys.exit(7)
"""


@pytest.mark.slow
@pytest.mark.parametrize("format", ["table", "markdown"])
def test_a_reader_that_has_enough_changes_neither_files_nor_status(
    tmp_path: Path, format: str
) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", SCRIPT, format],
        cwd=tmp_path,
        text=True,
        env=os.environ.copy(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    assert process.stdout is not None
    process.stdout.readline()
    process.stdout.close()
    assert process.stderr is not None
    errors = process.stderr.read()
    assert process.wait(timeout=60) == 7
    assert errors == "written to   kept\n"
    assert (tmp_path / "kept/a.json").read_text() == "whole"
