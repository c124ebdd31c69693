"""The path costs of semi-global matching: what the best labels along straight lines cost."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfdbench.system.compiled import compiled

__all__ = ["MOST", "path_costs"]

#: Largest cost and step together: the sums over eight paths are kept in 16 bits.
MOST = 65535 // 8

# Above any cost of a path, and still in 16 bits with a step added.
_FAR = np.uint16(2**15)
# The directions that a sweep from the upper left comes from, as rows and columns, those of four
# paths first; a sweep from the lower right comes from the opposite ones.
_FROM = np.array([[0, -1], [-1, 0], [-1, -1], [-1, 1]])

Array = NDArray[Any]


def path_costs(
    costs: NDArray[np.uint16], small: int, large: int, directions: int = 8
) -> NDArray[np.uint16]:
    """Return the sum over directions of the least cost of a path to each pixel and label.

    Parameters
    ----------
    costs : ndarray of uint16, shape (y, x, label)
        At most `MOST` less `large`.
    small, large : int
        What a path pays for a step of one label, and for a step of more.
    directions : {8, 4}
        Four are along rows and columns, the other four along diagonals.

    Notes
    -----
    ``L_r(p, d) = C(p, d) + min(L_r(p - r, d), L_r(p - r, d - 1) + P1, L_r(p - r, d + 1) + P1,
    min_i L_r(p - r, i) + P2) - min_i L_r(p - r, i)``: Hirschmüller, PAMI 2008, Eq. 13.

    Examples
    --------
    >>> path_costs(np.array([[[0, 2], [3, 0]]], np.uint16), 1, 1).tolist()
    [[[1, 16], [24, 1]]]
    """
    sums = np.zeros(costs.shape, np.uint16)
    _sweeps(costs, np.uint16(small), np.uint16(large), _FROM[: directions // 2], sums)
    return sums


@compiled()
def _sweeps(costs: Array, small: Any, large: Any, sources: Array, sums: Array) -> None:
    height, width, labels = costs.shape
    # Two rows of path costs a direction, one spare label at either end.
    paths = np.full((2, len(sources), width, labels + 2), _FAR, np.uint16)
    least = np.zeros((2, len(sources), width), np.uint16)
    start = np.zeros(labels + 2, np.uint16)
    for backwards in range(2):
        for row in range(height):
            y = height - 1 - row if backwards else row
            now, before = row % 2, (row + 1) % 2
            for column in range(width):
                x = width - 1 - column if backwards else column
                for direction in range(len(sources)):
                    there = column + sources[direction, 1]
                    level = now if sources[direction, 0] == 0 else before
                    begins = there < 0 or there >= width or (level == before and row == 0)
                    least[now, direction, column] = _step(
                        costs[y, x],
                        start if begins else paths[level, direction, there],
                        np.uint16(0) if begins else least[level, direction, there],
                        small,
                        large,
                        paths[now, direction, column],
                        sums[y, x],
                    )


@compiled()
def _step(
    cost: Array, before: Array, least: Any, small: Any, large: Any, now: Array, total: Array
) -> Any:
    """Write the path costs of one pixel and direction, add them to the sums, return their least."""
    # Numba makes every sum of 16-bit numbers one of 64 bits, which holds a quarter as many in a
    # processor's register: each is turned back at once.
    best, jump = _FAR, np.uint16(least + large)
    for label in range(cost.size):
        way = min(np.uint16(min(before[label], before[label + 2]) + small), before[label + 1])
        value = np.uint16(np.uint16(cost[label] + min(way, jump)) - least)
        now[label + 1] = value
        total[label] = np.uint16(total[label] + value)
        best = min(best, value)
    return best
