"""The leaderboard's tables: ranking, scores by exposure, how each was run, published numbers."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from decimal import Decimal
from math import fsum
from pathlib import Path

from dfdbench.leaderboard.boards import Board, Entry, Standing
from dfdbench.leaderboard.published import PublishedTable, mean_over
from dfdbench.metrics.protocol import METRICS, RELEASED, title_of
from dfdbench.results.record import RESULT, Result
from dfdbench.results.summary import SCENES_TO_TELL, interval_name
from dfdbench.tables.table import Link, Table

_NOTHING = "–"
_HEADS = {metric: f"{metric.upper()} {'↑' if up else '↓'}" for metric, up in METRICS.items()}


def board_tables(board: Board, folder: Path) -> list[Table]:
    """Return a board's tables: the ranking, the scores by lighting, how each was run.

    Parameters
    ----------
    board : Board
        From `dfdbench.leaderboard.boards.boards`.
    folder : Path
        The leaderboard's folder, from which links go out.
    """
    return [ranking_table(board, folder), lighting_table(board), runs_table(board, folder)]


def ranking_table(board: Board, folder: Path) -> Table:
    """Return the ranking: by NRMSE, ties by NMAE, as the thesis ranks."""
    protocol = board.protocol
    rows = []
    for standing in board.standings:
        entry = standing.entry
        scores = [_number(entry.score(protocol, metric)) for metric in METRICS]
        rows.append(
            (
                _NOTHING if standing.rank is None else str(standing.rank),
                entry.label,
                scores[0],
                _interval(standing.interval),
                scores[1],
                scores[2],
                str(standing.above or _NOTHING),
                seconds_text(entry.seconds),
                entry.status,
            )
        )
    notes = [
        _interval_note(board.scenes),
        *_incomplete_notes(board),
        *(
            f"{old.label}: {_file(old, new)} gives way to the newer {_file(new, old)}"
            for old, new in board.superseded
        ),
    ]
    columns = (
        "",
        "method",
        _HEADS["nrmse"],
        interval_name(board.scenes),
        _HEADS["nmae"],
        _HEADS["ssim"],
        "behind the row above",
        "seconds a pair",
        "status",
    )
    title = f"{board.dataset}, split {board.split}, protocol {title_of(protocol)}"
    records = tuple(_record(board, standing, folder) for standing in board.standings)
    return Table(
        title,
        columns,
        tuple(rows),
        "rlrlrrlrl",
        tuple(notes),
        records=records,
        parts=((0, 1, 2, 3, 4, 5), (0, 1, 6, 7, 8)),
    )


def lighting_table(board: Board) -> Table:
    """Return each method's means by block, exposure for instance, a row a metric."""
    axis = board.standings[0].entry.result.dataset.blocks
    levels = _levels(board)
    rows: list[tuple[str, ...]] = []
    rules = set()
    records: list[Mapping[str, object]] = []
    for standing in board.standings:
        entry = standing.entry
        for metric in METRICS:
            means = [_mean(entry.result, board.protocol, metric, axis, level) for level in levels]
            whole = entry.score(board.protocol, metric)
            name = entry.label if metric == "nrmse" else ""
            rows.append((name, _HEADS[metric], *map(_number, means), _number(whole)))
            values = {
                **{f"{axis} {n}": m for n, m in zip(levels, means, strict=True)},
                "overall": whole,
            }
            records.append({"method": entry.label, "metric": metric, **values})
        rules.add(len(rows) - 1)
    columns = ("method", "", *(f"{axis} {level}" for level in levels), "overall")
    align = "ll" + "r" * (len(levels) + 1)
    return Table(f"by {axis}", columns, tuple(rows), align, (), frozenset(rules), tuple(records))


def runs_table(board: Board, folder: Path | None = None) -> Table:
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
            method.trained_on or "nothing",
            seconds_text(entry.seconds),
            machine_of(entry.result),
            method.paper or _NOTHING,
        )
        if folder:
            cells += (_checked(entry), Link("result", _target(entry, folder)))
        rows.append(cells)
    columns: tuple[str, ...] = (
        "method",
        "parameters",
        "training data",
        "seconds a pair",
        "machine",
        "paper",
    )
    align = "lllrll"
    if folder:
        columns, align = (*columns, "reproduced", "file"), align + "ll"
    notes = ("Seconds compare only on one machine.",)
    return Table("how they were run", columns, tuple(rows), align, notes)


def published_summary(tables: Sequence[PublishedTable], compare: str) -> Table:
    """Return the rows that a publication sets side by side, best first, without a rank."""
    chosen = [table for table in tables if table.compare == compare]
    first = chosen[0]
    found: dict[str, PublishedTable] = {}
    for table in chosen:
        for row in table.rows:
            found.setdefault(row.method, table)
    lines = []
    for method, table in found.items():
        means = {metric: mean_over(table.rows, method, metric) for metric in METRICS}
        by_exposure = [
            _printed(row.scores.get("nrmse"))
            for row in table.rows
            if row.method == method and row.at.get("illumination") == "all"
        ]
        lines.append(
            (
                means["nrmse"] or 0.0,
                (
                    method,
                    *map(_number, means.values()),
                    *by_exposure,
                    _published_seconds(tables, method),
                    table.name,
                    "published",
                ),
            )
        )
    columns = (
        "method",
        *_HEADS.values(),
        *(f"NRMSE, exposure {level}" for level in (0, 1, 2)),
        "seconds an image",
        "where",
        "status",
    )
    rows = tuple(cells for _, cells in sorted(lines))
    notes = (
        "The overall means are ours, of the exposures' printed ones, 18 pairs each; seconds are "
        "the mean of the printed run times, for graph cuts over all scenes.",
    )
    title = f"{first.dataset}, {first.scope}: published, not rerun, not ranked"
    return Table(title, columns, rows, "l" + "r" * 6 + "lll", notes)


def published_table(table: PublishedTable) -> Table:
    """Return a published table as it is printed, with its origin."""
    places = tuple(dict.fromkeys(name for row in table.rows for name in row.at))
    spread = any(row.std for row in table.rows)
    timed = any(row.seconds is not None for row in table.rows)
    metrics = [metric for metric in METRICS if any(metric in row.scores for row in table.rows)]
    others = tuple(dict.fromkeys(name for row in table.rows for name in row.values))
    several = len({row.method for row in table.rows}) > 1
    columns = ["method"] if several else []
    columns += places
    for metric in metrics:
        columns += [_HEADS[metric], "std"] if spread else [_HEADS[metric]]
    columns += others
    columns += ["seconds", "device"] if timed else []
    rows = []
    for row in table.rows:
        cells = [row.method] if several else []
        cells += [row.at.get(place, "") for place in places]
        for metric in metrics:
            cells.append(_printed(row.scores.get(metric)))
            if spread:
                cells.append(_printed(row.std.get(metric)))
        cells += [_printed(row.values.get(name)) for name in others]
        if timed:
            cells += [_printed(row.seconds), row.device or ""]
        rows.append(tuple(cells))
    lead = len(places) + several
    align = "l" * lead + "r" * (len(columns) - lead - timed) + "l" * timed
    where = f"page {table.page}" if table.page else f"section {table.section}"
    pairs = f", {table.pairs} pairs" if table.pairs else ""
    what = f"Numbers: {table.quantity}. " if table.quantity else ""
    notes = (
        f"{what}Trained on: {table.training}. Protocol: {table.protocol}.",
        f"Our note: {table.note}",
    )
    title = f"{table.name} ({where}): {table.title}; {table.dataset}, {table.scope}{pairs}"
    return Table(title, tuple(columns), tuple(rows), align, notes)


def seconds_text(seconds: float | None) -> str:
    """Return seconds to the millisecond.

    Examples
    --------
    >>> seconds_text(1.23456), seconds_text(0.00001)
    ('1.235', '< 0.001')
    """
    if seconds is None:
        return _NOTHING
    return "< 0.001" if seconds < 0.001 else f"{seconds:.3f}"


def machine_of(result: Result) -> str:
    """Return the machine that a result was made on, in a few words.

    Marketing marks in the processor's name are left out.
    """
    environment = result.environment
    cpu = environment.cpu.replace("(R)", "").replace("(TM)", "")
    machine = f"{' '.join(cpu.split())}, {environment.cpu_count} cores"
    return f"{environment.gpu}; {machine}" if environment.gpu else machine


def parameters_of(result: Result) -> str:
    """Return the parameters that were set, as one would type them."""
    settings = (f"{name}={_plain(v)}" for name, v in result.method.parameters.items())
    return ", ".join(settings) or "defaults"


def _record(board: Board, standing: Standing, folder: Path) -> dict[str, object]:
    entry, protocol = standing.entry, board.protocol
    dataset = entry.result.dataset
    low, high = standing.interval or (None, None)
    above = standing.above
    released = RELEASED.get(protocol)
    newer = released.superseded_by if released else None
    by_level = {
        f"{metric} {dataset.blocks} {level}": _mean(
            entry.result, protocol, metric, dataset.blocks, level
        )
        for metric in METRICS
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
        "trained_on": entry.result.method.trained_on,
        **{metric: entry.score(protocol, metric) for metric in METRICS},
        "nrmse_low": low,
        "nrmse_high": high,
        "interval": interval_name(board.scenes),
        "nrmse_behind": above.mean if above else None,
        "nrmse_behind_low": above.low if above else None,
        "nrmse_behind_high": above.high if above else None,
        **by_level,
        "seconds": entry.seconds,
        "machine": machine_of(entry.result),
        "pairs": f"{dataset.evaluated}/{dataset.expected}",
        "status": entry.status,
        "result": _target(entry, folder),
    }


def _levels(board: Board) -> list[int]:
    axis = board.standings[0].entry.result.dataset.blocks
    pairs = [pair for s in board.standings for pair in s.entry.result.pairs]
    return sorted({pair.coordinates[axis] for pair in pairs})


def _mean(result: Result, protocol: str, metric: str, axis: str, level: int) -> float | None:
    # As in a run's own table: where a pair of the level is lacking there is no mean.
    pairs = [pair for pair in result.pairs if pair.coordinates[axis] == level]
    if not pairs or any(pair.status != "ok" for pair in pairs):
        return None
    values = [getattr(pair.scores[protocol], metric) for pair in pairs]
    defined = [value for value in values if value is not None]
    return fsum(defined) / len(defined) if defined else None


def _interval_note(scenes: int) -> str:
    behind = "Behind the row above: how much larger NRMSE is, pair by pair, with its"
    if scenes >= SCENES_TO_TELL:
        return (
            f"95 %: interval of NRMSE from a bootstrap over {scenes} scenes. {behind} interval; "
            "real where that leaves out 0."
        )
    if scenes == 1:
        return "A single scene: no interval."
    return (
        f"Range of scene means: the lowest and the highest NRMSE of {scenes} scenes; fewer than "
        f"six are too few for a 95 % interval. {behind} range over scenes; likely where all "
        "scenes lean one way."
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


def _incomplete_notes(board: Board) -> list[str]:
    notes = []
    for standing in board.standings:
        dataset = standing.entry.result.dataset
        if not standing.entry.result.complete:
            notes.append(
                f"{standing.entry.label}: {dataset.evaluated} of {dataset.expected} pairs "
                "evaluated; an incomplete run has no rank"
            )
        elif standing.rank is None:
            notes.append(f"{standing.entry.label}: NRMSE is defined for no pair")
    return notes


def _checked(entry: Entry) -> str:
    found = entry.verification
    if found is None:
        return "not yet"
    count = len(found.pairs)
    if found.identical == count:
        return f"{count} pairs, the same depth maps"
    return f"{count} pairs, scores within {found.largest_difference:.1g}"


def _published_seconds(tables: Sequence[PublishedTable], method: str) -> str:
    by_device: dict[str, list[float]] = {}
    for table in tables:
        for row in table.rows:
            if row.method == method and row.seconds is not None:
                by_device.setdefault(row.device or "", []).append(float(row.seconds))
    parts = [f"{seconds_text(fsum(v) / len(v))} ({device})" for device, v in by_device.items()]
    return "; ".join(parts) or _NOTHING


def _target(entry: Entry, folder: Path) -> str:
    return Path(os.path.relpath(entry.path, folder)).as_posix()


def _plain(value: object) -> str:
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def _interval(interval: tuple[float, float] | None) -> str:
    return _NOTHING if interval is None else f"{interval[0]:.4f} to {interval[1]:.4f}"


def _number(value: float | None) -> str:
    return _NOTHING if value is None else f"{value:.4f}"


def _printed(value: Decimal | None) -> str:
    return _NOTHING if value is None else str(value)
