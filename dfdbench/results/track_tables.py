"""A method's scores over tracks and their severities, as one table."""

from __future__ import annotations

from collections.abc import Mapping

from dfdbench.blur.tracks import CLEAN, find_degradation
from dfdbench.metrics.metric import mean_of
from dfdbench.metrics.protocol import metrics_of, ranked_by, title_of
from dfdbench.results.record import Result
from dfdbench.results.told import told
from dfdbench.results.wording import method_label, score_text
from dfdbench.tables.table import Table


def severities(
    results: Mapping[str, Result], protocol: str, metric: str
) -> dict[str, list[float | None]]:
    """Return a method's averages by track: clean first, then each severity.

    Parameters
    ----------
    results : mapping of str to Result
        Runs of one method on one split, by ``clean`` and ``TRACK-SEVERITY``.
    protocol, metric : str
        Which averages; None for a run that is incomplete.
    """
    found = [find_degradation(label).track for label in results if label != CLEAN]
    tracks = {track.name: track for track in found}
    labels = {
        name: [CLEAN, *(f"{name}-{number + 1}" for number in range(len(track.severities)))]
        for name, track in tracks.items()
    }
    return {
        name: [_average(results.get(label), protocol, metric) for label in wanted]
        for name, wanted in labels.items()
    }


def _average(result: Result | None, protocol: str, metric: str) -> float | None:
    return ((result.averages if result else None) or {}).get(protocol, {}).get(metric)


def tracks_table(results: Mapping[str, Result], protocol: str) -> Table:
    """Return a row a track: the score on clean images, at each severity, and their mean.

    The mean is over severities, clean left out; without all of them there is none.

    Parameters
    ----------
    results : mapping of str to Result
        Runs of one method on one split, by ``clean`` and ``TRACK-SEVERITY``.
    protocol : str
        Under which protocol.
    """
    metrics, first_by = metrics_of(protocol), ranked_by(protocol)[0]
    by_metric = {name: severities(results, protocol, name) for name in metrics}
    rows, records = [], []
    for track, values in by_metric[first_by].items():
        mean = _mean(values[1:])
        rows.append((track, *map(score_text, values), score_text(mean)))
        record: dict[str, object] = {"track": track}
        for name, tracked in by_metric.items():
            clean, *others = tracked[track]
            record |= {f"{name} {CLEAN}": clean}
            record |= {f"{name} {number}": value for number, value in enumerate(others, 1)}
            record |= {f"{name} mean": _mean(others)}
        records.append(record)
    most = max((len(row) for row in rows), default=3) - 3
    some = next(iter(results.values()))
    dataset = some.dataset
    return Table(
        f"{method_label(some.method)} on the tracks of {dataset.name.partition('@')[0]}, "
        f"split {dataset.split}, protocol {title_of(protocol)}: {metrics[first_by].heading}",
        ("track", CLEAN, *(str(number) for number in range(1, most + 1)), "mean of severities"),
        tuple(rows),
        "l" + "r" * (most + 2),
        _notes(results),
        records=tuple(records),
    )


def _mean(values: list[float | None]) -> float | None:
    return None if None in values or not values else mean_of(values)


def _notes(results: Mapping[str, Result]) -> tuple[str, ...]:
    notes = [f"{CLEAN}: {told(results[CLEAN])}"] if CLEAN in results else []
    tracked = {told(result) for label, result in results.items() if label != CLEAN}
    notes.append(f"on tracks: {'; '.join(sorted(tracked))}")
    for label, result in results.items():
        if not result.complete:
            dataset = result.dataset
            notes.append(f"{label}: {dataset.evaluated} of {dataset.expected} pairs, no average")
    return tuple(notes)
