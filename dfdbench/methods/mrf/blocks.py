"""Blocks: labels are found for squares of pixels first, then mended on smaller ones and pixels."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfdbench.methods.mrf.energy import Energy, Solution
from dfdbench.methods.mrf.repair import repair
from dfdbench.system.compiled import compiled

__all__ = ["coarse_to_fine", "coarser", "finer"]

Array = NDArray[Any]


def coarse_to_fine(
    energy: Energy, begin: Callable[[Energy], NDArray[Any]], rounds: Sequence[tuple[int, ...]]
) -> Solution:
    """Minimise an energy on ever smaller blocks, each beginning with the labels of the larger.

    Large blocks have few labels to find, and what no pixel says for certain many say together.
    Felzenszwalb and Huttenlocher, "Efficient belief propagation for early vision", IJCV 2006,
    pass messages on such blocks.

    Parameters
    ----------
    energy : Energy
        Of pixels.
    begin : callable
        Takes the energy of the largest blocks (`coarser`), gives labels to begin with there.
    rounds : sequence of tuples of int
        A round of repairs (`repair`) for each size of blocks, the largest first, pixels last: with
        three, blocks have sides of 4, 2 and 1.

    Returns
    -------
    Solution
        `history` begins with the energy of what `begin` gave and has an entry per round.

    Raises
    ------
    InputError
        If a block's costs are so large that int32 could overflow.

    Examples
    --------
    >>> from dfdbench.methods.mrf.smoothness import truncated_absolute
    >>> unary = np.array([[[9, 4, 0, 4], [3, 3, 2, 1], [9, 4, 0, 4]]], np.uint16)
    >>> energy = Energy(unary, truncated_absolute(4, cap=255))
    >>> solution = coarse_to_fine(energy, lambda blocks: blocks.unary.argmin(2), [(), (0,)])
    >>> solution.labels.tolist(), solution.history
    ([[2, 2, 2]], (2, 2, 2))
    """
    grids = [energy]
    while len(grids) < len(rounds):
        grids.append(coarser(grids[-1]))
    labels = begin(grids[-1])
    history = [grids[-1].evaluate(labels)]
    for lengths in rounds:
        grid = grids.pop()
        if labels.shape != grid.shape:
            labels = finer(labels, grid.shape)
        solution = repair(grid, labels, [lengths])
        labels = solution.labels
        history.append(solution.energy)
    return Solution(solution.labels, solution.energy, tuple(history))


def coarser(energy: Energy) -> Energy:
    """Restrict an energy to labelings that are constant in blocks of 2 x 2 pixels.

    A block pays what its pixels pay, and two blocks what the edges between their pixels cost: the
    result's energy of any labels is the given one's of the same labels at full size (`finer`). A
    last odd row or column makes blocks of its own.

    Parameters
    ----------
    energy : Energy
        Any; of (y, x) pixels.

    Returns
    -------
    Energy
        Of ((y + 1) // 2, (x + 1) // 2) blocks.

    Raises
    ------
    InputError
        If a block's costs are so large that int32 could overflow.

    Examples
    --------
    >>> from dfdbench.methods.mrf.smoothness import truncated_absolute
    >>> unary = np.array([[[0, 4], [7, 0], [1, 3]]], np.uint16)
    >>> blocks = coarser(Energy(unary, truncated_absolute(2, cap=1)))
    >>> blocks.unary.tolist(), blocks.evaluate([[1, 0]])
    ([[[7, 4], [1, 3]]], 6)
    """
    largest = 4 * energy.largest_cost
    dtype = np.uint16 if largest <= np.iinfo(np.uint16).max else np.int32
    height, width = energy.shape
    unary = np.empty(((height + 1) // 2, (width + 1) // 2, energy.labels), dtype)
    _add_blocks(energy.unary, unary)
    right, down = energy.edge_weights()
    # Of the edges to the right only those that leave a block, two rows of them; and so downward.
    rows, columns = np.arange(0, height, 2), np.arange(0, width, 2)
    between = np.add.reduceat(right[:, 1 : width - 1 : 2], rows, axis=0)
    below = np.add.reduceat(down[1 : height - 1 : 2], columns, axis=1)
    return Energy(unary, energy.smoothness, between, below, energy.offset)


def finer(labels: NDArray[Any], shape: tuple[int, int]) -> NDArray[Any]:
    """Give every pixel of a grid of that shape the label of its block of 2 x 2.

    Examples
    --------
    >>> finer(np.array([[5, 6]]), (1, 3)).tolist()
    [[5, 5, 6]]
    """
    whole = labels.repeat(2, axis=0).repeat(2, axis=1)
    return np.ascontiguousarray(whole[: shape[0], : shape[1]])


@compiled()
def _add_blocks(costs: Array, blocks: Array) -> None:
    height, width, labels = costs.shape
    for y in range(0, height, 2):
        for x in range(0, width, 2):
            block = blocks[y // 2, x // 2]
            block[:] = 0
            for row in range(y, min(y + 2, height)):
                for column in range(x, min(x + 2, width)):
                    pixel = costs[row, column]
                    for label in range(labels):
                        block[label] += pixel[label]
