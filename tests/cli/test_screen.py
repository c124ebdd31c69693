from pathlib import Path

import pytest
from matplotlib.figure import Figure

from dfdbench.cli import screen
from dfdbench.cli.screen import give, print_table
from dfdbench.errors import ResultError
from dfdbench.tables.table import Format, Table
from tests.cli.test_rig import BLUR
from tests.process import python


@pytest.mark.slow
def test_a_terminal_of_ascii_is_shown_all_in_line(tmp_path: Path) -> None:
    by_locale = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    words = ("-m", "dfdbench", *BLUR.split(), "--pixel", "4.8um")
    for encoding in (by_locale, {"PYTHONIOENCODING": "ascii"}):
        done = python(*words, cwd=tmp_path, **encoding)
        assert (done.returncode, done.stdout.isascii()) == (0, True), done.stderr
        assert r"blur radius (\xb5m)" in done.stdout


class _Clock:
    def __init__(self) -> None:
        self.seconds = 0.0

    def monotonic(self) -> float:
        return self.seconds


def test_without_a_terminal_long_work_says_every_minute_how_far_it_is(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clock = _Clock()
    monkeypatch.setattr(screen, "time", clock)
    with screen.progress("training dfd-net") as step:
        # Half of it was done by an earlier call, in no time: that says nothing of the speed.
        for done in range(5_000, 10_001, 100):
            step(done, 10_000)
            clock.seconds += 10.0
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 8
    assert lines[0] == "training dfd-net: 5,600 of 10,000, 1 min so far, about 7 min left"
    assert lines[-1] == "training dfd-net: 9,800 of 10,000, 8 min so far, about 0 min left"
    # A download says its bytes, too, and work of unknown length what is done.
    with screen.progress("fetching demo") as fetched:
        fetched(0, 4, 0)
        clock.seconds += 61.0
        fetched(1, 4, 2_000_000)
    with screen.progress("training u-net") as step:
        step(0, None)
        clock.seconds += 7200.0
        step(1200, None)
    assert capsys.readouterr().err.splitlines() == [
        "fetching demo: 1 of 4 files, 2.0 MB, 1 min so far, about 3 min left",
        "training u-net: 1,200, 2 h 00 min so far",
    ]


def test_a_table_of_others_text_steers_no_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    print_table(Table("title\x1b]0;x\x07", ("method",), (("mine\x1b[2J\r",),), "l", ("n\x9b",)))
    out = capsys.readouterr().out
    assert "mine\\x1b[2J\\r" in out
    assert not {"\x1b", "\x07", "\r", "\x9b"} & set(out)


TABLE = Table("a title", ("name",), (("value",),), "l", ("a note",))


def test_an_answer_is_printed_in_one_form_and_kept_in_all(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place, content = tmp_path / "new", '{"a": 1}\n'
    for format, told in (
        (Format.json, content), (Format.markdown, "| value |"), (Format.table, "─")
    ):  # fmt: skip
        give([TABLE], format, place, {"a.json": content, "a.png": Figure()}, "the verdict")
        out, err = capsys.readouterr()
        assert told in out
        assert ("the verdict" in out) == (format is not Format.json)
        assert (place / "a.json").read_text() == content
        assert (place / "a.png").exists()
        assert err == f"written to   {place}\n"
    give([TABLE], Format.json, place, {"a.json": "another"})
    assert "in place of an earlier answer" in capsys.readouterr().err


def test_a_place_that_cannot_be_written_is_told_before_anything_is_printed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("x")
    for place in (tmp_path / "file", tmp_path / "file/below"):
        with pytest.raises(ResultError, match="cannot write the answer"):
            give([TABLE], Format.table, place, {"a.json": "x"})
    (tmp_path / "in the way/a.json").mkdir(parents=True)
    with pytest.raises(ResultError, match=r"a\.json"):
        give([TABLE], Format.table, tmp_path / "in the way", {"a.json": "x"})
    assert capsys.readouterr().out == ""
