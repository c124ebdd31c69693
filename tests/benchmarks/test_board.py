"""The leaderboard's check against reading the same files with json and pandas, in one process.

Nothing is asserted of times.
"""

import json
from pathlib import Path
from typing import Any

import pandas as pd

from dfdbench.board.board import leaderboard
from dfdbench.board.row_file import RESULTS
from tests.benchmarks.ledger import Ledger, cpu

FOLDER = Path(__file__).parents[2] / "leaderboard"


def plain() -> pd.DataFrame:
    """Every score of every file, unchecked and unranked."""
    return pd.DataFrame(
        [
            (path.stem, run["label"], protocol, metric, value)
            for path in (FOLDER / RESULTS).rglob("*.json")
            for run in json.loads(path.read_text("utf-8"))["runs"]
            for protocol, columns in run["scores"].items()
            for metric, column in columns.items()
            for value in column
        ]
    )


def check() -> int:
    board = leaderboard(FOLDER)
    board.require_written()
    return len(board.rows)


def test_check(benchmark: Any, ledger: Ledger) -> None:
    files = benchmark.pedantic(check, rounds=3, warmup_rounds=1)
    seconds = cpu(check, 3), cpu(plain, 3)
    ours, peer = f"check of the leaderboard's {files} files", "the same files, unchecked, unranked"
    ledger.note(ours, seconds[0], "pandas", peer, seconds[1], "the rankings, as written")
