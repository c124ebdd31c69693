"""A board's tables: ranking, scores by exposure, how each was run."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from dfdbench.datasets.catalog import released_manifests
from dfdbench.leaderboard.boards import Entry, ScoreBoard, Standing, mean_over
from dfdbench.leaderboard.by_scene import folds_table, scenes_table
from dfdbench.leaderboard.folder import link_to
from dfdbench.metrics.intervals import SCENES_TO_TELL, interval_name
from dfdbench.metrics.metric import find_metric
from dfdbench.metrics.protocol import RELEASED, metrics_of, ranked_by, title_of
from dfdbench.results.record import Result
from dfdbench.results.record_file import RESULT
from dfdbench.results.told import TOLD_NOTE, knew_blur, told
from dfdbench.results.wording import (
    NOTHING,
    SECONDS_NOTE,
    interval_text,
    machine_of,
    parameters_of,
    score_text,
    seconds_text,
    training_of,
)
from dfdbench.tables.table import Link, Table
from dfdbench.tables.wording import counted


def board_tables(board: ScoreBoard, folder: Path) -> list[Table]:
    """Return a board's tables: the ranking, scores by lighting, scene and fold, how each was run.

    Parameters
    ----------
    board : ScoreBoard
        From `dfdbench.leaderboard.boards.boards`.
    folder : Path
        The leaderboard's folder, from which links go out.
    """
    tables = [
        standings_table(board, folder),
        lighting_table(board),
        scenes_table(board),
        folds_table(board),
        runs_table(board, folder),
    ]
    return [table for table in tables if table.rows]


def standings_table(board: ScoreBoard, folder: Path) -> Table:
    """Return the ranking: by NRMSE, ties by NMAE, as the thesis ranks."""
    first = ranked_by(board.protocol)[0]
    metrics = [metric for name, metric in metrics_of(board.protocol).items() if name != first]
    columns = (
        "",
        "method",
        "told",
        find_metric(first).heading,
        interval_name(board.scenes),
        *(metric.heading for metric in metrics),
        "behind the row above",
        "seconds per pair",
        "status",
    )
    rows = tuple(
        (
            NOTHING if standing.rank is None else str(standing.rank),
            standing.entry.label,
            told(standing.entry.result),
            standing.entry.shown_score(board.protocol, first),
            interval_text(standing.interval),
            *(standing.entry.shown_score(board.protocol, each.name) for each in metrics),
            str(standing.above or NOTHING),
            seconds_text(standing.entry.seconds),
            standing.entry.status,
        )
        for standing in board.standings
    )
    scores = len(columns) - 3
    return Table(
        f"{board.label}, split {board.split}, protocol {title_of(board.protocol)}",
        columns,
        rows,
        "rllrl" + "r" * len(metrics) + "lrl",
        tuple(_ranking_notes(board)),
        records=tuple(standing_record(board, standing, folder) for standing in board.standings),
        parts=(tuple(range(scores)), (0, 1, *range(scores, len(columns)))),
    )


def _ranking_notes(board: ScoreBoard) -> list[str]:
    return [
        _interval_note(board.scenes, find_metric(ranked_by(board.protocol)[0]).title),
        TOLD_NOTE,
        *_training_notes(board),
        *_floor_notes(board),
        *_incomplete_notes(board),
        *(
            f"{old.label}: {_file(old, new)} gives way to the newer {_file(new, old)}"
            for old, new in board.superseded
        ),
    ]


def _training_notes(board: ScoreBoard) -> list[str]:
    """Say what the other data sets are that methods were trained on."""
    trained_on = [standing.entry.result.method.trained_on or "" for standing in board.standings]
    others = {text.partition(",")[0] for text in trained_on} - {board.dataset}
    return [f"{m.stem}: {m.title}." for m in released_manifests() if m.stem in others]


def _floor_notes(board: ScoreBoard) -> list[str]:
    # A constant depth map is alike in structure wherever the true depth is flat.
    floors = [
        standing.entry.score(board.protocol, "ssim")
        for standing in board.standings
        if standing.entry.result.method.name == "constant"
    ]
    if not floors or floors[0] is None:
        return []
    name = find_metric("ssim").title
    return [f"{name} is to be read from its floor: a constant has {floors[0]:.2f} here."]


def lighting_table(board: ScoreBoard) -> Table:
    """Return each method's means by block, exposure for instance, a row a metric."""
    axis = board.standings[0].entry.result.dataset.blocks
    levels = _levels(board)
    rows: list[tuple[str, ...]] = []
    rules = set()
    records: list[Mapping[str, object]] = []
    for standing in board.standings:
        entry = standing.entry
        for number, (metric, shown) in enumerate(metrics_of(board.protocol).items()):
            means = [_mean(entry.result, board.protocol, metric, axis, level) for level in levels]
            whole = entry.shown_score(board.protocol, metric)
            name = "" if number else entry.label
            rows.append((name, shown.heading, *map(score_text, means), whole))
            values = {
                **{f"{axis} {n}": m for n, m in zip(levels, means, strict=True)},
                "overall": entry.score(board.protocol, metric),
            }
            records.append({"method": entry.label, "metric": metric, **values})
        rules.add(len(rows) - 1)
    columns = ("method", "", *(f"{axis} {level}" for level in levels), "overall")
    align = "ll" + "r" * (len(levels) + 1)
    return Table(f"by {axis}", columns, tuple(rows), align, (), frozenset(rules), tuple(records))


def runs_table(board: ScoreBoard, folder: Path | None = None) -> Table:
    """Return how each method was run: parameters, training data, machine, paper.

    With the leaderboard's folder also whether it was reproduced, and a link to its file.
    """
    rows: list[tuple[str, ...]] = []
    for standing in board.standings:
        entry = standing.entry
        method = entry.result.method
        cells: tuple[str, ...] = (
            method.name,
            parameters_of(entry.result),
            training_of(method),
            seconds_text(entry.seconds),
            machine_of(entry.result),
            method.paper or NOTHING,
        )
        if folder:
            cells += (_checked(entry), Link("result", link_to(entry.path, folder)))
        rows.append(cells)
    columns: tuple[str, ...] = (
        "method",
        "parameters",
        "training data",
        "seconds per pair",
        "machine",
        "paper",
    )
    align = "lllrll"
    if folder:
        columns, align = (*columns, "reproduced", "file"), align + "ll"
    notes = (SECONDS_NOTE,)
    return Table("how they were run", columns, tuple(rows), align, notes)


def standing_record(board: ScoreBoard, standing: Standing, folder: Path) -> dict[str, object]:
    """Return a row of the ranking as data, numbers in full."""
    entry, protocol = standing.entry, board.protocol
    dataset = entry.result.dataset
    metrics, first = metrics_of(protocol), ranked_by(protocol)[0]
    low, high = standing.interval or (None, None)
    above = standing.above
    released = RELEASED.get(protocol)
    newer = released.superseded_by if released else None
    by_level = {
        f"{metric} {dataset.blocks} {level}": _mean(
            entry.result, protocol, metric, dataset.blocks, level
        )
        for metric in metrics
        for level in _levels(board)
    }
    return {
        "dataset": board.dataset,
        "split": board.split,
        "protocol": protocol,
        "superseded_by": newer.label if newer else None,
        "fingerprint": board.fingerprint,
        "rank": standing.rank,
        "method": entry.result.method.name,
        "parameters": parameters_of(entry.result),
        "told": told(entry.result),
        "trained_on": entry.result.method.trained_on,
        "fitted_on": entry.result.method.fitted_on,
        **{metric: entry.score(protocol, metric) for metric in metrics},
        f"{first}_low": low,
        f"{first}_high": high,
        "interval": interval_name(board.scenes),
        f"{first}_behind": above.mean if above else None,
        f"{first}_behind_low": above.low if above else None,
        f"{first}_behind_high": above.high if above else None,
        **by_level,
        "seconds": entry.seconds,
        "machine": machine_of(entry.result),
        "pairs": f"{dataset.evaluated}/{dataset.expected}",
        "status": entry.status,
        "result": link_to(entry.path, folder),
    }


def _levels(board: ScoreBoard) -> list[int]:
    axis = board.standings[0].entry.result.dataset.blocks
    pairs = [pair for s in board.standings for pair in s.entry.result.pairs]
    return sorted({pair.coordinates[axis] for pair in pairs})


def _mean(result: Result, protocol: str, metric: str, axis: str, level: int) -> float | None:
    pairs = [pair for pair in result.pairs if pair.coordinates[axis] == level]
    return mean_over(pairs, protocol, metric)


def _interval_note(scenes: int, score: str) -> str:
    behind = f"Behind the row above: how much larger {score} is, pair by pair, with its"
    if scenes >= SCENES_TO_TELL:
        return (
            f"95 %: interval of {score} from a bootstrap over {scenes} scenes. {behind} interval; "
            "real where that leaves out 0."
        )
    if scenes == 1:
        return "A single scene: no interval."
    return (
        f"Range of scene means: the lowest and the highest {score} of {scenes} scenes. {behind} "
        "range over scenes. Fewer than six scenes are too few for a 95 % interval, and too few to "
        "tell a difference from chance."
    )


def _file(entry: Entry, other: Entry) -> str:
    # A run's result is called like every other: its folder tells it apart.
    files = [e.path.resolve() for e in (entry, other)]
    places = [file.parent if file.name == RESULT else file for file in files]
    if places[0].name != places[1].name:
        return places[0].name
    return Path(
        os.path.relpath(places[0], os.path.commonpath([p.parent for p in places]))
    ).as_posix()


def _incomplete_notes(board: ScoreBoard) -> list[str]:
    notes = []
    title = find_metric(ranked_by(board.protocol)[0]).title
    for standing in board.standings:
        dataset = standing.entry.result.dataset
        if not standing.entry.result.complete:
            notes.append(
                f"{standing.entry.label}: {dataset.evaluated} of {dataset.expected} pairs "
                "evaluated, whose means stand in brackets; an incomplete run has no rank"
            )
        elif knew_blur(standing.entry.result):
            notes.append(f"{standing.entry.label}: told a blur on a track, which gives no rank")
        elif standing.rank is None:
            notes.append(f"{standing.entry.label}: {title} is defined for no pair")
    return notes


def _checked(entry: Entry) -> str:
    found = entry.verification
    if found is None:
        return "not yet"
    count = len(found.pairs)
    if found.identical == count:
        return f"{counted(count, 'pair')}, the same depth maps"
    return f"{counted(count, 'pair')}, scores within {found.largest_difference:.1g}"
