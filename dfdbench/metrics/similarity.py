"""The local sums of SSIM, compiled: Eq. 3.14 of the thesis at every pixel."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfdbench.system.compiled import compiled
from dfdbench.system.vectors import LANES, all_of, load, plus, store, times

Array = NDArray[Any]


# One long loop nest: shorter functions would need a dozen arrays and counters for every pixel.
# Where no pixel of a window counts, a quotient is NaN, and is left out.
@compiled(error_model="numpy")
def mean_similarity(
    given: Array, width: int, masked: bool, weights: Array, c1: float, c2: float
) -> float:
    """Return the mean structural similarity of two images over the pixels that count.

    Parameters
    ----------
    given : ndarray of float64, shape (3, y, x)
        Ground truth, estimate, and 1 where a pixel counts, else 0 in all three. At least one whose
        window lies inside the image counts. Its rows end in `LANES` or more zeros.
    width : int
        The columns of the images, without those zeros.
    masked : bool
        Whether any pixel does not count.
    weights : ndarray of float64, shape (radius + 1,)
        The window's weights along one axis, from the centre outwards.
    c1, c2 : float
        The constants of Eq. 3.14.
    """
    # Row by row, so that everything stays in the processor's cache: the five local sums are
    # filtered vertically, then horizontally, then put into Eq. 3.14.
    _, height, stride = given.shape
    size, radius = height * stride, weights.size - 1
    rows, means = np.zeros((5, stride), np.float64), np.empty((5, stride), np.float64)
    found = np.empty(stride, np.float64)
    total, pixels = 0.0, 0
    for y in range(radius, height - radius):
        for x in range(0, width, LANES):
            trues = tests = squares = products = shares = all_of(0.0)
            for offset in range(-radius, radius + 1):
                at, weight = (y + offset) * stride + x, all_of(weights[abs(offset)])
                a, b = load(given, at), load(given, size + at)
                weighted_a, weighted_b = times(weight, a), times(weight, b)
                trues, tests = plus(trues, weighted_a), plus(tests, weighted_b)
                squares = plus(squares, plus(times(weighted_a, a), times(weighted_b, b)))
                products = plus(products, times(weighted_a, b))
                if masked:
                    shares = plus(shares, times(weight, load(given, 2 * size + at)))
            store(rows, x, trues)
            store(rows, stride + x, tests)
            store(rows, 2 * stride + x, squares)
            store(rows, 3 * stride + x, products)
            store(rows, 4 * stride + x, shares)
        for plane in range(5 if masked else 4):
            for x in range(plane * stride, plane * stride + width - 2 * radius, LANES):
                sums = times(all_of(weights[0]), load(rows, x + radius))
                for offset in range(1, radius + 1):
                    both = plus(load(rows, x + radius - offset), load(rows, x + radius + offset))
                    sums = plus(sums, times(all_of(weights[offset]), both))
                store(means, x, sums)
        for x in range(width - 2 * radius):
            # Scale a window's weights to sum to 1 over its known pixels.
            scale = 1.0 / means[4, x] if masked else 1.0
            mu_true, mu_test = means[0, x] * scale, means[1, x] * scale
            squared, product = mu_true * mu_true + mu_test * mu_test, mu_true * mu_test
            variances = means[2, x] * scale - squared
            covariance = means[3, x] * scale - product
            above = (2 * product + c1) * (2 * covariance + c2)
            found[x] = above / ((squared + c1) * (variances + c2))
        for x in range(width - 2 * radius):
            if given[2, y, x + radius] != 0.0:
                total += found[x]
                pixels += 1
    return total / pixels
