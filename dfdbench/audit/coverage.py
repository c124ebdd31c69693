"""Find the depth levels of a test that its training lacks: verdicts, a JSON record, and tables."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from dfdbench.audit.leaks import Leak
from dfdbench.audit.sides import Mask, Side, as_ranges, range_text, runs
from dfdbench.blur.recipe import LEVELS
from dfdbench.datasets.manifest import simulated_label
from dfdbench.results.record import Share
from dfdbench.system import text
from dfdbench.system.strict import Record, check_fields
from dfdbench.tables.table import Table, counted, listed, percent

WEIGHTS = "each depth map counts once for each pair that the manifest makes of it"
_SCENES_NAMED = 4
_ABSENT_NAMED = 8

Counts = NDArray[np.int64] | NDArray[np.float64]


class Verdict(StrEnum):
    """How well training covers a depth level of the test."""

    missing = "missing"
    scarce = "scarce"
    covered = "covered"


class Criterion(StrEnum):
    """What makes a level uncovered; `either` applies both."""

    thesis = "thesis"
    density = "density"
    either = "either"


@dataclass(frozen=True)
class Rule:
    """When a level of the test counts as uncovered, and when the test counts as covered.

    Parameters
    ----------
    criterion : Criterion
        `thesis`: the test has more pixels of the level than training (5.4.2), which includes every
        missing level. `density`: the level is too dense in the test for its density in training.
        `either` applies both.
    allowed_share : float
        Share of the test's known pixels that may be on uncovered levels.
    density_factor : float
        A level is too dense if its share of the test's known pixels exceeds its share of the
        training set's by more than this factor.
    density_floor : float
        Levels with a smaller share of the test raise no alarm.

    Raises
    ------
    InputError
        If a number is outside its range.

    Notes
    -----
    The thesis compares counts, so its criterion weakens as the test shrinks: for the published
    split it strikes at about 404 / 54 = 7.5 times the density of training. The density criterion
    keeps to about this factor for tests of any size.
    """

    criterion: Criterion = Criterion.either
    allowed_share: Share = 0.0
    density_factor: Annotated[float, Field(ge=1, allow_inf_nan=False)] = 8.0
    density_floor: Share = 0.001

    def __post_init__(self) -> None:
        check_fields(self, "rule of coverage")

    def uncovered(self, train: Counts, test: Counts, criterion: Criterion | None = None) -> Mask:
        """Return which levels are not covered, for counts of shape (..., 256).

        Examples
        --------
        >>> train, test = np.zeros(256), np.zeros(256)
        >>> train[[8, 9]], test[[8, 9]] = (900, 1), (100, 2)
        >>> np.flatnonzero(Rule().uncovered(train, test, Criterion.thesis)).tolist()
        [9]
        """
        criterion = criterion or self.criterion
        by_count = np.asarray(test > train)
        if criterion is Criterion.thesis:
            return by_count
        in_test = test / np.maximum(test.sum(axis=-1, keepdims=True), 1)
        in_train = train / np.maximum(train.sum(axis=-1, keepdims=True), 1)
        by_density = (in_test > self.density_factor * in_train) & (test > 0)
        by_density &= in_test >= self.density_floor
        return np.asarray(by_density if criterion is Criterion.density else by_count | by_density)


#: The default rule.
USUAL = Rule()


def share_of(counts: Counts, levels: Mask) -> float:
    """Return the share of the pixels on some levels."""
    total = counts.sum()
    return float(counts[levels].sum() / total) if total else 0.0


class SideRecord(Record):
    """One side: its scenes, pixels, and histograms over levels 0 to 255.

    `expanded` is the expected number of pixels if each pair is drawn once as a 32 x 32 crop in
    8 orientations; `inverted` says that levels were inverted (Eq. 7.1).
    """

    dataset: str
    fingerprint: str
    split: str
    scenes: list[str]
    absent_scenes: list[str]
    pairs: int
    known_pixels: int
    unknown_pixels: int
    inverted: bool
    counts: list[int]
    expanded: list[float]
    simulated: bool = False

    @property
    def label(self) -> str:
        """The data set's name in tables and figures; simulated sets are marked."""
        return simulated_label(self.dataset, self.simulated)


class RangeRecord(Record):
    """Neighbouring levels with one verdict and the same criteria.

    `share` is that of the test's known pixels; `scenes` divides the range's test pixels.
    """

    first: int
    last: int
    verdict: Verdict
    criteria: list[Criterion]
    test_pixels: int
    train_pixels: int
    share: float
    scenes: dict[str, float]

    @property
    def levels(self) -> str:
        """The levels as text, e.g. ``36-38``."""
        return range_text(self.first, self.last)


class CoverageRecord(Record):
    """A comparison in full.

    `shares` are shares of the test's known pixels by verdict and by criterion, `expanded_shares`
    the uncovered ones if both sides are seen as random crops. `covered` says whether the share
    that `criterion` finds is at most `allowed_share`; with leaks it is never true.
    """

    format: Literal["dfdbench coverage"] = "dfdbench coverage"
    schema_version: Literal[1] = 1
    covered: bool
    criterion: Criterion
    allowed_share: float
    density_factor: float
    density_floor: float
    weights: str
    train: SideRecord
    test: SideRecord
    shares: dict[str, float]
    expanded_shares: dict[str, float]
    ranges: list[RangeRecord]
    verdicts: list[Verdict | None]
    leaks: list[Leak]

    def levels(self, *verdicts: Verdict) -> Mask:
        """Return which levels have one of the verdicts."""
        return np.array([verdict in verdicts for verdict in self.verdicts])

    def ranges_of(self, kind: Verdict | Criterion) -> str:
        """Format the uncovered levels of a verdict, or by a criterion, as ranges."""
        marked = np.zeros(LEVELS, bool)
        for item in self.ranges:
            if kind in (item.verdict, *item.criteria, Criterion.either):
                marked[item.first : item.last + 1] = True
        return as_ranges(marked)


def compare_depths(
    train: Side, test: Side, rule: Rule = USUAL, leaks: tuple[Leak, ...] = ()
) -> CoverageRecord:
    """Compare the depths of a test with those of its training.

    Parameters
    ----------
    train, test : Side
        From `dfdbench.audit.sides.sides_of`.
    rule : Rule
        Decides whether the test is covered; the record has both criteria.
    leaks : tuple of Leak
        What both sides share.
    """
    seen, tested = train.histogram, test.histogram
    by_criterion = {c: rule.uncovered(seen.counts, tested.counts, c) for c in Criterion}
    as_crops = {c: rule.uncovered(seen.expanded, tested.expanded, c) for c in Criterion}
    either = by_criterion[Criterion.either]
    missing = (tested.counts > 0) & (seen.counts == 0)
    masks: dict[str, Mask] = {str(c): mask for c, mask in by_criterion.items()}
    masks |= {"missing": missing, "scarce": either & ~missing, "covered": ~either}
    shares = {name: share_of(tested.counts, mask) for name, mask in masks.items()}
    verdicts = [
        Verdict.missing if m else Verdict.scarce if u else Verdict.covered if pixels else None
        for m, u, pixels in zip(missing, either, tested.counts, strict=True)
    ]
    return CoverageRecord(
        covered=shares[rule.criterion] <= rule.allowed_share and not leaks,
        **asdict(rule),
        weights=WEIGHTS,
        train=_side_record(train),
        test=_side_record(test),
        shares=shares,
        expanded_shares={str(c): share_of(tested.expanded, as_crops[c]) for c in Criterion},
        ranges=_ranges(train, test, verdicts, by_criterion),
        verdicts=verdicts,
        leaks=list(leaks),
    )


def as_json(record: CoverageRecord) -> str:
    """Format a record as its JSON file."""
    return record.model_dump_json(indent=1) + "\n"


def _side_record(side: Side) -> SideRecord:
    histogram, manifest = side.histogram, side.store.manifest
    return SideRecord(
        dataset=manifest.stem,
        fingerprint=side.store.fingerprint,
        split=side.name,
        scenes=list(side.scenes),
        absent_scenes=list(side.absent),
        pairs=histogram.pairs,
        known_pixels=histogram.known,
        unknown_pixels=histogram.unknown,
        inverted=side.inverted,
        counts=histogram.counts.tolist(),
        expanded=np.round(histogram.expanded, 3).tolist(),
        simulated=manifest.simulated,
    )


def _ranges(
    train: Side, test: Side, verdicts: list[Verdict | None], masks: Mapping[Criterion, Mask]
) -> list[RangeRecord]:
    hits = [[c for c in Criterion if masks[c][n]] for n in range(LEVELS)]
    seen, counts = train.histogram.counts, test.histogram.counts
    found = []
    for first, last in runs([(v, h) if h else None for v, h in zip(verdicts, hits, strict=True)]):
        span = slice(first, last + 1)
        pixels = int(counts[span].sum())
        scenes = {name: int(h.counts[span].sum()) / pixels for name, h in test.scenes.items()}
        most_first = sorted(scenes.items(), key=lambda item: -item[1])
        found.append(
            RangeRecord(
                first=first,
                last=last,
                verdict=Verdict(str(verdicts[first])),
                criteria=[c for c in hits[first] if c is not Criterion.either],
                test_pixels=pixels,
                train_pixels=int(seen[span].sum()),
                share=pixels / int(counts.sum()),
                scenes={name: share for name, share in most_first if share},
            )
        )
    return found


def coverage_table(record: CoverageRecord) -> Table:
    """Return the uncovered ranges of levels with their pixels and scenes."""
    rows = tuple(
        (
            item.levels,
            item.verdict,
            " and ".join(item.criteria),
            percent(item.share),
            f"{item.test_pixels:,}",
            f"{item.train_pixels:,}",
            listed((f"{name} {percent(s)}" for name, s in item.scenes.items()), _SCENES_NAMED),
        )
        for item in record.ranges
    )
    columns = ("levels", "verdict", "criterion", "share", "in test", "in training", "scenes")
    title = f"depths of {_name(record.test)} that {_name(record.train)} lacks"
    return Table(title, columns, rows, "lllrrrl", tuple(_notes(record)))


def verdict_line(record: CoverageRecord) -> str:
    """Say in one line whether the test is covered."""
    if record.leaks:
        return f"LEAK: {leak_text(record)}: the test says nothing of new scenes"
    allowed = f" ({percent(record.allowed_share)} allowed)" if record.allowed_share else ""
    return (
        f"{'covered' if record.covered else 'NOT covered'}: "
        f"{percent(record.shares[record.criterion])} of the test's known pixels lie on levels "
        f"missing or scarce by criterion {record.criterion}{allowed}"
    )


def leak_text(record: CoverageRecord) -> str:
    """Say how much the two sides share, e.g. ``training holds 2 scenes of the test``."""
    counts = Counter(leak.kind for leak in record.leaks)
    found = [counted(count, kind) for kind, count in counts.items()]
    return f"training holds {' and '.join(found)} of the test"


def each_table(records: Mapping[str, CoverageRecord], kind: str) -> Table:
    """Return a row for each scene or fold, tested against the others."""
    rows = tuple(
        (
            name,
            ", ".join(record.test.scenes) if kind == "fold" else str(record.test.pairs),
            percent(record.shares["thesis"]),
            record.ranges_of(Criterion.thesis) or "–",
            percent(record.shares["density"]),
            record.ranges_of(Criterion.density) or "–",
            record.ranges_of(Verdict.missing) or "–",
        )
        for name, record in records.items()
    )
    second = "test scenes" if kind == "fold" else "pairs"
    notes = [
        "share of the test's known pixels on levels that are not covered by criterion thesis and "
        "by criterion density, and which; missing ones count in the first"
    ]
    sides = [side for record in records.values() for side in (record.train, record.test)]
    if absent := sorted({scene for side in sides for scene in side.absent_scenes}):
        notes.append(f"not in the store, so on neither side: {', '.join(absent)}")
    title = f"each {kind} of {sides[1].label} against the others"
    columns = (kind, second, "thesis", "levels", "density", "levels", "missing")
    align = "llrlrll" if kind == "fold" else "lrrlrll"
    return Table(title, columns, rows, align, tuple(notes))


def each_as_json(records: Mapping[str, CoverageRecord], kind: str) -> str:
    """Return the records of `each_table` as JSON, by scene or fold."""
    return text.as_json(f"coverage, each {kind}", records=dict(records))


def _notes(record: CoverageRecord) -> list[str]:
    shares, as_crops = record.shares, record.expanded_shares
    notes = [
        "share: of the known test pixels; in test, in training: pixels, each depth map once for "
        "each of its pairs; scenes: of the test, with their parts of the range's pixels",
        f"missing: in the test, never in training: {percent(shares['missing'])} of "
        f"{record.test.known_pixels:,} known test pixels; {record.test.unknown_pixels:,} are "
        "unknown and left out",
        "thesis: more pixels in the test than in training, pairs weighted by their lightings: "
        f"{percent(shares['thesis'])}; as 32 x 32 crops {percent(as_crops['thesis'])}",
        f"density: {record.density_factor:g} times the share in training, and at least "
        f"{percent(record.density_floor)} of the test: {percent(shares['density'])}; as crops "
        f"{percent(as_crops['density'])}",
    ]
    if record.test.inverted:
        notes.append("the test's levels were turned round, 255 - level (Eq. 7.1), to mean the same")
    return notes + [
        f"not in the store, so not counted in {side.split}: "
        + listed(side.absent_scenes, _ABSENT_NAMED)
        for side in (record.train, record.test)
        if side.absent_scenes
    ]


def _name(side: SideRecord) -> str:
    scenes = counted(len(side.scenes), "scene")
    return f"{side.label}, {side.split} ({counted(side.pairs, 'pair')} of {scenes})"
