"""Methods made for the tests of what calls them."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from dfdbench.methods.method import Method
from dfdbench.methods.sources import Hashes, Sources


class Counting:
    """Answers with the red channel; may fail on chosen calls."""

    def __init__(self, fail_at: int | None = None, stop_at: int | None = None) -> None:
        self.calls = 0
        self.warmed = 0
        self.fail_at, self.stop_at = fail_at, stop_at

    def warm_up(self, infocus: Any, defocus: Any) -> None:
        self.warmed += 1

    def __call__(self, infocus: Any, defocus: Any) -> Any:
        self.calls += 1
        if self.calls == self.stop_at:
            raise KeyboardInterrupt
        if self.calls == self.fail_at:
            raise RuntimeError("out of memory")
        return infocus[..., 0].astype(np.float32) / 2


class Written(Sources):
    """As of a method whose file has this hash."""

    def __init__(self, sha256: str) -> None:
        super().__init__()
        self.sha256 = sha256

    @property
    def module_sha256(self) -> str:
        return self.sha256

    def hashes(self) -> Hashes:
        return {"tests:Counting": self.sha256}

    def hashes_again(self, labels: Iterable[str]) -> Hashes:
        return self.hashes()


def method(predict: Any, source: str = "0" * 64) -> Method:
    return Method("counting", "tests:Counting", predict, sources=Written(source))


def grey(infocus: Any, defocus: Any) -> Any:
    return infocus[..., 0]


#: Fitted to the mean depth of the training pairs, whose images it then spoils.
MEAN = """
import numpy as np

class Mean:
    fits = 0

    def __init__(self, recipe=None, keep=True, wrong=False):
        self.recipe, self.keep, self.wrong, self.level = recipe, keep, wrong, None

    def fit(self, pairs):
        type(self).fits += 1
        if self.wrong:
            raise RuntimeError("too dark")
        level = np.mean([pair.depth[pair.valid].mean() for pair in pairs])
        for pair in pairs:
            for image in (pair.infocus, pair.defocus, pair.depth, pair.valid):
                image[:] = 0
        if self.keep:
            return {"level": level}
        self.level = level

    def restore(self, learned):
        self.level = learned["level"]

    def __call__(self, infocus, defocus):
        return np.full(infocus.shape[:2], self.level)
"""


def write_mean(folder: Path) -> str:
    """Write it into a folder, and return its entry."""
    (folder / "mean.py").write_text(MEAN)
    return f"{folder / 'mean.py'}:Mean"
