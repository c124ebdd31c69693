"""Scores as pandas tables: one long table for any number of runs, or one row per pair."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from dfdbench.blur.tracks import CLEAN, find_degradation
from dfdbench.datasets.tracked import part_name
from dfdbench.metrics.metric import mean_of
from dfdbench.metrics.protocol import metrics_of, require_scored
from dfdbench.results.first_table import shown_protocol
from dfdbench.results.record import Result
from dfdbench.results.wording import method_label, parameters_of

COLUMNS = (
    "run",
    "dataset",
    "track",
    "severity",
    "split",
    "method",
    "parameters",
    "capture",
    "scene",
    "coordinates",
    "status",
    "protocol",
    "metric",
    "value",
    "seconds",
)


def scores_of(results: Sequence[Result]) -> pd.DataFrame:
    """Return the scores of runs as one long table.

    Parameters
    ----------
    results : sequence of Result
        Runs on any data sets, with any methods.

    Returns
    -------
    DataFrame
        A row per pair, protocol and metric: ``run`` (its place among the results), ``dataset``
        (without its track), ``track`` and ``severity`` (``clean`` and 0 without one), ``split``,
        ``method`` (with its parameters), ``parameters``, ``capture`` (the pair's name), ``scene``,
        ``coordinates`` (by axis), ``status``, ``protocol``, ``metric``, ``value`` and ``seconds``.
        A value is NaN if the pair was not evaluated or the metric is undefined.
    """
    rows: list[dict[str, object]] = []
    for number, result in enumerate(results):
        dataset = result.dataset
        found = find_degradation(dataset.degradation) if dataset.degradation != CLEAN else None
        run = {
            "run": number,
            "dataset": part_name(dataset.name)[0],
            "track": found.track.name if found else CLEAN,
            "severity": found.severity if found else 0,
            "split": dataset.split,
            "method": method_label(result.method),
            "parameters": parameters_of(result),
        }
        scored = {
            label: [
                name
                for name in metrics_of(label)
                if any(name in pair.scores.get(label, {}) for pair in result.pairs)
            ]
            or list(metrics_of(label))
            for label in result.protocol_names
        }
        for pair in result.pairs:
            place = {"capture": pair.id, "scene": pair.scene, "coordinates": pair.coordinates}
            for protocol, metrics in scored.items():
                scores = pair.scores.get(protocol, {})
                for metric in metrics:
                    rows.append(
                        {
                            **run,
                            **place,
                            "status": pair.status,
                            "protocol": protocol,
                            "metric": metric,
                            "value": scores.get(metric),
                            "seconds": pair.seconds,
                        }
                    )
    frame = pd.DataFrame(rows, columns=COLUMNS)
    return frame.astype({"value": float, "seconds": float})


def mean_scores(scores: pd.DataFrame, *by: str) -> pd.Series:
    """Return the mean value of each group; NaN if one of its pairs was not evaluated.

    Pairs for which a metric is undefined are left out. The mean does not depend on their order.

    Parameters
    ----------
    scores : DataFrame
        From `scores_of`.
    *by : str
        Its columns that make the groups; the answer has them as index, in order of appearance.
    """
    parts = scores.assign(evaluated=scores["status"] == "ok").groupby([*by], sort=False)
    means = parts["value"].agg(mean_defined)
    return means.where(parts["evaluated"].all())


def mean_defined(values: pd.Series) -> float:
    """Return the mean of the values that are not NaN, or NaN if there are none."""
    numbers = values.to_numpy()
    mean = mean_of(numbers[~np.isnan(numbers)].tolist())
    return np.nan if mean is None else mean


def frame_of(result: Result, protocol: str | None = None) -> pd.DataFrame:
    """Return a result's pairs as a table; this is `Result.to_frame`.

    Parameters
    ----------
    result : Result
        The run.
    protocol : str, optional
        Whose scores; default: the one that the data set's tables show first.

    Returns
    -------
    DataFrame
        One row per pair, by ``pair``, its name: ``scene``, the axes, ``status``, each metric and
        ``seconds``; NaN where there is none.

    Raises
    ------
    UnknownNameError
        Where the result was not scored under that protocol.
    """
    shown = protocol or shown_protocol(result)
    require_scored(shown, result.protocol_names, f"{result.method.name}'s result")
    metrics = tuple(metrics_of(shown))
    rows = [
        {
            "pair": pair.id,
            "scene": pair.scene,
            **{axis: pair.coordinates[axis] for axis in result.dataset.axes},
            "status": pair.status,
            **{name: pair.score(shown, name) if pair.scores else None for name in metrics},
            "seconds": pair.seconds,
        }
        for pair in result.pairs
    ]
    frame = pd.DataFrame(rows).set_index("pair")
    return frame.astype(dict.fromkeys((*metrics, "seconds"), float))
