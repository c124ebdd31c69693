"""Point-spread functions in two dimensions, from the Gaussian to nearly a disk."""

import numpy as np

from dfdbench.blur.light import Floats

# Bisections of the interval that holds a scale, at most 10^13 wide: enough to fix the last bit.
_HALVINGS = 100


def point_spread_functions(sigmas: Floats, size: int, exponent: float = 2.0) -> Floats:
    """Return ``exp(-(r / c)^p)`` on the pixel grid, as wide as the Gaussian of each sigma.

    Parameters
    ----------
    sigmas : ndarray of float, shape (level,)
        Standard deviations of Gaussians, in pixels, above 0.
    size : int
        Side of the kernels in pixels, odd.
    exponent : float
        The exponent p, 1 to 64: 2 is the Gaussian, 32 is nearly a disk.

    Returns
    -------
    ndarray of float64, shape (level, size, size)
        Each sums to 1 and is symmetric in both axes and their diagonal.

    Notes
    -----
    The scale c is chosen so that the *sampled* kernel has the same variance along each axis as the
    Gaussian of that sigma sampled on the same grid. For kernels many pixels wide this is the
    continuous ``sigma^2 = c^2 Gamma(4 / p) / (2 Gamma(2 / p))``; for a disk, ``c = 2 sigma``. But
    the least sigma of the published recipe is a third of a pixel. There the continuous rule would
    turn every disk of a radius below 1 into the same kernel, a single pixel, and jump whenever the
    radius reaches further pixels. With our rule the variance is that of the recipe's kernel at each
    level, no two levels look alike, and p = 2 gives the recipe's own kernel.

    Examples
    --------
    >>> from dfdbench.blur.tracks import DISK
    >>> disk = point_spread_functions(np.array([3.0]), 27, DISK)[0]
    >>> disk[13, 13:22].round(4).tolist()
    [0.0089, 0.0089, 0.0089, 0.0089, 0.0089, 0.0089, 0.0048, 0.0, 0.0]
    """
    radius = size // 2
    squares = np.add.outer(np.arange(radius + 1.0) ** 2, np.arange(radius + 1.0) ** 2)
    # A kernel has few different distances from its centre, so weight each by how often it occurs.
    distances, where = np.unique(squares, return_inverse=True)
    times = np.full(squares.shape, 4.0)
    times[0], times[:, 0], times[0, 0] = 2, 2, 1
    counts = np.bincount(where.ravel(), weights=times.ravel()).astype(np.float64)
    gaussians = counts * np.exp(-distances / (2 * sigmas[:, np.newaxis] ** 2))
    variances = _variances(gaussians, distances)
    scales = _scales(variances, distances, counts, exponent)
    weights = _bells(distances, scales, exponent)
    weights /= (counts * weights).sum(axis=1, keepdims=True)
    quadrants = weights[:, where.reshape(squares.shape)]
    offsets = np.abs(np.arange(-radius, radius + 1))
    return np.asarray(quadrants[:, offsets[:, np.newaxis], offsets], dtype=np.float64)


def _bells(distances: Floats, scales: Floats, exponent: float) -> Floats:
    # `distances` are squared: (r / c)^p is (r^2 / c^2)^(p / 2).
    ratios = distances / scales[:, np.newaxis] ** 2
    with np.errstate(over="ignore"):
        return np.asarray(np.exp(-(ratios ** (exponent / 2))), dtype=np.float64)


def _variances(weights: Floats, distances: Floats) -> Floats:
    """Return the variance along one axis: half the mean squared distance from the centre."""
    moments = (weights * distances).sum(axis=1) / weights.sum(axis=1)
    return np.asarray(moments / 2, dtype=np.float64)


def _scales(variances: Floats, distances: Floats, counts: Floats, exponent: float) -> Floats:
    """Return the scale that gives a kernel each variance, which rises with the scale."""
    # From the nearest neighbours' weight underflowing to all weights being equal.
    low = np.full(variances.shape, -np.log(700.0) / exponent)
    high = np.full(variances.shape, np.log(distances[-1] + 1) + 30 / exponent)
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        bells = counts * _bells(distances, np.exp(middle), exponent)
        narrow = _variances(bells, distances) < variances
        low, high = np.where(narrow, middle, low), np.where(narrow, high, middle)
    return np.asarray(np.exp((low + high) / 2), dtype=np.float64)
