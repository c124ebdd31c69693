"""What a pixel tells of its depth: Fisher's information under a blur law."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfdbench.methods.blurred import Blurred

_LEVELS_LOOKED_AT = 8


def information(blurred: Blurred, levels: NDArray[np.intp]) -> float:
    """Return what a pixel tells of its depth level: Fisher's information, a level to the -2.

    The mean over pixels and some levels of the squared change a level makes, in units of the
    noise. Its root is one over the error of a pixel's level, were the pixel alone.

    Parameters
    ----------
    blurred : Blurred
        The pair.
    levels : ndarray of int
        The depth levels that `blurred` holds, rising.
    """
    last = len(levels) - 1
    middles = np.linspace(0, last, min(_LEVELS_LOOKED_AT, last + 1)).astype(int)
    sums = np.zeros(len(middles))
    for band in blurred.bands():
        for place, middle in enumerate(middles):
            low, high = max(middle - 1, 0), min(middle + 1, last)
            change = blurred.factors[:, high] - blurred.factors[:, low]
            slope = band.nodes @ change / np.float32(levels[high] - levels[low])
            sums[place] += np.square(slope / band.noise).sum(axis=2).sum(dtype=np.float64)
    found = sums / math.prod(blurred.aim.shape[:2]) / blurred.spread[middles]
    return math.fsum(found) / len(found)


def information_at(blurred: Blurred, levels: NDArray[Any]) -> NDArray[np.float64]:
    """Return what each pixel tells of its own depth level, as `information`: shape (y, x).

    Its inverse root is the least standard deviation, in levels, of an unbiased estimate from this
    pixel alone (Cramér and Rao). Of normal noise with mean m and variance v, both a level's, a
    channel tells ``m'^2 / v + (v' / v)^2 / 2``.

    Parameters
    ----------
    blurred : Blurred
        The pair, at all levels of its law.
    levels : ndarray of int, shape (y, x)
        The depth level of each pixel.
    """
    # Slopes are taken over a level to either side; at the ends of the scale to the inner one.
    slopes = np.gradient(blurred.factors, axis=1)
    # Blur leaves bare surfaces as they are, few kernels nearly so: over wide windows that adds up.
    slopes -= slopes.mean(axis=0)
    change = np.zeros(blurred.aim.shape, np.float32)
    for node, slope in enumerate(slopes.astype(np.float32)):
        change += blurred.nodes[..., node] * slope[levels][..., np.newaxis]
    told = np.square(change / blurred.noise).sum(axis=2, dtype=np.float64)
    wider = np.square(np.gradient(np.log(blurred.spread))) * blurred.aim.shape[2] / 2
    return np.asarray(told / blurred.spread[levels] + wider[levels])
