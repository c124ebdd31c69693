"""Boards over tracks: for a data set's split one ranking of methods, by their mean over tracks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from dfdbench.blur.tracks import CLEAN, TRACKS
from dfdbench.errors import ResultError
from dfdbench.leaderboard.entry_problems import entry_problems
from dfdbench.leaderboard.folder import require_leaderboard, result_files
from dfdbench.leaderboard.ranks import order_of, tied_ranks
from dfdbench.leaderboard.tracks_submission import (
    HEADLINE,
    is_tracks_file,
    load_tracks,
    tracks_label,
)
from dfdbench.leaderboard.verification_file import (
    SUFFIX,
    Reproduction,
    load_tracks_verification,
    status_of,
)
from dfdbench.metrics.metric import RANKED_BY, TIES_BY, mean_of
from dfdbench.results.record import Result
from dfdbench.results.told import knew_blur
from dfdbench.results.track_tables import severities


@dataclass(frozen=True)
class TracksEntry:
    """A method's runs on clean images and on tracks, their file, and what verifying it found."""

    results: Mapping[str, Result]
    path: Path
    verification: Reproduction | None

    @property
    def label(self) -> str:
        """The method with its parameters."""
        return tracks_label(self.results)

    @property
    def clean(self) -> Result:
        """The run on clean images."""
        return self.results[CLEAN]

    @property
    def on_tracks(self) -> list[Result]:
        """The runs on tracks."""
        return [result for label, result in self.results.items() if label != CLEAN]

    @property
    def told(self) -> bool:
        """Whether the method was told the blur on any track, by what its records say."""
        return any(knew_blur(result) for result in self.results.values())

    @property
    def status(self) -> str:
        """As of `dfdbench.leaderboard.boards.Entry`."""
        return status_of(self.verification)

    def by_track(self, metric: str) -> dict[str, list[float | None]]:
        """Return the averages of each track by severity, from 1; None where a run is lacking."""
        found = severities(self.results, HEADLINE, metric)
        return {
            name: found[name][1:] if name in found else [None] * len(track.severities)
            for name, track in TRACKS.items()
        }

    def means(self, metric: str) -> dict[str, float | None]:
        """Return each track's mean over its severities; None where one is lacking."""
        return {
            name: None if None in values else mean_of(values)
            for name, values in self.by_track(metric).items()
        }

    def mean(self, metric: str) -> float | None:
        """Return the mean over all tracks; None where one is lacking."""
        means = list(self.means(metric).values())
        return None if None in means else mean_of(means)

    @property
    def lacking(self) -> list[str]:
        """The tracks and severities on which there is no complete run."""
        return [
            f"{name}-{number}"
            for name, values in self.by_track(RANKED_BY).items()
            for number, value in enumerate(values, 1)
            if value is None
        ]


@dataclass(frozen=True)
class TracksBoard:
    """Methods that were run on the tracks of one data set's split.

    `rows` are entries with their ranks: by the mean over tracks of NRMSE, ties of NMAE. Without a
    rank stand, last, a method that was told the blur and one that lacks a track.
    """

    dataset: str
    split: str
    rows: tuple[tuple[int | None, TracksEntry], ...]


def collect_tracks(folder: Path) -> list[TracksEntry]:
    """Read every file of runs on tracks of a leaderboard.

    Raises
    ------
    ResultError
        With everything that is wrong in any of the files.
    """
    require_leaderboard(folder)
    entries: list[TracksEntry] = []
    paths, problems = result_files(folder)
    for path in paths:
        try:
            if path.name.endswith(SUFFIX) or not is_tracks_file(path):
                continue
            results = load_tracks(path, folder)
            problems += entry_problems(results[CLEAN].method, path)
            entries.append(TracksEntry(results, path, load_tracks_verification(results, path)))
        except ResultError as error:
            problems += error.problems
    if problems:
        raise ResultError.of(problems)
    return entries


def track_boards(entries: Sequence[TracksEntry]) -> list[TracksBoard]:
    """Part entries into boards by data set, split and data, and rank each."""
    parted: dict[tuple[str, str, str], list[TracksEntry]] = {}
    for entry in entries:
        dataset = entry.clean.dataset
        key = (dataset.name, dataset.split, dataset.fingerprint)
        parted.setdefault(key, []).append(entry)
    return [
        TracksBoard(dataset, split, _ranked(found))
        for (dataset, split, _), found in sorted(parted.items(), key=lambda item: item[0])
    ]


def _ranked(found: Sequence[TracksEntry]) -> tuple[tuple[int | None, TracksEntry], ...]:
    can_rank = [entry for entry in found if not entry.told and entry.mean(RANKED_BY) is not None]
    ranked = sorted(can_rank, key=lambda entry: (*_order(entry), entry.label))
    ranks = tied_ranks([_order(entry) for entry in ranked])
    others = [entry for entry in found if entry not in ranked]
    return (
        *zip(ranks, ranked, strict=True),
        *((None, e) for e in sorted(others, key=lambda e: (e.told, e.label))),
    )


def _order(entry: TracksEntry) -> tuple[float, float]:
    return order_of(entry.mean(RANKED_BY), entry.mean(TIES_BY))
