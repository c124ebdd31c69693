"""Which depth levels of a test set its training set lacks: histograms, verdicts, ranges."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from dfdbench.audit.depth_histogram import DepthHistogram, Mask
from dfdbench.blur.recipe import LEVELS
from dfdbench.errors import InputError, Problem


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
    >>> from dfdbench.audit.depth_histogram import depth_histogram
    >>> from dfdbench.audit.level_ranges import as_ranges
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
