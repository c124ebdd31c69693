"""What a difference of two neighbours' labels costs: the functions of the thesis's Table 4.1."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfdbench.errors import InputError

# Solvers work in int32. A pixel's terminal link adds up one difference of its costs and, from each
# of four edges, at most three differences of smoothness costs: below 13 times this limit.
COST_LIMIT = 2**27


def published(labels: int) -> NDArray[np.int32]:
    """Build the smoothness of the thesis's program, close to |d| up to 228 and |d| - 1 above.

    V(d) = int(5.28 * 255 * |1 - exp(0.0015 d)| / (1 + exp(0.0015 d))).

    Parameters
    ----------
    labels : int
        Number of labels; the formula was made for 256.

    Returns
    -------
    (label,) int32

    Examples
    --------
    >>> published(256)[[0, 1, 228, 229, 255]].tolist()
    [0, 1, 228, 228, 254]
    """
    rise = np.exp(0.0015 * np.arange(_at_least_two(labels)))
    table: NDArray[np.int32] = (5.28 * 255 * np.abs(1 - rise) / (1 + rise)).astype(np.int32)
    return table


def truncated_absolute(labels: int, cap: int, scale: int = 1) -> NDArray[np.int32]:
    """Build V(d) = scale * min(cap, d), the second row of Table 4.1.

    Examples
    --------
    >>> truncated_absolute(5, cap=3, scale=2).tolist()
    [0, 2, 4, 6, 6]
    """
    return _table(np.arange(_at_least_two(labels)), cap, scale)


def truncated_quadratic(labels: int, cap: int, scale: int = 1) -> NDArray[np.int32]:
    """Build V(d) = scale * min(cap, d^2), the first row of Table 4.1; no metric.

    Examples
    --------
    >>> truncated_quadratic(5, cap=10).tolist()
    [0, 1, 4, 9, 10]
    """
    return _table(np.arange(_at_least_two(labels)) ** 2, cap, scale)


def potts(labels: int, cap: int) -> NDArray[np.int32]:
    """Build V(d) = cap for every d but 0, the third row of Table 4.1.

    Examples
    --------
    >>> potts(4, cap=7).tolist()
    [0, 7, 7, 7]
    """
    return truncated_absolute(labels, 1, cap)


def adaptive_potts_weights(
    image: NDArray[Any], threshold: float
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Build the edge weights of the intensity-adaptive Potts model, Table 4.1's last row.

    A label change costs twice as much where the intensity changes by at most the threshold.

    Parameters
    ----------
    image : (y, x) real
        Intensities.
    threshold : float
        Largest intensity difference that counts as the same surface (Table 4.1's beta).

    Returns
    -------
    weights_horizontal : (y, x - 1) int32
    weights_vertical : (y - 1, x) int32

    Raises
    ------
    InputError
        If the image has not two axes.

    Examples
    --------
    >>> import numpy as np
    >>> right, down = adaptive_potts_weights(np.array([[10, 12, 90]], np.uint8), threshold=5)
    >>> right.tolist(), down.shape
    ([[2, 1]], (0, 3))
    """
    values = np.asarray(image, np.float64)
    if values.ndim != 2:
        raise InputError(f"image: expected a shape (y, x), got {values.shape}")
    right, down = (
        np.where(np.abs(np.diff(values, axis=axis)) <= threshold, 2, 1).astype(np.int32)
        for axis in (1, 0)
    )
    return right, down


def _at_least_two(labels: int) -> int:
    if labels < 2:
        raise InputError(f"labels: expected at least 2, got {labels}")
    return labels


def _table(costs: NDArray[Any], cap: int, scale: int) -> NDArray[np.int32]:
    for name, value in (("cap", cap), ("scale", scale)):
        if not 0 < value < COST_LIMIT:
            raise InputError(f"{name}: expected 1 to {COST_LIMIT - 1}, got {value}")
    table = scale * np.minimum(costs.astype(np.int64), cap)
    if table.max() >= COST_LIMIT:
        raise InputError(f"smoothness: expected below {COST_LIMIT}, got {table.max()}")
    return table.astype(np.int32)
