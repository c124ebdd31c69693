from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from dfdbench.cli import screen
from dfdbench.cli.screen import print_table
from dfdbench.tables.table import Table
from tests.cli.test_rig import BLUR
from tests.process import python


@pytest.mark.slow
def test_a_terminal_of_ascii_is_shown_all_in_line(tmp_path: Path) -> None:
    by_locale = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    words = ("-m", "dfdbench", *BLUR.split(), "--pixel", "4.8um")
    for encoding in (by_locale, {"PYTHONIOENCODING": "ascii"}):
        done = python(*words, cwd=tmp_path, **encoding)
        assert (done.returncode, done.stdout.isascii()) == (0, True), done.stderr
        assert "blur width (um)" in done.stdout
        rows = [line for line in done.stdout.splitlines() if line[0] in "+|"]
        assert len({len(row) for row in rows}) == 1, done.stdout


def test_without_a_terminal_long_work_says_every_minute_how_far_it_is(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clock: Any = SimpleNamespace(seconds=0.0, monotonic=lambda: clock.seconds)
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


def test_the_text_of_a_bar_steers_no_terminal(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    with screen.progress("q[/x]/m.py\x1b[2J") as step:
        step(1, 2, "[/y]")
    shown = capsys.readouterr().err
    assert "q[/x]/m.py\\x1b[2J" in shown
    assert "[/y]" in shown
