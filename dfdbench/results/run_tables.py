"""Tables out of results: scores by lighting, best and worst pairs, run times."""

from __future__ import annotations

from collections.abc import Sequence

from dfdbench.metrics.intervals import SCENES_TO_TELL
from dfdbench.metrics.metric import find_metric, mean_of
from dfdbench.metrics.protocol import metrics_of, title_of
from dfdbench.results.record import PairResult, Result
from dfdbench.results.summary import RunSummary, ScoreGroup
from dfdbench.results.wording import score_text
from dfdbench.tables.table import Table
from dfdbench.tables.wording import counted

EXTREMES = 5


def run_tables(summary: RunSummary) -> list[Table]:
    """Return a run's tables: scores, best and worst pairs, run times."""
    tables = [run_score_table(summary)]
    if summary.ranked:
        tables.append(extremes_table(summary))
    if summary.ranked and not summary.result.method.scored:
        tables.append(time_table(summary))
    failures = [pair for pair in summary.result.pairs if pair.status == "failed"]
    if failures:
        tables.append(_failure_table(failures))
    return tables


def run_score_table(summary: RunSummary) -> Table:
    """Return mean and spread of each metric by lighting, as the thesis's Tables 4.3 and 5.3."""
    result, groups = summary.result, summary.groups
    dataset = result.dataset
    partial = any(group.evaluated < group.expected for group in groups)
    labels = _labels(result)
    metrics = metrics_of(summary.protocol)
    columns = [*labels, *(head for metric in metrics.values() for head in (metric.heading, "std"))]
    rows = []
    for group in groups:
        cells = [*_place(group, len(labels))]
        for metric in metrics:
            statistic = group.metrics[metric]
            cells += [score_text(statistic.mean), score_text(statistic.std)]
        rows.append((*cells, f"{group.evaluated}/{group.expected}") if partial else tuple(cells))
    if partial:
        columns.append("pairs")
    state = "" if result.complete else "PARTIAL, "
    title = (
        f"{result.method.title} on {dataset.label}, split {dataset.split}, "
        f"protocol {title_of(summary.protocol)} "
        f"({state}{dataset.evaluated} of {counted(dataset.expected, 'pair')})"
    )
    align = "l" * len(labels) + "r" * (len(columns) - len(labels))
    return Table(
        title,
        tuple(columns),
        tuple(rows),
        align,
        tuple(_notes(result, groups)),
        _rules(groups),
        label=f"{result.method.name} {dataset.name} {dataset.split} {summary.protocol}",
    )


def extremes_table(summary: RunSummary) -> Table:
    """Return the best and the worst pairs as they rank, as the thesis's Table 5.2."""
    protocol, metrics = summary.protocol, metrics_of(summary.protocol)
    top = summary.ranked[:EXTREMES]
    bottom = summary.ranked[len(top) :][-EXTREMES:]
    axes = summary.result.dataset.axes
    rows = [
        (
            kind,
            pair.scene,
            *(str(pair.coordinates[axis]) for axis in axes),
            *(score_text(pair.score(protocol, metric)) for metric in metrics),
        )
        for kind, pairs in (("top", top), ("bottom", bottom))
        for pair in pairs
    ]
    return Table(
        f"best and worst pairs, protocol {title_of(protocol)}",
        ("", "scene", *axes, *(metric.heading for metric in metrics.values())),
        tuple(rows),
        "ll" + "r" * (len(axes) + len(metrics)),
        (),
        frozenset({len(top) - 1}),
    )


def time_table(summary: RunSummary) -> Table:
    """Return the seconds per pair by lighting, as the thesis's Table 4.4."""
    result, groups = summary.result, summary.groups
    labels = _labels(result)
    rows = [
        (*_place(group, len(labels)), score_text(group.seconds.mean), score_text(group.seconds.std))
        for group in groups
    ]
    environment = result.environment
    threads = ", ".join(f"{name} {count}" for name, count in environment.threads.items())
    machine = f"{environment.cpu}, {environment.cpu_count} cores; threads: {threads}"
    if environment.gpu:
        machine += f"; GPU: {environment.gpu}"
    alone = all(pair.timed_alone for pair in result.pairs)
    how = "one at a time" if alone else "several at once: not comparable"
    return Table(
        f"seconds per pair, warm, {how}",
        (*labels, "mean", "std"),
        tuple(rows),
        "l" * len(labels) + "rr",
        (machine,),
        _rules(groups),
    )


def _failure_table(failures: list[PairResult]) -> Table:
    by_error: dict[str, list[str]] = {}
    for pair in failures:
        by_error.setdefault(pair.error or "", []).append(pair.id)
    rows = tuple((error, ids[0], str(len(ids))) for error, ids in by_error.items())
    title = f"{counted(len(failures), 'pair')} failed"
    return Table(title, ("error", "first", "pairs"), rows, "llr")


def _notes(result: Result, groups: tuple[ScoreGroup, ...]) -> list[str]:
    whole = groups[-1]
    notes = []
    intervals = [
        f"{find_metric(name).title} {score_text(value.low)} to {score_text(value.high)}"
        for name, value in whole.metrics.items()
        if value.low is not None
    ]
    if intervals:
        scenes = len({pair.scene for pair in result.pairs if pair.status == "ok"})
        what = f"95 % interval of the overall mean, bootstrapped over {scenes} scenes"
        if scenes < SCENES_TO_TELL:
            what = f"range of the means of {scenes} scenes, too few for an interval"
        notes.append(f"{what}: {'; '.join(intervals)}")
    if whole.undefined:
        notes.append(
            "without a defined score (flat ground truth), in no mean: "
            + counted(whole.undefined, "pair")
        )
    numbers: dict[str, list[float]] = {}
    for pair in result.pairs:
        for name, value in pair.numbers.items():
            numbers.setdefault(name, []).append(value)
    if numbers:
        means = (f"{name} {mean_of(found):.6g}" for name, found in numbers.items())
        notes.append("the method's own numbers, mean a pair: " + "; ".join(means))
    texts = {"missing": "not in the store", "not-run": "not run", "failed": "failed"}
    for status, text in texts.items():
        count = sum(pair.status == status for pair in result.pairs)
        if count:
            notes.append(f"{count} of {len(result.pairs)} pairs {text}")
    if not result.complete:
        notes.append(
            "an incomplete run has no overall score and no rank: means are of what was run"
        )
    return notes + [f"warning: {text}" for text in result.warnings]


def _labels(result: Result) -> list[str]:
    return [axis for axis in (result.dataset.blocks, result.dataset.rows) if axis]


def _place(group: ScoreGroup, count: int) -> tuple[str, ...]:
    if group.block is None:
        return ("overall", "")[:count]
    return (str(group.block), "overall" if group.row is None else str(group.row))[:count]


def _rules(groups: Sequence[ScoreGroup]) -> frozenset[int]:
    """Return the rows that a line follows: whole blocks, or all but the overall row."""
    blocks = [number for number, group in enumerate(groups) if group.row is None]
    several = any(group.row is not None for group in groups)
    return frozenset(blocks if several else blocks[-2:-1])
