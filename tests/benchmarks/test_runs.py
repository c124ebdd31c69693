"""What a run costs beside its method, against importing its libraries and against plain zarr.

Nothing is asserted of times.
"""

import sys
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr

from dfdbench.datasets.dataset import Dataset
from dfdbench.evaluation.loading import load_for
from dfdbench.evaluation.plan import RunOptions
from dfdbench.evaluation.run import run_method
from tests.benchmarks.ledger import Ledger, cpu
from tests.benchmarks.test_startup import least_seconds


def test_a_run_with_nothing_to_do(
    benchmark: Any, ledger: Ledger, demo_store: Dataset, tmp_path: Path
) -> None:
    program = str(Path(sys.executable).with_name("dfdbench"))
    words = f"run --method constant --split Market --no-figures --dataset {demo_store.path}"
    ours = [program, *words.split(), "--out", str(tmp_path / "run")]
    theirs = [sys.executable, "-c", "import numba, pandas, zarr"]
    own, other = least_seconds(benchmark, ours, theirs)
    peer = "import of zarr, numba and pandas"
    ledger.note("a run with nothing to do", own, "zarr", peer, other, "each in a fresh process")


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
