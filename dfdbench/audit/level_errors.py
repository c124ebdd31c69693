"""Errors of predictions, depth level by depth level."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dfdbench.audit.depth_histogram import Mask
from dfdbench.blur.recipe import LEVELS
from dfdbench.datasets.depth_scale import DepthScale


@dataclass(frozen=True)
class LevelErrors:
    """Sums over pixels by their true level, for means over any set of levels.

    Parameters
    ----------
    pixels : ndarray of int64, shape (256,)
        Known pixels of each level.
    absolute, squared : ndarray of float64, shape (256,)
        Their absolute and squared errors summed, in levels or in metres.
    """

    pixels: NDArray[np.int64]
    absolute: NDArray[np.float64]
    squared: NDArray[np.float64]

    def __add__(self, other: LevelErrors) -> LevelErrors:
        return LevelErrors(
            self.pixels + other.pixels, self.absolute + other.absolute, self.squared + other.squared
        )

    @classmethod
    def total(cls, parts: Iterable[LevelErrors]) -> LevelErrors:
        """Return the sum of several; without any, one of no pixels."""
        empty = cls(np.zeros(LEVELS, np.int64), np.zeros(LEVELS), np.zeros(LEVELS))
        return sum(parts, start=empty)

    def share(self, levels: Mask) -> float:
        """Return the share of the known pixels on some levels."""
        return float(self.pixels[levels].sum() / max(self.pixels.sum(), 1))

    def mean(self, levels: Mask) -> float:
        """Return the mean absolute error on some levels (Eq. 7.2), NaN without a pixel."""
        pixels = self.pixels[levels].sum()
        return float(self.absolute[levels].sum() / pixels) if pixels else math.nan

    def root_mean_square(self, levels: Mask) -> float:
        """Return the root mean square error on some levels, NaN without a pixel."""
        pixels = self.pixels[levels].sum()
        return math.sqrt(self.squared[levels].sum() / pixels) if pixels else math.nan

    def excess(self, levels: Mask) -> float:
        """Return by what share the mean error falls if these levels did as well as the others.

        Negative where they do better than the others; NaN where one side has no pixel.
        """
        whole = np.ones(LEVELS, bool)
        rest, mean = self.mean(~levels), self.mean(whole)
        return 1 - rest / mean if mean and self.pixels[levels].any() else math.nan


def level_errors(
    depth: NDArray[np.uint8],
    valid: Mask,
    prediction: NDArray[np.float32],
    scale: DepthScale | None = None,
) -> LevelErrors:
    """Sum a prediction's errors by true level.

    Parameters
    ----------
    depth : ndarray of uint8, shape (y, x)
        Ground truth in depth levels.
    valid : ndarray of bool, shape (y, x)
        True where it is known; other pixels are left out.
    prediction : ndarray of float32, shape (y, x)
        Estimated depth levels.
    scale : DepthScale, optional
        How levels become metres: then the errors are in metres.

    Examples
    --------
    >>> depth = np.array([[9, 9, 80]], np.uint8)
    >>> errors = level_errors(depth, depth > 0, np.array([[19, 13, 81]], np.float32))
    >>> scarce = np.arange(256) == 9
    >>> errors.mean(scarce), errors.mean(~scarce), round(errors.excess(scarce), 3)
    (7.0, 1.0, 0.8)
    """
    known = depth[valid]
    estimate = prediction[valid].astype(np.float64)
    if scale is None:
        error = np.abs(estimate - known)
    else:
        error = np.abs(scale.to_metres(estimate) - scale.to_metres(known))
    return LevelErrors(
        np.bincount(known, minlength=LEVELS).astype(np.int64),
        np.asarray(np.bincount(known, weights=error, minlength=LEVELS), np.float64),
        np.asarray(np.bincount(known, weights=error**2, minlength=LEVELS), np.float64),
    )
