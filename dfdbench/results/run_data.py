"""A run's numbers as data: CSV and JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from dfdbench.metrics.protocol import metrics_of
from dfdbench.results.record import PairResult
from dfdbench.results.run_tables import EXTREMES
from dfdbench.results.summary import RunSummary, ScoreGroup, Statistic, summarise_scenes
from dfdbench.tables.render import as_csv

Labels = Mapping[str, Mapping[str, str]]
_OF_RUN = ("method", "dataset", "split", "protocol")
_OF_STATISTIC = ("mean", "std", "min", "max", "low", "high", "interval", "defined")


def run_as_csv(summary: RunSummary, labels: Labels | None = None) -> str:
    """Return a run's scores as comma-separated values, a line a group and metric.

    Parameters
    ----------
    summary : RunSummary
        The run under a protocol.
    labels : mapping of str to mapping, optional
        What else parts the scenes, with each scene's label of it: a column and its groups.
    """
    labels = labels or {}
    dataset = summary.result.dataset
    places = [*_axes(summary), *labels]
    groups = _placed(summary) + [
        placed for what, label_of in labels.items() for placed in _by_label(summary, what, label_of)
    ]
    run = (summary.result.method.title, dataset.name, dataset.split, summary.protocol)
    rows = []
    for place, group in groups:
        found = (place.get(name) for name in places)
        where = ["all" if value is None else value for value in found]
        for metric, value in [*group.metrics.items(), ("seconds", group.seconds)]:
            rows.append((*run, *where, metric, *_cells(value), group.evaluated, group.expected))
    columns = (*_OF_RUN, *places, "metric", *_OF_STATISTIC, "evaluated", "expected")
    return as_csv(columns, rows)


def run_as_json(summary: RunSummary, labels: Labels | None = None) -> str:
    """Return a run's tables as JSON, numbers in full; `labels` as for `run_as_csv`."""
    result, protocol, order = summary.result, summary.protocol, summary.ranked
    dataset = result.dataset

    def line(pair: PairResult) -> dict[str, Any]:
        scores = {name: pair.score(protocol, name) for name in metrics_of(protocol)}
        return {"pair": pair.id, **scores}

    content = {
        "method": result.method.title,
        "dataset": dataset.name,
        "fingerprint": dataset.fingerprint,
        "split": dataset.split,
        "protocol": protocol,
        "complete": result.complete,
        "evaluated": dataset.evaluated,
        "expected": dataset.expected,
        "groups": [_group_as_dict(place, group) for place, group in _placed(summary)],
        **{
            f"by_{what}": [
                _group_as_dict(place, group) for place, group in _by_label(summary, what, label_of)
            ]
            for what, label_of in (labels or {}).items()
        },
        "top": [line(pair) for pair in order[:EXTREMES]],
        "bottom": [line(pair) for pair in order[EXTREMES:][-EXTREMES:]],
        "failed": {pair.id: pair.error for pair in result.pairs if pair.status == "failed"},
    }
    return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _axes(summary: RunSummary) -> list[str]:
    dataset = summary.result.dataset
    return [axis for axis in (dataset.blocks, dataset.rows) if axis]


def _placed(summary: RunSummary) -> list[tuple[dict[str, object], ScoreGroup]]:
    axes = _axes(summary)
    return [
        (dict(zip(axes, (group.block, group.row), strict=False)), group) for group in summary.groups
    ]


def _by_label(
    summary: RunSummary, what: str, label_of: Mapping[str, str]
) -> list[tuple[dict[str, object], ScoreGroup]]:
    groups = summarise_scenes(summary.result, summary.protocol, label_of)
    return [({what: label}, group) for label, group in groups.items()]


def _cells(value: Statistic) -> tuple[object, ...]:
    spread = (value.mean, value.std, value.minimum, value.maximum)
    return (*spread, value.low, value.high, value.interval_is, value.defined)


def _numbers(value: Statistic) -> dict[str, Any]:
    return {
        "mean": value.mean,
        "std": value.std,
        "min": value.minimum,
        "max": value.maximum,
        "interval": None if value.low is None else [value.low, value.high],
        "interval_is": value.interval_is,
        "defined": value.defined,
    }


def _group_as_dict(place: Mapping[str, object], group: ScoreGroup) -> dict[str, Any]:
    return {
        **{name: "all" if value is None else value for name, value in place.items()},
        "expected": group.expected,
        "evaluated": group.evaluated,
        "failed": group.failed,
        "undefined": group.undefined,
        **{metric: _numbers(value) for metric, value in group.metrics.items()},
        "seconds": _numbers(group.seconds),
    }
