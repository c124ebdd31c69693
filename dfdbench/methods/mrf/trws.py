"""Tree-reweighted message passing: bounds that no labeling can beat, and good starts.

Sequential TRW (Kolmogorov, "Convergent tree-reweighted message passing for energy minimization",
PAMI 2006) with the rows and columns of the grid as its chains. All arithmetic is in integers: a
pixel's cost is shared out between its row and its column without remainder, so that the bound
holds exactly, whatever the messages are. One algorithm whose passes share their message arrays: it
stays in one file, a little longer than most.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfdbench.errors import InputError
from dfdbench.methods.mrf.energy import Energy, Solution, label_dtype
from dfdbench.methods.mrf.smoothness import COST_LIMIT
from dfdbench.system.compiled import compiled

__all__ = ["lower_bound", "message_passing"]

# Costs are counted in this part of a unit, where int32 has the room. Halves of costs are rounded;
# counted in whole units, the rounding stops the messages far from where they converge.
FINEST = 64

Array = NDArray[Any]


def message_passing(energy: Energy, iterations: int = 20) -> Solution:
    """Minimise an energy by sequential tree-reweighted message passing.

    Memory: two messages a pixel, each as long as a pixel's costs.

    Parameters
    ----------
    energy : Energy
        Any smoothness, metric or not. Time per pixel and label is constant where the table is
        linear up to a distance and constant after it, and grows with the distance else.
    iterations : int, optional
        Number of forward and backward sweeps, at least 1.

    Returns
    -------
    Solution
        The best labeling met, with `lower_bound` set; `history` has an entry per iteration.

    Raises
    ------
    InputError
        If `iterations` is below 1.

    Examples
    --------
    >>> import numpy as np
    >>> from dfdbench.methods.mrf.energy import Energy
    >>> from dfdbench.methods.mrf.smoothness import truncated_absolute
    >>> unary = np.array([[[0, 9, 9], [2, 0, 2], [9, 9, 0]]], np.uint16)
    >>> solution = message_passing(Energy(unary, truncated_absolute(3, cap=2)), 3)
    >>> solution.labels.tolist(), solution.energy, solution.lower_bound
    ([[0, 1, 2]], 2, 2)
    """
    if iterations < 1:
        raise InputError(f"iterations: expected at least 1, got {iterations}")
    height, width = energy.shape
    right, down = energy.edge_weights()
    reach, plateau = _table_shape(energy.smoothness)
    highest = int(energy.smoothness.max()) * max(int(right.max()), int(down.max()))
    largest = max(highest, int(energy.unary.max()), 1)
    finer = FINEST
    while finer > 1 and (finer * largest >= COST_LIMIT or finer * highest >= 2**16 > highest):
        finer //= 2
    table = finer * energy.smoothness
    dtype = np.uint16 if finer * highest < 2**16 else np.int32
    messages = np.zeros((2, height, width, energy.labels), dtype)
    found = np.zeros(energy.shape, np.int32)
    best = np.zeros(energy.shape, label_dtype(energy.labels))
    lowest: int | None = None
    bound = 0
    history = []
    for _ in range(iterations):
        _forward(energy.unary, finer, table, right, down, messages, found, reach, plateau)
        value = energy.evaluate(found)
        if lowest is None or value < lowest:
            lowest = value
            best[...] = found
        history.append(lowest)
        swept = _backward(energy.unary, finer, table, right, down, messages, reach, plateau)
        # Each iteration's bound is valid, so the best one is; rounding may make one lower.
        # Energies are whole, so that the bound may be rounded up to a whole one.
        bound = max(bound, -(-int(swept) // finer))
    assert lowest is not None
    return Solution(best, lowest, tuple(history), bound + energy.offset)


def lower_bound(energy: Energy, iterations: int = 20) -> int:
    """Give a value that the energy of no labeling is below (more iterations, a higher one).

    Parameters
    ----------
    energy : Energy
        Any smoothness.
    iterations : int, optional
        Number of forward and backward sweeps, at least 1.

    Raises
    ------
    InputError
        If `iterations` is below 1.

    Examples
    --------
    >>> import numpy as np
    >>> from dfdbench.methods.mrf.energy import Energy
    >>> from dfdbench.methods.mrf.smoothness import potts
    >>> lower_bound(Energy(np.array([[[0, 5], [5, 0]]], np.uint16), potts(2, cap=3)))
    3
    """
    bound = message_passing(energy, iterations).lower_bound
    assert bound is not None
    return bound


def _table_shape(table: Array) -> tuple[int, int]:
    """Up to which distance a table is linear, and from which on it is at its constant maximum.

    A table that rises faster than its first step is linear up to 0: the two passes over the
    labels that do for a linear one would find costs that are too low.
    """
    line = np.arange(len(table), dtype=np.int64) * int(table[1])
    off = np.flatnonzero(table != line)
    reach = int(off[0]) - 1 if len(off) else len(table) - 1
    if np.any(table > line):
        reach = 0
    below = np.flatnonzero(table != table.max())
    plateau = int(below[-1]) + 1 if table[-1] == table.max() else len(table)
    return reach, plateau


@compiled()
def _convolve(
    table: Array, weight: int, reach: int, plateau: int, costs: Array, rising: Array, out: Array
) -> None:
    # out[k] = min over j of costs[j] + weight * table[|k - j|]; `costs` has its least at 0.
    count = costs.size
    slope = weight * table[1] if reach > 0 else 2**30
    up, back = costs[0], costs[count - 1]
    for label in range(count):
        up = min(up + slope, costs[label])
        rising[label] = up
    for label in range(count - 1, -1, -1):
        back = min(back + slope, costs[label])
        out[label] = min(back, rising[label])
    if plateau < count:
        # Nothing costs more than the least cost and the table's maximum.
        top = weight * table[plateau]
        for label in range(count):
            out[label] = min(out[label], top)
    if reach + 1 < plateau:
        nearest = table[reach + 1]
        for distance in range(reach + 2, plateau):
            nearest = min(nearest, table[distance])
        highest = out[0]
        for label in range(1, count):
            highest = max(highest, out[label])
        # Between the linear part and the plateau every distance is tried, where one can help.
        if highest > weight * nearest:
            for distance in range(reach + 1, min(plateau, count)):
                cost = weight * table[distance]
                for label in range(count - distance):
                    out[label] = min(out[label], costs[label + distance] + cost)
                    out[label + distance] = min(out[label + distance], costs[label] + cost)


@compiled()
def _row_part(cost: Any, height: int, width: int) -> Any:
    # A row and a column share a pixel's cost, unless the grid is a single row or column.
    if height == 1:
        return cost
    return cost >> 1 if width > 1 else 0


@compiled()
def _send(
    table: Array,
    weight: int,
    reach: int,
    plateau: int,
    costs: Array,
    rising: Array,
    out: Array,
    message: Array,
) -> Any:
    # Replace a message by the one that goes on with `costs`; give what was taken off it.
    least = costs[0]
    for label in range(1, costs.size):
        least = min(least, costs[label])
    for label in range(costs.size):
        costs[label] -= least
    _convolve(table, weight, reach, plateau, costs, rising, out)
    for label in range(costs.size):
        message[label] = out[label]
    return least


@compiled()
def _forward(
    unary: Array,
    finer: int,
    table: Array,
    right: Array,
    down: Array,
    messages: Array,
    labels: Array,
    reach: int,
    plateau: int,
) -> None:
    height, width, count = unary.shape
    own = np.empty(count, np.int32)
    row = np.empty(count, np.int32)
    column = np.empty(count, np.int32)
    rising = np.empty(count, np.int32)
    out = np.empty(count, np.int32)
    for y in range(height):
        for x in range(width):
            ahead, below = messages[0, y, x], messages[1, y, x]
            # The label is chosen given the chosen ones behind and the messages from ahead.
            for label in range(count):
                own[label] = finer * np.int32(unary[y, x, label]) + ahead[label] + below[label]
                row[label] = own[label]
            if x > 0:
                behind = messages[0, y, x - 1]
                for label in range(count):
                    own[label] += behind[label]
                    row[label] += right[y, x - 1] * table[abs(label - labels[y, x - 1])]
            if y > 0:
                above = messages[1, y - 1, x]
                for label in range(count):
                    own[label] += above[label]
                    row[label] += down[y - 1, x] * table[abs(label - labels[y - 1, x])]
            labels[y, x] = np.argmin(row)
            for label in range(count):
                part = _row_part(own[label], height, width)
                row[label] = part - ahead[label]
                column[label] = own[label] - part - below[label]
            if x + 1 < width:
                _send(table, right[y, x], reach, plateau, row, rising, out, ahead)
            if y + 1 < height:
                _send(table, down[y, x], reach, plateau, column, rising, out, below)


@compiled()
def _backward(
    unary: Array,
    finer: int,
    table: Array,
    right: Array,
    down: Array,
    messages: Array,
    reach: int,
    plateau: int,
) -> int:
    height, width, count = unary.shape
    own = np.empty(count, np.int32)
    row = np.empty(count, np.int32)
    column = np.empty(count, np.int32)
    rising = np.empty(count, np.int32)
    out = np.empty(count, np.int32)
    # Every row and every column is a chain; this sweep is also the exact minimum of each, for
    # these shares of the pixels' costs. Their sum is the bound.
    bound = 0
    for y in range(height - 1, -1, -1):
        for x in range(width - 1, -1, -1):
            ahead, below = messages[0, y, x], messages[1, y, x]
            for label in range(count):
                own[label] = finer * np.int32(unary[y, x, label]) + ahead[label] + below[label]
            if x > 0:
                behind = messages[0, y, x - 1]
                for label in range(count):
                    own[label] += behind[label]
            if y > 0:
                above = messages[1, y - 1, x]
                for label in range(count):
                    own[label] += above[label]
            for label in range(count):
                row[label] = _row_part(own[label], height, width)
                column[label] = own[label] - row[label]
            if x > 0:
                behind = messages[0, y, x - 1]
                for label in range(count):
                    row[label] -= behind[label]
                bound += _send(table, right[y, x - 1], reach, plateau, row, rising, out, behind)
            else:
                bound += row.min()
            if y > 0:
                above = messages[1, y - 1, x]
                for label in range(count):
                    column[label] -= above[label]
                bound += _send(table, down[y - 1, x], reach, plateau, column, rising, out, above)
            else:
                bound += column.min()
    return bound
