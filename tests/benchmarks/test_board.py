"""The leaderboard's check against reading the same files with json and pandas, in one process.

Nothing is asserted of times.
"""

import json
import time
from pathlib import Path
from typing import Any

import pandas as pd

from dfdbench.board.board import leaderboard
from dfdbench.board.row_file import RESULTS

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


def seconds(what: Any) -> float:
    begun = time.process_time()
    what()
    return time.process_time() - begun


def test_check(benchmark: Any) -> None:
    files = benchmark.pedantic(check, rounds=3, warmup_rounds=1)
    ours, theirs = (min(seconds(what) for _ in range(3)) for what in (check, plain))
    print(
        f"\ncheck of {files} files: {ours:.2f} s of processor time, {ours / theirs:.1f} times "
        f"{theirs:.2f} s of json and pandas; {1e3 * ours / files:.1f} ms a file"
    )
