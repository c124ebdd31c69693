"""From the range image to a depth map on the camera's image: levels, upsampled, warped."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.recipe import LAST_LEVEL
from dfdbench.rig.lidar import (
    Beams,
    Floats,
    Kind,
    Mask,
    align_columns,
    crop_columns,
    fill_missing,
    median_cross,
    to_cartesian,
)

MILLIMETRES_PER_LEVEL = 10
_UPSAMPLED_MEDIAN = 13
#: Total scale after each of the six steps: (height, width).
UPSAMPLING = ((3, 2), (6, 2), (9, 4), (12, 4), (15, 6), (18, 6))


def to_levels(distance: Floats) -> Floats:
    """Return distances in millimetres as depth levels of a centimetre: divided by 10, floored.

    Levels are clipped to 0 to 255: see `in_range` for what that leaves out.

    Examples
    --------
    >>> to_levels(np.array([1509.9, 2550.0, 4000.0])).tolist()
    [150.0, 255.0, 255.0]
    """
    return np.clip(np.floor(distance / MILLIMETRES_PER_LEVEL), 0, LAST_LEVEL)


def in_range(distance: Floats) -> Mask:
    """Return True where a distance in millimetres has a level of its own: below 2.55 m.

    Level 255 stands for all that is farther, too.

    Examples
    --------
    >>> in_range(np.array([0.0, 1500.0, 2549.0, 2550.0])).tolist()
    [False, True, True, False]
    """
    return (distance >= MILLIMETRES_PER_LEVEL) & (distance < LAST_LEVEL * MILLIMETRES_PER_LEVEL)


def upsample(levels: Floats, valid: Mask) -> tuple[Floats, Mask]:
    """Return levels and validity 18 times as high and 6 times as wide, in six steps.

    Each step scales to the nearest neighbour, then takes the medians 13 x 1 and 1 x 13, which
    round off the stairs that scaling leaves. What was not valid stays so; what a median took from
    beyond the range is not valid either.

    Examples
    --------
    >>> levels, valid = upsample(np.full((64, 300), 150.0), np.ones((64, 300), bool))
    >>> levels.shape, float(levels.min()), bool(valid.all())
    ((1152, 1800), 150.0, True)
    """
    height, width = levels.shape
    scaled = levels
    for down, across in UPSAMPLING:
        scaled = median_cross(_nearest(scaled, height * down, width * across), _UPSAMPLED_MEDIAN)
    return scaled, np.asarray(_nearest(valid, *scaled.shape) & (scaled < LAST_LEVEL))


def warp(
    levels: Floats, valid: Mask, matrix: Floats, shape: tuple[int, int]
) -> tuple[NDArray[np.uint8], Mask]:
    """Return levels and validity as the camera sees them.

    Parameters
    ----------
    levels, valid : ndarray, shape (y, x)
        After `upsample`.
    matrix : ndarray of float, shape (3, 3)
        Projective, from a place (x, y) of `levels` to one of the image, in pixels.
    shape : tuple of int
        Height and width of the image.

    Returns
    -------
    levels : ndarray of uint8, shape `shape`
        0 where not valid.
    valid : ndarray of bool, shape `shape`
        False as well where the image sees past the LIDAR's.
    """
    size = (shape[1], shape[0])
    seen = cv2.warpPerspective(
        valid.astype(np.uint8), matrix, size, flags=cv2.INTER_NEAREST, borderValue=0
    ).astype(bool)
    warped = cv2.warpPerspective(
        levels.astype(np.uint8), matrix, size, flags=cv2.INTER_NEAREST, borderValue=0
    )
    return np.where(seen, warped, 0).astype(np.uint8), np.asarray(seen)


def depth_image(ranges: Floats, beams: Beams) -> tuple[Floats, Mask]:
    """Return what the LIDAR saw ahead as levels, before registration: every step up to `upsample`.

    Parameters
    ----------
    ranges : ndarray of float, shape (beam, column)
        Averaged, in millimetres.
    beams : Beams
        Where each row points.

    Returns
    -------
    levels : ndarray of float, shape (18 * beam, 1800)
        Depth levels.
    valid : ndarray of bool
        False where nothing came back, or from farther than the levels reach.
    """
    ahead, _, _ = to_cartesian(ranges, beams)
    distance = crop_columns(align_columns(ahead, beams))
    returned = crop_columns(align_columns(ranges, beams)) > 0
    filtered = median_cross(fill_missing(distance, returned))
    return upsample(to_levels(filtered), returned & in_range(filtered))


def _nearest(values: NDArray[Kind], height: int, width: int) -> NDArray[Kind]:
    rows = (2 * np.arange(height) + 1) * values.shape[0] // (2 * height)
    columns = (2 * np.arange(width) + 1) * values.shape[1] // (2 * width)
    return np.asarray(values[rows[:, np.newaxis], columns])
