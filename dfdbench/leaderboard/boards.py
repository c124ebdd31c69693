"""The leaderboard: collect sealed results, compare like with like, and rank."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from dfdbench.datasets.catalog import released_manifests
from dfdbench.datasets.manifest import Manifest
from dfdbench.errors import Problem, ResultError
from dfdbench.leaderboard.folder import RESULTS, require_leaderboard
from dfdbench.leaderboard.submission import TIME_FORMAT, load_submission
from dfdbench.leaderboard.tracks_submission import is_tracks_file
from dfdbench.leaderboard.verification import entry_problems
from dfdbench.leaderboard.verification_file import SUFFIX, Reproduction, load_verification
from dfdbench.metrics.intervals import scene_interval
from dfdbench.metrics.metric import mean_of
from dfdbench.metrics.of_protocol import ranked_by
from dfdbench.metrics.protocol import RELEASED
from dfdbench.results.differences import PairedDifference, changes, paired_difference
from dfdbench.results.record import Result
from dfdbench.results.told import knew_blur
from dfdbench.results.wording import method_label

#: Sets whose first board is under the thesis's protocol, which its printed tables are held
#: against. There SSIM and unknown pixels flatter everyone; other sets are headed by `valid`.
_HEADED_BY_THESIS = ("demo", "middlebury", "realworld", "realworld-synthetic")


def headline_of(short: str) -> str:
    """Return the protocol that a data set, by its short name, is ranked by first.

    Examples
    --------
    >>> headline_of("demo"), headline_of("middlebury-default")
    ('thesis', 'valid')
    """
    return "thesis" if short in _HEADED_BY_THESIS else "valid"


@dataclass(frozen=True)
class Entry:
    """A result of the leaderboard, its file, and what verifying it found."""

    result: Result
    path: Path
    verification: Reproduction | None

    @property
    def label(self) -> str:
        """The method with its parameters."""
        return method_label(self.result.method)

    @property
    def status(self) -> str:
        """``reproduced``, where a sample of its pairs was run again, or ``rerun``.

        Depth maps that were scored, not run, are ``unverified``: nothing can be run again.
        """
        if self.result.method.scored:
            return "unverified"
        return "reproduced" if self.verification else "rerun"

    @property
    def seconds(self) -> float | None:
        """Mean seconds a pair; None where they cannot be compared, or nothing was evaluated."""
        if not all(pair.timed_alone for pair in self.result.pairs):
            return None
        return mean_of(pair.seconds for pair in self.result.pairs)

    def score(self, protocol: str, metric: str) -> float | None:
        """Return the average over all pairs; None for an incomplete run."""
        return (self.result.averages or {}).get(protocol, {}).get(metric)


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
        """Whether this protocol's board is the one to look at first; see `_HEADED_BY_THESIS`."""
        return self.protocol == headline_of(self.short)

    @property
    def short(self) -> str:
        """The data set's short name."""
        return self.standings[0].entry.result.dataset.short

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
    problems: list[Problem] = []
    for path in sorted((folder / RESULTS).rglob("*.json")):
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
    """Part entries into boards of what may be compared, and rank each."""
    groups: dict[tuple[str, str, bool, int, str, str], list[Entry]] = {}
    for entry in entries:
        dataset = entry.result.dataset
        for protocol in entry.result.protocol_names:
            order = list(RELEASED).index(protocol) if protocol in RELEASED else len(RELEASED)
            later = protocol != headline_of(dataset.short)
            key = (dataset.name, dataset.split, later, order, protocol, dataset.fingerprint)
            groups.setdefault(key, []).append(entry)
    return [
        _board(dataset, split, fingerprint, protocol, found)
        for (dataset, split, _, _, protocol, fingerprint), found in sorted(
            groups.items(), key=lambda item: item[0]
        )
    ]


def _board(
    dataset: str, split: str, fingerprint: str, protocol: str, found: Sequence[Entry]
) -> ScoreBoard:
    newest: dict[str, Entry] = {}
    superseded = []
    for entry in sorted(found, key=_age):
        if entry.label in newest:
            superseded.append((newest[entry.label], entry))
        newest[entry.label] = entry
    ranks_by = ranked_by(protocol)[0]
    ranked = sorted(
        (entry for entry in newest.values() if _can_rank(entry, protocol)),
        key=lambda entry: (*_order(entry, protocol), entry.label),
    )
    standings: list[Standing] = []
    for place, entry in enumerate(ranked, 1):
        above = ranked[place - 2] if place > 1 else None
        tied = above is not None and _order(above, protocol) == _order(entry, protocol)
        rank = standings[-1].rank if tied else place
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


def _can_rank(entry: Entry, protocol: str) -> bool:
    return entry.score(protocol, ranked_by(protocol)[0]) is not None and not knew_blur(entry.result)


def _age(entry: Entry) -> tuple[str, str]:
    submission = entry.result.submission
    if submission:
        return (submission.submitted, str(entry.path))
    written = datetime.fromtimestamp(entry.path.stat().st_mtime, UTC)
    return (written.strftime(TIME_FORMAT), str(entry.path))


def _order(entry: Entry, protocol: str) -> tuple[float, float]:
    first, second = (entry.score(protocol, metric) for metric in ranked_by(protocol))
    return (math.inf if first is None else first, math.inf if second is None else second)


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
