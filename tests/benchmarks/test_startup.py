"""The command line's start against `import numpy`, both in processor time of a fresh process."""

import resource
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from dfdbench.datasets.dataset import Dataset
from tests.benchmarks.ledger import Ledger

ROUNDS = 5
PROGRAM = str(Path(sys.executable).with_name("dfdbench"))


def processor_seconds(command: list[str]) -> float:
    """Return the user and system time of a command."""

    def used() -> float:
        return sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2])

    before = used()
    subprocess.run(command, check=True, capture_output=True)
    return used() - before


def least_seconds(benchmark: Any, ours: list[str], theirs: list[str]) -> tuple[float, float]:
    """Return the least processor seconds of two commands that take turns."""
    benchmark.pedantic(processor_seconds, (ours,), rounds=1, warmup_rounds=1)
    pairs = [(processor_seconds(ours), processor_seconds(theirs)) for _ in range(ROUNDS)]
    own, other = map(min, zip(*pairs, strict=True))
    return own, other


@pytest.mark.parametrize(
    "arguments",
    [
        ["--version"],
        ["--help"],
        ["audit", "--help"],
        ["list"],
        ["info", "middlebury", "--pairs", "all"],
    ],
    ids=" ".join,
)
def test_start(benchmark: Any, ledger: Ledger, arguments: list[str]) -> None:
    numpy = [sys.executable, "-c", "import numpy"]
    own, theirs = least_seconds(benchmark, [PROGRAM, *arguments], numpy)
    title = f"dfdbench {' '.join(arguments)}"
    ledger.note(title, own, "numpy", "import numpy", theirs, "each in a fresh process")


def test_a_run_with_nothing_to_do(
    benchmark: Any, ledger: Ledger, demo_store: Dataset, tmp_path: Path
) -> None:
    words = f"run --method constant --split Market --no-figures --dataset {demo_store.path}"
    ours = [PROGRAM, *words.split(), "--out", str(tmp_path / "run")]
    theirs = [sys.executable, "-c", "import numba, pandas, zarr"]
    own, other = least_seconds(benchmark, ours, theirs)
    peer = "import of zarr, numba and pandas"
    ledger.note("a run with nothing to do", own, "zarr", peer, other, "each in a fresh process")
