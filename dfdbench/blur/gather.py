"""Blur each pixel by the two-dimensional kernel of its own level."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dfdbench.errors import InputError, Problem
from dfdbench.system.compiled import compiled


def blur_by_level(
    image: NDArray[np.float64], levels: NDArray[np.integer], kernels: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return an image of which each pixel is the mean of its window under its level's kernel.

    Parameters
    ----------
    image : ndarray of float64, shape (y, x, channel) or (y, x)
        In any unit; the edge pixel is repeated past the border.
    levels : ndarray of int, shape (y, x)
        Which kernel each pixel has.
    kernels : ndarray of float64, shape (level, size, size)
        One a level, of odd size.

    Returns
    -------
    ndarray of float64
        Of the image's shape, not rounded.

    Raises
    ------
    InputError
        Where shapes do not fit one another, or a pixel's level has no kernel.

    Notes
    -----
    ``out[y, x] = sum over (j, i) of kernels[levels[y, x], j, i] * image[y + j - r, x + i - r]``
    with r the kernel's radius. The order of the sums is fixed, so that the last bit is the same
    on any machine, whatever else is running. Where a kernel ends in zeros they are left out.

    Examples
    --------
    >>> image = np.arange(25.0).reshape(5, 5)
    >>> box = np.full((1, 3, 3), 1 / 9)
    >>> float(blur_by_level(image, np.zeros((5, 5), int), box)[2, 2].round(9))
    12.0
    """
    problems = gather_problems(image, levels, kernels)
    if problems:
        raise InputError.of(problems)
    channels = image if image.ndim == 3 else image[:, :, np.newaxis]
    radius = kernels.shape[1] // 2
    padded = np.pad(channels, ((radius, radius), (radius, radius), (0, 0)), mode="edge")
    rows = np.ascontiguousarray(padded, dtype=np.float64).reshape(padded.shape[0], -1)
    # A weight a channel, so that a row of the window is one run of products.
    spread = np.repeat(np.asarray(kernels, dtype=np.float64), channels.shape[2], axis=2)
    own = np.asarray(levels, dtype=np.int64)
    blurred: NDArray[np.float64] = _gather(rows, own, spread, reaches(kernels), channels.shape[2])
    return blurred.reshape(image.shape)


def gather_problems(
    image: NDArray[np.float64], levels: NDArray[np.integer], kernels: NDArray[np.float64]
) -> list[Problem]:
    """Return what keeps an image from being blurred by these levels and kernels."""
    problems = []
    if image.ndim not in (2, 3) or image.shape[:2] != levels.shape or levels.size == 0:
        problems.append(
            Problem(
                "sizes differ",
                where="levels",
                expected=f"{image.shape[:2]}, as the image",
                got=str(levels.shape),
            )
        )
    if kernels.ndim != 3 or kernels.shape[1] != kernels.shape[2] or kernels.shape[1] % 2 == 0:
        problems.append(
            Problem(
                "wrong shape",
                where="kernels",
                expected="(level, size, size), an odd size",
                got=str(kernels.shape),
            )
        )
    elif levels.size and not 0 <= levels.min() <= levels.max() < len(kernels):
        problems.append(
            Problem(
                "a level has no kernel",
                where="levels",
                expected=f"0 to {len(kernels) - 1}",
                got=f"{levels.min()} to {levels.max()}",
            )
        )
    return problems


def reaches(kernels: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return how many pixels from its centre each kernel's last weight that is not 0 lies."""
    size = kernels.shape[1]
    offsets = np.abs(np.arange(size) - size // 2)
    rings = np.maximum.outer(offsets, offsets)
    return np.asarray(np.where(kernels != 0, rings, 0).max(axis=(1, 2)), dtype=np.int64)


@compiled()
def _gather(
    rows: NDArray[np.float64],
    levels: NDArray[np.int64],
    kernels: NDArray[np.float64],
    reach: NDArray[np.int64],
    channels: int,
) -> NDArray[np.float64]:
    # Row by row of the window into one row of products, which vectorises; no fast-math.
    height, width = levels.shape
    radius = kernels.shape[1] // 2
    out = np.empty((height, width * channels), np.float64)
    column = np.empty(kernels.shape[2], np.float64)
    for y in range(height):
        for x in range(width):
            level = levels[y, x]
            near = reach[level]
            span = (2 * near + 1) * channels
            first = (radius - near) * channels
            left = x * channels + first
            for i in range(span):
                column[i] = 0.0
            for j in range(radius - near, radius + near + 1):
                weights = kernels[level, j, first : first + span]
                pixels = rows[y + j, left : left + span]
                for i in range(span):
                    column[i] += weights[i] * pixels[i]
            for channel in range(channels):
                total = 0.0
                for i in range(channel, span, channels):
                    total += column[i]
                out[y, x * channels + channel] = total
    return out
