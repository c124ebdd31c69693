"""The leaderboard: collect sealed results, compare like with like, and rank."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from dfdbench.datasets.catalog import released_manifests
from dfdbench.datasets.manifest import Manifest
from dfdbench.errors import ResultError
from dfdbench.leaderboard.entry_problems import entry_problems
from dfdbench.leaderboard.folder import require_leaderboard, result_files
from dfdbench.leaderboard.ranks import order_of, tied_ranks
from dfdbench.leaderboard.submission import TIME_FORMAT, load_submission
from dfdbench.leaderboard.tracks_submission import is_tracks_file
from dfdbench.leaderboard.verification_file import (
    SUFFIX,
    Reproduction,
    load_verification,
    status_of,
)
from dfdbench.metrics.intervals import scene_interval
from dfdbench.metrics.metric import mean_of
from dfdbench.metrics.protocol import RELEASED, ranked_by
from dfdbench.results.differences import PairedDifference, changes, paired_difference
from dfdbench.results.first_table import first_protocol
from dfdbench.results.record import PairResult, Result
from dfdbench.results.summary import median_seconds
from dfdbench.results.told import knew_blur
from dfdbench.results.wording import NOTHING, labelled, method_label, score_text


@dataclass(frozen=True)
class Entry:
    """A result of the leaderboard, its file, and what verifying it found.

    `place` is that of a `dfdbench.results.saved_run.SavedRun`; the leaderboard itself has none.
    """

    result: Result
    path: Path
    verification: Reproduction | None
    place: str = ""

    @property
    def label(self) -> str:
        """The method with its parameters, and the place where that is needed."""
        return labelled(method_label(self.result.method), self.place)

    @property
    def identity(self) -> tuple[str, str, str]:
        """What makes two results those of one method: name, parameters as JSON, and the place."""
        method = self.result.method
        return method.name, json.dumps(method.parameters, sort_keys=True), self.place

    @property
    def status(self) -> str:
        """``reproduced``, where a sample of its pairs was run again, or ``rerun``.

        Depth maps that were scored, not run, are ``unverified``: nothing can be run again.
        """
        if self.result.method.scored:
            return "unverified"
        return status_of(self.verification)

    @property
    def seconds(self) -> float | None:
        """Median seconds per pair; see `median_seconds`."""
        return median_seconds([self.result])

    def score(self, protocol: str, metric: str) -> float | None:
        """Return the average over all pairs, computed from them; None for an incomplete run."""
        if protocol not in self.result.protocol_names:
            return None
        return mean_over(self.result.pairs, protocol, metric)

    def shown_score(self, protocol: str, metric: str) -> str:
        """Return the average as tables show it.

        Of an incomplete run it is that of the pairs that were evaluated, in brackets.
        """
        if self.result.complete:
            return score_text(self.score(protocol, metric))
        scores = [
            score
            for pair in self.result.pairs
            if pair.status == "ok" and (score := pair.score(protocol, metric)) is not None
        ]
        return f"({score_text(mean_of(scores))})" if scores else NOTHING


@dataclass(frozen=True)
class Standing:
    """An entry's place on its board.

    Parameters
    ----------
    entry : Entry
        The result.
    rank : int or None
        By NRMSE, ties by NMAE, in metres by AbsRel; None for a run that is incomplete or has none,
        and for one that was told the blur on a track.
    interval : tuple of float, or None
        Of NRMSE, as `dfdbench.metrics.intervals.scene_interval` has it.
    above : PairedDifference or None
        How much larger its NRMSE is than that of the row above, pair by pair.
    """

    entry: Entry
    rank: int | None
    interval: tuple[float, float] | None
    above: PairedDifference | None


@dataclass(frozen=True)
class ScoreBoard:
    """Results that may be compared: of one data set fingerprint, split and protocol.

    `superseded` are older results of a method that has a newer one here.
    """

    dataset: str
    split: str
    fingerprint: str
    protocol: str
    standings: tuple[Standing, ...]
    superseded: tuple[tuple[Entry, Entry], ...]

    @property
    def headline(self) -> bool:
        """Whether this protocol's board is the one to look at first; see `first_protocol`."""
        return self.protocol == first_protocol(self.short)

    @property
    def short(self) -> str:
        """The data set's short name."""
        return self.standings[0].entry.result.dataset.short

    @property
    def label(self) -> str:
        """What its tables call the data set: captures that are none say so."""
        return self.standings[0].entry.result.dataset.label

    @property
    def manifest(self) -> Manifest | None:
        """The released manifest of the data set; None for a set of one's own."""
        known = {manifest.stem: manifest for manifest in released_manifests()}
        return known.get(self.dataset)

    @property
    def scenes(self) -> int:
        """How many scenes the split has."""
        return len({pair.scene for s in self.standings for pair in s.entry.result.pairs})


def collect(folder: Path) -> list[Entry]:
    """Read every result of a leaderboard but those that hold runs on tracks together.

    Parameters
    ----------
    folder : Path
        The leaderboard's folder, with ``results/DATASET-SPLIT/PROTOCOL/METHOD.json``.

    Raises
    ------
    ResultError
        With everything that is wrong in any of the files.
    """
    require_leaderboard(folder)
    entries: list[Entry] = []
    paths, problems = result_files(folder)
    for path in paths:
        try:
            if path.name.endswith(SUFFIX):
                _refuse_orphan(path)
            elif not is_tracks_file(path):
                result = load_submission(path, folder)
                problems += entry_problems(result.method, path)
                entries.append(Entry(result, path, load_verification(result, path)))
        except ResultError as error:
            problems += error.problems
    if problems:
        raise ResultError.of(problems)
    return entries


def parted(entries: Sequence[Entry]) -> tuple[list[ScoreBoard], list[ScoreBoard]]:
    """Return the boards of what was run, and those of what was scored and not run, apart.

    Nobody can run the second again, so a rank among the first would say too much.
    """
    run, scored = (
        [entry for entry in entries if bool(entry.result.method.scored) is apart]
        for apart in (False, True)
    )
    return boards(run), boards(scored)


def boards(entries: Sequence[Entry]) -> list[ScoreBoard]:
    """Part entries into boards of what may be compared, and rank each.

    Besides the images, the manifest decides on scores: by its splits, crops and metres.
    """
    groups: dict[tuple[str, str, bool, int, str, str, str], list[Entry]] = {}
    for entry in entries:
        dataset = entry.result.dataset
        for protocol in entry.result.protocol_names:
            order = list(RELEASED).index(protocol) if protocol in RELEASED else len(RELEASED)
            later = protocol != first_protocol(dataset.short)
            data = (dataset.fingerprint, dataset.manifest_sha256)
            key = (dataset.name, dataset.split, later, order, protocol, *data)
            groups.setdefault(key, []).append(entry)
    return [
        _board(dataset, split, fingerprint, protocol, found)
        for (dataset, split, _, _, protocol, fingerprint, _), found in sorted(
            groups.items(), key=lambda item: item[0]
        )
    ]


def _board(
    dataset: str, split: str, fingerprint: str, protocol: str, found: Sequence[Entry]
) -> ScoreBoard:
    newest: dict[tuple[str, str, str], Entry] = {}
    superseded = []
    for entry in sorted(found, key=_age):
        if entry.identity in newest:
            superseded.append((newest[entry.identity], entry))
        newest[entry.identity] = entry
    ranks_by = ranked_by(protocol)[0]
    ranked = sorted(
        (entry for entry in newest.values() if _can_rank(entry, protocol)),
        key=lambda entry: (*_order(entry, protocol), entry.label),
    )
    standings: list[Standing] = []
    ranks = tied_ranks([_order(entry, protocol) for entry in ranked])
    for above, entry, rank in zip([None, *ranked], ranked, ranks, strict=False):
        difference = None
        if above is not None:
            found_changes = changes(above.result, entry.result, protocol, ranks_by)
            difference = paired_difference(found_changes, ranks_by)
        standings.append(Standing(entry, rank, _interval(entry.result, protocol), difference))
    unranked = [entry for entry in newest.values() if not _can_rank(entry, protocol)]
    standings += [
        Standing(entry, None, None, None)
        for entry in sorted(unranked, key=lambda entry: entry.label)
    ]
    return ScoreBoard(dataset, split, fingerprint, protocol, tuple(standings), tuple(superseded))


def mean_over(pairs: Sequence[PairResult], protocol: str, metric: str) -> float | None:
    """Return the average over some pairs; None where one is lacking, as in a run's table."""
    if not pairs or any(pair.status != "ok" for pair in pairs):
        return None
    return mean_of(pair.score(protocol, metric) for pair in pairs)


def _can_rank(entry: Entry, protocol: str) -> bool:
    return entry.score(protocol, ranked_by(protocol)[0]) is not None and not knew_blur(entry.result)


def _age(entry: Entry) -> tuple[str, str]:
    submission = entry.result.submission
    if submission:
        return (submission.submitted, str(entry.path))
    written = datetime.fromtimestamp(entry.path.stat().st_mtime, UTC)
    return (written.strftime(TIME_FORMAT), str(entry.path))


def _order(entry: Entry, protocol: str) -> tuple[float, float]:
    first, second = ranked_by(protocol)
    return order_of(entry.score(protocol, first), entry.score(protocol, second))


def _interval(result: Result, protocol: str) -> tuple[float, float] | None:
    metric = ranked_by(protocol)[0]
    defined = [
        (score, pair.scene)
        for pair in result.pairs
        if pair.status == "ok" and (score := pair.score(protocol, metric)) is not None
    ]
    return scene_interval([score for score, _ in defined], [scene for _, scene in defined])


def _refuse_orphan(path: Path) -> None:
    if not path.with_name(path.name.removesuffix(SUFFIX) + ".json").exists():
        raise ResultError("a verification without its result", where=str(path), fix="delete it")
