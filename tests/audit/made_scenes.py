"""Made counts of levels by scene, for the tests of what parts scenes."""

import numpy as np

from dfdbench.audit.splits import Scenes


def make(
    number: int = 8, seed: int = 0, groups: tuple[tuple[str, ...], ...] = (), **more: float
) -> Scenes:
    random = np.random.default_rng(seed)
    names = tuple("ABCDEFGHIJKLMNOP"[:number])
    counts = np.zeros((number, 256), np.int64)
    for row in counts:
        first = random.integers(0, 150)
        row[first : first + 100] = random.integers(1, 500, 100)
    return Scenes(names, counts, groups or tuple((name,) for name in names), **more)  # type: ignore[arg-type]
