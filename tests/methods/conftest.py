"""A module of methods, as a user writes it; weights of a small network."""

from pathlib import Path

import pytest

from tests.one_torch_thread import one_torch_thread

__all__ = ["one_torch_thread"]

MODULE = """
import numpy as np

def predict(infocus, defocus):
    return np.full(infocus.shape[:2], 7)

def scaled(infocus, defocus, factor=1.0, *, offset: float = 0.0):
    return np.full(infocus.shape[:2], factor * 10 + offset)

class Named:
    trained_on = "nothing"
    paper = "none"

    def __init__(self, recipe, level=1):
        self.recipe, self.level = recipe, level

    def __call__(self, infocus, defocus):
        return np.full(infocus.shape[:2], self.level)

class Broken:
    def __init__(self):
        raise RuntimeError("no weights")

number = 5
"""


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    path = tmp_path / "mine.py"
    path.write_text(MODULE)
    monkeypatch.chdir(tmp_path)
    return path


@pytest.fixture
def weights(tmp_path: Path) -> Path:
    # Imported here: most tests of methods need no torch.
    from tests.methods.made_weights import save_small

    return save_small(tmp_path / "mine.safetensors")
