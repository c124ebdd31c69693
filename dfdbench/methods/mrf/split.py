"""The default solver: a few dozen minimum cuts where alpha-expansion takes a thousand.

For a convex smoothness a cut may decide a bit of all labels at once. `split` halves each pixel's
range of labels until one label is left, then repairs the labels with moves of many labels at once.
Where it can, it does so on blocks of 4 x 4 pixels, and repairs those labels on blocks of 2 x 2 and
on pixels: cuts of a sixteenth and a quarter of the size do most of the work.
"""

from __future__ import annotations

from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from dfdbench.errors import InputError
from dfdbench.methods.mrf.blocks import coarse_to_fine
from dfdbench.methods.mrf.energy import Energy, Solution
from dfdbench.methods.mrf.expansion import expansion
from dfdbench.methods.mrf.maxflow import GridGraph
from dfdbench.methods.mrf.moves import Mover
from dfdbench.methods.mrf.repair import repair
from dfdbench.methods.mrf.smoothness import COST_LIMIT
from dfdbench.system.compiled import compiled

__all__ = ["Quality", "split"]

Quality = Literal["fast", "default", "high"]

# So few labels take few cuts on pixels alone; two of them take one, which is exact.
FEW_LABELS = 16

# The repairs of each quality, as `repair` takes them: a round for each grid, the coarsest first.
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

# A table counts as nearly convex if it lies at most this part of its maximum above its convex
# hull: the published one, rounded down from a concave curve, lies 1 of 254 above.
CONVEX_TOLERANCE = 0.01

Array = NDArray[Any]


def split(energy: Energy, quality: Quality = "default") -> Solution:
    """Minimise an energy with a convex smoothness by splitting ranges of labels.

    The splits follow the decomposition of convex priors into binary problems (Darbon and Sigelle,
    JMIV 2006; Kolmogorov and Shioura, Discrete Optimization 2009), with the least cost of a range
    for its cost. The repairs are jumps, snaps and lines (`repair`). None raises the energy.

    If the smoothness is nearly linear and there are more than a few labels, all that is done to
    blocks of 4 x 4 pixels first (`coarse_to_fine`).

    A smoothness that is not even nearly convex (Potts, truncated at a small difference) gives
    ranges no meaning; the labels then come from `expansion`, whatever the quality.

    Parameters
    ----------
    energy : Energy
        Any smoothness.
    quality : {"fast", "default", "high"}, optional
        How much repair: on photographs `fast` ends about 0.4 % above the energies of `expansion`,
        `default` 0.05 %, and `high` at them.

    Returns
    -------
    Solution
        `history` begins with the energy of the halved ranges, on blocks or pixels, and has an
        entry per round of repairs.

    Raises
    ------
    InputError
        If the quality is none of those.

    Examples
    --------
    >>> import numpy as np
    >>> from dfdbench.methods.mrf.energy import Energy
    >>> from dfdbench.methods.mrf.smoothness import truncated_absolute
    >>> unary = np.array([[[9, 4, 0, 4], [3, 3, 2, 1], [9, 4, 0, 4]]], np.uint16)
    >>> solution = split(Energy(unary, truncated_absolute(4, cap=255)))
    >>> solution.labels.tolist(), solution.energy
    ([[2, 2, 2]], 2)
    """
    if quality not in get_args(Quality):
        raise InputError(f"quality: expected one of {get_args(Quality)}, got {quality!r}")
    if not _nearly_convex(energy.smoothness):
        return expansion(energy)
    rounds = COARSE_TO_FINE[quality]
    if _goes_coarse_to_fine(energy, len(rounds)):
        return coarse_to_fine(energy, _halve, rounds)
    graph = GridGraph(*energy.shape)
    return repair(energy, _halve(energy, graph), REPAIRS[quality], graph)


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
    # Where neighbours cost each other nothing, halving is exact, and blocks only mislead.
    if energy.labels <= FEW_LABELS or not energy.smoothness.any():
        return False
    # Lines, which mend where surfaces end, take the smoothness for linear.
    table = energy.smoothness
    line = int(table[1]) * np.arange(table.size)
    if np.abs(table - line).max() > CONVEX_TOLERANCE * table.max():
        return False
    # A coarser grid's blocks have four pixels' costs, and two edges between each other.
    weights = (energy.weights_horizontal, energy.weights_vertical)
    heaviest = max(1 if weight is None else int(weight.max(initial=1)) for weight in weights)
    largest = max(
        4 ** (grids - 1) * energy.largest_cost, 2 ** (grids - 1) * heaviest * int(table.max())
    )
    return bool(largest < COST_LIMIT)


def _halve(energy: Energy, graph: GridGraph | None = None) -> NDArray[np.int32]:
    """Find labels by deciding one bit of all of them per cut, the highest first."""
    graph = GridGraph(*energy.shape) if graph is None else graph
    # A range is as good as its best label. Its mean would do for blunt costs, but where one label
    # alone explains a pixel, the labels beside it must not speak against their range.
    costs = [energy.unary]
    while costs[-1].shape[2] > 2:
        costs.append(_pair_minima(costs[-1]))
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
        Mover(ranges, labels, graph).move(upper_half)
    return labels


@compiled()
def _pair_minima(costs: Array) -> Array:
    height, width, count = costs.shape
    minima = np.empty((height, width, (count + 1) // 2), costs.dtype)
    for y in range(height):
        for x in range(width):
            row, pairs = costs[y, x], minima[y, x]
            for label in range(count // 2):
                pairs[label] = min(row[2 * label], row[2 * label + 1])
            if count % 2:
                pairs[count // 2] = row[count - 1]
    return minima
