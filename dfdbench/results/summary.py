"""Means, spreads and intervals over a result's pairs."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dfdbench.datasets.manifest import Scene
from dfdbench.metrics.intervals import group_interval, interval_name
from dfdbench.metrics.metric import mean_of
from dfdbench.metrics.protocol import SURE, metrics_of, ranked_by, require_scored
from dfdbench.results.record import PairResult, Result
from dfdbench.tables.table import grouped


@dataclass(frozen=True)
class Statistic:
    """A metric over some pairs.

    Parameters
    ----------
    mean, std : float or None
        Over the pairs for which it is defined; `std` is the sample standard deviation, as in the
        thesis's Tables 4.3 and 5.3. None if there is nothing to average, if a pair of the group
        failed or lacks answers, if an overall group lacks a pair, or (`std`) for a single pair.
    defined : int
        The number of these pairs.
    low, high : float or None
        From `group_interval`; None for a single group of scenes.
    groups : int
        The number of groups of scenes of these pairs.
    interval_is : str or None
        What `low` and `high` are, from `interval_name`; None if there are none.
    minimum, maximum : float or None
        Over the same pairs as `mean`, as in the thesis's Tables 7.3 and 7.6.
    of_what_ran : float or None
        If pairs failed or were not run, the mean of the others.
    """

    mean: float | None
    std: float | None
    defined: int
    low: float | None = None
    high: float | None = None
    groups: int = 0
    interval_is: str | None = None
    minimum: float | None = None
    maximum: float | None = None
    of_what_ran: float | None = None


@dataclass(frozen=True)
class ScoreGroup:
    """The pairs of one table row.

    `block` and `row` are values on the table's axes, or None for all of them together.
    `undefined` counts evaluated pairs for which some metric is undefined, `unanswered` those that
    lack answers which the protocol needs.
    """

    block: int | None
    row: int | None
    expected: int
    evaluated: int
    failed: int
    undefined: int
    metrics: dict[str, Statistic]
    seconds: Statistic
    unanswered: int = 0


@dataclass(frozen=True)
class RunSummary:
    """A run's means and ranking under one protocol, from which all of its tables are made.

    Parameters
    ----------
    result : Result
        The run.
    protocol : str
        The protocol.
    groups : tuple of ScoreGroup
        One per table row: each cell, each block overall, and all pairs last.
    ranked : tuple of PairResult
        The evaluated pairs, best first, see `ranked`.
    """

    result: Result
    protocol: str
    groups: tuple[ScoreGroup, ...]
    ranked: tuple[PairResult, ...]


def summarise(result: Result, protocol: str) -> RunSummary:
    """Compute a run's means and intervals, and rank its pairs.

    Parameters
    ----------
    result : Result
        The run.
    protocol : str
        The protocol.

    Raises
    ------
    UnknownNameError
        If the result was not scored under that protocol.
    """
    require_scored(protocol, result.protocol_names, f"{result.method.name}'s result")
    groups = tuple(_groups(result, protocol))
    return RunSummary(result, protocol, groups, ranked(result, protocol))


def _groups(result: Result, protocol: str) -> Iterator[ScoreGroup]:
    blocks, rows = result.dataset.blocks, result.dataset.rows
    for block in _values(result.pairs, blocks):
        of_block = [pair for pair in result.pairs if pair.coordinates[blocks] == block]
        if rows:
            for row in _values(of_block, rows):
                cell = [pair for pair in of_block if pair.coordinates[rows] == row]
                yield _group(result, cell, protocol, block, row)
        yield _group(result, of_block, protocol, block, overall=bool(rows))
    yield _group(result, result.pairs, protocol, overall=True)


def scene_labels(scenes: Sequence[Scene]) -> dict[str, dict[str, str]]:
    """Return each scene's label by kind of label: geometry and texture.

    Examples
    --------
    >>> scene_labels([Scene(name="k00", source="thesis", geometry="flat-far", texture=0)])
    {'geometry': {'k00': 'flat-far'}, 'texture': {'k00': '00'}}
    """
    named = {
        "geometry": {scene.name: scene.geometry for scene in scenes if scene.geometry},
        "texture": {s.name: f"{s.texture:02d}" for s in scenes if s.texture is not None},
    }
    return {what: label_of for what, label_of in named.items() if label_of}


def summarise_scenes(
    result: Result, protocol: str, label_of: Mapping[str, str]
) -> dict[str, ScoreGroup]:
    """Return a group for each label of scenes, such as a geometry or a texture.

    Parameters
    ----------
    result : Result
        The run.
    protocol : str
        The protocol.
    label_of : mapping of str to str
        The label of each scene; scenes without one are left out.
    """
    labelled = ((label_of[pair.scene], pair) for pair in result.pairs if pair.scene in label_of)
    pairs = grouped(labelled).items()
    return {label: _group(result, members, protocol) for label, members in pairs}


def ranked(result: Result, protocol: str) -> tuple[PairResult, ...]:
    """Rank the evaluated pairs, best first, by NRMSE and then NMAE as in the thesis.

    In metres they are ranked by AbsRel. Pairs for which that score is undefined are left out.
    """
    first_by, ties_by = ranked_by(protocol)
    keys = [
        (first, math.inf if (tie := pair.score(protocol, ties_by)) is None else tie, pair.id, pair)
        for pair in result.evaluated
        if (first := pair.score(protocol, first_by)) is not None
    ]
    return tuple(pair for *_, pair in sorted(keys, key=lambda key: key[:3]))


def median_seconds(results: Iterable[Result]) -> float | None:
    """Return the median seconds per pair over some runs of one method.

    It is None if pairs ran in parallel or on several machines, or if no pair has a time.
    """
    runs = list(results)
    pairs = [pair for run in runs for pair in run.pairs]
    seconds = [pair.seconds for pair in pairs if pair.seconds is not None]
    alone = all(pair.timed_alone for pair in pairs)
    places = (run.environments[pair.machine] for run in runs for pair in run.evaluated)
    machines = {(place.cpu, place.cpu_count, place.gpu) for place in places}
    return float(np.median(seconds)) if seconds and alone and len(machines) == 1 else None


def _values(pairs: Sequence[PairResult], axis: str) -> list[int]:
    return sorted({pair.coordinates[axis] for pair in pairs})


def _group(
    result: Result,
    pairs: Sequence[PairResult],
    protocol: str,
    block: int | None = None,
    row: int | None = None,
    overall: bool = False,
) -> ScoreGroup:
    evaluated = [pair for pair in pairs if pair.status == "ok"]
    failed = sum(pair.status == "failed" for pair in pairs)
    # A cell shows the mean of what was run. An incomplete run has no overall mean, which would be
    # taken for the method's score.
    averaged = not failed and (not overall or len(evaluated) == len(pairs))
    unanswered = sum(pair.lacks_answers(protocol) for pair in evaluated)

    def statistic(values: Sequence[float | None], metric: str | None = None) -> Statistic:
        defined = [
            (result.dataset.group_of(pair.scene), value)
            for pair, value in zip(evaluated, values, strict=True)
            if value is not None
        ]
        # Nor is there a mean over only the pairs for which a method chose to answer enough.
        if metric and any(pair.lacks_answers(protocol, metric) for pair in evaluated):
            return Statistic(None, None, len(defined))
        if averaged:
            return _statistic(defined, overall)
        ran = mean_of(value for _, value in defined)
        return Statistic(None, None, len(defined), of_what_ran=ran)

    # Under `SURE`, what a pair lacks is the method's sigma.
    whole = (pair for pair in evaluated if pair.answered == 1 and protocol != SURE)
    undefined = sum(None in pair.scores[protocol].values() for pair in whole)
    counts = len(pairs), len(evaluated), failed, undefined
    scores = {
        name: statistic([pair.score(protocol, name) for pair in evaluated], name)
        for name in metrics_of(protocol)
    }
    seconds = statistic([pair.seconds for pair in evaluated])
    return ScoreGroup(block, row, *counts, scores, seconds, unanswered)


def _statistic(defined: Sequence[tuple[str, float]], overall: bool) -> Statistic:
    if not defined:
        return Statistic(None, None, 0)
    groups, numbers = zip(*defined, strict=True)
    interval = group_interval(numbers, groups) if overall else None
    std = float(np.std(numbers, ddof=1)) if len(numbers) > 1 else None
    low, high = interval or (None, None)
    count = len({*groups})
    named = interval_name(count) if interval else None
    ends = min(numbers), max(numbers)
    return Statistic(mean_of(numbers), std, len(numbers), low, high, count, named, *ends)
