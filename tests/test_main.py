"""The start of the command line, before anything of it is loaded."""

import os
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.process import python, shell

PICTURE = cv2.imencode(".png", np.arange(2400, dtype=np.uint8).reshape(40, 60))[1].tobytes()
STOPPED_WHILE_LOADING = """
import sys
from importlib.abc import MetaPathFinder

class CtrlC(MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name == sys.argv[1]:
            raise KeyboardInterrupt

sys.meta_path.insert(0, CtrlC())
from dfdbench.__main__ import main
main()
"""

DRAWING = """
import sys
from dfdbench.cli import main

sys.argv = ["dfdbench", "--version"]
try:
    main()
except SystemExit:
    import matplotlib.figure
"""


def test_ctrl_c_while_it_loads_is_told_in_a_line() -> None:
    for module in ("dfdbench.cli.screen", "dfdbench.cli"):
        ended = python("-c", STOPPED_WHILE_LOADING, module)
        assert (ended.returncode, ended.stderr) == (130, "stopped\n")


@pytest.mark.parametrize("closed", [">&-", "<&- >&- 2>&-"])
def test_a_closed_stream_is_no_mistake(closed: str) -> None:
    ended = shell(f'"{sys.executable}" -m dfdbench info demo {closed}')
    assert ended.returncode == 0
    assert "Traceback" not in ended.stderr


@pytest.mark.slow
@pytest.mark.parametrize("kilobytes", [60_000, 150_000, 250_000])
def test_too_little_memory_is_told_without_a_traceback(kilobytes: int) -> None:
    command = f'ulimit -v {kilobytes}; exec "{sys.executable}" -m dfdbench run --method constant'
    ended = shell(command, OPENBLAS_NUM_THREADS="1")
    assert ended.returncode == 2, ended.stderr
    assert ended.stderr.startswith("error: not enough memory or threads")
    assert "Traceback" not in ended.stderr


def test_no_variable_names_a_screen_for_figures() -> None:
    ended = python("-c", DRAWING, MPLBACKEND="nonsense")
    assert (ended.returncode, ended.stderr) == (0, "")


@pytest.mark.slow
def test_a_folder_that_is_gone_and_a_name_that_is_no_text_are_told(tmp_path: Path) -> None:
    gone = tmp_path / "gone"
    gone.mkdir()
    build = f'cd "{gone}" && rmdir "{gone}" && "{sys.executable}" -P -m dfdbench'
    ended = shell(f"{build} build demo --store rel.zarr --cache {tmp_path}")
    assert ended.returncode == 2
    assert "No such file or directory" in ended.stderr
    folder = os.fsencode(tmp_path / "odd") + b"\xff"
    os.makedirs(folder + b"/a\xff")
    for name in (b"sharp.png", b"blurred.png", b"depth.png"):
        Path(os.fsdecode(folder + b"/a\xff/" + name)).write_bytes(PICTURE)
    ended = python("-m", "dfdbench", "new-dataset", folder, cwd=tmp_path)
    assert ended.returncode == 2
    assert "not UTF-8" in ended.stderr
    assert "Traceback" not in ended.stderr
