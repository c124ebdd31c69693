"""For how many steps a noisy loss has made no progress, as dlib's trainer judges it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

_FEWEST = 3
#: A loss has fallen where this is sure, in dlib and here.
SURE = 0.51


def steps_without_progress(
    losses: Sequence[float] | NDArray[np.float64], probability: float = SURE
) -> int:
    """Return the largest number of last steps over which the loss is not known to have fallen.

    A line is fitted to the last n losses by least squares. With Gaussian noise its slope is
    normally distributed; the loss has fallen where the slope is negative with at least this
    probability (5.2.2, after dlib).

    Parameters
    ----------
    losses : array_like of float, shape (n,)
        One a step, oldest first.
    probability : float
        How sure one has to be that the loss has fallen, above 0.5.

    Returns
    -------
    int
        0 where it falls over every stretch up to now.

    Examples
    --------
    >>> steps_without_progress([9, 8, 7, 6, 5, 4, 3, 2, 1, 0])
    0
    >>> steps_without_progress([9, 8, 7, 6, 5, 5, 5, 5, 5, 5, 5])
    7
    """
    values = np.asarray(losses, np.float64)
    if values.size < _FEWEST:
        return 0
    # From the newest back: sums over the last n for all n at once.
    backwards = values[::-1] - values.mean()
    index = np.arange(values.size, dtype=np.float64)
    n = index + 1
    total = np.cumsum(backwards)
    spread = (n**3 - n) / 12
    with np.errstate(divide="ignore", invalid="ignore"):
        rise = (np.cumsum(index * backwards) - (n - 1) / 2 * total) / spread
        residual = np.cumsum(backwards**2) - total**2 / n - rise**2 * spread
        error = np.sqrt(np.maximum(residual, 0) / (n - 2) / spread)
        # Back in time a falling loss rises.
        least = _rounding(values)
        exact = np.where(rise > least, 1.0, 0.5)
        falling = np.where(error > least, ndtr(rise / error), exact)
    stuck = falling[_FEWEST - 1 :] < probability
    return int(np.flatnonzero(stuck)[-1]) + _FEWEST if stuck.any() else 0


def probability_of_fall(losses: Sequence[float] | NDArray[np.float64]) -> float:
    """Return how sure it is that the loss has fallen over all of its steps.

    That of the line through all losses, as `steps_without_progress` has it for its largest number.

    Parameters
    ----------
    losses : array_like of float, shape (n,)
        One a step, oldest first; at least 3.

    Examples
    --------
    >>> probability_of_fall([5.0, 4.0, 3.0]), probability_of_fall([1.0, 1.0, 1.0])
    (1.0, 0.5)
    >>> round(probability_of_fall([2.0, 1.0, 3.0, 2.0]), 3)
    0.319
    """
    values = np.asarray(losses, np.float64)
    steps = np.arange(values.size) - (values.size - 1) / 2
    centred = values - values.mean()
    slope = float(steps @ centred / (steps @ steps))
    residual = centred - slope * steps
    error = float(np.sqrt(residual @ residual / (values.size - 2) / (steps @ steps)))
    least = _rounding(values)
    if error > least:
        return float(ndtr(-slope / error))
    return 0.5 if abs(slope) <= least else float(slope < 0)


def without_largest(losses: Sequence[float] | NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the losses but the largest tenth of them, in their order, as dlib leaves them out.

    Examples
    --------
    >>> without_largest([3, 9, 1, 2, 5, 4, 6, 7, 8, 2, 1]).tolist()
    [3.0, 1.0, 2.0, 5.0, 4.0, 6.0, 7.0, 8.0, 2.0, 1.0]
    """
    values = np.asarray(losses, np.float64)
    highest = int((values.size - 1) * 0.9 + 0.5)
    kept: NDArray[np.float64] = values[values <= np.partition(values, highest)[highest]]
    return kept


def _rounding(values: NDArray[np.float64]) -> float:
    # Below this, slopes and their errors are the sums' own rounding.
    return float(1e-12 * max(1.0, np.abs(values).max()))
