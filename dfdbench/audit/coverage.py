"""Which depth levels of a test set its training set lacks: histograms, verdicts, ranges."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from dfdbench.errors import InputError, Problem

LEVELS = 256
#: Side in pixels of the crops that the thesis's networks train on (5.2.1) ...
CROP_SIZE = 32
#: ... and in how many orientations each is shown: four rotations, each mirrored.
ORIENTATIONS = 8

Counts = NDArray[np.int64]
Mask = NDArray[np.bool_]


class Verdict(StrEnum):
    """What a depth level of the test is, seen from the training set."""

    missing = "missing"
    scarce = "scarce"
    covered = "covered"


class Criterion(StrEnum):
    """By which a level counts as not covered; `either` is the stricter of the two."""

    thesis = "thesis"
    density = "density"
    either = "either"


@dataclass(frozen=True)
class DensityBound:
    """When a level's density in the test is too much for that in training.

    Parameters
    ----------
    factor : float
        The level's share of the test's known pixels exceeds this many times its share of the
        training set's.
    floor : float
        Levels with a smaller share of the test raise no alarm.

    Notes
    -----
    The thesis compares counts, so its criterion weakens as the test shrinks: for the published
    split it strikes where the density exceeds that of training about 404 / 54 = 7.5 times. The
    density criterion holds about that for tests of any size.
    """

    factor: float = 8.0
    floor: float = 0.001

    def __post_init__(self) -> None:
        problems = []
        if not 1 <= self.factor < math.inf:
            expected = "a number from 1 up"
            problems.append(
                Problem(
                    "wrong density factor", where="factor", expected=expected, got=str(self.factor)
                )
            )
        if not 0 <= self.floor <= 1:
            problems.append(
                Problem(
                    "wrong density floor", where="floor", expected="0 to 1", got=str(self.floor)
                )
            )
        if problems:
            raise InputError.of(problems)


@dataclass(frozen=True)
class DepthHistogram:
    """How often each depth level occurs over some pairs, unknown pixels apart.

    Parameters
    ----------
    counts : ndarray of int64, shape (256,)
        Known pixels of each level; a depth map counts once for each pair that uses it.
    expanded : ndarray of float64, shape (256,)
        How often a pixel of each level is expected in training if each pair is drawn once: a
        random 32 x 32 crop in 8 orientations (thesis 5.2.1, Fig. 5.9).
    unknown : int
        Pixels without ground truth.
    pairs : int
        Pairs counted.
    """

    counts: Counts
    expanded: NDArray[np.float64]
    unknown: int
    pairs: int

    @property
    def known(self) -> int:
        """Pixels with ground truth."""
        return int(self.counts.sum())

    def __add__(self, other: DepthHistogram) -> DepthHistogram:
        return DepthHistogram(
            self.counts + other.counts,
            self.expanded + other.expanded,
            self.unknown + other.unknown,
            self.pairs + other.pairs,
        )

    def inverted(self) -> DepthHistogram:
        """Return the histogram of 255 - depth (Eq. 7.1): nearness for distance."""
        return DepthHistogram(self.counts[::-1], self.expanded[::-1], self.unknown, self.pairs)

    @classmethod
    def total(cls, parts: Iterable[DepthHistogram]) -> DepthHistogram:
        """Return the sum of histograms; without any, one of no pixels."""
        empty = cls(np.zeros(LEVELS, np.int64), np.zeros(LEVELS), 0, 0)
        return sum(parts, start=empty)


def depth_histogram(depth: NDArray[np.uint8], valid: Mask, pairs: int = 1) -> DepthHistogram:
    """Count a depth map's levels, once for each pair that uses it.

    Parameters
    ----------
    depth : ndarray of uint8, shape (y, x)
        Depth levels.
    valid : ndarray of bool, shape (y, x)
        True where the depth is known.
    pairs : int
        How many pairs use this depth map: its lightings.

    Examples
    --------
    >>> depth = np.array([[7, 7], [0, 9]], np.uint8)
    >>> histogram = depth_histogram(depth, depth > 0, pairs=3)
    >>> histogram.counts[[7, 9]].tolist(), histogram.unknown
    ([6, 3], 3)
    """
    if depth.dtype != np.uint8 or depth.ndim != 2 or valid.shape != depth.shape:
        raise InputError(
            "not a depth map",
            where="depth, valid",
            expected="uint8 and bool of one shape (y, x)",
            got=f"{depth.dtype} {depth.shape}, {valid.shape}",
        )
    known = depth[valid]
    # A rotation or a mirror image shows the same levels again: eight times the crop.
    weights = ORIENTATIONS * expected_uses(depth.shape)[valid]
    return DepthHistogram(
        pairs * np.bincount(known, minlength=LEVELS).astype(np.int64),
        np.asarray(pairs * np.bincount(known, weights=weights, minlength=LEVELS), np.float64),
        pairs * int(valid.size - known.size),
        pairs,
    )


@functools.lru_cache(maxsize=64)
def expected_uses(shape: tuple[int, int], crop_size: int = CROP_SIZE) -> NDArray[np.float64]:
    """Return how often each pixel is expected in one random square crop of an image.

    Pixels near the border lie in fewer crops. An image smaller than the crop is taken whole.

    Examples
    --------
    >>> expected_uses((1, 4), crop_size=2).round(3).tolist()
    [[0.333, 0.667, 0.667, 0.333]]
    """
    uses = []
    for extent in shape:
        crop = min(crop_size, extent)
        places = np.arange(extent)
        count = np.minimum(np.minimum(places + 1, extent - places), min(crop, extent - crop + 1))
        uses.append(count / (extent - crop + 1))
    return np.outer(*uses)


@dataclass(frozen=True)
class Coverage:
    """A test set's depth levels held against those of a training set.

    Parameters
    ----------
    train, test : DepthHistogram
        Both in the same sense, nearness or distance.
    bound : DensityBound
        Of the density criterion.

    Examples
    --------
    >>> near = depth_histogram(np.full((2, 2), 200, np.uint8), np.ones((2, 2), bool))
    >>> far = depth_histogram(np.array([[200, 9]], np.uint8), np.ones((1, 2), bool))
    >>> as_ranges(Coverage(train=near, test=far).missing)
    '9'
    """

    train: DepthHistogram
    test: DepthHistogram
    bound: DensityBound = field(default_factory=DensityBound)

    @property
    def missing(self) -> Mask:
        """Levels in the test that training never shows."""
        return np.asarray((self.test.counts > 0) & (self.train.counts == 0))

    def uncovered(self, criterion: Criterion = Criterion.either) -> Mask:
        """Levels that are not covered by a criterion.

        `thesis`: the level's pixels in the test outnumber those in training (5.4.2), so that
        a missing level always is among them. `density`: see `DensityBound`.
        """
        return uncovered(self.train.counts, self.test.counts, criterion, self.bound)

    @property
    def scarce(self) -> Mask:
        """Levels that are in training, but too rarely by either criterion."""
        return self.uncovered() & ~self.missing

    @property
    def verdicts(self) -> tuple[Verdict | None, ...]:
        """The verdict on each level; None where the test has no pixel of it."""
        missing, scarce = self.missing, self.scarce
        return tuple(
            Verdict.missing
            if missing[level]
            else Verdict.scarce
            if scarce[level]
            else Verdict.covered
            if self.test.counts[level]
            else None
            for level in range(LEVELS)
        )

    def share(self, levels: Mask) -> float:
        """Return the share of the test's known pixels that lie on some levels."""
        return float(self.test.counts[levels].sum() / max(self.test.known, 1))

    def expanded_share(self, criterion: Criterion = Criterion.either) -> float:
        """Return the uncovered share where both sides are seen as random crops (Fig. 5.9)."""
        levels = uncovered(self.train.expanded, self.test.expanded, criterion, self.bound)
        return float(self.test.expanded[levels].sum() / max(self.test.expanded.sum(), 1e-300))


def uncovered(
    train: NDArray[np.int64] | NDArray[np.float64],
    test: NDArray[np.int64] | NDArray[np.float64],
    criterion: Criterion,
    bound: DensityBound,
) -> Mask:
    """Return which levels are not covered; counts of shape (..., 256), see `Coverage.uncovered`.

    Examples
    --------
    >>> train, test = np.zeros(256), np.zeros(256)
    >>> train[[8, 9]], test[[8, 9]] = (900, 1), (100, 2)
    >>> np.flatnonzero(uncovered(train, test, Criterion.thesis, DensityBound())).tolist()
    [9]
    """
    by_count = test > train
    if criterion is Criterion.thesis:
        return np.asarray(by_count)
    in_test = test / np.maximum(test.sum(axis=-1, keepdims=True), 1)
    in_train = train / np.maximum(train.sum(axis=-1, keepdims=True), 1)
    by_density = (in_test > bound.factor * in_train) & (in_test >= bound.floor) & (test > 0)
    if criterion is Criterion.density:
        return np.asarray(by_density)
    return np.asarray(by_count | by_density)


def check_allowance(share: float) -> None:
    """Refuse an allowed share of the test's pixels that is none.

    Raises
    ------
    InputError
        Where it is not 0 to 1.
    """
    if not 0 <= share <= 1:
        raise InputError("wrong allowed share", where="allow", expected="0 to 1", got=str(share))


def runs(keys: Sequence[object]) -> list[tuple[int, int]]:
    """Return first and last index of each run of equal keys, None left out.

    Examples
    --------
    >>> runs(["a", "a", None, "b"])
    [(0, 1), (3, 3)]
    """
    found: list[tuple[int, int]] = []
    for level, key in enumerate(keys):
        if key is None:
            continue
        if found and found[-1][1] == level - 1 and keys[level - 1] == key:
            found[-1] = (found[-1][0], level)
        else:
            found.append((level, level))
    return found


def range_text(first: int, last: int) -> str:
    """Return a range of levels as text, one level where both ends are the same.

    Examples
    --------
    >>> range_text(36, 38), range_text(9, 9)
    ('36-38', '9')
    """
    return str(first) if first == last else f"{first}-{last}"


def as_ranges(levels: Mask) -> str:
    """Return marked levels as ranges.

    Examples
    --------
    >>> marked = np.zeros(256, bool)
    >>> marked[[9, 36, 37, 38]] = True
    >>> as_ranges(marked)
    '9, 36-38'
    """
    return ", ".join(range_text(*run) for run in runs([True if mark else None for mark in levels]))
