"""Rank methods on the same data, split and protocol, from one long table of scores."""

import functools
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise, zip_longest
from pathlib import Path
from statistics import fmean

import numpy as np
import pandas as pd

from dfdbench.blur.tracks import CLEAN, SUITES, find_degradation
from dfdbench.metrics.intervals import INTERVAL_GROUPS, group_interval
from dfdbench.metrics.metric import find_metric
from dfdbench.metrics.protocol import RELEASED, SURE, VALID, metrics_of, ranked_by
from dfdbench.results import frame
from dfdbench.results.differences import PairedDifference, corrected, paired_difference
from dfdbench.results.record import Result, first_protocol
from dfdbench.results.summary import median_seconds
from dfdbench.results.wording import NOTHING, knew_blur, score_text
from dfdbench.tables.table import counted

#: The protocol that suites of tracks are ranked by.
TRACKS_PROTOCOL = VALID


@dataclass(frozen=True)
class Entry:
    """A method's runs that a ranking uses, and their file.

    Parameters
    ----------
    runs : tuple of Result
        One run; for a suite of tracks, the run on clean images first, then those on tracks.
    path : Path
        Their file.
    label : str
        The method with its parameters.
    """

    runs: tuple[Result, ...] = field(repr=False)
    path: Path
    label: str

    @property
    def result(self) -> Result:
        """The first run."""
        return self.runs[0]

    @property
    def ranked_runs(self) -> tuple[Result, ...]:
        """The runs that a rank is based on: those on tracks, or the only one."""
        on_tracks = tuple(run for run in self.runs if run.dataset.degradation != CLEAN)
        return on_tracks or self.runs

    @property
    def given_blur(self) -> bool:
        """Whether the method was given a blur on a track, so that it has no rank."""
        return any(knew_blur(run.method, run.dataset.degradation) for run in self.runs)

    @property
    def complete(self) -> bool:
        """Whether every pair of every run was evaluated."""
        return all(run.complete for run in self.ranked_runs)

    @property
    def seconds(self) -> float | None:
        """Median seconds per pair; see `median_seconds`."""
        return median_seconds(self.ranked_runs)

    def unranked(self, protocol: str) -> str:
        """Say why its row has no rank, and what it shows instead."""
        done, expected = self.result.evaluated, self.result.dataset.expected
        first = ranked_by(protocol)[0]
        if gaps := sum(pair.lacks_answers(protocol, first) for pair in done):
            part = "half of the known pixels" if protocol == SURE else "every pixel"
            return f"not ranked: {counted(gaps, 'pair')} without an answer for {part}"
        if self.given_blur:
            return "not ranked: given a blur on a track"
        if self.complete:
            return f"not ranked: {find_metric(first).title} is defined for no pair"
        means = "; their means are in brackets" if done else ""
        return f"not ranked: {len(done)} of {expected} pairs evaluated{means}"


@dataclass(frozen=True)
class Standing:
    """An entry's place in a ranking.

    Parameters
    ----------
    entry : Entry
        The method.
    rank : int or None
        Shared if the intervals overlap, provided there are enough groups for intervals. None if a
        score is missing, the method was given a blur on a track, or the ranking has no ranks.
    scores : dict of str to float or None
        By metric; on a suite of tracks, the mean over tracks of the mean over severities.
    interval : tuple of float, or None
        The interval of the ranking score, from `dfdbench.metrics.intervals.group_interval`.
    above : PairedDifference or None
        This row's score minus that of the row above, pair by pair; its `p` is corrected for the
        number of rows.
    """

    entry: Entry
    rank: int | None
    scores: dict[str, float | None]
    interval: tuple[float, float] | None = None
    above: PairedDifference | None = None

    @property
    def place(self) -> str:
        """The rank as text."""
        return NOTHING if self.rank is None else str(self.rank)


@dataclass(frozen=True)
class ScoreBoard:
    """Comparable methods, ranked: on the same data, split, protocol and suite.

    `scores` is their part of the long table from `dfdbench.results.frame.scores_of`; its column
    ``row`` is the index in `standings`.
    """

    suite: str
    protocol: str
    standings: tuple[Standing, ...]
    scores: pd.DataFrame

    def __repr__(self) -> str:
        what = f"{self.result.dataset.heading}, {self.suite}, protocol {self.protocol}"
        return f"<{what}: {counted(len(self.standings), 'method')}>"

    @property
    def result(self) -> Result:
        """One run of the board: all are on the same data."""
        return self.standings[0].entry.result

    @property
    def headline(self) -> bool:
        """Whether this is the ranking to look at first; see `first_protocol`."""
        return self.protocol == first_protocol(self.result.dataset.short)

    @property
    def metric(self) -> str:
        """The metric that ranks."""
        return ranked_by(self.protocol)[0]

    @functools.cached_property
    def groups(self) -> int:
        """How many independent groups of scenes the ranking score is over."""
        return _groups(self.scores, self.metric)

    def means(self, scores: pd.DataFrame, *by: str) -> pd.DataFrame:
        """Return means of some of the board's scores: a row per group, a column per standing."""
        table = frame.group_means(scores, "row", *by).unstack("row")
        return table.reindex(columns=range(len(self.standings)))

    def shown(self, row: int, metric: str) -> str:
        """Format a score; that of an incomplete run is in brackets and covers only what was run."""
        standing = self.standings[row]
        if standing.entry.complete:
            return score_text(standing.scores.get(metric))
        own = self.scores[(self.scores["row"] == row) & (self.scores["metric"] == metric)]
        mean = frame.mean_defined(own["value"].to_numpy())
        gaps = (own["status"] == frame.UNANSWERED).any()
        return NOTHING if gaps or np.isnan(mean) else f"({score_text(mean)})"


def boards(
    entries: Sequence[Entry], suite: str = CLEAN, ranked: bool = True, headlines: bool = False
) -> list[ScoreBoard]:
    """Return a ranking of methods for each data set, split, data, manifest and protocol.

    Parameters
    ----------
    entries : sequence of Entry
        The methods.
    suite : str
        What to rank: single runs (``clean``), or a suite of `dfdbench.blur.tracks.SUITES`.
    ranked : bool
        Whether rows get a rank.
    headlines : bool
        Return only the rankings to look at first.
    """
    runs = [(number, run) for number, entry in enumerate(entries) for run in entry.runs]
    if not runs:
        return []
    groups: dict[tuple[str, str, bool, int, str, str, str], list[int]] = {}
    for number, entry in enumerate(entries):
        data = entry.result.dataset
        for protocol in entry.result.protocol_names:
            order = list(RELEASED).index(protocol) if protocol in RELEASED else len(RELEASED)
            later = protocol != first_protocol(data.short)
            if (suite != CLEAN and protocol != TRACKS_PROTOCOL) or (headlines and later):
                continue
            key = (data.name, data.split, later, order, protocol)
            groups.setdefault((*key, data.fingerprint, data.manifest_sha256), []).append(number)
    scores = frame.scores_of([run for _, run in runs], {key[4] for key in groups})
    scores["entry"] = scores["run"].map(dict(enumerate(number for number, _ in runs)))
    return [
        _board(entries, members, scores, suite, key[4], ranked)
        for key, members in sorted(groups.items(), key=lambda item: item[0])
    ]


def over_tracks(means: pd.Series, suite: str) -> pd.DataFrame:
    """Return each track's mean over severities; NaN if a severity is missing.

    Parameters
    ----------
    means : Series
        Means of runs, with ``track`` and ``severity`` as the last two levels of the index.
    suite : str
        The suite whose tracks are required; for ``clean``, whatever tracks there are.
    """
    parts = pd.DataFrame(means.unstack(["track", "severity"]))
    if suite != CLEAN:
        found = [find_degradation(label) for label in SUITES[suite]]
        wanted = [(place.track.name, place.severity) for place in found]
        parts = parts.reindex(columns=pd.MultiIndex.from_tuples(wanted, names=parts.columns.names))
    tracks, table = parts.columns.get_level_values("track"), parts.to_numpy()
    each = {name: list(map(fmean, table[:, tracks == name])) for name in tracks.unique()}
    return pd.DataFrame(each, parts.index).rename_axis(columns="track")


def _board(
    entries: Sequence[Entry],
    members: Sequence[int],
    scores: pd.DataFrame,
    suite: str,
    protocol: str,
    ranked: bool,
) -> ScoreBoard:
    part = scores[scores["entry"].isin(members) & (scores["protocol"] == protocol)]
    first, ties = ranked_by(protocol)
    by_run = frame.group_means(part, "entry", "metric", "track", "severity")
    means = over_tracks(by_run, suite).agg(fmean, axis=1).unstack("metric").to_dict()

    def score(number: int, metric: str) -> float | None:
        return frame.defined(means[metric].get(number, np.nan))

    def order(number: int) -> tuple[float, float]:
        value, tie = score(number, first), score(number, ties)
        return (np.inf if value is None else value, np.inf if tie is None else tie)

    able = {n for n in members if score(n, first) is not None and not entries[n].given_blur}
    placed = sorted(able, key=lambda n: (*order(n), entries[n].label))
    places = [order(number) for number in placed]
    others = {n for n in members if n not in able}
    placed += sorted(others, key=lambda n: (entries[n].given_blur, entries[n].label))
    own = part[(part["metric"] == first) & ((part["track"] != CLEAN) | (suite == CLEAN))]
    values = frame.capture_means(own, "entry")
    ranking = [values[number] for number in placed[: len(able)]]
    intervals = [group_interval(*frame.with_groups(each)) for each in ranking]
    differences = [
        paired_difference(*frame.with_groups(each - before), first)
        for before, each in pairwise(ranking)
    ]
    standings: list[Standing] = []
    for at, (number, interval, above) in enumerate(
        zip_longest(placed, intervals, corrected([None, *differences]))
    ):
        found = {
            metric: score(number, metric) for metric in metrics_of(protocol) if metric in means
        }
        rank = places.index(places[at]) + 1 if number in able and ranked else None
        standings.append(Standing(entries[number], rank, found, interval, above))
    if _groups(part, first) >= INTERVAL_GROUPS:
        standings = _with_shared_ranks(standings)
    rows = part["entry"].map({number: at for at, number in enumerate(placed)})
    return ScoreBoard(suite, protocol, tuple(standings), part.assign(row=rows))


def _groups(scores: pd.DataFrame, metric: str) -> int:
    """Return the number of groups, without those whose truth leaves the metric undefined."""
    undefined = (scores["status"] == "ok") & scores["value"].isna()
    own = scores[(scores["metric"] == metric) & ~undefined]
    return int((scores if own.empty else own)["group"].nunique())


def _with_shared_ranks(standings: Sequence[Standing]) -> list[Standing]:
    """Let rows share a rank if their intervals overlap, which is too close to call."""
    highs = [s.interval[1] for s in standings if s.interval and s.rank is not None]
    shared = []
    lowest = len(standings)
    # From the last row up: a narrow interval must not rank below a wide one with a worse mean.
    for standing in reversed(standings):
        if standing.interval and standing.rank is not None:
            low = standing.interval[0]
            lowest = min(lowest, 1 + sum(high < low for high in highs))
            standing = replace(standing, rank=lowest)
        shared.append(standing)
    return shared[::-1]
