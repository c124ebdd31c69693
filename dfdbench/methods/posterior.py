"""How sure costs are of a pixel's level: the spread of its posterior."""

from collections.abc import Iterable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from dfdbench.system.compiled import compiled

Array = NDArray[Any]

# The variance of a number that is rounded to whole levels: no spread is less.
_ROUNDING = 1 / 12


class Posterior:
    """The moments of each pixel's levels under ``exp(-sharpness * cost)``, level after level.

    Parameters
    ----------
    shape : tuple of int
        Of the image, (y, x).
    window : int
        Side of the square window that costs are averaged over first, in pixels, odd: a pixel alone
        says little of how wrong it is.
    sharpness : float
        What a nat counts. As costs are averaged, not summed, more than 1 may be right.
    most : float
        Nats that a pixel says at most against a level, before costs are averaged: where surfaces
        end, a pixel may be far from all of them.

    Examples
    --------
    >>> posterior = Posterior((1, 1), 1, 1.0, np.inf)
    >>> for level, cost in ((10, 0), (14, 0), (200, 99)):
    ...     posterior.add(level, np.full((1, 1), cost))
    >>> round(float(posterior.spread_about(np.array([[12.0]]))[0, 0]), 2)
    2.02
    """

    def __init__(self, shape: tuple[int, ...], window: int, sharpness: float, most: float) -> None:
        self._window = (window, window)
        self._sharpness, self._most = np.float32(sharpness), np.float32(most)
        self._least = np.full(shape, np.inf, np.float32)
        self._sums = np.zeros((3, *shape))

    def add_all(self, levels: Iterable[float], costs: Iterable[Array], nat: float) -> None:
        """Add levels, and of each what it costs each pixel, so many a nat."""
        for level, cost in zip(levels, costs, strict=True):
            self.add(float(level), cost / np.float32(nat))

    def add(self, level: float, cost: Array) -> None:
        """Add a level, and what it costs each pixel, in nats."""
        plane = np.minimum(np.asarray(cost, np.float32), self._most)
        plane *= self._sharpness
        edge = cv2.BORDER_REPLICATE
        plane = np.asarray(cv2.boxFilter(plane, cv2.CV_32F, self._window, borderType=edge))
        least = np.minimum(self._least, plane)
        # All that was added before is held against the new least. Weights are written over what
        # they follow from: memory is slow to come by.
        with np.errstate(under="ignore"):
            for held in (self._least, plane):
                np.exp(np.subtract(least, held, out=held), out=held)
        powers = np.array([1, level, level**2], np.float32)
        _count_in(self._sums, self._least, plane, powers)
        self._least = least

    def spread_about(self, answer: Array) -> NDArray[np.float32]:
        """Return the root mean square distance of the levels from an answer, shape (y, x).

        It is never below that of a number that is rounded to a whole level.
        """
        total, mean, square = self._sums
        around = (square - 2 * answer * mean) / total + np.square(answer)
        return np.asarray(np.sqrt(np.maximum(around, 0) + _ROUNDING), np.float32)


@compiled()
def _count_in(sums: Array, fade: Array, weight: Array, powers: Array) -> None:
    """Let sums fade, and add a weight times each power: one pass, as they are large."""
    count, height, width = sums.shape
    for y in range(height):
        for power in range(count):
            for x in range(width):
                sums[power, y, x] = sums[power, y, x] * fade[y, x] + weight[y, x] * powers[power]
