"""The local sums of SSIM, compiled: Eq. 3.14 of the thesis at every pixel."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfdbench.system.compiled import compiled

Array = NDArray[Any]


# One long loop nest: shorter functions would need a dozen arrays and counters for every pixel.
@compiled()
def mean_similarity(
    truth: Array, test: Array, counts: Array, masked: bool, weights: Array, c1: float, c2: float
) -> float:
    """Return the mean structural similarity of images, shape (y, x), over pixels that count.

    Parameters
    ----------
    truth, test : ndarray of float64, shape (y, x)
        Ground truth and estimate; if `masked`, 0 at pixels that do not count.
    counts : ndarray of bool, shape (y, x)
        Which pixels count: at least one whose window lies inside the image.
    masked : bool
        Whether any pixel does not count.
    weights : ndarray of float64, shape (radius + 1,)
        The window's weights along one axis, from the centre outwards.
    c1, c2 : float
        The constants of Eq. 3.14.
    """
    # Row by row, so that everything stays in the processor's cache: the five local sums are
    # filtered vertically, then horizontally, then put into Eq. 3.14.
    height, width = truth.shape
    radius = weights.size - 1
    rows = np.empty((5, width), np.float64)
    means = np.empty((5, width - 2 * radius), np.float64)
    total, pixels = 0.0, 0
    for y in range(radius, height - radius):
        rows[:] = 0.0
        for offset in range(-radius, radius + 1):
            weight = weights[abs(offset)]
            a, b, known = truth[y + offset], test[y + offset], counts[y + offset]
            for x in range(width):
                weighted_a, weighted_b = weight * a[x], weight * b[x]
                rows[0, x] += weighted_a
                rows[1, x] += weighted_b
                rows[2, x] += weighted_a * a[x] + weighted_b * b[x]
                rows[3, x] += weighted_a * b[x]
            if masked:
                for x in range(width):
                    rows[4, x] += weight * known[x]
        for plane in range(5 if masked else 4):
            row, mean = rows[plane], means[plane]
            for x in range(mean.size):
                mean[x] = weights[0] * row[x + radius]
            for offset in range(1, radius + 1):
                weight = weights[offset]
                left, right = row[radius - offset :], row[radius + offset :]
                for x in range(mean.size):
                    mean[x] += weight * (left[x] + right[x])
        for x in range(width - 2 * radius):
            if not counts[y, x + radius]:
                continue
            # Scale a window's weights to sum to 1 over its known pixels.
            scale = 1.0 / means[4, x] if masked else 1.0
            mu_true, mu_test = means[0, x] * scale, means[1, x] * scale
            squares, product = mu_true * mu_true + mu_test * mu_test, mu_true * mu_test
            variances = means[2, x] * scale - squares
            covariance = means[3, x] * scale - product
            total += ((2 * product + c1) * (2 * covariance + c2)) / (
                (squares + c1) * (variances + c2)
            )
            pixels += 1
    return total / pixels
