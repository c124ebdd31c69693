"""Smooth a map within an image's edges, by weighted least squares."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfdbench.methods.fitted import Image, channels_of
from dfdbench.system.compiled import compiled

Array = NDArray[Any]

# Rounds of smoothing along rows and columns: with fewer, stripes show.
_ROUNDS = 3


def within_edges(
    fields: Array, guide: Image, strength: float, contrast: float
) -> NDArray[np.float64]:
    """Return fields that differ little from neighbour to neighbour, unless the image does.

    Parameters
    ----------
    fields : ndarray, shape (field, y, x)
        What to smooth, each field by itself.
    guide : ndarray of uint8, shape (y, x, channel) or (y, x)
        The image.
    strength : float
        How much a difference of neighbours counts beside a change of a pixel.
    contrast : float
        The difference of two neighbours in the image, in grey levels, the mean over channels, at
        which that falls to 1 / e.

    Notes
    -----
    Of a field f the answer u nearly has the least ``sum (u - f)^2 + strength * sum over neighbours
    k (u_p - u_q)^2``, with k for ``exp(-difference / contrast)``: Farbman et al., Edge-preserving
    decompositions for multi-scale tone and detail manipulation, SIGGRAPH 2008. Rows and columns
    take turns, each solved exactly, with less strength every round: Min et al., Fast global image
    smoothing based on weighted least squares, TIP 2014, Eq. 13 to 16.

    Examples
    --------
    >>> guide = np.array([[10, 10, 10, 90, 90, 90]], np.uint8)
    >>> noisy = np.array([[[0.0, 3.0, 0.0, 8.0, 8.0, 5.0]]])
    >>> within_edges(noisy, guide, 100, 3).round(1).tolist()
    [[[1.0, 1.0, 1.0, 7.0, 7.0, 7.0]]]
    """
    channels = channels_of(guide)
    across, down = (
        np.exp(-np.abs(np.diff(channels, axis=axis)).mean(axis=2, dtype=np.float64) / contrast)
        for axis in (1, 0)
    )
    ties = across, np.ascontiguousarray(down.T)
    smooth = np.array(fields, np.float64, order="C")
    for turn in range(_ROUNDS):
        part = strength * 1.5 * 4.0 ** (_ROUNDS - 1 - turn) / (4.0**_ROUNDS - 1)
        for tie in ties:
            _smooth_rows(smooth, part * tie)
            smooth = np.ascontiguousarray(smooth.swapaxes(1, 2))
    return smooth


def lent_within_edges(
    fields: Array, weight: Array, guide: Image, strength: float, contrast: float
) -> NDArray[np.float64]:
    """Return fields whose pixels lend each other what they say, by weight, within edges.

    The quotient of weighted fields and the weight, shape (y, x), both smoothed by `within_edges`.

    Examples
    --------
    >>> guide, said = np.full((1, 4), 90, np.uint8), np.array([[[8.0, 0.0, 0.0, 8.0]]])
    >>> lent_within_edges(said, np.array([[1, 0.01, 0.01, 1]]), guide, 1e4, 3).round(1).tolist()
    [[[7.9, 7.9, 7.9, 7.9]]]
    """
    weighted = np.concatenate([weight * fields, weight[np.newaxis]])
    smooth = within_edges(weighted, guide, strength, contrast)
    return np.asarray(smooth[:-1] / smooth[-1])


@compiled()
def _smooth_rows(fields: Array, ties: Array) -> None:
    """Solve ``(1 + L) u = f`` on each row of fields, in place; L ties neighbours to each other.

    Elimination of a matrix with three diagonals, the same for all fields.
    """
    count, height, width = fields.shape
    factors = np.empty(width)
    for y in range(height):
        before = 0.0
        for x in range(width):
            after = ties[y, x] if x < width - 1 else 0.0
            kept = before * factors[x - 1] if x else 0.0
            pivot = 1.0 + before + after - kept
            factors[x] = after / pivot
            for field in range(count):
                carried = before * fields[field, y, x - 1] if x else 0.0
                fields[field, y, x] = (fields[field, y, x] + carried) / pivot
            before = after
        for x in range(width - 2, -1, -1):
            for field in range(count):
                fields[field, y, x] += factors[x] * fields[field, y, x + 1]
