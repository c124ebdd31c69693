"""The command line's start against `import numpy`, both in processor time of a fresh process."""

import resource
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.benchmarks.ledger import Ledger

ROUNDS = 5


def processor_seconds(command: list[str]) -> float:
    """Return the user and system time of a command."""

    def used() -> float:
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        return used.ru_utime + used.ru_stime

    before = used()
    subprocess.run(command, check=True, capture_output=True)
    return used() - before


def least_seconds(benchmark: Any, ours: list[str], theirs: list[str]) -> tuple[float, float]:
    """Return the least processor seconds of two commands that take turns."""
    benchmark.pedantic(processor_seconds, (ours,), rounds=1, warmup_rounds=1)
    pairs = [(processor_seconds(ours), processor_seconds(theirs)) for _ in range(ROUNDS)]
    own, other = map(min, zip(*pairs, strict=True))
    return own, other


LINES = ("--version", "--help", "audit --help", "list", "info middlebury --pairs all")


@pytest.mark.parametrize("line", LINES)
def test_start(benchmark: Any, ledger: Ledger, line: str) -> None:
    ours = [str(Path(sys.executable).with_name("dfdbench")), *line.split()]
    numpy = [sys.executable, "-c", "import numpy"]
    own, theirs = least_seconds(benchmark, ours, numpy)
    result = "each in a fresh process"
    ledger.note(f"dfdbench {line}", own, "numpy", "import numpy", theirs, result)
