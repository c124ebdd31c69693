"""The default solver: a few dozen minimum cuts where alpha-expansion takes a thousand.

For a convex smoothness a cut may decide a bit of all labels at once. `split` first halves each
pixel's range of labels until one label is left, then repairs the labels with cuts that move many
labels a little at once.
"""

from __future__ import annotations

from typing import Any, Literal, get_args

import numba
import numpy as np
from numpy.typing import NDArray

from dfdbench.errors import InputError, Problem
from dfdbench.mrf.energy import Energy, Solution, label_dtype
from dfdbench.mrf.expansion import expansion
from dfdbench.mrf.maxflow import GridGraph
from dfdbench.mrf.moves import Mover, jump_offer, snap_offer

__all__ = ["Quality", "split"]

Quality = Literal["fast", "default", "high", "best"]

# The repairs of each quality: a positive number d stands for jumps by d and -d, a negative one
# for the snaps of that period in all its phases. "best" repeats the last until nothing changes.
REPAIRS: dict[str, tuple[tuple[int, ...], ...]] = {
    "fast": (),
    "default": ((16, 4, -8),),
    "high": ((16, 8, 4, 2, 1), (-16,)),
    "best": ((16, 8, 4, 2, 1), (-16, 1)),
}

# A table counts as nearly convex if it lies at most this part of its maximum above its convex
# hull: the published one, rounded down from a concave curve, lies 1 of 254 above.
CONVEX_TOLERANCE = 0.01

Array = NDArray[Any]


def split(energy: Energy, quality: Quality = "default") -> Solution:
    """Minimise an energy with a convex smoothness by splitting ranges of labels.

    The splits follow the decomposition of convex priors into binary problems (Darbon and Sigelle,
    JMIV 2006; Kolmogorov and Shioura, Discrete Optimization 2009), with the mean cost of a range
    for its cost. The repairs are jump moves and snaps (`moves`). No repair raises the energy.

    A smoothness that is not even nearly convex (Potts, truncated at a small difference) gives
    ranges no meaning; the labels then come from `expansion`, whatever the quality.

    Parameters
    ----------
    energy : Energy
        Any smoothness.
    quality : {"fast", "default", "high", "best"}, optional
        How much repair: none, enough for about 0.02 % over the least energy known on a
        photograph, more, or until nothing changes.

    Returns
    -------
    Solution
        `history` begins with the energy of the splits and has an entry per round of repairs.

    Raises
    ------
    InputError
        If the quality is none of those.

    Examples
    --------
    >>> import numpy as np
    >>> from dfdbench.mrf.energy import Energy, truncated_absolute
    >>> unary = np.array([[[9, 4, 0, 4], [3, 3, 2, 1], [9, 4, 0, 4]]], np.uint16)
    >>> solution = split(Energy(unary, truncated_absolute(4, cap=255)))
    >>> solution.labels.tolist(), solution.energy
    ([[2, 2, 2]], 2)
    """
    if quality not in get_args(Quality):
        raise InputError(Problem(f"quality: expected one of {get_args(Quality)}, got {quality!r}"))
    if not _nearly_convex(energy.smoothness):
        return expansion(energy)
    graph = GridGraph(*energy.shape)
    labels = _halve(energy, graph)
    mover = Mover(energy, graph)
    history = [energy.evaluate(labels)]
    for repairs in REPAIRS[quality]:
        changed = True
        while changed:
            changes = [mover.move(labels, offer) for offer in _offers(repairs, energy.labels)]
            changed = quality == "best" and any(changes)
            history.append(energy.evaluate(labels))
    return Solution(labels.astype(label_dtype(energy.labels)), history[-1], tuple(history))


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


def _offers(repairs: tuple[int, ...], labels: int) -> list[NDArray[np.int32]]:
    offers = []
    for repair in repairs:
        if repair > 0:
            # Nothing is a jump's length away from itself in a range that is shorter.
            if repair < labels:
                offers += [jump_offer(labels, repair), jump_offer(labels, -repair)]
        else:
            # Every other phase first: what one leaves is nearest to what the next offers.
            phases = np.arange(min(-repair, labels))
            offers += [snap_offer(labels, -repair, int(p)) for p in (*phases[::2], *phases[1::2])]
    return offers


def _halve(energy: Energy, graph: GridGraph) -> NDArray[np.int32]:
    """Find labels by deciding one bit of all of them per cut, the highest first."""
    right, down = energy.edge_weights()
    highest = int(energy.smoothness.max()) * int(max(right.max(), down.max(), 1))
    # What is further above the least than four neighbours can pay for is never taken. Counting
    # it as no more keeps one bad label from speaking for all of its range.
    costs = [energy.unary]
    while costs[-1].shape[2] > 2:
        costs.append(_pair_means(costs[-1], 4 * highest + 1))
    labels = np.zeros(energy.shape, np.int32)
    for level in range(len(costs) - 1, -1, -1):
        count = costs[level].shape[2]
        ranges = Energy(
            costs.pop(),
            energy.smoothness[:: 1 << level],
            energy.weights_horizontal,
            energy.weights_vertical,
        )
        upper_half = np.minimum(np.arange(count, dtype=np.int32) | 1, count - 1)
        labels *= 2
        Mover(ranges, graph).move(labels, upper_half)
    return labels


@numba.njit(cache=True, nogil=True)
def _pair_means(costs: Array, limit: int) -> Array:
    height, width, count = costs.shape
    means = np.empty((height, width, (count + 1) // 2), costs.dtype)
    most = np.int32(limit)
    for y in range(height):
        for x in range(width):
            row, pairs = costs[y, x], means[y, x]
            for label in range(count // 2):
                low = min(np.int32(row[2 * label]), most)
                high = min(np.int32(row[2 * label + 1]), most)
                pairs[label] = (low + high) >> 1
            if count % 2:
                pairs[count // 2] = min(np.int32(row[count - 1]), most)
    return means
