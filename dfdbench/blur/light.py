"""Grey levels and light: the sRGB curve."""

from functools import cache

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Image = NDArray[np.uint8]

# Parts of full light: so small that the rounded grey level changes once in one of them at most.
_PARTS = 1 << 16


def decode(grey: NDArray[np.floating]) -> Floats:
    """Convert grey levels, 0 to 255, to linear light, 0 to 1, by the sRGB curve (IEC 61966-2-1).

    Examples
    --------
    >>> decode(np.array([0, 128, 255])).round(4).tolist()
    [0.0, 0.2159, 1.0]
    """
    signal = np.asarray(grey, dtype=np.float64) / 255
    curve = ((np.maximum(signal, 0) + 0.055) / 1.055) ** 2.4
    return np.asarray(np.where(signal <= 0.04045, signal / 12.92, curve))


#: Linear light of each grey level.
LINEAR = decode(np.arange(256.0))


def encode(light: Floats) -> Floats:
    """Convert linear light, clipped to 0..1, to grey levels, not rounded: the inverse of `decode`.

    Examples
    --------
    >>> encode(np.array([-0.1, 0.2159, 2.0])).round().tolist()
    [0.0, 128.0, 255.0]
    """
    light = np.clip(light, 0, 1)
    curve = 1.055 * light ** (1 / 2.4) - 0.055
    return np.asarray(255 * np.where(light <= 0.0031308, 12.92 * light, curve))


def photographed(light: Floats) -> Image:
    """Convert linear light to the nearest grey levels: what `encode` and rounding give, but faster.

    As everywhere, it is rounded to float32, then half to even.

    Examples
    --------
    >>> photographed(np.array([-0.1, 0.2159, 2.0])).tolist()
    [0, 128, 255]
    """
    least, begins = _least_light()
    grey = begins[np.clip(light * _PARTS, 0, _PARTS).astype(np.int32)]
    grey += light >= least[grey]
    return np.asarray(grey)


@cache
def _least_light() -> tuple[Floats, Image]:
    """Return the least light above each grey level, and the grey level where each part begins."""
    levels = np.arange(1, len(LINEAR))
    low, high = np.zeros(levels.shape), np.ones(levels.shape)
    # Halve until there is no number left between them.
    while (((middle := (low + high) / 2) > low) & (middle < high)).any():
        reached = np.rint(encode(middle).astype(np.float32)) >= levels
        low, high = np.where(reached, low, middle), np.where(reached, middle, high)
    begins = np.searchsorted(high, np.arange(_PARTS + 1) / _PARTS, side="right")
    return np.append(high, np.inf), begins.astype(np.uint8)
