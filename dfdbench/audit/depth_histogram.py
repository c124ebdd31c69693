"""How often each depth level occurs, and how often a training uses it."""

from __future__ import annotations

import functools
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.recipe import LEVELS
from dfdbench.errors import InputError

#: Side in pixels of the crops that the thesis's networks train on (5.2.1) ...
CROP_SIZE = 32
#: ... and in how many orientations each is shown: four rotations, each mirrored.
ORIENTATIONS = 8

Counts = NDArray[np.int64]
Mask = NDArray[np.bool_]


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
