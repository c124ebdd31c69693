"""Few kernels that stand for many: what is blurred with them gives every label's blurred image."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


def few_kernels(planes: Array, tolerance: float) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Choose few kernels, and the sums of them that stand for all.

    Blurring is linear: the same sums of images blurred with the few give the images blurred with
    all.

    Parameters
    ----------
    planes : ndarray of float64, shape (label, tap)
        The kernels; a tap that stands for its mirror images too is as many times as large.
    tolerance : float
        Largest sum of absolute differences between a kernel and what stands for it.

    Returns
    -------
    chosen : ndarray of int
        Rows of the kernels chosen.
    factors : ndarray of float64, shape (chosen, label)
        What the sum for a label takes of each.
    """
    rest, chosen = planes.copy(), list[int]()
    while len(chosen) < min(planes.shape):
        # The kernel that those chosen stand for worst; what is along it is taken from all.
        chosen.append(int(np.argmax(np.square(rest).sum(1))))
        along = rest[chosen[-1]] / np.linalg.norm(rest[chosen[-1]])
        rest -= np.outer(rest @ along, along)
        if np.abs(rest).sum(1).max() <= tolerance:
            break
    factors = np.linalg.lstsq(planes[chosen].T, planes.T, rcond=None)[0]
    return np.array(chosen), np.ascontiguousarray(factors)
