"""Reading the pairs of a store, and running a method on them, against plain zarr in one run."""

import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr

from dfdbench.datasets.dataset import Dataset, open_dataset
from dfdbench.evaluation.loading import load_for
from dfdbench.evaluation.plan import RunOptions
from dfdbench.evaluation.run import run_method
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


@pytest.mark.benchmark(group="a pair of 240 x 320", timer=time.process_time)
def test_a_pair_beyond_its_method(
    benchmark: Any, ledger: Ledger, demo_store: Dataset, tmp_path: Path
) -> None:
    """Read, scored under every protocol, kept and noted; by zarr read and kept."""
    method = load_for(demo_store, "constant", {}, 0)
    pairs = demo_store.pairs("train")[:40]

    def run(number: int) -> None:
        options = RunOptions(limit=number, fresh=True)
        run_method(demo_store, method, "train", tmp_path / "run", options)

    def plain() -> None:
        for pair in pairs:
            scene: Any = zarr.open_group(str(demo_store.path), path=pair.scene, mode="r")
            assert scene["images"][0, 0, 0].shape == (2, 240, 320, 3)
            kept = zarr.open_group(str(tmp_path / "plain"), path=pair.id, mode="a")
            kept.create_array("depth", data=scene["depth"][0].astype(np.float32), overwrite=True)

    run(1)
    few, many = (cpu(partial(run, number), 3) for number in (4, 4 + len(pairs)))
    ours = (many - few) / len(pairs)
    theirs = cpu(plain) / len(pairs)
    benchmark.pedantic(run, (8,), rounds=1)
    title, peer = "a pair of a run beyond its method", "the same arrays read, and one kept"
    ledger.note(title, ours, "zarr", peer, theirs, "scores under three protocols, too")
