"""The scores of a depth map (NRMSE, NMAE, SSIM), and whether its depth is reversed."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dfdbench.errors import InputError, Problem

#: Larger values of a method's own numbers are not kept, so that their sums stay finite.
LARGEST_NUMBER = 1e100
_SSIM_SIGMA = 1.5
_SSIM_RADIUS = 5
_SSIM_WEIGHTS = np.exp(-(np.arange(_SSIM_RADIUS + 1) ** 2) / (2 * _SSIM_SIGMA**2))
_SSIM_WEIGHTS /= _SSIM_WEIGHTS[0] + 2 * _SSIM_WEIGHTS[1:].sum()
_SSIM_K1, _SSIM_K2 = 0.01, 0.03

#: A correlation below this means that a depth map is reversed.
AGAINST = -0.3


def correlation(truth: ArrayLike, estimate: ArrayLike) -> float:
    """Return Pearson's correlation of two depth maps, -1 to 1.

    Parameters
    ----------
    truth, estimate : array_like of real numbers, of one shape
        Depth levels of the pixels that count.

    Returns
    -------
    float
        NaN if one of them is flat, or no pixel counts.

    Examples
    --------
    >>> truth = np.array([10, 20, 40])
    >>> round(correlation(truth, 255 - truth), 6), correlation(truth, [7, 7, 7])
    (-1.0, nan)
    """
    a, b = (np.asarray(levels, np.float64).ravel() for levels in (truth, estimate))
    if not a.size or np.ptp(a) == 0 or np.ptp(b) == 0:
        return math.nan
    return float(np.corrcoef(a, b)[0, 1])


def nrmse(
    image_true: ArrayLike,
    image_test: ArrayLike,
    *,
    data_range: float | None = None,
    mask: ArrayLike | None = None,
) -> float:
    """Return the normalised root mean square error; smaller is better.

    Parameters
    ----------
    image_true, image_test : array_like of real numbers, shape (y, x)
        Ground truth and estimate, in depth levels.
    data_range : float, optional
        What the error is divided by. By default the range of the ground truth,
        ``max - min`` over the pixels that count, as in the thesis.
    mask : array_like of bool, shape (y, x), optional
        True where a pixel counts. By default all do.

    Returns
    -------
    float
        NaN if it is undefined: no pixel counts, or the ground truth is flat and there is no
        `data_range`.

    Raises
    ------
    InputError
        If shapes differ, values are complex or non-finite, or the range is not positive.

    Notes
    -----
    Eq. 3.10 and 3.11 of the thesis. It is not symmetric: the ground truth's range is the divisor.

    Examples
    --------
    >>> truth = np.array([[0, 100], [200, 100]])
    >>> round(nrmse(truth, truth + 10), 6)
    0.05
    >>> nrmse(np.full((2, 2), 7), np.zeros((2, 2)))
    nan
    """
    truth, test, counts = checked(image_true, image_test, mask)
    divisor = _divisor(truth, counts, data_range)
    error = _counted(truth - test, counts)
    return math.nan if math.isnan(divisor) else float(np.sqrt(np.mean(error**2)) / divisor)


def nmae(
    image_true: ArrayLike,
    image_test: ArrayLike,
    *,
    data_range: float | None = None,
    mask: ArrayLike | None = None,
) -> float:
    """Return the normalised mean absolute error; smaller is better.

    Parameters, errors and the undefined case are those of `nrmse`, which is never smaller.

    Notes
    -----
    Eq. 3.12 and 3.13 of the thesis.

    Examples
    --------
    >>> truth = np.array([[0, 100], [200, 100]])
    >>> nmae(truth, [[0, 100], [200, 140]], data_range=200)
    0.05
    """
    truth, test, counts = checked(image_true, image_test, mask)
    divisor = _divisor(truth, counts, data_range)
    error = _counted(truth - test, counts)
    return math.nan if math.isnan(divisor) else float(np.mean(np.abs(error)) / divisor)


def ssim(
    image_true: ArrayLike,
    image_test: ArrayLike,
    *,
    data_range: float = 255.0,
    mask: ArrayLike | None = None,
) -> float:
    """Return the mean structural similarity; larger is better, and 1 means identical.

    Parameters
    ----------
    image_true, image_test : array_like of real numbers, shape (y, x)
        Ground truth and estimate, in depth levels.
    data_range : float
        L of the constants ``(0.01 L)^2`` and ``(0.03 L)^2``.
    mask : array_like of bool, shape (y, x), optional
        True where a pixel counts. The others are left out of the average and of every window; the
        weights of a window's remaining pixels are scaled to sum to 1.

    Returns
    -------
    float
        NaN if it is undefined: no pixel counts, or the image is smaller than the window.

    Raises
    ------
    InputError
        As for `nrmse`.

    Notes
    -----
    Eq. 3.14 of the thesis, after Wang et al. 2004: 11 x 11 Gaussian window, sigma 1.5, biased
    covariance, averaged over the pixels whose window lies inside the image. Equal to
    scikit-image's with ``gaussian_weights=True, sigma=1.5, use_sample_covariance=False``.

    Examples
    --------
    >>> truth = np.arange(400.0).reshape(20, 20) % 256
    >>> ssim(truth, truth)
    1.0
    >>> ssim(truth, 255 - truth) < 0
    True
    """
    truth, test, counts = checked(image_true, image_test, mask)
    _divisor(truth, counts, data_range)
    # This is also empty if the image is smaller than the window.
    inner = counts[_SSIM_RADIUS:-_SSIM_RADIUS, _SSIM_RADIUS:-_SSIM_RADIUS]
    if not inner.any():
        return math.nan
    c1, c2 = (_SSIM_K1 * data_range) ** 2, (_SSIM_K2 * data_range) ** 2
    # Imported here so that reading a result does not have to wait for numba.
    from dfdbench.metrics.similarity import mean_similarity
    from dfdbench.system.vectors import LANES

    height, width = truth.shape
    given = np.zeros((3, height, width + LANES))
    for plane, values in enumerate((truth, test, counts)):
        np.multiply(values, counts, out=given[plane, :, :width])
    mean = mean_similarity(given, width, mask is not None, _SSIM_WEIGHTS, c1, c2)
    # Rounding may put nearly equal images slightly above 1.
    return float(np.clip(mean, -1.0, 1.0))


def checked(
    image_true: ArrayLike, image_test: ArrayLike, mask: ArrayLike | None
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Return ground truth and estimate as float64, and which pixels count; all of shape (y, x).

    Raises
    ------
    InputError
        If shapes differ, values are complex or non-finite, or the mask is invalid.
    """
    given = {"image_true": image_true, "image_test": image_test}
    what, fix = "masked pixels would count", "give ~image.mask as mask, too"
    masked = [name for name, image in given.items() if mask is None and np.ma.is_masked(image)]
    problems = [Problem(what, where=name, fix=fix) for name in masked]
    truth, test = np.asarray(image_true), np.asarray(image_test)
    problems += [*_wrong("image_true", truth), *_wrong("image_test", test)]
    if not problems and truth.shape != test.shape:
        what = f"sizes differ, {truth.shape} and {test.shape}"
        problems.append(Problem(what, where="image_test"))
    InputError.raise_if(problems)
    counts = np.ones(truth.shape, bool) if mask is None else np.asarray(mask)
    if counts.shape != truth.shape or counts.dtype != np.bool_:
        got = f"{counts.dtype} {counts.shape}"
        raise InputError("wrong mask", where="mask", expected=f"bool {truth.shape}", got=got)
    return np.asarray(truth, np.float64), np.asarray(test, np.float64), counts


def _wrong(name: str, image: NDArray[Any]) -> Iterator[Problem]:
    if image.dtype.kind not in "uif":
        yield Problem("wrong type", where=name, expected="real numbers", got=str(image.dtype))
    elif image.ndim != 2 or image.size == 0:
        yield Problem("wrong shape", where=name, expected="(y, x)", got=str(image.shape))
    elif not np.isfinite(image).all():
        yield Problem("not finite", where=name, expected="finite levels", got="NaN or infinity")


def _counted(levels: NDArray[np.float64], counts: NDArray[np.bool_]) -> NDArray[np.float64]:
    # Most often all pixels count, and to pick them one by one takes longer than a metric.
    return levels.ravel() if counts.all() else levels[counts]


def _divisor(truth: NDArray[np.float64], counts: NDArray[np.bool_], data_range: Any) -> float:
    if data_range is not None:
        if not (math.isfinite(data_range) and data_range > 0):
            expected, got = "a positive number", str(data_range)
            raise InputError("wrong range", where="data_range", expected=expected, got=got)
        return float(data_range) if counts.any() else math.nan
    own = float(np.ptp(_counted(truth, counts))) if counts.any() else 0.0
    return own if own > 0 else math.nan
