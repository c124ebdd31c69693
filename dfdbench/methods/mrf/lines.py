"""Best lines: find the labels of a whole row or column at once, with the other lines fixed.

A cut chooses between two labels for every pixel of the image. Here every pixel of one line chooses
among sixteen, exactly, by dynamic programming, in no more time. Labels spread along lines: where
surfaces end, a pixel's correct label is mostly that of a neighbour.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfdbench.system.compiled import compiled

# A pixel chooses from this many labels around its own, those of its four neighbours, and the one
# that its own costs favour; together they fill a processor's widest register.
AROUND = 11
CANDIDATES = AROUND + 4 + 1

_FAR = np.int32(2**31 - 1)

Array = NDArray[Any]
#: Every label's cost at every pixel; labels, their costs, and a label that each pixel may choose.
Arrays = tuple[Array, Array, Array, Array]
#: The slope and the cap of the smoothness.
Law = tuple[Any, Any]
#: Where a line's labels are, and where its costs are.
Grids = tuple[tuple[int, int, int], tuple[int, int, int]]


def best_lines(
    unary: NDArray[Any],
    labels: NDArray[np.int32],
    costs: NDArray[Any],
    favoured: NDArray[np.int32],
    slope: int,
    cap: int,
    along: NDArray[np.int32],
    across: NDArray[np.int32],
    columns: bool,
    first: int = 0,
) -> None:
    """Give each row or column in turn the best labels among its pixels' candidates.

    Parameters
    ----------
    unary : (y, x, label) uint16 or int32
        Every label's cost at every pixel, for some adjacent lines.
    labels, costs : (y, x) int32 and of the type of the costs
        Labels and their costs, both changed in place.
    favoured : (y, x) int32
        A label that every pixel may choose.
    slope, cap : int
        Neighbours whose labels differ by d cost ``slope * min(d, cap)`` times their edge's weight.
    along, across : (y, x) int32
        Weights of the edges to the next pixel of the line, and to the pixel in the next line.
    columns : bool
        Whether the lines are columns.
    first : int
        The first of those lines.

    Examples
    --------
    >>> unary = np.array([[[0, 2, 3], [9, 9, 0], [0, 2, 3]]], np.uint16)
    >>> labels, costs = np.zeros((1, 3), np.int32), np.array([[0, 9, 0]], np.uint16)
    >>> edges = np.array([[1, 1, 0]], np.int32), np.zeros((1, 3), np.int32)
    >>> best_lines(unary, labels, costs, labels + 2, 2, 255, *edges, columns=False)
    >>> labels.tolist(), costs.tolist()
    ([[2, 2, 2]], [[3, 0, 3]])
    """
    height, width = labels.shape
    count, own = unary.shape[2], unary.shape[1]
    grid = (height, 1, width) if columns else (width, width, 1)
    # Where the costs of a line's pixels are, just as the grid says where its labels are.
    part = (first, 1, own) if columns else (first, own, 1)
    arrays = unary.reshape(-1, count), labels.reshape(-1), costs.reshape(-1), favoured.reshape(-1)
    law = np.int32(slope), np.int32(cap)
    _sweep(arrays, law, along.reshape(-1), across.reshape(-1), (grid, part))


@compiled()
def _sweep(arrays: Arrays, law: Law, along: Array, across: Array, grids: Grids) -> None:
    (length, next_line, step), (first, _, _) = grids
    # The candidates of each pixel of a line, and their costs.
    choices = np.empty((length, CANDIDATES), np.int32)
    sums = np.empty((length, CANDIDATES), np.int32)
    for line in range(first, first + len(arrays[0]) // length):
        _offer(arrays, law, across, grids, line, choices, sums)
        _add_lines(law, along, line * next_line, step, choices, sums)
        _take(arrays, law, along, grids, line, choices, sums)


@compiled()
def _offer(
    arrays: Arrays, law: Law, across: Array, grids: Grids, line: int, choices: Array, sums: Array
) -> None:
    # A candidate's cost is its cost at the pixel plus that of the edges to the adjacent lines.
    (unary, labels, _, favoured), (slope, cap) = arrays, law
    (length, next_line, step), (first, own_next, own_step) = grids
    lines, count = labels.size // length, unary.shape[1]
    last, highest = np.int32(count - 1), max(count - AROUND, 0)
    for place in range(length):
        at = line * next_line + place * step
        own, chosen, total = labels[at], choices[place], sums[place]
        low = np.int32(min(max(own - AROUND // 2, 0), highest))
        for candidate in range(AROUND):
            chosen[candidate] = min(np.int32(low + candidate), last)
        for candidate in range(AROUND, CANDIDATES):
            chosen[candidate] = own
        chosen[AROUND] = favoured[at]
        if line > 0:
            chosen[AROUND + 1] = labels[at - next_line]
        if line + 1 < lines:
            chosen[AROUND + 2] = labels[at + next_line]
        if place > 0:
            chosen[AROUND + 3] = labels[at - step]
        if place + 1 < length:
            chosen[AROUND + 4] = labels[at + step]
        for candidate in range(CANDIDATES):
            total[candidate] = unary[
                (line - first) * own_next + place * own_step, chosen[candidate]
            ]
        if line > 0:
            weight = np.int32(slope * across[at - next_line])
            _add_edge(total, chosen, labels[at - next_line], weight, cap)
        if line + 1 < lines:
            weight = np.int32(slope * across[at])
            _add_edge(total, chosen, labels[at + next_line], weight, cap)


@compiled()
def _add_lines(law: Law, along: Array, first: int, step: int, choices: Array, sums: Array) -> None:
    # From pixel to pixel, add the least cost of the line up to the previous one. All costs are
    # relative to the pixel's least, so that sums stay small.
    slope, cap = law
    before = np.empty(CANDIDATES, np.int32)
    for place in range(len(sums)):
        total = sums[place]
        if place > 0:
            weight = np.int32(slope * along[first + (place - 1) * step])
            _reach(sums[place - 1], choices[place - 1], choices[place], weight, cap, before)
            for candidate in range(CANDIDATES):
                total[candidate] += before[candidate]
        least = _least(total)
        for candidate in range(CANDIDATES):
            total[candidate] -= least


@compiled()
def _take(
    arrays: Arrays, law: Law, along: Array, grids: Grids, line: int, choices: Array, sums: Array
) -> None:
    (unary, labels, costs, _), (slope, cap) = arrays, law
    (_, next_line, step), (first, own_next, own_step) = grids
    # From the line's end, each pixel takes the best label given the next pixel's label.
    for place in range(len(sums) - 1, -1, -1):
        at = line * next_line + place * step
        chosen, total = choices[place], sums[place]
        if place + 1 < len(sums):
            _add_edge(total, chosen, labels[at + step], np.int32(slope * along[at]), cap)
        least = _least(total)
        # Of equally good labels, a pixel keeps its own or else takes the first.
        best = labels[at] - chosen[0]
        if total[best] != least:
            best = 0
            while total[best] != least:
                best += 1
            labels[at] = chosen[best]
            costs[at] = unary[(line - first) * own_next + place * own_step, chosen[best]]


# Numba widens every sum of 32-bit numbers to 64 bits, of which only half as many fit in a
# processor's register, so convert each one back at once.
@compiled(inline="always")
def _add_edge(total: Array, chosen: Array, label: Any, weight: Any, cap: Any) -> None:
    other = np.int32(label)
    for candidate in range(CANDIDATES):
        own = chosen[candidate]
        apart = min(max(np.int32(own - other), np.int32(other - own)), cap)
        total[candidate] = np.int32(total[candidate] + np.int32(weight * apart))


@compiled(inline="always")
def _reach(
    sums: Array, choices: Array, chosen: Array, weight: Any, cap: Any, before: Array
) -> None:
    # The least cost of the line up to the previous pixel, plus the edge between.
    for candidate in range(CANDIDATES):
        own, least = chosen[candidate], _FAR
        for other in range(CANDIDATES):
            label = choices[other]
            apart = min(max(np.int32(own - label), np.int32(label - own)), cap)
            least = min(least, np.int32(sums[other] + np.int32(weight * apart)))
        before[candidate] = least


@compiled(inline="always")
def _least(total: Array) -> Any:
    least = total[0]
    for candidate in range(CANDIDATES):
        least = min(least, total[candidate])
    return least
