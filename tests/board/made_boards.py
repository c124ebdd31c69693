"""Boards of made results, for the tests of boards and of their tables."""

from pathlib import Path
from typing import Any

from dfdbench.board.board import leaderboard
from dfdbench.board.ranking import ScoreBoard
from dfdbench.board.submission import submit
from dfdbench.datasets.manifest import Pair
from dfdbench.results.record import Result
from tests.made_results import make_demo_result


def add(folder: Path, name: str, value: float, **changes: Any) -> Path:
    # Each scene leans the same way by a little more, so that intervals have a width.
    def score(pair: Pair) -> float:
        return value + 0.0001 * len(pair.scene) + 0.001 * pair.at["exposure"]

    return submit(make_demo_result(score, name, **changes), folder)


def only_board(folder: Path) -> ScoreBoard:
    (board,) = leaderboard(folder).boards
    return board


def scored(name: str, value: float) -> Result:
    """Depth maps that were made elsewhere."""
    made = make_demo_result(lambda pair: value, name)
    pairs = [pair.model_copy(update={"seconds": None}) for pair in made.pairs]
    method = made.method.model_copy(update={"scored": "levels", "entry": "scored, not run"})
    return made.model_copy(update={"pairs": pairs, "method": method})
