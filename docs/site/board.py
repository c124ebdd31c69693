"""The leaderboard as data, for the page that sorts, filters and draws it."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from dfdbench.blur.tracks import TRACKS
from dfdbench.leaderboard.boards import Entry, ScoreBoard, parted
from dfdbench.leaderboard.readme import collect_all
from dfdbench.leaderboard.track_boards import TracksBoard, TracksEntry, track_boards
from dfdbench.metrics.metric import RANKED_BY, find_metric
from dfdbench.metrics.protocol import metrics_of, ranked_by, title_of
from dfdbench.results.record import SCORED, Result
from dfdbench.results.summary import median_seconds
from dfdbench.results.told import told
from dfdbench.results.wording import machine_of

PAGE = """---
hide: [navigation, toc]
---

# Leaderboard

Choose a data set and a protocol; press a heading to sort; type to filter. A method's name opens its
result file, with the scores of every pair. Compare like with like: what *told* means, and the other
columns, [the questions](../questions.md#what-does-told-mean) say, and
[how to read it](../leaderboard.md#how-to-read-it) says more. [All tables](tables.md), with
intervals, lightings, scenes and machines, are on a page of their own, beside what the thesis
prints. [Add a row](../submit.md).

<div id="board"><p>This table needs JavaScript; <a href="tables/">all tables</a> do not.</p></div>
<script type="application/json" id="board-data">{data}</script>
"""


def board_page(folder: Path) -> str:
    """Return the page: its text, and the rows as JSON."""
    entries, tracked = collect_all(folder)
    run, scored = parted(entries)
    found = [_board(board, folder) for board in run]
    found += [_without_ranks(_board(board, folder)) for board in scored]
    found += [_tracks(board, folder) for board in track_boards(tracked)]
    text = json.dumps(found, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return PAGE.replace("{data}", text.replace("<", "\\u003c"))


def _board(board: ScoreBoard, folder: Path) -> dict[str, Any]:
    metrics = metrics_of(board.protocol)
    first = ranked_by(board.protocol)[0]
    order = [first, *(name for name in metrics if name != first)]
    return {
        "set": f"{board.label}, split {board.split}",
        "protocol": title_of(board.protocol),
        "metrics": [
            {"title": metrics[name].heading, "falls": metrics[name].larger_is_better}
            for name in order
        ],
        "rows": [
            _row(
                standing.entry,
                [standing.entry.result],
                standing.rank,
                [standing.entry.score(board.protocol, name) for name in order],
                folder,
            )
            for standing in board.standings
        ],
    }


def _without_ranks(board: dict[str, Any]) -> dict[str, Any]:
    rows = [row | {"rank": None} for row in board["rows"]]
    return board | {"protocol": f"{board['protocol']}: {SCORED}", "rows": rows}


def _tracks(board: TracksBoard, folder: Path) -> dict[str, Any]:
    title = find_metric(RANKED_BY).heading
    return {
        "set": f"{board.dataset}, split {board.split}",
        "protocol": "valid, over all tracks",
        "metrics": [{"title": text, "falls": False} for text in (f"mean {title}", *TRACKS)],
        "rows": list(_track_rows(board, folder)),
    }


def _track_rows(board: TracksBoard, folder: Path) -> Iterator[dict[str, Any]]:
    for rank, entry in board.rows:
        means = entry.means(RANKED_BY)
        scores = [entry.mean(RANKED_BY), *(means[name] for name in TRACKS)]
        yield _row(entry, entry.on_tracks, rank, scores, folder)


def _row(
    entry: Entry | TracksEntry,
    runs: Sequence[Result],
    rank: int | None,
    scores: list[float | None],
    folder: Path,
) -> dict[str, Any]:
    return {
        "rank": rank,
        "method": entry.label,
        "told": "; ".join(_each(told, runs)),
        "scores": scores,
        "seconds": median_seconds(runs),
        "status": entry.status,
        "machines": _each(machine_of, runs),
        "version": "; ".join(_each(lambda run: run.environment.versions.get("dfdbench", ""), runs)),
        "file": _file(entry.path, folder),
    }


def _each(text_of: Callable[[Result], str], runs: Sequence[Result]) -> list[str]:
    return sorted({text_of(run) for run in runs})


def _file(path: Path, folder: Path) -> str:
    return path.relative_to(folder).as_posix()
