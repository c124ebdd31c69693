"""The leaderboard as data, for the page that sorts, filters and draws it."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from dfdbench.blur.tracks import CLEAN
from dfdbench.board.board import leaderboard
from dfdbench.board.ranking import Entry, ScoreBoard
from dfdbench.board.tables import link_to, plain, tracks_of
from dfdbench.metrics.metric import find_metric
from dfdbench.metrics.protocol import metrics_of, title_of
from dfdbench.results.record import SCORED, Result
from dfdbench.results.wording import given_to, machine_of

PAGE = """---
hide: [navigation, toc]
---

# Leaderboard

Choose a data set and a protocol; press a heading to sort; type to filter. A method's name opens its
result file, with the scores of every pair. Compare like with like: what *given* and the
other columns mean, [the questions](../questions.md#what-does-given-mean) say;
[how to read it](../leaderboard.md#how-to-read-it) says more. [All tables](tables.md), with
intervals, lightings, scenes and machines, are on a page of their own, beside what the thesis
prints. [Add a row](../submit.md).

<div id="board"><p>This table needs JavaScript; <a href="tables/">all tables</a> do not.</p></div>
<script type="application/json" id="board-data">{data}</script>
"""


def board_page(folder: Path) -> str:
    """Return the page: its text, and the rows as JSON."""
    found = [_board(board, folder) for board in leaderboard(folder).boards]
    text = json.dumps(found, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return PAGE.replace("{data}", text.replace("<", "\\u003c"))


def _board(board: ScoreBoard, folder: Path) -> dict[str, Any]:
    dataset, metric = board.result.dataset, find_metric(board.metric)
    protocol = title_of(board.protocol)
    if board.result.method.scored:
        protocol = f"{protocol}: {SCORED}"
    if board.suite == CLEAN:
        names = [board.metric, *(n for n in metrics_of(board.protocol) if n != board.metric)]
        heads = [(find_metric(name).heading, find_metric(name).larger_is_better) for name in names]
        scores = [[standing.scores.get(name) for name in names] for standing in board.standings]
    else:
        tracks = pd.DataFrame(tracks_of(board).xs(board.metric, level="metric"))
        protocol = f"{protocol}, over {board.suite}"
        heads = [(f"mean {metric.heading}", False), *((str(name), False) for name in tracks)]
        scores = [
            [standing.scores[board.metric], *map(plain, tracks.loc[row])]
            for row, standing in enumerate(board.standings)
        ]
    return {
        "set": f"{dataset.label}, split {dataset.split}",
        "protocol": protocol,
        "metrics": [{"title": title, "falls": falls} for title, falls in heads],
        "rows": [
            {"rank": standing.rank, "scores": own, **_facts(standing.entry, folder)}
            for standing, own in zip(board.standings, scores, strict=True)
        ],
    }


def _facts(entry: Entry, folder: Path) -> dict[str, Any]:
    runs = entry.ranked_runs
    return {
        "method": entry.label,
        "given": "; ".join(_each(given_to, runs)),
        "seconds": entry.seconds,
        "machines": _each(machine_of, runs),
        "version": "; ".join(_each(lambda run: run.environment.versions.get("dfdbench", ""), runs)),
        "file": link_to(entry.path, folder),
    }


def _each(text_of: Callable[[Result], str], runs: Sequence[Result]) -> list[str]:
    return sorted({text_of(run) for run in runs})
