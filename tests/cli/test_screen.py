import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.test_optics import BLUR


@pytest.mark.parametrize(
    "encoding",
    [{"PYTHONIOENCODING": "ascii"}, {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}],
)
def test_a_terminal_that_is_not_utf_8_is_shown_all_in_line(
    encoding: dict[str, str], tmp_path: Path
) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "dfdbench", *BLUR, "--pixel", "4.8um"],
        cwd=tmp_path,
        env={**os.environ, **encoding},
        capture_output=True,
        encoding="ascii",
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert r"blur radius (\xb5m)" in done.stdout
    assert len({len(line) for line in done.stdout.splitlines() if line.startswith("|")}) == 1


@pytest.mark.parametrize(
    "arguments",
    [
        ("verify", "d" * 300),
        ("list", "--cache", "c" * 300),
        ("register", "all", "--source", "s" * 300),
    ],
)
def test_a_name_too_long_for_the_file_system_is_a_mistake(
    arguments: tuple[str, ...], tmp_path: Path
) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "dfdbench", *arguments],
        cwd=tmp_path,
        capture_output=True,
        encoding="utf-8",
        check=False,
    )
    assert done.returncode == 2, done.stderr
    assert done.stderr.startswith("error: "), done.stderr
