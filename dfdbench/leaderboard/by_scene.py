"""A board's scores by scene and by fold: where methods differ, and whether they do everywhere."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from dfdbench.leaderboard.boards import ScoreBoard, mean_over
from dfdbench.metrics.metric import find_metric
from dfdbench.metrics.protocol import ranked_by
from dfdbench.results.wording import score_text
from dfdbench.tables.table import Table


def scenes_table(board: ScoreBoard) -> Table:
    """Return each method's mean over each scene, a row a scene.

    Parameters
    ----------
    board : ScoreBoard
        From `dfdbench.leaderboard.boards.boards`.
    """
    scenes = sorted({pair.scene for s in board.standings for pair in s.entry.result.pairs})
    return _table(board, "scene", [(scene, (scene,)) for scene in scenes])


def folds_table(board: ScoreBoard) -> Table:
    """Return each method's mean over the test scenes of each fold, a row a fold.

    Without rows where the data set has no folds, or the split does not hold them whole.

    Parameters
    ----------
    board : ScoreBoard
        From `dfdbench.leaderboard.boards.boards`.
    """
    there = {pair.scene for s in board.standings for pair in s.entry.result.pairs}
    folds = board.manifest.folds if board.manifest else []
    whole = [(f.name, tuple(f.test_scenes)) for f in folds if there.issuperset(f.test_scenes)]
    return _table(board, "fold", whole if len(whole) > 1 else [])


def _table(board: ScoreBoard, what: str, groups: Iterable[tuple[str, Sequence[str]]]) -> Table:
    metric = find_metric(ranked_by(board.protocol)[0])
    labels = [standing.entry.label for standing in board.standings]
    rows, records = [], []
    for name, scenes in groups:
        means = [
            mean_over(
                [pair for pair in standing.entry.result.pairs if pair.scene in scenes],
                board.protocol,
                metric.name,
            )
            for standing in board.standings
        ]
        rows.append((name, *map(score_text, means)))
        records.append({what: name, **dict(zip(labels, means, strict=True))})
    return Table(
        f"{metric.heading} by {what}",
        (what, *labels),
        tuple(rows),
        "l" + "r" * len(labels),
        records=tuple(records),
    )
