"""Alpha-expansion, the published algorithm: slow, and what every faster solver is measured by."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dfdbench.methods.mrf.energy import Energy, Solution, label_dtype, starting_labels
from dfdbench.methods.mrf.moves import Mover, expansion_offer
from dfdbench.system.compiled import compiled

__all__ = ["expansion"]

# Costs are turned from pixels of labels to labels of pixels for so many labels at a time: in one
# label's plane, neighbours are neighbours in memory, and this many come in one line of the cache.
BLOCK = 32

Array = NDArray[Any]


def expansion(
    energy: Energy, start: ArrayLike | None = None, max_sweeps: int | None = None
) -> Solution:
    """Minimise an energy by expanding label after label until none lowers it.

    Boykov, Veksler and Zabih, "Fast approximate energy minimization via graph cuts", PAMI 2001,
    section 5; the thesis's section 4.1. For a metric every expansion is the best one. Else, such
    as for the truncated quadratic, pairs that are not submodular are truncated: an expansion is
    then still never accepted unless it lowers the energy, but may not be the best one.

    Parameters
    ----------
    energy : Energy
        Any smoothness.
    start : (y, x) integer, optional
        Labels to begin with; all 0 where not given, as published.
    max_sweeps : int, optional
        Stop after so many sweeps over all labels; by default when no label lowers the energy.

    Returns
    -------
    Solution
        `history` begins with the energy of the start and has an entry per sweep.

    Raises
    ------
    InputError
        If the start does not fit the energy.

    Examples
    --------
    >>> import numpy as np
    >>> from dfdbench.methods.mrf.energy import Energy
    >>> from dfdbench.methods.mrf.smoothness import potts
    >>> unary = np.array([[[9, 0, 5], [9, 5, 3], [9, 0, 5]]], np.uint16)
    >>> solution = expansion(Energy(unary, potts(3, cap=2)))
    >>> solution.labels.tolist(), solution.energy, solution.history
    ([[1, 1, 1]], 5, (27, 5, 5))
    """
    labels = starting_labels(energy, start)
    mover = Mover(energy, labels)
    history = [mover.value()]
    idle = 0
    while idle < energy.labels and (max_sweeps is None or len(history) <= max_sweeps):
        for label in range(energy.labels):
            if label % BLOCK == 0:
                planes = _planes(energy.unary[:, :, label : label + BLOCK])
            offer = expansion_offer(energy.labels, label)
            idle = 0 if mover.move(offer, planes[label % BLOCK]) else idle + 1
            # As many labels in a row as there are: none can lower the energy any more.
            if idle == energy.labels:
                break
        history.append(mover.value())
    return Solution(labels.astype(label_dtype(energy.labels)), history[-1], tuple(history))


@compiled()
def _planes(costs: Array) -> Array:
    height, width, labels = costs.shape
    planes = np.empty((labels, height, width), costs.dtype)
    for y in range(height):
        for x in range(width):
            for label in range(labels):
                planes[label, y, x] = costs[y, x, label]
    return planes
