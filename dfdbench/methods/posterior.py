"""How sure the costs are of a pixel's level: the spread of its posterior."""

from collections.abc import Iterable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from dfdbench.system.compiled import compiled

Array = NDArray[Any]

# The variance of rounding to whole levels, below which no spread goes.
_ROUNDING = 1 / 12


class Posterior:
    """The moments of each pixel's levels under ``exp(-sharpness * cost)``, added level by level.

    Parameters
    ----------
    shape : tuple of int
        The shape of the image, (y, x).
    window : int
        Side of the square window over which costs are first averaged, in pixels, odd: a single
        pixel says little about how wrong it is.
    sharpness : float
        The factor for a nat. It may exceed 1, since costs are averaged and not summed.
    most : float
        The most nats that a pixel counts against a level, before costs are averaged: where surfaces
        end, a pixel may be far from every level.

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
        """Add levels, each with its cost at every pixel, in units of which `nat` make a nat."""
        for level, cost in zip(levels, costs, strict=True):
            self.add(float(level), cost / np.float32(nat))

    def add(self, level: float, cost: Array) -> None:
        """Add a level with its cost at every pixel, in nats."""
        plane = np.minimum(np.asarray(cost, np.float32), self._most)
        plane *= self._sharpness
        edge = cv2.BORDER_REPLICATE
        plane = np.asarray(cv2.boxFilter(plane, cv2.CV_32F, self._window, borderType=edge))
        least = np.minimum(self._least, plane)
        # Rescale everything added before to the new least cost. Weights overwrite the arrays they
        # are computed from, since allocating memory is slow.
        with np.errstate(under="ignore"):
            for held in (self._least, plane):
                np.exp(np.subtract(least, held, out=held), out=held)
        powers = np.array([1, level, level**2], np.float32)
        _count_in(self._sums, self._least, plane, powers)
        self._least = least

    def spread_about(self, answer: Array) -> NDArray[np.float32]:
        """Return the root mean square distance of the levels from an answer, shape (y, x).

        It is never below that of rounding to whole levels.
        """
        total, mean, square = self._sums
        around = (square - 2 * answer * mean) / total + np.square(answer)
        return np.asarray(np.sqrt(np.maximum(around, 0) + _ROUNDING), np.float32)


@compiled()
def _count_in(sums: Array, fade: Array, weight: Array, powers: Array) -> None:
    """Scale the sums by `fade`, and add the weight times each power, in one pass over memory."""
    count, height, width = sums.shape
    for y in range(height):
        for power in range(count):
            for x in range(width):
                sums[power, y, x] = sums[power, y, x] * fade[y, x] + weight[y, x] * powers[power]
