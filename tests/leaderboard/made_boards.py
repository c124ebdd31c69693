"""Boards of made results, for the tests of boards and of their tables."""

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from dfdbench.datasets.manifest import Pair
from dfdbench.leaderboard.boards import ScoreBoard, boards, collect
from dfdbench.leaderboard.submission import submit
from tests.made_results import make_demo_result

WHEN = datetime(2026, 1, 2, tzinfo=UTC)


def add(folder: Path, name: str, value: float, **changes: Any) -> Path:
    # Each scene leans the same way by a little more, so that intervals have a width.
    def score(pair: Pair) -> float:
        return value + 0.0001 * len(pair.scene) + 0.001 * pair.at["exposure"]

    return submit(make_demo_result(score, name, **changes), folder, WHEN)[0]


def only_board(folder: Path) -> ScoreBoard:
    (board,) = boards(collect(folder))
    return board
