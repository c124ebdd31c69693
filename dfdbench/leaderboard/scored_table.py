"""The leaderboard's rows of depth maps that were made elsewhere: apart, and without ranks."""

from __future__ import annotations

from pathlib import Path

from dfdbench.leaderboard.board_tables import standing_record
from dfdbench.leaderboard.boards import ScoreBoard
from dfdbench.leaderboard.folder import link_to
from dfdbench.metrics.intervals import interval_name
from dfdbench.metrics.protocol import metrics_of, ranked_by, title_of
from dfdbench.results.record import SCORED
from dfdbench.results.wording import interval_text, score_text
from dfdbench.tables.table import Link, Table


def scored_table(board: ScoreBoard, folder: Path) -> Table:
    """Return the rows of a board of depth maps that were scored, not run: without ranks.

    Parameters
    ----------
    board : ScoreBoard
        From `dfdbench.leaderboard.boards.parted`.
    folder : Path
        The leaderboard's folder, from which links go out.
    """
    metrics, first = metrics_of(board.protocol), ranked_by(board.protocol)[0]
    others = [metric for name, metric in metrics.items() if name != first]
    rows = tuple(
        (
            standing.entry.label,
            score_text(standing.entry.score(board.protocol, first)),
            interval_text(standing.interval),
            *(score_text(standing.entry.score(board.protocol, each.name)) for each in others),
            standing.entry.status,
            Link("result", link_to(standing.entry.path, folder)),
        )
        for standing in board.standings
    )
    records = tuple(
        standing_record(board, standing, folder) | {"rank": None} for standing in board.standings
    )
    return Table(
        f"{board.label}, split {board.split}, protocol {title_of(board.protocol)}: {SCORED}",
        (
            "method",
            metrics[first].heading,
            interval_name(board.scenes),
            *(metric.heading for metric in others),
            "status",
            "file",
        ),
        rows,
        "lrl" + "r" * len(others) + "ll",
        (f"Data fingerprint {board.fingerprint}.",),
        records=records,
    )
