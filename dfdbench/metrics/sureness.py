"""Score how sure a method is, and whether it is right to be.

An estimate may be NaN where the method gives no answer, and may come with sigma, the standard
deviation that it gives each pixel. `squared_errors` takes both; the scores take its result.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dfdbench.errors import InputError
from dfdbench.metrics.scores import checked

Floats = NDArray[np.float64]

#: Half the 90 % interval of a Gaussian, in standard deviations.
REACH_90 = 1.6448536269514722
#: The densities at which errors are compared for the area: 1 %, 2 % and so on.
DENSITIES = np.arange(1, 101) / 100


class Errors(NamedTuple):
    """The errors of the pixels whose truth is known and that have an answer.

    Parameters
    ----------
    squares : ndarray of float64, shape (pixel,)
        Squared errors.
    sigma : ndarray of float64, shape (pixel,), or None
        The standard deviation that the method gives each pixel; None if it gives none.
    known : int
        The number of known pixels, answered or not.
    """

    squares: Floats
    sigma: Floats | None
    known: int

    @property
    def density(self) -> float:
        """The share of known pixels that have an answer; NaN if none is known."""
        return self.squares.size / self.known if self.known else math.nan


def squared_errors(
    truth: ArrayLike,
    estimate: ArrayLike,
    sigma: ArrayLike | None = None,
    mask: ArrayLike | None = None,
) -> Errors:
    """Return the squared errors of an answer.

    Parameters
    ----------
    truth, estimate : array_like of real numbers, shape (y, x)
        In the same unit; the estimate is NaN where there is no answer.
    sigma : array_like of real numbers, shape (y, x), optional
        Standard deviations in the same unit, above 0 where there is an answer.
    mask : array_like of bool, shape (y, x), optional
        True where the truth is known. By default it is everywhere.

    Raises
    ------
    InputError
        If shapes differ, values are complex or infinite, or sigma is invalid.

    Examples
    --------
    >>> squared_errors([[1, 2, 3]], [[1, np.nan, 5]])
    Errors(squares=array([0., 4.]), sigma=None, known=3)
    """
    values = np.asarray(estimate)
    answered = ~np.isnan(values)
    true, test, known = checked(truth, np.where(answered, values, 0), mask)
    chosen = known & answered
    squares = np.square(test[chosen] - true[chosen])
    if sigma is None:
        return Errors(squares, None, int(known.sum()))
    given = np.asarray(sigma, np.float64)
    if given.shape != true.shape or not (np.isfinite(given) & (given > 0))[answered].all():
        expected = f"{true.shape}, finite and above 0 where there is an answer"
        raise InputError("no standard deviations", where="sigma", expected=expected)
    return Errors(squares, given[chosen], int(known.sum()))


def error_curve(squares: Floats, order: Floats, shares: ArrayLike) -> Floats:
    """Return the root mean square error of the surest pixels, for some shares of them.

    Parameters
    ----------
    squares : ndarray of float64, shape (pixel,)
        Squared errors of at least one pixel.
    order : ndarray of float64, shape (pixel,)
        Smaller where the method is surer. Pixels of equal rank count together: any part of them
        has their mean error.
    shares : array_like of float
        Above 0, at most 1.

    Returns
    -------
    ndarray of float64
        One per share, in the unit of the errors.

    Examples
    --------
    >>> error_curve(np.array([1.0, 9.0, 9.0, 1.0]), np.array([1, 2, 2, 1]), [0.5, 0.75, 1])
    array([1.        , 1.91485422, 2.23606798])
    """
    _, place, sizes = np.unique(order, return_inverse=True, return_counts=True)
    sums = np.bincount(place, squares)
    reached = np.concatenate([[0], np.cumsum(sizes)])
    total = np.concatenate([[0.0], np.cumsum(sums)])
    wanted = np.asarray(shares, np.float64) * squares.size
    return np.asarray(np.sqrt(np.interp(wanted, reached, total) / wanted))


def density(found: Errors, *, data_range: float = 255.0) -> float:
    """Return the share of known pixels that have an answer; larger is better.

    It does not depend on `data_range`. NaN if no pixel is known.

    Examples
    --------
    >>> density(squared_errors([[1, 2]], [[1, np.nan]]))
    0.5
    """
    return found.density


def surest_nrmse(found: Errors, *, share: float, data_range: float = 255.0) -> float:
    """Return the NRMSE of the known pixels that a method is surest of; smaller is better.

    Parameters
    ----------
    found : Errors
        From `squared_errors`.
    share : float
        The share of all known pixels, above 0, at most 1.
    data_range : float
        What the error is divided by.

    Returns
    -------
    float
        NaN if fewer pixels have an answer. Without a sigma all pixels are equally sure, and this
        is the error of all that have an answer.

    Examples
    --------
    >>> surest_nrmse(squared_errors([[1, 2]], [[1, 4]], [[1, 9]]), share=0.5)
    0.0
    >>> surest_nrmse(squared_errors([[1, 2]], [[1, np.nan]]), share=0.9)
    nan
    """
    wanted = share * found.known
    if not 0 < wanted <= found.squares.size:
        return math.nan
    order = np.zeros(found.squares.size) if found.sigma is None else found.sigma
    curve = error_curve(found.squares, order, [wanted / found.squares.size])
    return float(curve[0] / data_range)


def ause(found: Errors, *, data_range: float = 255.0) -> float:
    """Return the area under the sparsification error, 0 or more; smaller is better.

    Parameters are those of `surest_nrmse`.

    Returns
    -------
    float
        0 if sigma puts the pixels in the order of their errors. NaN without a sigma, or if no
        known pixel has an answer.

    Notes
    -----
    ``mean over densities d of (RMSE of the surest d - RMSE of the d with the least errors)``,
    divided by `data_range`, with densities 0.01, 0.02, ... 1 of the pixels that have an answer.
    Ilg et al., Uncertainty estimates and multi-hypotheses networks for optical flow, ECCV 2018,
    divide by the error of all pixels instead, so their area does not reward a better depth map.
    Ours does.

    Examples
    --------
    >>> ause(squared_errors([[0, 0]], [[1, 3]], [[0.1, 0.2]]))
    0.0
    >>> ause(squared_errors([[0, 0]], [[1, 3]], [[2, 1]])) > 0
    True
    """
    if found.sigma is None or not found.squares.size:
        return math.nan
    ours, best = (
        error_curve(found.squares, order, DENSITIES) for order in (found.sigma, found.squares)
    )
    # Rounding may put the best order slightly above another.
    return max(float(np.mean(ours - best) / data_range), 0.0)


def within_interval(found: Errors, *, data_range: float = 255.0) -> float:
    """Return the share of truths within the 90 % interval, depth ± 1.645 sigma; best at 0.9.

    It does not depend on `data_range`. NaN without a sigma, or if no known pixel has an answer.

    Examples
    --------
    >>> within_interval(squared_errors([[1, 2]], [[2, 4]], [[1, 1]]))
    0.5
    """
    if found.sigma is None or not found.squares.size:
        return math.nan
    return float(np.mean(found.squares <= np.square(REACH_90 * found.sigma)))
