"""What a comparison of training and test depths found, in a form that JSON keeps."""

from __future__ import annotations

import json
from typing import Literal

import numpy as np

from dfdbench.audit.coverage import Coverage, Criterion, DensityBound, Verdict, check_allowance
from dfdbench.audit.depth_histogram import DepthHistogram
from dfdbench.audit.leaks import Leak
from dfdbench.audit.level_ranges import range_text, runs
from dfdbench.audit.sides import Side
from dfdbench.blur.recipe import LEVELS
from dfdbench.datasets.manifest import simulated_label
from dfdbench.system.record import Record

WEIGHTS = "each depth map counts once for each pair that the manifest makes of it"


class SideRecord(Record):
    """One side: whose scenes, how many pixels, and its histograms over levels 0 to 255.

    `expanded` is the expected number of pixels if each pair is drawn once as a 32 x 32 crop in
    8 orientations; `inverted` says that levels were turned round (Eq. 7.1).
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
        """What tables and figures call the data set: captures that are none say so."""
        return simulated_label(self.dataset, self.simulated)


class RangeRecord(Record):
    """Neighbouring levels that share a verdict and its criteria, and where they come from.

    `share` is that of the test's known pixels; `scenes` parts the range's test pixels.
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


class LeakRecord(Record):
    """One thing that both sides share."""

    kind: str
    train: str
    test: str
    detail: str


class CoverageRecord(Record):
    """A comparison in full.

    `shares` are shares of the test's known pixels by verdict and by criterion,
    `expanded_shares` the uncovered ones if both sides are seen as random crops. `covered` says
    whether the share that `criterion` finds is at most `allowed_share`; where there are leaks it
    never is true.
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
    leaks: list[LeakRecord]

    @property
    def uncovered_share(self) -> float:
        """The share of the test's known pixels that are not covered by the criterion."""
        return self.shares[self.criterion]

    def levels(self, *verdicts: Verdict) -> list[bool]:
        """Return which levels have one of the verdicts, for each of the 256."""
        return [verdict in verdicts for verdict in self.verdicts]

    def ranges_of(self, kind: Verdict | Criterion) -> str:
        """Return the uncovered levels of a verdict, or by a criterion, as ranges."""
        keys: list[bool | None] = [None] * LEVELS
        for item in self.ranges:
            if kind in (item.verdict, *item.criteria, Criterion.either):
                keys[item.first : item.last + 1] = [True] * (item.last + 1 - item.first)
        return ", ".join(range_text(*run) for run in runs(keys))


def compare_depths(
    train: Side,
    test: Side,
    bound: DensityBound | None = None,
    criterion: Criterion = Criterion.either,
    allowed_share: float = 0.0,
    leaks: tuple[Leak, ...] = (),
) -> CoverageRecord:
    """Hold a test side against a training side.

    Parameters
    ----------
    train, test : Side
        From `dfdbench.audit.sides.sides_of`.
    bound : DensityBound, optional
        Of the density criterion.
    criterion : Criterion
        What decides whether the test is covered; the record has both.
    allowed_share : float
        Share of the test's known pixels that may lie on uncovered levels.
    leaks : tuple of Leak
        What was found on both sides.

    Raises
    ------
    InputError
        For an allowed share that is none.
    """
    check_allowance(allowed_share)
    bound = bound or DensityBound()
    coverage = Coverage(train.histogram, test.histogram, bound)
    masks = {chosen: coverage.uncovered(chosen) for chosen in Criterion}
    shares = {str(name): coverage.share(mask) for name, mask in masks.items()}
    shares |= {
        "missing": coverage.share(coverage.missing),
        "scarce": coverage.share(coverage.scarce),
        "covered": coverage.share(~masks[Criterion.either]),
    }
    return CoverageRecord(
        covered=shares[criterion] <= allowed_share and not leaks,
        criterion=criterion,
        allowed_share=allowed_share,
        density_factor=bound.factor,
        density_floor=bound.floor,
        weights=WEIGHTS,
        train=_side_record(train, coverage.train),
        test=_side_record(test, coverage.test),
        shares=shares,
        expanded_shares={str(chosen): coverage.expanded_share(chosen) for chosen in Criterion},
        ranges=_ranges(coverage, test),
        verdicts=list(coverage.verdicts),
        leaks=[
            LeakRecord(kind=leak.kind, train=leak.train, test=leak.test, detail=leak.detail)
            for leak in leaks
        ],
    )


def _side_record(side: Side, histogram: DepthHistogram) -> SideRecord:
    return SideRecord(
        dataset=side.dataset,
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
        simulated=side.store.manifest.simulated,
    )


def _ranges(coverage: Coverage, test: Side) -> list[RangeRecord]:
    named = (Criterion.thesis, Criterion.density)
    masks = [coverage.uncovered(criterion) for criterion in named]
    uncovered = coverage.uncovered()
    keys = [
        (verdict, tuple(bool(mask[level]) for mask in masks)) if uncovered[level] else None
        for level, verdict in enumerate(coverage.verdicts)
    ]
    found = []
    for first, last in runs(keys):
        key = keys[first]
        assert key is not None
        inside = np.arange(LEVELS)
        levels = (inside >= first) & (inside <= last)
        pixels = int(coverage.test.counts[levels].sum())
        by_scene = {name: int(h.counts[levels].sum()) for name, h in test.scenes.items()}
        order = sorted(by_scene, key=lambda name: -by_scene[name])
        found.append(
            RangeRecord(
                first=first,
                last=last,
                verdict=Verdict(str(key[0])),
                criteria=[name for name, hit in zip(named, key[1], strict=True) if hit],
                test_pixels=pixels,
                train_pixels=int(coverage.train.counts[levels].sum()),
                share=coverage.share(levels),
                scenes={name: by_scene[name] / pixels for name in order if by_scene[name]},
            )
        )
    return found


def coverage_schema() -> str:
    """Return the JSON schema of a record, as published in ``dfdbench/results/schemas``."""
    return json.dumps(CoverageRecord.model_json_schema(), indent=1, sort_keys=True) + "\n"
