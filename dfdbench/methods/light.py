"""The unit in which images are compared under a blur law: grey levels or light, and its noise."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.formation import decode, encode
from dfdbench.blur.law import ROUNDING_VARIANCE, BlurLaw, noise_at
from dfdbench.blur.recipe import LAST_LEVEL, LEVELS
from dfdbench.methods.alignment import Alignment, undo

Array = NDArray[Any]

# Rounding's standard deviation: a law may be measured on too few pixels to show even that.
ROUNDING = ROUNDING_VARIANCE**0.5
# Over this sigma the defocus image is smoothed where it tells how much noise to expect: by its own
# noise a pixel would choose its own weight.
_SMOOTHING = 2.0


def light_of(image: Array, linear: bool) -> NDArray[np.float32]:
    """Return grey levels 0 to 255 as they are, or as linear light, of which white has 255.

    Parameters
    ----------
    image : ndarray of any number, any shape
        sRGB grey levels.
    linear : bool
        True: light.

    Returns
    -------
    ndarray of float32, shape as `image`
    """
    return np.asarray(decode(image) * LAST_LEVEL if linear else image, np.float32)


def grey_of(light: Array, linear: bool) -> NDArray[np.float64]:
    """Return the grey levels, 0 to 255, of what `light_of` gives: float64, shape as `light`."""
    return encode(light / LAST_LEVEL) if linear else np.asarray(light, np.float64)


def aim_of(defocus: Array, linear: bool, how: Alignment, offset: float = 0) -> NDArray[np.float32]:
    """Return a defocus image as `light_of` has it, moved back, of the other image's brightness.

    Parameters
    ----------
    defocus : ndarray of uint8, shape (y, x, channel)
        As it was taken.
    linear : bool
        As of `light_of`.
    how : Alignment
        How it lies to the in-focus image; undone.
    offset : float
        Grey levels that it has on top, in the unit of `light_of`; taken away.

    Returns
    -------
    ndarray of float32, shape (y, x, channel)
    """
    light = light_of(defocus, linear)
    if how == Alignment(0.0, 0.0, 1.0) and not offset:
        return light
    return undo(how, light, offset)


def noise_of(law: BlurLaw, aim: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the noise to expect of a defocus image, rounding the least: (y, x, channel)."""
    grey = smooth_grey(aim, law.linear)
    noise = noise_at(law.noise, grey)
    return np.maximum(noise, rounding_at(grey, law.linear)).astype(np.float32)


def smooth_grey(aim: NDArray[np.float32], linear: bool) -> NDArray[np.float64]:
    """Return the grey level about each pixel, by which its noise is looked up: (y, x, channel)."""
    smooth = cv2.GaussianBlur(aim, (0, 0), _SMOOTHING).reshape(aim.shape)
    return np.clip(grey_of(smooth.astype(np.float64), linear), 0, LAST_LEVEL)


def rounding_at(grey: Array, linear: bool) -> NDArray[np.float64]:
    """Return the standard deviation of rounding to grey levels, in the unit of `light_of`.

    Parameters
    ----------
    grey : ndarray of float, any shape
        Grey levels 0 to 255.
    linear : bool
        As of `light_of`.

    Returns
    -------
    ndarray of float64, shape as `grey`
    """
    levels = np.arange(float(LEVELS))
    light = decode(levels) * LAST_LEVEL if linear else levels
    return np.asarray(ROUNDING * np.interp(grey, levels, np.gradient(light)))
