"""The command line as a fixture, for the tests of each family of verbs."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from dfdbench.cli import main
from tests.cli.command import Command, Outcome

MINE = """
import numpy as np

def predict(infocus, defocus):
    print("predicting")
    return np.full(infocus.shape[:2], 90)

def nan(infocus, defocus):
    return np.full(infocus.shape[:2], np.nan)
"""


@pytest.fixture
def dfdbench(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> Command:
    """Calls the command line in a folder of the test's own, where `mymodule` holds two methods."""
    (tmp_path / "work").mkdir(exist_ok=True)
    (tmp_path / "work/mymodule.py").write_text(MINE)
    monkeypatch.chdir(tmp_path / "work")

    def command(*arguments: str) -> Outcome:
        monkeypatch.setattr(sys, "argv", ["dfdbench", *arguments])
        status = 0
        try:
            main()
        except SystemExit as exit_:
            status = int(exit_.code or 0)
        captured = capsys.readouterr()
        return Outcome(status, captured.out, captured.err)

    return command
