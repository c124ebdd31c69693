"""Every score of runs as a pandas table, and tables of a run over tracks."""

from collections.abc import Collection, Iterator, Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from dfdbench.blur.tracks import CLEAN, TRACKS, find_degradation
from dfdbench.datasets.catalog import part_name
from dfdbench.metrics.intervals import group_interval, interval_name
from dfdbench.metrics.metric import mean_of
from dfdbench.metrics.protocol import metrics_of, ranked_by, require_scored, title_of
from dfdbench.results import wording
from dfdbench.results.record import Result, shown_protocol
from dfdbench.tables.table import Table

COLUMNS = (
    "run", "dataset", "track", "severity", "split", "method", "parameters", "capture", "scene",
    "group", "coordinates", "status", "protocol", "metric", "value", "seconds",
)  # fmt: skip


#: The status of a pair with unanswered pixels, under a protocol that needs an answer for each.
UNANSWERED = "unanswered"


def scores_of(results: Sequence[Result], protocols: Collection[str] | None = None) -> pd.DataFrame:
    """Return the scores of runs as one long table.

    Parameters
    ----------
    results : sequence of Result
        Runs on any data sets, with any methods.
    protocols : collection of str, optional
        Return only the scores under these.

    Returns
    -------
    DataFrame
        One row per pair, protocol and metric: ``run`` (its index among the results), ``dataset``
        (without its track), ``track`` and ``severity`` (``clean`` and 0 without one), ``split``,
        ``method`` (with its parameters), ``parameters``, ``capture`` (the pair's name), ``scene``,
        ``group`` (the scene's family or room), ``coordinates`` (by axis), ``status``, ``protocol``
        (its name and, from the second version on, the version, as in ``thesis-networks-2``),
        ``metric``, ``value`` and ``seconds``.
        A value is NaN if the pair was not evaluated or the metric is undefined; the status is
        ``unanswered`` if pixels lack an answer that the protocol needs.
    """
    rows = [row for at, result in enumerate(results) for row in _rows(at, result, protocols)]
    return pd.DataFrame(rows, columns=COLUMNS).astype({"value": float, "seconds": float})


def _rows(
    number: int, result: Result, protocols: Collection[str] | None
) -> Iterator[tuple[object, ...]]:
    dataset, method = result.dataset, result.method
    found = find_degradation(dataset.degradation) if dataset.degradation != CLEAN else None
    track, severity = (found.track.name, found.severity) if found else (CLEAN, 0)
    place = (number, part_name(dataset.name)[0], track, severity, dataset.split)
    run = (*place, wording.method_label(method), wording.parameters_of(result))
    labels = [p for p in result.protocol_names if protocols is None or p in protocols]
    scored = {label: _scored_by(result, label) for label in labels}
    for pair in result.pairs:
        capture = (pair.id, pair.scene, dataset.group_of(pair.scene), pair.coordinates)
        for label, names in scored.items():
            for name in names:
                status = UNANSWERED if pair.lacks_answers(label, name) else pair.status
                value = pair.score(label, name)
                yield (*run, *capture, status, label, name, value, pair.seconds)


def _scored_by(result: Result, label: str) -> list[str]:
    """Return the metrics of a protocol that any pair has; all of them if no pair has any."""
    there = {name for pair in result.pairs for name in pair.scores.get(label, ())}
    return [name for name in metrics_of(label) if name in there] or list(metrics_of(label))


def group_means(scores: pd.DataFrame, *by: str) -> pd.Series:
    """Return the mean value of each group; NaN if one of its pairs was not evaluated.

    Pairs for which a metric is undefined are left out. The mean does not depend on their order.

    Parameters
    ----------
    scores : DataFrame
        From `scores_of`.
    *by : str
        The columns that define the groups; they become the index, in order of appearance.
    """
    parts = scores.groupby([*by], sort=False)
    # By hand, because a pandas aggregate that sums exactly takes ten times as long.
    numbers, index = parts.ngroup().to_numpy(), parts.size().index
    order = numbers.argsort(kind="stable")
    starts = np.flatnonzero(np.diff(numbers[order])) + 1
    values = np.split(scores["value"].to_numpy()[order], starts) if len(order) else []
    means = np.array([mean_defined(each) for each in values])
    means[numbers[scores["status"] != "ok"]] = np.nan
    return pd.Series(means, index, name="value")


def capture_means(scores: pd.DataFrame, by: str) -> pd.Series:
    """Return each capture's mean over tracks of its means over severities.

    Parameters
    ----------
    scores : DataFrame
        From `scores_of`, for one metric under one protocol.
    by : str
        The column that becomes the index's first level; ``capture`` and ``group`` follow.
    """
    index = [by, "capture", "group"]
    of_tracks = scores.groupby([*dict.fromkeys((*index, "track"))])["value"].mean()
    return of_tracks.groupby(index).mean()


def with_groups(values: pd.Series) -> tuple[list[float], list[str]]:
    """Return the values of `capture_means` that are not NaN, and the group of each."""
    known = values.dropna()
    return known.tolist(), known.index.get_level_values("group").tolist()


def mean_defined(numbers: NDArray[np.float64]) -> float:
    """Return the mean of the numbers that are not NaN, or NaN if there are none."""
    mean = mean_of(numbers[~np.isnan(numbers)].tolist())
    return np.nan if mean is None else mean


def defined(value: float) -> float | None:
    """Return a number from a table, or None if it is NaN."""
    return None if np.isnan(value) else float(value)


def frame_of(result: Result, protocol: str | None = None) -> pd.DataFrame:
    """Return a result's pairs as a table, as `Run.to_frame` does.

    Parameters
    ----------
    result : Result
        The run.
    protocol : str, optional
        The protocol of the scores; by default the one that the data set's tables show first.

    Returns
    -------
    DataFrame
        One row per pair, indexed by ``pair``, its name: ``scene``, the axes, ``status``, each
        metric and ``seconds``; NaN where there is no value.

    Raises
    ------
    UnknownNameError
        If the result was not scored under that protocol.
    """
    shown = protocol or shown_protocol(result)
    require_scored(shown, result.protocol_names, f"{result.method.name}'s result")
    metrics = tuple(metrics_of(shown))
    rows = [
        {
            "pair": pair.id,
            "scene": pair.scene,
            **{axis: pair.coordinates[axis] for axis in result.dataset.axes},
            "status": UNANSWERED if pair.lacks_answers(shown) else pair.status,
            **{name: pair.score(shown, name) for name in metrics},
            "seconds": pair.seconds,
        }
        for pair in result.pairs
    ]
    frame = pd.DataFrame(rows).set_index("pair")
    return frame.astype(dict.fromkeys((*metrics, "seconds"), float))


def track_means(scores: pd.DataFrame, protocol: str, metric: str) -> pd.DataFrame:
    """Return a method's means, one row per track and one column per severity, 0 for clean images.

    Parameters
    ----------
    scores : DataFrame
        Scores of one method on one split, from `dfdbench.results.frame.scores_of`.
    protocol, metric : str
        Which scores; NaN if a run is incomplete or missing.
    """
    own = scores[(scores["protocol"] == protocol) & (scores["metric"] == metric)]
    means = group_means(own, "track", "severity")
    names = means.index.get_level_values("track")
    tracks = [name for name in dict.fromkeys(names) if name in TRACKS]
    most = max((len(TRACKS[name].severities) for name in tracks), default=0)
    table = means.unstack("severity").reindex(index=tracks, columns=range(most + 1))
    table[0] = means.get((CLEAN, 0), np.nan)
    return table


def severities_table(results: Sequence[Result], protocol: str) -> Table:
    """Return one row per track: the score on clean images, at each severity, and their mean.

    The mean is over the severities without clean, and has an interval over groups of scenes. There
    is no mean if a severity is missing.

    Parameters
    ----------
    results : sequence of Result
        Runs of one method on one split, on clean images and on tracks.
    protocol : str
        The protocol.
    """
    metrics, first_by = metrics_of(protocol), ranked_by(protocol)[0]
    scores = scores_of(results)
    by_metric = {}
    for name in metrics:
        means = track_means(scores, protocol, name)
        by_metric[name] = means.assign(mean=means.drop(columns=0).mean(axis=1, skipna=False))
    shown = by_metric[first_by]
    own = scores[(scores["protocol"] == protocol) & (scores["metric"] == first_by)]
    named = interval_name(own.dropna(subset="value")["group"].nunique())
    intervals = _intervals(own, shown["mean"])
    rows = tuple(
        (str(track), *map(wording.score_text, values), wording.interval_text(interval))
        for (track, values), interval in zip(shown.iterrows(), intervals, strict=True)
    )
    records = tuple(
        {
            "track": track,
            **{
                f"{name} {CLEAN if column == 0 else column}": defined(value)
                for name, means in by_metric.items()
                # Results that are older than a metric do not have it.
                for column, value in means.reindex_like(shown).loc[track].items()
            },
            **dict(zip(("low", "high"), interval or (None, None), strict=True)),
            "interval": named,
        }
        for track, interval in zip(shown.index, intervals, strict=True)
    )
    dataset, method = results[0].dataset, results[0].method
    title = (
        f"{wording.method_label(method)} on the tracks of {dataset.name.partition('@')[0]}, "
        f"split {dataset.split}, protocol {title_of(protocol)}: {metrics[first_by].heading}"
    )
    columns = ("track", CLEAN, *map(str, shown.columns[1:-1]), "mean of severities", named)
    notes = tuple(_notes(results, protocol))
    return Table(title, columns, rows, "l", notes, records=records)


def _intervals(scores: pd.DataFrame, means: pd.Series) -> list[tuple[float, float] | None]:
    """Return the interval of each track's mean, or None if there is none."""
    values = capture_means(scores, "track")
    return [
        None if np.isnan(mean) else group_interval(*with_groups(values.loc[str(track)]))
        for track, mean in means.items()
    ]


def _notes(results: Sequence[Result], protocol: str) -> list[str]:
    notes = [
        f"given on {CLEAN} images: {wording.given_to(run)}"
        for run in results
        if run.dataset.degradation == CLEAN
    ]
    tracked = {wording.given_to(run) for run in results if run.dataset.degradation != CLEAN}
    notes.append(f"given on tracks: {'; '.join(sorted(tracked))}")
    for run in results:
        if not run.complete:
            data = run.dataset
            notes.append(f"{data.degradation}: {data.evaluated} of {data.expected} pairs, no mean")
    gaps = sum(pair.lacks_answers(protocol) for run in results for pair in run.evaluated)
    return notes + [wording.without_answers(gaps)] * bool(gaps)
