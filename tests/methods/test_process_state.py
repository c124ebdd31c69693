import os
import random
import subprocess
import sys
import warnings
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numba
import numpy as np
import pytest

from dfdbench.methods.calling import call
from dfdbench.methods.process_state import seeded

IMAGE = np.zeros((4, 6, 3), np.uint8)


def test_a_method_cannot_spoil_the_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def spoiling(infocus: Any, defocus: Any) -> Any:
        os.chdir(tmp_path)
        os.environ["MINE"] = "1"
        os.environ["KEPT"] = "changed"
        del os.environ["GONE"]
        np.set_printoptions(precision=1)
        np.seterr(all="raise")
        warnings.simplefilter("error")
        sys.setrecursionlimit(200)
        if infocus.max():
            raise RuntimeError("boom")
        return infocus[..., 0]

    monkeypatch.setenv("KEPT", "as it was")
    monkeypatch.setenv("GONE", "not gone")

    def state() -> tuple[Any, ...]:
        filters = list(warnings.filters)
        numpy = np.get_printoptions(), np.geterr()
        return Path.cwd(), dict(os.environ), *numpy, filters, sys.getrecursionlimit()

    before = state()
    for image in (IMAGE, IMAGE + np.uint8(1)):
        call(spoiling, image, image)
        assert state() == before


def test_a_method_cannot_change_the_numbers_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    # It stands for PyTorch, which takes seconds to load.
    torch: Any = SimpleNamespace(threads=4, get_num_threads=lambda: torch.threads)
    torch.set_num_threads = partial(setattr, torch, "threads")
    monkeypatch.setitem(sys.modules, "torch", torch)

    def state() -> tuple[int, ...]:
        return cv2.getNumThreads(), numba.get_num_threads(), torch.threads

    def hurrying(infocus: Any, defocus: Any) -> Any:
        cv2.setNumThreads(cv2.getNumThreads() + 1)
        numba.set_num_threads(1)
        torch.set_num_threads(1)
        return infocus[..., 0]

    before = state()
    call(hurrying, IMAGE, IMAGE)
    assert state() == before


def test_a_process_that_a_method_forked_does_not_go_on() -> None:
    program = (
        "import os\nfrom dfdbench.methods.process_state import process_kept\n"
        "with process_kept():\n    os.fork()\nprint('once', flush=True)\n"
        # A child that ends itself keeps its status.
        "with process_kept():\n    child = os.fork()\n    child or exit(0)\n"
        "print(os.waitpid(child, 0)[1])\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, check=True)
    assert done.stdout == b"once\n0\n"


def test_random_numbers_drawn_in_a_call_reach_nobody_else() -> None:
    def state() -> str:
        return f"{random.getstate()}{np.random.get_state()}"

    before = state()
    with seeded(3):
        call(lambda *_: random.random() + np.random.random(), IMAGE, IMAGE)
    assert state() == before
