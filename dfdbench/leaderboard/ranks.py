"""Who stands where: by one score, ties by another, equal ones on one rank."""

from __future__ import annotations

import math
from collections.abc import Sequence


def order_of(first: float | None, second: float | None) -> tuple[float, float]:
    """Return what sorts by two scores, of which smaller is better; None stands last."""
    return (math.inf if first is None else first, math.inf if second is None else second)


def tied_ranks(orders: Sequence[tuple[float, float]]) -> list[int]:
    """Return the ranks of sorted orders, from 1; those that tie share the first one's.

    Examples
    --------
    >>> tied_ranks([(0.1, 0.2), (0.3, 0.4), (0.3, 0.4), (0.5, 0.1)])
    [1, 2, 2, 4]
    """
    return [orders.index(order) + 1 for order in orders]
