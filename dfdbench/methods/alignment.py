"""Align the images of a pair: bring them to one unit, and find their shift and gain."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.formation import move
from dfdbench.blur.law import ROUNDING_VARIANCE, BlurLaw, noise_at
from dfdbench.blur.light import LINEAR, decode, encode
from dfdbench.blur.recipe import LAST_LEVEL, LEVELS

Array = NDArray[Any]

# The standard deviation of rounding. A law measured on few pixels may not even show that much.
ROUNDING = ROUNDING_VARIANCE**0.5
# The defocus image is smoothed by this sigma before its noise is looked up by grey level.
# Otherwise a pixel's own noise would determine its weight.


def light_of(image: Array, linear: bool) -> NDArray[np.float32]:
    """Return grey levels 0 to 255 as they are, or as linear light in which white is 255.

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
    if linear and image.dtype == np.uint8:
        # A table, since there are few grey levels and powers are slow.
        return (LINEAR * LAST_LEVEL).astype(np.float32)[image]
    return np.asarray(decode(image) * LAST_LEVEL if linear else image, np.float32)


def grey_of(light: Array, linear: bool) -> NDArray[np.float64]:
    """Convert what `light_of` returns to grey levels, 0 to 255: float64, shape as `light`."""
    return encode(light / LAST_LEVEL) if linear else np.asarray(light, np.float64)


def aim_of(defocus: Array, linear: bool, how: Alignment, offset: float = 0) -> NDArray[np.float32]:
    """Return a defocus image in the unit of `light_of`, aligned to the in-focus image.

    Parameters
    ----------
    defocus : ndarray of uint8, shape (y, x, channel)
        As it was taken.
    linear : bool
        As for `light_of`.
    how : Alignment
        Its shift and gain against the in-focus image, to undo.
    offset : float
        Its offset in the unit of `light_of`, to subtract.

    Returns
    -------
    ndarray of float32, shape (y, x, channel)
    """
    back: Array = light_of(defocus, linear)
    if how.down or how.right:
        back = move(back.astype(np.float64), -how.down, -how.right)
    if offset or how.gain != 1:
        back = (back - offset) / how.gain
    return np.asarray(back, np.float32)


def noise_of(law: BlurLaw, aim: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return a defocus image's expected noise, at least that of rounding: (y, x, channel)."""
    grey = smooth_grey(aim, law.linear)
    noise = noise_at(law.noise, grey)
    return np.maximum(noise, rounding_at(grey, law.linear)).astype(np.float32)


def smooth_grey(aim: NDArray[np.float32], linear: bool) -> NDArray[np.float64]:
    """Return the grey level around each pixel, for looking up its noise: (y, x, channel)."""
    smooth = cv2.GaussianBlur(aim, (0, 0), _SMOOTHING).reshape(aim.shape)
    return np.clip(grey_of(smooth.astype(np.float64), linear), 0, LAST_LEVEL)


def rounding_at(grey: Array, linear: bool) -> NDArray[np.float64]:
    """Return the standard deviation of rounding to grey levels, in the unit of `light_of`.

    Parameters
    ----------
    grey : ndarray of float, any shape
        Grey levels 0 to 255.
    linear : bool
        As for `light_of`.

    Returns
    -------
    ndarray of float64, shape as `grey`
    """
    if not linear:
        return np.full(np.shape(grey), ROUNDING)
    widths = np.gradient(LINEAR * LAST_LEVEL)
    return np.asarray(ROUNDING * np.interp(grey, np.arange(LEVELS), widths))


# Both images are smoothed by a Gaussian of this sigma before they are compared, so that
# differences in blur count less than differences in position.
_SMOOTHING = 2.0
# Newton steps; each leaves a tenth of the shift or less.
_STEPS = 5
# Above this share of white an image may be clipped.
_BRIGHT = 0.96
# The largest shift of a pair in pixels, and its largest gain.
_FARTHEST = 6.0
_LARGEST_GAIN = 4.0
# Pixels at the border that comparisons leave out.
_BORDER = 8


@dataclass(frozen=True)
class Alignment:
    """The shift and gain of a pair's defocus image against its in-focus image.

    Parameters
    ----------
    down, right : float
        How far the defocus image is shifted, in pixels.
    gain : float
        How many times brighter it is.
    """

    down: float
    right: float
    gain: float


def find_alignment(infocus: NDArray[Any], defocus: NDArray[Any], offset: float = 0) -> Alignment:
    """Return how a defocus image is shifted and brightened against the in-focus image.

    Parameters
    ----------
    infocus, defocus : ndarray, shape (y, x, channel)
        Grey levels, or light.
    offset : float
        The offset of the defocus image.

    Notes
    -----
    We model the smoothed defocus image as a sum of the smoothed in-focus image, its two first
    derivatives, which shift it, and its Laplacian, which changes its blur. Least squares give the
    factors (Lucas and Kanade 1981, with blur). Blur is symmetric, so it shifts nothing. The gain
    is the ratio of sums, which blur does not change.

    Examples
    --------
    >>> image = np.random.default_rng(0).uniform(50, 200, (60, 60, 1)).astype(np.float32)
    >>> image = cv2.GaussianBlur(image, (0, 0), 1)[..., np.newaxis].astype(float)
    >>> found = find_alignment(image, 1.1 * move(image, 0.25, -0.5))
    >>> round(found.down, 2), round(found.right, 2), round(found.gain, 3)
    (0.25, -0.5, 1.1)
    """
    sharp = infocus.mean(axis=2, dtype=np.float32)
    blurred = defocus.mean(axis=2, dtype=np.float64) - offset
    smooth = cv2.GaussianBlur(sharp, (0, 0), _SMOOTHING)
    inner = (slice(_BORDER, -_BORDER), slice(_BORDER, -_BORDER))
    most = _BRIGHT * LAST_LEVEL
    known = (smooth < most) & (cv2.GaussianBlur(blurred, (0, 0), _SMOOTHING) < most)
    known = cv2.erode(known.astype(np.uint8), np.ones((9, 9), np.uint8)).astype(bool)[inner]
    if not known.any():
        return Alignment(0.0, 0.0, 1.0)
    down = np.gradient(smooth, axis=0)
    right = np.gradient(smooth, axis=1)
    bend = cv2.Laplacian(smooth, cv2.CV_32F)
    terms = [smooth, down, right, bend, np.ones_like(smooth)]
    columns = np.stack([term[inner][known] for term in terms], axis=1)
    place = np.zeros(2)
    for _ in range(_STEPS):
        here = move(blurred[..., np.newaxis], *-place)[..., 0].astype(np.float32)
        aim = cv2.GaussianBlur(here, (0, 0), _SMOOTHING)[inner][known]
        factors = np.linalg.lstsq(columns, aim, rcond=None)[0]
        step = factors[1:3] / factors[0] if factors[0] > 0 else np.full(2, np.inf)
        if not (np.abs(place - step) <= _FARTHEST).all():
            # Images without texture, or of different scenes, cannot be aligned.
            return Alignment(0.0, 0.0, 1.0)
        place -= step
    total, other = (float(image[inner][known].sum(dtype=np.float64)) for image in (sharp, here))
    gain = other / total if total > 0 else 1.0
    if not 1 / _LARGEST_GAIN <= gain <= _LARGEST_GAIN:
        gain = 1.0
    return Alignment(float(place[0]), float(place[1]), gain)
