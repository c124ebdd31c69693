"""The winner of a cost volume: each pixel's label of least cost, to a fraction by a parabola."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def least_label(costs: NDArray[Any]) -> NDArray[np.float64]:
    """Return each pixel's label of least cost, with the fraction that its neighbours tell.

    Through the least cost and those beside it goes a parabola; its minimum lies within half a
    label. The first and the last label stay as they are, and so does one whose neighbours cost
    the same.

    Parameters
    ----------
    costs : ndarray, shape (label, y, x)
        Of any real type.

    Returns
    -------
    ndarray of float64, shape (y, x)
        0 to the number of labels less one.

    Examples
    --------
    >>> least_label(np.array([9, 1, 3, 9]).reshape(4, 1, 1)).tolist()
    [[1.3]]
    """
    labels = costs.argmin(axis=0)
    inner = np.clip(labels, 1, max(len(costs) - 2, 1))
    if len(costs) < 3:
        return np.asarray(labels, np.float64)
    before, least, after = (
        np.take_along_axis(costs, (inner + step)[np.newaxis], 0)[0].astype(np.float64)
        for step in (-1, 0, 1)
    )
    bend = before - 2 * least + after
    fits = (labels == inner) & (bend > 0)
    fraction = np.divide(before - after, 2 * bend, out=np.zeros(bend.shape), where=fits)
    return np.asarray(labels + fraction)
