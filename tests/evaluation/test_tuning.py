"""Parameters are chosen on training captures alone, each scored on what was not fitted on."""

from pathlib import Path

import pytest

import dfdbench
from dfdbench.datasets.dataset import Dataset
from dfdbench.errors import InputError, MethodError

#: Answers with the training mean and an error of its own; it writes down what it sees.
OFF = """
import numpy as np

class Off:
    ranges = {"off": (30, 0, 10)}

    def __init__(self, log="", off=0, peek=False):
        self.off, self.log, self.peek = off, log, peek

    def fit(self, pairs):
        self.scenes = sorted({pair.pair.scene for pair in pairs})
        return {"level": np.mean([pair.levels[pair.valid].mean() for pair in pairs])}

    def restore(self, learned):
        self.level = learned["level"]

    def __call__(self, infocus, defocus):
        if self.peek:
            raise ValueError("no such thing")
        with open(self.log, "a") as file:
            file.write(f"{infocus.sum()} {' '.join(self.scenes)}\\n")
        return np.full(infocus.shape[:2], self.level + self.off, np.float32)
"""


@pytest.fixture
def off(tmp_path: Path) -> str:
    path = tmp_path / "off.py"
    path.write_text(OFF)
    return f"{path}:Off"


def test_no_capture_is_scored_by_its_own_group(few_demo: Dataset, off: str, tmp_path: Path) -> None:
    log = tmp_path / "log"
    tried = dfdbench.tune(off, few_demo, parameters={"log": str(log)}, protocol="valid")
    # Off by nothing is best, and what is off by most comes last.
    assert (tried.index.names, tried.index.tolist()) == (["off"], [0, 10, 30])
    captures = {str(each.infocus.sum()): each.pair.scene for each in few_demo.captures("train")}
    lines = [line.split() for line in log.read_text().splitlines()]
    assert len(lines) == 3 * len(captures) == 3 * len({image for image, *_ in lines})
    train = set(few_demo.manifest.scenes_of("train"))
    for image, *fitted in lines:
        assert captures[image] not in fitted
        assert set(fitted) < train


def test_ranges_are_crossed_and_few_captures_looked_at(few_demo: Dataset, off: str) -> None:
    ranges: dict[str, list[object]] = {"off": [5, 0], "peek": [False]}
    nowhere = {"log": "/dev/null"}
    seen: list[tuple[int, int]] = []

    def note(done: int, total: int) -> None:
        seen.append((done, total))

    tried = dfdbench.tune(off, few_demo, ranges, parameters=nowhere, limit=6, on_pair=note)
    assert tried.index.tolist() == [(0, False), (5, False)]
    assert seen[-1] == (12, 12)


def test_what_cannot_be_tried_says_why(few_demo: Dataset, tiny_store: Dataset, off: str) -> None:
    with pytest.raises(InputError, match="1 groups of training captures are too few for 4 folds"):
        dfdbench.tune(off, tiny_store)
    with pytest.raises(MethodError, match="strength"):
        dfdbench.tune(off, few_demo, {"strength": [1, 2]})
    with pytest.raises(MethodError, match="no such thing"):
        dfdbench.tune(off, few_demo, {"peek": [True]})
