"""A run's numbers as data: CSV and JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from dfdbench.metrics.intervals import interval_name
from dfdbench.results.record import PairResult, Result
from dfdbench.results.run_tables import EXTREMES
from dfdbench.results.summary import Group, Statistic, ranked, summarise, summarise_scenes
from dfdbench.tables.render import as_csv


def run_as_csv(
    result: Result, protocol: str, labels: Mapping[str, Mapping[str, str]] | None = None
) -> str:
    """Return a run's scores as comma-separated values, a line a group and metric.

    Parameters
    ----------
    result : Result
        The run.
    protocol : str
        Under which protocol.
    labels : mapping of str to mapping, optional
        What else parts the scenes, with each scene's label of it: a column and its groups.
    """
    labels = labels or {}
    dataset = result.dataset
    axes = [axis for axis in (dataset.blocks, dataset.rows) if axis]
    places = [*axes, *labels]
    groups: list[tuple[dict[str, object], Group]] = [
        (dict(zip(axes, (group.block, group.row), strict=False)), group)
        for group in summarise(result, protocol)
    ]
    for what, label_of in labels.items():
        parts = summarise_scenes(result, protocol, label_of).items()
        groups += [({what: label}, group) for label, group in parts]
    rows: list[tuple[object, ...]] = []
    for place, group in groups:
        found = (place.get(name) for name in places)
        where = ["all" if value is None else value for value in found]
        for metric, statistic in [*group.metrics.items(), ("seconds", group.seconds)]:
            rows.append(
                (
                    result.method.name,
                    dataset.name,
                    dataset.split,
                    protocol,
                    *where,
                    metric,
                    statistic.mean,
                    statistic.std,
                    statistic.minimum,
                    statistic.maximum,
                    statistic.low,
                    statistic.high,
                    None if statistic.low is None else interval_name(statistic.scenes),
                    statistic.defined,
                    group.evaluated,
                    group.expected,
                )
            )
    columns = (
        "method",
        "dataset",
        "split",
        "protocol",
        *places,
        "metric",
        "mean",
        "std",
        "min",
        "max",
        "low",
        "high",
        "interval",
        "defined",
        "evaluated",
        "expected",
    )
    return as_csv(columns, rows)


def run_as_json(
    result: Result, protocol: str, labels: Mapping[str, Mapping[str, str]] | None = None
) -> str:
    """Return a run's tables as JSON, numbers in full; `labels` as for `run_as_csv`."""
    dataset = result.dataset

    def line(pair: PairResult) -> dict[str, Any]:
        return {"pair": pair.id, **pair.scores[protocol].model_dump()}

    order = ranked(result, protocol)
    places = [axis for axis in (dataset.blocks, dataset.rows) if axis]
    groups = [
        _group_as_dict(dict(zip(places, (group.block, group.row), strict=False)), group)
        for group in summarise(result, protocol)
    ]
    content = {
        "method": result.method.name,
        "dataset": dataset.name,
        "fingerprint": dataset.fingerprint,
        "split": dataset.split,
        "protocol": protocol,
        "complete": result.complete,
        "evaluated": dataset.evaluated,
        "expected": dataset.expected,
        "groups": groups,
        **{
            f"by_{what}": [
                _group_as_dict({what: label}, group)
                for label, group in summarise_scenes(result, protocol, label_of).items()
            ]
            for what, label_of in (labels or {}).items()
        },
        "top": [line(pair) for pair in order[:EXTREMES]],
        "bottom": [line(pair) for pair in order[EXTREMES:][-EXTREMES:]],
        "failed": {pair.id: pair.error for pair in result.pairs if pair.status == "failed"},
    }
    return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _group_as_dict(place: Mapping[str, object], group: Group) -> dict[str, Any]:
    def statistic(value: Statistic) -> dict[str, Any]:
        return {
            "mean": value.mean,
            "std": value.std,
            "min": value.minimum,
            "max": value.maximum,
            "interval": None if value.low is None else [value.low, value.high],
            "interval_is": None if value.low is None else interval_name(value.scenes),
            "defined": value.defined,
        }

    return {
        **{name: "all" if value is None else value for name, value in place.items()},
        "expected": group.expected,
        "evaluated": group.evaluated,
        "failed": group.failed,
        "undefined": group.undefined,
        **{metric: statistic(value) for metric, value in group.metrics.items()},
        "seconds": statistic(group.seconds),
    }
