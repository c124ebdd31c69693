"""The default solver: a few dozen minimum cuts where alpha-expansion takes a thousand.

For a convex smoothness, one cut may decide one bit of all labels. `split` halves each pixel's range
of labels until one label is left, then repairs the labels with moves of many labels at once. If
possible, it does so on blocks of 4 x 4 pixels, and repairs those labels on blocks of 2 x 2 and on
pixels, so that cuts of a sixteenth and a quarter of the size do most of the work.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dfdbench.methods.mrf.energy import COST_LIMIT, Energy, Solution, bands_of
from dfdbench.methods.mrf.maxflow import Array, GridGraph
from dfdbench.methods.mrf.moves import Mover, expansion_offer, jump_offer, snap_offer
from dfdbench.system.compiled import compiled

# Costs are transposed from (y, x, label) to (label, y, x) for this many labels at a time. In one
# label's plane, neighbours are adjacent in memory, and this many costs fill one line of the cache.
BLOCK = 32


def expansion(
    energy: Energy, start: ArrayLike | None = None, max_sweeps: int | None = None
) -> Solution:
    """Minimise an energy by expanding one label after the other until none lowers it.

    Boykov, Veksler and Zabih, "Fast approximate energy minimization via graph cuts", PAMI 2001,
    section 5; the thesis's section 4.1. For a metric, every expansion is the best one. Otherwise,
    as for the truncated quadratic, pairs that are not submodular are truncated: an expansion is
    still only accepted if it lowers the energy, but it may not be the best one.

    Parameters
    ----------
    energy : Energy
        Any smoothness.
    start : (y, x) integer, optional
        The initial labels; by default all 0, as published.
    max_sweeps : int, optional
        Stop after this many sweeps over all labels; by default when no label lowers the energy.

    Returns
    -------
    Solution
        `history` begins with the energy of the start and has an entry per sweep.

    Examples
    --------
    >>> import numpy as np
    >>> from dfdbench.methods.mrf.energy import Energy
    >>> from dfdbench.methods.mrf.energy import potts
    >>> unary = np.array([[[9, 0, 5], [9, 5, 3], [9, 0, 5]]], np.uint16)
    >>> solution = expansion(Energy(unary, potts(3, cap=2)))
    >>> solution.labels.tolist(), solution.energy, solution.history
    ([[1, 1, 1]], 5, (27, 5, 5))
    """
    energy = energy.held()
    labels = np.array(np.zeros(energy.shape) if start is None else start, np.int32)
    mover = Mover(energy, labels)
    history = [mover.value()]
    idle = 0
    while idle < energy.labels and (max_sweeps is None or len(history) <= max_sweeps):
        for label in range(energy.labels):
            if label % BLOCK == 0:
                planes = _planes(energy.unary[:, :, label : label + BLOCK])
            offer = expansion_offer(energy.labels, label)
            idle = 0 if mover.move(offer, planes[label % BLOCK]) else idle + 1
            # All labels have been tried in a row, and none lowers the energy any more.
            if idle == energy.labels:
                break
        history.append(mover.value())
    return _solution(energy, labels, history)


def _solution(energy: Energy, labels: NDArray[np.int32], history: list[int]) -> Solution:
    small = labels.astype(np.uint8 if energy.labels <= 256 else np.uint16)
    return Solution(small, history[-1], tuple(history))


@compiled()
def _planes(costs: Array) -> Array:
    height, width, labels = costs.shape
    planes = np.empty((labels, height, width), costs.dtype)
    for y in range(height):
        for x in range(width):
            for label in range(labels):
                planes[label, y, x] = costs[y, x, label]
    return planes


def repair(energy: Energy, start: ArrayLike, rounds: Iterable[tuple[int, ...]]) -> Solution:
    """Lower an energy by jumps, snaps and lines (`moves`) from given labels.

    Parameters
    ----------
    energy : Energy
        Any smoothness.
    start : (y, x) integer
        The initial labels.
    rounds : iterable of tuples of int
        A positive number d means jumps by d and -d, a negative one means snaps of that period in
        all its phases, and 0 means the best labels along rows, then along columns.

    Returns
    -------
    Solution
        `history` begins with the energy of the start and has an entry per round; it never rises.

    Examples
    --------
    >>> from dfdbench.methods.mrf.energy import truncated_absolute
    >>> unary = np.array([[[9, 4, 0, 4], [3, 3, 2, 1], [9, 4, 0, 4]]], np.uint16)
    >>> solution = repair(Energy(unary, truncated_absolute(4, cap=255)), [[0, 1, 0]], [(2,), (1,)])
    >>> solution.labels.tolist(), solution.history
    ([[2, 2, 2]], (23, 3, 2))
    """
    labels = np.array(start, np.int32)
    mover = Mover(energy, labels)
    history = [mover.value()]
    for lengths in rounds:
        for length in lengths:
            if length == 0:
                mover.move_lines(columns=False)
                mover.move_lines(columns=True)
            for offer in _offers(length, energy.labels):
                mover.move(offer)
        history.append(mover.value())
    return _solution(energy, labels, history)


def _offers(length: int, labels: int) -> list[NDArray[np.int32]]:
    if length < 0:
        # Every other phase first: the labels that one leaves are nearest to what the next offers.
        phases = np.arange(min(-length, labels))
        return [snap_offer(labels, -length, int(p)) for p in (*phases[::2], *phases[1::2])]
    # A jump longer than the range of labels does nothing.
    steps = (length, -length) if 0 < length < labels else ()
    return [jump_offer(labels, step) for step in steps]


def coarse_to_fine(
    energy: Energy, begin: Callable[[Energy], NDArray[Any]], rounds: Sequence[tuple[int, ...]]
) -> Solution:
    """Minimise an energy on smaller and smaller blocks, each starting from the larger one's labels.

    There are few large blocks, and many pixels together are sure where a single one is not.
    Felzenszwalb and Huttenlocher, "Efficient belief propagation for early vision", IJCV 2006,
    pass messages on such blocks.

    Parameters
    ----------
    energy : Energy
        The energy of the pixels.
    begin : callable
        Takes the energy of the largest blocks (`coarser`) and returns initial labels for them.
    rounds : sequence of tuples of int
        A round of repairs (`repair`) for each size of blocks, the largest first and pixels last:
        with three, blocks have sides of 4, 2 and 1.

    Returns
    -------
    Solution
        `history` begins with the energy of the labels from `begin` and has an entry per round.

    Raises
    ------
    InputError
        If a block's costs are so large that int32 could overflow.

    Examples
    --------
    >>> from dfdbench.methods.mrf.energy import truncated_absolute
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

    A block costs what its pixels cost, and a pair of blocks what the edges between their pixels
    cost. So the result's energy for any labels equals the given energy for the same labels at full
    size (`finer`). A last odd row or column makes blocks of its own.

    Parameters
    ----------
    energy : Energy
        Any energy of (y, x) pixels.

    Returns
    -------
    Energy
        The energy of ((y + 1) // 2, (x + 1) // 2) blocks.

    Raises
    ------
    InputError
        If a block's costs are so large that int32 could overflow.

    Examples
    --------
    >>> from dfdbench.methods.mrf.energy import truncated_absolute
    >>> unary = np.array([[[0, 4], [7, 0], [1, 3]]], np.uint16)
    >>> blocks = coarser(Energy(unary, truncated_absolute(2, cap=1)))
    >>> blocks.unary.tolist(), blocks.evaluate([[1, 0]])
    ([[[7, 4], [1, 3]]], 6)
    """
    largest = 4 * energy.largest_cost
    dtype = np.uint16 if largest <= np.iinfo(np.uint16).max else np.int32
    height, width = energy.shape
    unary = np.empty(((height + 1) // 2, (width + 1) // 2, energy.labels), dtype)
    for band, part in bands_of(energy.unary):
        _add_blocks(part, unary[band.start // 2 : (band.stop + 1) // 2])
    right, down = energy.edge_weights()
    # Of the edges to the right, keep only those that leave a block, two rows of them; the same for
    # the edges downward.
    rows, columns = np.arange(0, height, 2), np.arange(0, width, 2)
    between = np.add.reduceat(right[:, 1 : width - 1 : 2], rows, axis=0)
    below = np.add.reduceat(down[1 : height - 1 : 2], columns, axis=1)
    return Energy(unary, energy.smoothness, between, below, energy.offset)


def finer(labels: NDArray[Any], shape: tuple[int, int]) -> NDArray[Any]:
    """Give every pixel of a grid of this shape the label of its 2 x 2 block.

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


Quality = Literal["fast", "default", "high"]

# So few labels need only a few cuts on pixels; two labels need one, which is exact.
FEW_LABELS = 16

# The repairs of each quality, as for `repair`: a round for each grid, the coarsest first.
COARSE_TO_FINE: dict[str, tuple[tuple[int, ...], ...]] = {
    "fast": ((16, 4), (0, 16, 8, 4), (0, 16, 8)),
    "default": ((16, 4, -8), (0, 16, 8, 4, 2, 1), (0, 24, 8, 1, 0)),
    "high": ((16, 4, -8), (0, 16, 8, 4, 2, 1), (0, 24, 8, 1, 0, 8, 4, 2, 1, -16, 0)),
}
# The rounds of repairs on pixels alone.
REPAIRS: dict[str, tuple[tuple[int, ...], ...]] = {
    "fast": (),
    "default": ((16, 4, -8),),
    "high": ((16, 8, 4, 2, 1), (-32,)),
}

# A table counts as nearly convex if it exceeds its convex hull by at most this share of its
# maximum. The published one, rounded down from a concave curve, exceeds it by 1 of 254.
CONVEX_TOLERANCE = 0.01


def split(energy: Energy, quality: Quality = "default") -> Solution:
    """Minimise an energy with a convex smoothness by splitting ranges of labels.

    The splits follow the decomposition of convex priors into binary problems (Darbon and Sigelle,
    JMIV 2006; Kolmogorov and Shioura, Discrete Optimization 2009); the cost of a range is its least
    cost. The repairs are jumps, snaps and lines (`repair`). None raises the energy.

    If the smoothness is nearly linear and there are more than a few labels, all this is first done
    on blocks of 4 x 4 pixels (`coarse_to_fine`).

    If the smoothness is not even nearly convex (Potts, truncated at a small difference), ranges
    have no meaning. The labels then come from `expansion`, whatever the quality.

    Parameters
    ----------
    energy : Energy
        Any smoothness.
    quality : {"fast", "default", "high"}, optional
        How much to repair. On photographs `fast` ends about 0.4 % above the energies of
        `expansion`, `default` about 0.05 % above, and `high` about at them.

    Returns
    -------
    Solution
        `history` begins with the energy of the halved ranges, on blocks or pixels, and has an
        entry per round of repairs.

    Examples
    --------
    >>> import numpy as np
    >>> from dfdbench.methods.mrf.energy import Energy
    >>> from dfdbench.methods.mrf.energy import truncated_absolute
    >>> unary = np.array([[[9, 4, 0, 4], [3, 3, 2, 1], [9, 4, 0, 4]]], np.uint16)
    >>> solution = split(Energy(unary, truncated_absolute(4, cap=255)))
    >>> solution.labels.tolist(), solution.energy
    ([[2, 2, 2]], 2)
    """
    if not _nearly_convex(energy.smoothness):
        return expansion(energy)
    rounds = COARSE_TO_FINE[quality]
    if _goes_coarse_to_fine(energy, len(rounds)):
        return coarse_to_fine(energy, _halve, rounds)
    energy = energy.held()
    return repair(energy, _halve(energy), REPAIRS[quality])


def _nearly_convex(table: NDArray[np.int32]) -> bool:
    values = table.astype(np.float64)
    distances = np.arange(len(values))
    # The lower convex hull, from left to right.
    hull: list[int] = []
    for at in range(len(values)):
        while len(hull) > 1 and (values[hull[-1]] - values[hull[-2]]) * (at - hull[-2]) >= (
            values[at] - values[hull[-2]]
        ) * (hull[-1] - hull[-2]):
            hull.pop()
        hull.append(at)
    above = values - np.interp(distances, hull, values[hull])
    return bool(above.max() <= CONVEX_TOLERANCE * values.max())


def _goes_coarse_to_fine(energy: Energy, grids: int) -> bool:
    # If edges cost nothing, halving is exact and blocks only mislead.
    if energy.labels <= FEW_LABELS or not energy.smoothness.any():
        return False
    # Lines, which repair the ends of surfaces, assume a linear smoothness.
    table = energy.smoothness
    line = int(table[1]) * np.arange(table.size)
    if np.abs(table - line).max() > CONVEX_TOLERANCE * table.max():
        return False
    # A coarser grid's block has the costs of four pixels, and two edges to each neighbour.
    edge = energy.heaviest * int(table.max())
    largest = max(4 ** (grids - 1) * energy.largest_cost, 2 ** (grids - 1) * edge)
    return bool(largest < COST_LIMIT)


def _halve(energy: Energy) -> NDArray[np.int32]:
    """Find labels by deciding one bit of all of them per cut, the highest first."""
    graph = GridGraph(*energy.shape)
    # A range is as good as its best label. Its mean would do for flat costs, but if only one label
    # explains a pixel, the labels beside it must not count against their range.
    costs = [energy.unary]
    while costs[-1].shape[2] > 2:
        costs.append(_pair_minima(costs[-1]))
    labels = np.zeros(energy.shape, np.int32)
    for level in range(len(costs) - 1, -1, -1):
        count = costs[level].shape[2]
        ranges = replace(energy, unary=costs.pop(), smoothness=energy.smoothness[:: 1 << level])
        upper_half = np.minimum(np.arange(count, dtype=np.int32) | 1, count - 1)
        labels *= 2
        Mover(ranges, labels, graph).move(upper_half)
    return labels


def _pair_minima(costs: Array) -> Array:
    pairs = np.minimum(costs[..., :-1:2], costs[..., 1::2])
    return np.concatenate([pairs, costs[..., -1:]], 2) if costs.shape[2] % 2 else pairs
