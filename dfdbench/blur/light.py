"""Grey levels and light: the sRGB curve."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Image = NDArray[np.uint8]


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
