"""Repairs: moves of many labels at once, from a labeling that is nearly right."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dfdbench.methods.mrf.energy import Energy, Solution, label_dtype, starting_labels
from dfdbench.methods.mrf.maxflow import GridGraph
from dfdbench.methods.mrf.moves import Mover, jump_offer, snap_offer

__all__ = ["repair"]


def repair(
    energy: Energy,
    start: ArrayLike,
    rounds: Iterable[tuple[int, ...]],
    graph: GridGraph | None = None,
) -> Solution:
    """Lower an energy by jumps, snaps and lines (`moves`) from given labels.

    Parameters
    ----------
    energy : Energy
        Any smoothness.
    start : (y, x) integer
        Labels to begin with.
    rounds : iterable of tuples of int
        A positive number d stands for jumps by d and -d, a negative one for the snaps of that
        period in all its phases, 0 for the best labels along rows, then along columns.
    graph : GridGraph, optional
        Memory of the energy's height and width to use again.

    Returns
    -------
    Solution
        `history` begins with the energy of the start and has an entry per round; it never rises.

    Raises
    ------
    InputError
        If the start does not fit the energy.

    Examples
    --------
    >>> from dfdbench.methods.mrf.smoothness import truncated_absolute
    >>> unary = np.array([[[9, 4, 0, 4], [3, 3, 2, 1], [9, 4, 0, 4]]], np.uint16)
    >>> solution = repair(Energy(unary, truncated_absolute(4, cap=255)), [[0, 1, 0]], [(2,), (1,)])
    >>> solution.labels.tolist(), solution.history
    ([[2, 2, 2]], (23, 3, 2))
    """
    labels = starting_labels(energy, start)
    mover = Mover(energy, labels, graph)
    history = [mover.value()]
    for lengths in rounds:
        for length in lengths:
            if length == 0:
                mover.move_lines(columns=False)
                mover.move_lines(columns=True)
            for offer in _offers(length, energy.labels):
                mover.move(offer)
        history.append(mover.value())
    return Solution(labels.astype(label_dtype(energy.labels)), history[-1], tuple(history))


def _offers(length: int, labels: int) -> list[NDArray[np.int32]]:
    if length < 0:
        # Every other phase first: what one leaves is nearest to what the next offers.
        phases = np.arange(min(-length, labels))
        return [snap_offer(labels, -length, int(p)) for p in (*phases[::2], *phases[1::2])]
    # Nothing is a jump's length away from itself in a range that is shorter.
    steps = (length, -length) if 0 < length < labels else ()
    return [jump_offer(labels, step) for step in steps]
