import os
import re
import subprocess
from pathlib import Path

import pytest

from tests.process import python

PACKAGE = Path(__file__).parents[2] / "dfdbench"
SUM = """
from dfdbench.system.compiled import compiled

@compiled()
def total(numbers):
    return numbers.sum()

@compiled(inline="always")
def twice(number):
    return 2 * number
"""
CALL = """
import numpy as np
from kernels import total, twice
print(total(np.arange(4)), twice(3), total.stats.cache_path)
"""


def call(folder: Path, cache: Path) -> subprocess.CompletedProcess[str]:
    (folder / "kernels.py").write_text(SUM)
    # No folder can be made below a file, not even by root.
    (folder / "__pycache__").write_text("in the way")
    caches = {"NUMBA_CACHE_DIR": "", "DFDBENCH_CACHE": str(cache), "XDG_CACHE_HOME": "/dev/null"}
    path = f"{folder}{os.pathsep}{PACKAGE.parent}"
    return python("-c", CALL, cwd=None, HOME="/dev/null", PYTHONPATH=path, **caches)


@pytest.mark.slow
def test_without_a_place_for_a_cache_it_compiles_and_warns_once(tmp_path: Path) -> None:
    done = call(tmp_path, Path("/dev/null"))
    assert (done.stdout, done.stderr.count("\n")) == ("6 6 None\n", 1)
    assert done.stderr.startswith("warning: compiled code cannot be cached")
    assert "DFDBENCH_CACHE" in done.stderr


@pytest.mark.slow
def test_where_the_cache_has_no_room_it_compiles_and_warns_once(tmp_path: Path) -> None:
    (tmp_path / "kernels.py").write_text(SUM)
    # A file may have no bytes, as on a full disk.
    limited = f"import resource\nresource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))\n{CALL}"
    path = f"{tmp_path}{os.pathsep}{PACKAGE.parent}"
    done = python("-c", limited, NUMBA_CACHE_DIR=str(tmp_path / "cache"), PYTHONPATH=path)
    assert (done.stdout[:4], done.stderr.count("\n")) == ("6 6 ", 1)
    assert "cannot be cached" in done.stderr
    assert "NUMBA_CACHE_DIR" in done.stderr


@pytest.mark.slow
def test_beside_a_source_that_is_read_only_it_caches_in_our_own_folder(tmp_path: Path) -> None:
    place = tmp_path / "cache"
    done = call(tmp_path, place)
    assert (done.stderr, done.stdout.startswith(f"6 6 {place}/compiled/")) == ("", True)
    assert list(place.rglob("*.nbc"))


def test_all_that_is_compiled_is_compiled_by_it() -> None:
    others = [path for path in PACKAGE.rglob("*.py") if path.name != "compiled.py"]
    assert not [path for path in others if re.search(r"\bn?jit\(", path.read_text("utf-8"))]
