"""The leaderboard on the site: a page that sorts, filters and draws it, its tables, its frame."""

from __future__ import annotations

import gzip
import json
import shlex
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
from links import relinked

from dfdbench.blur.tracks import CLEAN, SUITES, find_degradation
from dfdbench.board.board import Board
from dfdbench.board.cards import Card, cards_table
from dfdbench.board.ranking import Entry, ScoreBoard, Standing
from dfdbench.board.tables import lighting_table, link_to, ranking_table, runs_table, tracks_of
from dfdbench.datasets.catalog import part_name, released_manifests
from dfdbench.metrics.metric import find_metric
from dfdbench.metrics.protocol import metrics_of, title_of
from dfdbench.results.frame import defined
from dfdbench.results.record import SCORED, Result
from dfdbench.results.wording import NOTHING, given_to, machine_of, score_text, seconds_text
from dfdbench.tables.render import as_markdown, escape_markdown
from dfdbench.tables.table import Table
from leaderboard.published import load_published, published_summary, published_table

PICTURES = Path(__file__).parents[1] / "assets/pictures/demo"
NOTE = "note.md"
#: What the pictures are of; other sets have none.
DRAWN = "demo-1"
SCORES, TABLES_PLACE = "board/scores.csv.gz", "board/tables.md"

PAGE = """---
hide: [navigation, toc]
description: Rankings of depth from defocus methods by data set; sort, filter, link, download.
---

# Leaderboard

Choose a data set and a protocol, press a heading to sort, type to filter. The address keeps your
choice, so a link shows others the same. A method's name opens its page; *how* shows the command
that makes the row, and links the scores of every pair. Compare like with like:
[what *given* means](../questions.md#what-does-given-mean),
[how to read it](../leaderboard.md#how-to-read-it). [All tables](tables.md) have intervals,
lightings, scenes and machines. [Every score as CSV](scores.csv.gz), {rows:,} rows, opens with
`pandas.read_csv`. [Add a row](../submit.md).

<div id="board" markdown>

{tables}

</div>
<script type="application/json" id="board-data">{data}</script>
"""
TABLES = """---
search: {{ exclude: true }}
description: Every ranking of the leaderboard, and the numbers that the thesis prints.
---

# All tables

| data set | rankings |
|:---|:---|
{listed}

{note}

## Methods

{cards}

## Published numbers

From {citation}, doi [{doi}](https://doi.org/{doi}). The copy that they were carried over from has
no page numbers, so each says its table and section.

{published}
"""
TRACKS_NOTE = """Each track makes the same scenes harder in one way, at three severities:
[tracks](../tracks.md). Nobody is given the blur; what is hidden may be learned from the training
pairs. A row is ranked in the suite of tracks that it ran.
"""
SCORED_NOTE = """Depth maps that somebody made elsewhere and handed in, scored as runs are, without
ranks. We cannot tell how they were made, on what machine, or with what knowledge of the truth.
"""


def board_files(board: Board) -> Iterator[tuple[str, str | bytes]]:
    """Yield the board's pages and the frame, each with its place on the site."""
    yield "board/index.md", board_page(board)
    yield TABLES_PLACE, _index(board)
    for name, members in _by_set(board).items():
        yield f"board/{name}.md", _set_page(members, board.folder)
    yield SCORES, scores_csv(board)


def scores_csv(board: Board) -> bytes:
    """Return the board's frame as gzipped CSV, coordinates as JSON; the same bytes every time."""
    scores = board.scores
    told = scores.assign(coordinates=scores["coordinates"].map(json.dumps))
    return gzip.compress(told.to_csv(index=False).encode(), mtime=0)


def board_page(board: Board) -> str:
    """Return the page: its text, tables for readers without scripts, and the rows as JSON."""
    found = [_ranking(one, board) for one in _newest_first(board)]
    drawn = [*(name for name in board.cards if (PICTURES / f"{name}.jpg").exists())]
    data = {"boards": found, "drawn": drawn}
    text = json.dumps(data, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    tables = [as_markdown(_short_table(one)) for one in _newest_first(board) if one.headline]
    return PAGE.format(
        rows=len(board.scores), tables="\n".join(tables), data=text.replace("<", "\\u003c")
    )


def command_of(entry: Entry, suite: str, card: Card | None) -> str:
    """Return the command that makes a row."""
    run = entry.result
    name, _ = part_name(run.dataset.short)
    place = ["--dataset", name, "--split", run.dataset.split]
    if run.method.scored:
        words = ["score", "FOLDER", *place, "--method", run.method.name]
    elif len(labels := SUITES.get(suite, ())) > 1:
        tracks = dict.fromkeys(find_degradation(label).track.name for label in labels)
        words = ["tracks", *place, *(f"--track={track}" for track in tracks)]
    else:
        words = ["run", "--dataset", run.dataset.short, *place[2:]]
    own = card.arguments(on_tracks=words[0] == "tracks") if card and not run.method.scored else []
    return shlex.join(["dfdbench", *words, *own])


def _newest_first(board: Board) -> list[ScoreBoard]:
    """Return the rankings, those of the newest seed first."""
    seeds = [str(draw.seed) for draw in board.draws]

    def age(one: ScoreBoard) -> int:
        return next((n for n, seed in enumerate(seeds[:1]) if seed in one.result.dataset.name), 1)

    return sorted(board.boards, key=age)


def _by_set(board: Board) -> dict[str, list[ScoreBoard]]:
    found: dict[str, list[ScoreBoard]] = {}
    for one in _newest_first(board):
        name, _ = part_name(one.result.dataset.name)
        found.setdefault(f"{name}-{one.result.dataset.split}", []).append(one)
    return found


def _index(board: Board) -> str:
    published = load_published(board.folder)
    compared = dict.fromkeys(table.compare for table in published if table.compare)
    parts = [as_markdown(published_summary(published, name)) for name in compared]
    parts += [
        _folded(f"{table.name}: {table.title}", as_markdown(published_table(table)))
        for table in published
    ]
    note, source = board.folder / NOTE, f"leaderboard/{NOTE}"
    return TABLES.format(
        listed="\n".join(f"| [{n}]({n}.md) | {len(each)} |" for n, each in _by_set(board).items()),
        note=relinked(note.read_text("utf-8"), source, TABLES_PLACE) if note.exists() else "",
        cards=as_markdown(cards_table(board.cards, in_repository=False)),
        citation=escape_markdown(published[0].citation) if published else "",
        doi=published[0].doi if published else "",
        published="\n".join(parts),
    )


def _set_page(members: Sequence[ScoreBoard], folder: Path) -> str:
    data = members[0].result.dataset
    title = f"{part_name(data.name)[0]}, split {data.split}"
    parts = [
        "---\nsearch: { exclude: true }\n"
        f"description: Every ranking of methods on {title}, with intervals and machines.\n---\n\n"
        f"# {title}\n"
    ]
    for one in members:
        ranking = ranking_table(one, folder)
        tables = [replace(ranking, title="ranking"), *further_tables(one, folder)]
        notes = {True: SCORED_NOTE, False: TRACKS_NOTE if one.suite != CLEAN else ""}
        text = f"{notes[bool(one.result.method.scored)]}\n" + "\n".join(map(as_markdown, tables))
        text = f"Data fingerprint `{one.result.dataset.fingerprint}`.\n\n{text}"
        if one.headline or one.suite != CLEAN:
            parts.append(f"## {escape_markdown(ranking.title)}\n\n{text}")
        else:
            parts.append(_folded(ranking.title, text))
    return "\n".join(parts)


def further_tables(board: ScoreBoard, folder: Path) -> list[Table]:
    """Return the non-empty tables beside a ranking of single runs.

    What each method is, and where it ran, is told only once, beside the headline.
    """
    if board.suite != CLEAN or board.result.method.scored:
        return []
    tables = [lighting_table(board), scenes_table(board), scenes_table(board, folds=True)]
    tables += [runs_table(board, folder)] * board.headline
    return [table for table in tables if table.rows]


def scenes_table(board: ScoreBoard, folds: bool = False) -> Table:
    """Return each method's mean over each scene, or over a fold's test scenes.

    There are no rows of folds unless the split holds at least two whole ones.
    """
    what, there = "scene", set(board.scores["scene"])
    groups = {name: [name] for name in sorted(there)}
    if folds:
        known = {manifest.stem: manifest.folds for manifest in released_manifests()}
        tests = {f.name: f.test_scenes for f in known.get(board.result.dataset.name, [])}
        whole = {name: scenes for name, scenes in tests.items() if there.issuperset(scenes)}
        what, groups = "fold", whole if len(whole) > 1 else {}
    own = board.scores[board.scores["metric"] == board.metric]
    labels = [standing.entry.label for standing in board.standings]
    rows, records = [], []
    for name, scenes in groups.items():
        part = own[own["scene"].isin(scenes)].assign(group=name)
        found = board.means(part, "group").loc[name]
        rows.append((name, *map(score_text, found)))
        records.append({what: name, **dict(zip(labels, map(defined, found), strict=True))})
    title = f"{find_metric(board.metric).heading} by {what}"
    return Table(title, (what, *labels), tuple(rows), "l", records=tuple(records))


def _folded(title: str, text: str) -> str:
    summary = escape_markdown(title)
    return f"<details markdown>\n<summary>{summary}</summary>\n\n{text}\n</details>\n"


def _short_table(board: ScoreBoard) -> Table:
    """Return a ranking by one metric, for readers without scripts."""
    rows = tuple(
        (
            NOTHING if standing.rank is None else str(standing.rank),
            standing.entry.label,
            board.shown(row, board.metric),
            "; ".join(_each(given_to, standing.entry.ranked_runs)),
            seconds_text(standing.entry.seconds),
        )
        for row, standing in enumerate(board.standings)
    )
    columns = ("", "method", find_metric(board.metric).heading, "given", "seconds per pair")
    return Table(_set_of(board) + f", protocol {_protocol_of(board)}", columns, rows, "rlrlr")


def _set_of(board: ScoreBoard) -> str:
    return f"{board.result.dataset.label}, split {board.result.dataset.split}"


def _protocol_of(board: ScoreBoard) -> str:
    protocol = title_of(board.protocol)
    if board.result.method.scored:
        protocol = f"{protocol}: {SCORED}"
    return protocol if board.suite == CLEAN else f"{protocol}, over {board.suite}"


def _ranking(board: ScoreBoard, whole: Board) -> dict[str, Any]:
    metric = find_metric(board.metric)
    if board.suite == CLEAN:
        names = [board.metric, *(n for n in metrics_of(board.protocol) if n != board.metric)]
        heads = [(find_metric(name).heading, find_metric(name).larger_is_better) for name in names]
        scores = [[standing.scores.get(name) for name in names] for standing in board.standings]
    else:
        tracks = pd.DataFrame(tracks_of(board).xs(board.metric, level="metric"))
        heads = [(f"mean {metric.heading}", False), *((str(name), False) for name in tracks)]
        scores = [
            [standing.scores[board.metric], *map(defined, tracks.loc[row])]
            for row, standing in enumerate(board.standings)
        ]
    return {
        "set": _set_of(board),
        "drawn": part_name(board.result.dataset.name)[0] == DRAWN,
        "protocol": _protocol_of(board),
        "metrics": [{"title": title, "falls": falls} for title, falls in heads],
        "rows": [
            {"rank": standing.rank, "scores": own, **_facts(standing, board, whole)}
            for standing, own in zip(board.standings, scores, strict=True)
        ],
    }


def _facts(standing: Standing, board: ScoreBoard, whole: Board) -> dict[str, Any]:
    entry = standing.entry
    runs = entry.ranked_runs
    return {
        "method": entry.label,
        "given": "; ".join(_each(given_to, runs)),
        "seconds": entry.seconds,
        "machines": _each(machine_of, runs),
        "version": "; ".join(_each(lambda run: run.environment.versions.get("dfdbench", ""), runs)),
        "file": link_to(entry.path, whole.folder),
        "command": command_of(entry, board.suite, whole.cards.get(entry.label)),
    }


def _each(text_of: Callable[[Result], str], runs: Sequence[Result]) -> list[str]:
    return sorted({text_of(run) for run in runs})
