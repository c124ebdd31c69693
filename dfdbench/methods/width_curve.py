"""Find the blur's width at every depth level from the residuals of a ladder of widths."""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.linalg import solve_banded

from dfdbench.blur.recipe import LEVELS
from dfdbench.errors import MethodError
from dfdbench.methods.alignment import ROUNDING, Array

#: The widths to try, in pixels; between them the residual is a smooth curve.
LADDER = np.geomspace(0.22, 6.4, 37)
_FINE = np.geomspace(LADDER[0], LADDER[-1], 16 * (LADDER.size - 1) + 1)
# The number of Newton steps towards the curve, the largest step as a share of the width, and how
# many levels on either side are pooled before the first step.
_STEPS = 6
_LARGEST_STEP = 0.2
_NEAR = 6
# Among curves whose cross-validation score is at most this many times the best, the smoothest is
# taken.
_AS_GOOD = 1.5
# A curve that falls below its largest width by this factor has turned back; how many levels before
# that give its slope.
_TURNED_BACK, _STRAIGHT = 1.1, 32
# A level whose curve is flatter than this says nothing.
_LEAST_SHARPNESS = 1e-3


def width_curve(sums: Array, pixels: Array) -> NDArray[np.float64]:
    """Return the smooth curve of widths by depth level that leaves the least difference.

    Parameters
    ----------
    sums : ndarray of float, shape (256, widths)
        Squared differences by depth level and width of `LADDER`.
    pixels : ndarray of int, shape (256,)
        The number of pixels of each level.

    Returns
    -------
    ndarray of float64, shape (256,)
        Standard deviations in pixels.

    Raises
    ------
    MethodError
        If fewer than two levels show their width.
    """
    splines = CubicSpline(np.log(LADDER), sums, axis=1)
    # Start with neighbouring levels pooled.
    near = np.abs(np.subtract.outer(np.arange(LEVELS), np.arange(LEVELS))) <= _NEAR
    pooled = near @ sums
    widths, sharpness, least = best_widths(pooled)
    # In units of twice the remaining variance, which is at least that of rounding.
    unit = 2 * max(float(least.sum()) / max(float((near @ pixels).sum()), 1.0), ROUNDING**2)
    known = (pixels > 0) & (sharpness / unit > _LEAST_SHARPNESS)
    if known.sum() < 2:
        what = "the training pairs do not show how their blur depends on depth"
        fix = "add pairs with texture at several depths, away from jumps in depth and the border"
        raise MethodError(what, fix=fix)
    sigmas, strength = smooth_curve(widths, np.where(known, sharpness / unit, 0))
    for _ in range(_STEPS):
        sigmas = np.clip(sigmas, LADDER[0], LADDER[-1])
        places = np.log(sigmas)
        slope, bend = (np.diagonal(splines(places, order)) for order in (1, 2))
        # Convert to derivatives by the width instead of its logarithm.
        slope, bend = slope / sigmas, (bend - slope) / sigmas**2
        weights = np.where(known & (bend > 0), bend, 0) / unit
        step = np.where(weights > 0, -slope / np.where(bend > 0, bend, 1), 0)
        target = sigmas + np.clip(step, -_LARGEST_STEP * sigmas, _LARGEST_STEP * sigmas)
        sigmas, _ = smooth_curve(target, weights, strength)
    return np.clip(sigmas, LADDER[0], LADDER[-1])


def held_at_ends(sigmas: Array, pixels: Array) -> NDArray[np.float64]:
    """Return a curve of widths whose ends, which no pixel shows, do not turn back to other widths.

    Beyond the levels that training shows, a smooth curve continues as it ended. If that leads back
    to the widths of other levels, two depths would look alike, so the last width shown is kept.

    Parameters
    ----------
    sigmas : ndarray of float, shape (level,)
        Standard deviations in pixels.
    pixels : ndarray of int, shape (level,)
        How many pixels show each level; some level is shown.

    Examples
    --------
    >>> held_at_ends(np.array([2.0, 2.5, 3.0, 2.0, 1.0, 0.5]), np.array([0, 0, 9, 9, 9, 0]))
    array([3. , 3. , 3. , 2. , 1. , 0.5])
    """
    shown = np.flatnonzero(pixels)
    first, last = int(shown[0]), int(shown[-1])
    inside = sigmas[first : last + 1]
    held = np.asarray(sigmas, np.float64).copy()
    for end, beyond in ((first, slice(0, first)), (last, slice(last + 1, None))):
        outside = held[beyond]
        if ((outside >= inside.min()) & (outside <= inside.max())).any():
            outside[:] = held[end]
    return held


def grown_from_focus(sigmas: Array, pixels: Array) -> NDArray[np.float64]:
    """Return a curve of widths that grows from one level to both sides, like the blur of a lens.

    If the data say little about a level's width, mostly beside jumps in depth, a curve may turn
    back to the widths of other levels. To find where, we compare it with curves that start at one
    level and never fall to either side, and take the one that is closest over all pixels. An end
    that has turned back by a tenth or more continues from there along the slope it had before. If
    more levels turned back than had grown, and these to less than twice the least width, it stays
    as it is: that is noise near the focus.

    Parameters
    ----------
    sigmas : ndarray of float, shape (level,)
        Standard deviations in pixels.
    pixels : ndarray of int, shape (level,)
        How many pixels show each level.

    Examples
    --------
    >>> grown_from_focus(np.array([1.5, 2.8, 3.0, 2.0, 1.0, 1.5]), np.array([1, 1, 9, 9, 9, 9]))
    array([5. , 4. , 3. , 2. , 1. , 1.5])
    """
    above = (np.maximum.accumulate(sigmas[level:]) for level in range(len(sigmas)))
    below = (np.maximum.accumulate(sigmas[level::-1])[:0:-1] for level in range(len(sigmas)))
    grown = np.array([np.concatenate(sides) for sides in zip(below, above, strict=True)])
    focus = int((np.square(grown - sigmas) @ (pixels + 1)).argmin())
    best, found = grown[focus], np.asarray(sigmas, np.float64).copy()
    # Each side is a view from the focus to one end.
    for side, held in ((found[focus:], best[focus:]), (found[focus::-1], best[focus::-1])):
        turn = int((held == held[-1]).argmax())
        back = held[-1] > _TURNED_BACK * side[turn:]
        if back[-1] and (back.sum() <= turn or held[-1] > 2 * held[0]):
            start = max(turn - _STRAIGHT, 0)
            slope = (side[turn] - side[start]) / max(turn - start, 1)
            straight = side[turn] + slope * np.arange(len(side) - turn)
            side[turn:] = np.minimum(straight, max(side[turn], LADDER[-1]))
    return found


def left_at(sums: Array, sigmas: Array) -> NDArray[np.float64]:
    """Return the squared difference of each depth level at its width.

    Parameters
    ----------
    sums : ndarray of float, shape (level, widths)
        Squared differences by depth level and width of `LADDER`.
    sigmas : ndarray of float, shape (level,)
        The widths, in pixels.

    Returns
    -------
    ndarray of float64, shape (level,)
        Interpolated between the widths of the ladder by a cubic spline, 0 or more.
    """
    curves = CubicSpline(np.log(LADDER), sums, axis=1)(np.log(sigmas))
    return np.asarray(np.maximum(np.diagonal(curves), 0), np.float64)


def best_widths(
    sums: Array,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return each level's width of least difference, its sharpness, and the difference there.

    Parameters
    ----------
    sums : ndarray of float, shape (level, widths)
        Squared differences by depth level and width of `LADDER`.

    Returns
    -------
    widths, sharpness, least : ndarray of float64, shape (level,)
        The widths in pixels; the second derivative of the difference by the width, 0 if there is no
        minimum inside the ladder; the squared difference at the minimum.
    """
    values = CubicSpline(np.log(LADDER), sums, axis=1)(np.log(_FINE))
    best = values.argmin(axis=1)
    inner = np.clip(best, 1, _FINE.size - 2)
    rows = np.arange(len(sums))
    before, here, after = (values[rows, inner + step] for step in (-1, 0, 1))
    bend = before - 2 * here + after
    spacing = _FINE[inner] * math.log(_FINE[1] / _FINE[0])
    sharpness = np.where(bend > 0, bend / spacing**2, 0.0)
    return _FINE[best], sharpness, np.maximum(values[rows, best], 0)


def smooth_curve(
    values: Array, weights: Array, strength: float | None = None
) -> tuple[NDArray[np.float64], float]:
    """Return the curve of least bending through weighted values (Whittaker 1923).

    By default, generalised cross-validation chooses how strongly bending counts; that strength is
    returned too.

    Parameters
    ----------
    values, weights : ndarray of float, shape (level,)
        The values, and their weights, 0 or more; a value with weight 0 is unknown.
    strength : float, optional
        The weight of bending, relative to the squared deviations of the curve.

    Returns
    -------
    curve : ndarray of float64, shape (level,)
        `values` unchanged if all weights are 0.
    strength : float
    """
    bends = np.diff(np.eye(len(values)), 2, axis=0)
    penalty = _bands(bends.T @ bends)
    known = weights > 0
    if not known.any():
        return values, strength or 1.0
    target = np.where(known, values, 0.0)
    if strength is not None:
        return _bent_through(weights, strength * penalty, weights * target), strength
    tried = []
    for strength in np.geomspace(1e-2, 1e10, 25) * np.median(weights[known]):
        hat = _bent_through(weights, strength * penalty, np.diag(weights))
        curve = hat @ target
        freedom = max(1 - np.trace(hat) / known.sum(), 1e-6)
        score = float((weights * np.square(target - curve)).sum()) / freedom**2
        tried.append((score, curve, float(strength)))
    # The smoothest curve extrapolates best to levels that are missing.
    best = min(score for score, _, _ in tried)
    smoothest = next(each for each in reversed(tried) if each[0] <= _AS_GOOD * best)
    return smoothest[1], smoothest[2]


def _bands(matrix: Array) -> NDArray[np.float64]:
    """Return the five diagonals of a matrix in LAPACK's band form."""
    bands = np.zeros((5, len(matrix)))
    for above in range(-2, 3):
        diagonal = np.diagonal(matrix, above)
        bands[2 - above, max(above, 0) : len(matrix) + min(above, 0)] = diagonal
    return bands


def _bent_through(weights: Array, penalty: Array, right: Array) -> NDArray[np.float64]:
    # Use a band solver: a dense solver's last digits depend on its number of threads, and on a busy
    # machine its threads wait for each other.
    bands = penalty.copy()
    bands[2] += weights
    return np.asarray(solve_banded((2, 2), bands, right), np.float64)
