"""Binary moves: which of two labels each pixel takes is one minimum cut (`maxflow`).

A move offers every pixel another label, the same one to all pixels of one label: expansion offers
label a to all, a jump offers l + d, a snap the nearest of some labels. Offers that keep the order
of labels are submodular where the smoothness is linear, since |x - y| never prefers a mixed
choice then; expansions are for every metric, jumps for every convex table. Where a pair's costs
are not submodular, a mixed choice is made to cost more than it does (Rother, Kumar, Kolmogorov
and Blake, "Digital tapestry", CVPR 2005): the cut still never picks what raises the energy.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from dfdbench.methods.mrf.energy import Energy
from dfdbench.methods.mrf.maxflow import DOWN, RIGHT, SINK, GridGraph

__all__ = ["Mover", "expansion_offer", "jump_offer", "snap_offer"]

Array = NDArray[Any]


def expansion_offer(labels: int, target: int) -> NDArray[np.int32]:
    """Offer one label to all (Boykov, Veksler and Zabih, PAMI 2001).

    Examples
    --------
    >>> expansion_offer(4, 2).tolist()
    [2, 2, 2, 2]
    """
    return np.full(labels, target, np.int32)


def jump_offer(labels: int, step: int) -> NDArray[np.int32]:
    """Offer each label l the label l + step, or the last one before the end (Veksler's jumps).

    Examples
    --------
    >>> jump_offer(4, -2).tolist()
    [0, 0, 0, 1]
    """
    return np.clip(np.arange(labels) + step, 0, labels - 1).astype(np.int32)


def snap_offer(labels: int, period: int, phase: int) -> NDArray[np.int32]:
    """Offer each label the nearest of phase, phase + period, ...: many expansions in one cut.

    Examples
    --------
    >>> snap_offer(8, period=4, phase=1).tolist()
    [1, 1, 1, 5, 5, 5, 5, 5]
    """
    nearest = (np.arange(labels) - phase + period // 2) // period
    last = (labels - 1 - phase) // period
    return (phase + period * np.clip(nearest, 0, last)).astype(np.int32)


class Mover:
    """Applies moves to labelings of one energy, with the cut's memory reserved once.

    Parameters
    ----------
    energy : Energy
        What to lower.
    graph : GridGraph, optional
        Memory of the same height and width to use again.
    """

    def __init__(self, energy: Energy, graph: GridGraph | None = None) -> None:
        self.graph = GridGraph(*energy.shape) if graph is None else graph
        self._unary = energy.unary
        self._table = energy.smoothness
        self._right, self._down = energy.edge_weights()

    def move(self, labels: NDArray[np.int32], offer: NDArray[np.int32]) -> int:
        """Let the best set of pixels go from their label l to ``offer[l]``.

        Parameters
        ----------
        labels : (y, x) int32
            Changed in place.
        offer : (label,) int32
            What each label is offered; itself where it is to stay.

        Returns
        -------
        int
            Change of the energy; 0 where nothing moved. Where terms were not submodular, the
            true change is this or lower.
        """
        graph = self.graph
        change = int(
            _propose(
                self._unary,
                self._table,
                self._right,
                self._down,
                labels,
                offer,
                graph.terminal,
                graph.capacity,
            )
        )
        change += graph.cut()
        if change < 0:
            _apply(labels, offer, graph.tree)
        return change


@numba.njit(cache=True, nogil=True)
def _apply(labels: Array, offer: Array, tree: Array) -> None:
    height, width = labels.shape
    for y in range(height):
        for x in range(width):
            if tree[(y + 1) * (width + 1) + 1 + x] == SINK:
                labels[y, x] = offer[labels[y, x]]


@numba.njit(cache=True, nogil=True)
def _propose(
    unary: Array,
    table: Array,
    right: Array,
    down: Array,
    labels: Array,
    offer: Array,
    terminal: Array,
    capacity: Array,
) -> int:
    height, width, _ = unary.shape
    pitch = width + 1
    terminal[:] = 0
    for y in range(height):
        for x in range(width):
            node = (y + 1) * pitch + 1 + x
            label = labels[y, x]
            new = offer[label]
            if new != label:
                terminal[node] += np.int32(unary[y, x, new]) - np.int32(unary[y, x, label])
            for direction in (RIGHT, DOWN):
                if direction == RIGHT:
                    if x + 1 == width:
                        continue
                    weight, other, beside = right[y, x], node + 1, labels[y, x + 1]
                else:
                    if y + 1 == height:
                        continue
                    weight, other, beside = down[y, x], node + pitch, labels[y + 1, x]
                beyond = offer[beside]
                # Costs of the edge, less its cost if neither pixel moves.
                same = table[abs(label - beside)]
                both = weight * (table[abs(new - beyond)] - same)
                first = weight * (table[abs(new - beside)] - same) - both
                second = weight * (table[abs(label - beyond)] - same)
                # `both` is paid by this pixel's own link. What is left of the edge must not be
                # negative in sum, which raising one side ensures, nor in either direction, for
                # which one pixel's link lends to the other's.
                second = max(second, -first)
                lent = min(second, 0) - min(first, 0)
                terminal[node] += both - lent
                terminal[other] += lent
                capacity[4 * node + direction] = second - lent
                capacity[4 * other + (direction ^ 1)] = first + lent
    # The change of a cut is its value less the value of the cut where nothing moves.
    stay = 0
    for node in range(terminal.size):
        if terminal[node] < 0:
            stay += terminal[node]
    return stay
