"""Printed numbers as tables: those that a publication compares, and each as it stands there."""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Decimal

from dfdbench.leaderboard.published import PublishedTable, mean_over
from dfdbench.metrics.metric import METRICS, RANKED_BY, mean_of
from dfdbench.results.wording import NOTHING, score_text, seconds_text
from dfdbench.tables.table import Table

_EXPOSURES = (0, 1, 2)


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
        cells = (
            method,
            *map(score_text, means.values()),
            *_by_exposure(table, method),
            _published_seconds(tables, method),
            table.name,
            "published",
        )
        lines.append((means[RANKED_BY] or 0.0, cells))
    columns = (
        "method",
        *(metric.heading for metric in METRICS.values()),
        *(f"{METRICS[RANKED_BY].title}, exposure {level}" for level in _EXPOSURES),
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
    return Table(title, columns, rows, "l" + "r" * (len(METRICS) + len(_EXPOSURES)) + "lll", notes)


def _by_exposure(table: PublishedTable, method: str) -> list[str]:
    return [
        _printed(row.scores.get(RANKED_BY))
        for row in table.rows
        if row.method == method and row.at.get("illumination") == "all"
    ]


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
        columns += [METRICS[metric].heading, *(["std"] if spread else [])]
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


def _published_seconds(tables: Sequence[PublishedTable], method: str) -> str:
    by_device: dict[str, list[float]] = {}
    for table in tables:
        for row in table.rows:
            if row.method == method and row.seconds is not None:
                by_device.setdefault(row.device or "", []).append(float(row.seconds))
    parts = [f"{seconds_text(mean_of(v))} ({device})" for device, v in by_device.items()]
    return "; ".join(parts) or NOTHING


def _printed(value: Decimal | None) -> str:
    return NOTHING if value is None else str(value)
