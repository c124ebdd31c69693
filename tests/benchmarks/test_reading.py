"""Reading the pairs of a store against opening and indexing it with zarr, in one run."""

import time
from typing import Any

import numpy as np
import pytest
import zarr

from dfdbench.datasets.dataset import Dataset, open_dataset
from tests.benchmarks.ledger import Ledger, cpu


@pytest.mark.benchmark(timer=time.process_time)
def test_against_zarr(benchmark: Any, ledger: Ledger, demo_store: Dataset) -> None:
    data = open_dataset("demo", demo_store.path).captures("test")
    axes = demo_store.manifest.axes

    def plain() -> list[tuple[Any, Any]]:
        found = []
        for pair in data.pairs:
            scene: Any = zarr.open_group(str(demo_store.path), path=pair.scene, mode="r")
            at = tuple(axes[axis].index(value) for axis, value in pair.coordinates)
            found.append((scene["images"][at], scene["depth"][at[0]]))
        return found

    ours = benchmark.pedantic(lambda: list(data), rounds=5, warmup_rounds=1)
    for capture, (images, depth) in zip(ours, plain(), strict=True):
        assert np.array_equal(capture.images, images)
        assert np.array_equal(capture.depth, depth, equal_nan=True)
    title, peer = f"reading of {len(ours)} pairs of 240 x 320", "open_group and indexing"
    ledger.note(title, benchmark.stats["min"], "zarr", peer, cpu(plain, 5), "equal")
