"""The energy that every solver here minimises: costs of labels, and of differences between them.

    E(l) = offset + sum over pixels p of unary[p, l_p]
                  + sum over 4-neighbours p, q of weight[p, q] * smoothness[|l_p - l_q|]

This is the thesis's Eq. 4.2 with integer terms (Boykov, Veksler and Zabih, PAMI 2001).
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dfdbench.errors import InputError

# Solvers work in int32. A pixel's terminal link sums one difference of its costs and, from each of
# four edges, at most three differences of smoothness costs: less than 13 times this limit.
COST_LIMIT = 2**27


def published(labels: int) -> NDArray[np.int32]:
    """Build the smoothness of the thesis's program: about |d| up to 228 and |d| - 1 above.

    V(d) = int(5.28 * 255 * |1 - exp(0.0015 d)| / (1 + exp(0.0015 d))).

    Parameters
    ----------
    labels : int
        Number of labels; the formula is meant for 256.

    Returns
    -------
    (label,) int32

    Examples
    --------
    >>> published(256)[[0, 1, 228, 229, 255]].tolist()
    [0, 1, 228, 228, 254]
    """
    rise = np.exp(0.0015 * np.arange(labels))
    table: NDArray[np.int32] = (5.28 * 255 * np.abs(1 - rise) / (1 + rise)).astype(np.int32)
    return table


def truncated_absolute(labels: int, cap: int, scale: int = 1) -> NDArray[np.int32]:
    """Build V(d) = scale * min(cap, d), the second row of Table 4.1.

    Examples
    --------
    >>> truncated_absolute(5, cap=3, scale=2).tolist()
    [0, 2, 4, 6, 6]
    """
    return _table(np.arange(labels), cap, scale)


def truncated_quadratic(labels: int, cap: int, scale: int = 1) -> NDArray[np.int32]:
    """Build V(d) = scale * min(cap, d^2), the first row of Table 4.1; it is not a metric.

    Examples
    --------
    >>> truncated_quadratic(5, cap=10).tolist()
    [0, 1, 4, 9, 10]
    """
    return _table(np.arange(labels) ** 2, cap, scale)


def potts(labels: int, cap: int) -> NDArray[np.int32]:
    """Build V(d) = cap for every d except 0, the third row of Table 4.1.

    Examples
    --------
    >>> potts(4, cap=7).tolist()
    [0, 7, 7, 7]
    """
    return truncated_absolute(labels, 1, cap)


def adaptive_potts_weights(
    image: NDArray[Any], threshold: float
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Build the edge weights of the intensity-adaptive Potts model, Table 4.1's last row.

    A label change costs twice as much where the intensity changes by at most the threshold.

    Parameters
    ----------
    image : (y, x) real
        Intensities.
    threshold : float
        Largest intensity difference that counts as the same surface (Table 4.1's beta).

    Returns
    -------
    weights_horizontal : (y, x - 1) int32
    weights_vertical : (y - 1, x) int32

    Examples
    --------
    >>> import numpy as np
    >>> right, down = adaptive_potts_weights(np.array([[10, 12, 90]], np.uint8), threshold=5)
    >>> right.tolist(), down.shape
    ([[2, 1]], (0, 3))
    """
    values = np.asarray(image, np.float64)
    right, down = (
        np.where(np.abs(np.diff(values, axis=axis)) <= threshold, 2, 1).astype(np.int32)
        for axis in (1, 0)
    )
    return right, down


def _table(costs: NDArray[Any], cap: int, scale: int) -> NDArray[np.int32]:
    for name, value in (("cap", cap), ("scale", scale)):
        if not 0 < value < COST_LIMIT:
            raise InputError(f"{name}: expected 1 to {COST_LIMIT - 1}, got {value}")
    table = scale * np.minimum(costs.astype(np.int64), cap)
    if table.max() >= COST_LIMIT:
        raise InputError(f"smoothness: expected below {COST_LIMIT}, got {table.max()}")
    return table.astype(np.int32)


#: Costs that take more memory are computed in `Parts` if a method can, which takes longer.
MOST_HELD = 400_000_000


@dataclass(frozen=True, eq=False)
class Parts:
    """Costs that are computed again whenever they are read, and never held as a whole.

    Parameters
    ----------
    of : callable
        ``of(rows=..., columns=...)`` returns the costs of a part of the grid, (y, x, label) uint16,
        and the sum of what was subtracted from them.
    shape : tuple of int
        The shape of all costs, (y, x, label).
    most : int
        The upper limit of all costs.
    most_bytes : int
        The most memory for a band of rows or columns, if it has more than two of them.

    Examples
    --------
    >>> costs = np.array([[[0, 4], [7, 0]], [[1, 3], [0, 2]], [[5, 0], [0, 1]]], np.uint16)
    >>> parts = Parts(lambda rows, columns: (costs[rows, columns], 0), costs.shape, 7, 1)
    >>> [(rows, part.shape) for rows, part in bands_of(parts)]
    [(slice(0, 2, None), (2, 2, 2)), (slice(2, 3, None), (1, 2, 2))]
    """

    of: Callable[..., tuple[NDArray[np.uint16], int]]
    shape: tuple[int, ...]
    most: int
    most_bytes: int = 32_000_000
    dtype = np.dtype(np.uint16)

    def max(self) -> int:
        """Return the upper limit of all costs."""
        return self.most

    def offset(self) -> int:
        """Return the sum of what was subtracted from all costs."""
        return sum(offset for _, (_, offset) in self._bands(columns=False))

    def bands(self, columns: bool = False) -> Iterator[tuple[slice, NDArray[np.uint16]]]:
        """Yield bands of an even number of rows or columns (except the last), and their costs."""
        for band, (costs, _) in self._bands(columns):
            yield band, costs

    def _bands(self, columns: bool) -> Iterator[tuple[slice, tuple[NDArray[np.uint16], int]]]:
        count, others = self.shape[columns], self.shape[not columns]
        lines = max(self.most_bytes // (2 * others * self.shape[2]) // 2, 1) * 2
        whole = slice(None)
        for first in range(0, count, lines):
            band = slice(first, min(first + lines, count))
            rows, across = (whole, band) if columns else (band, whole)
            yield band, self.of(rows=rows, columns=across)


def bands_of(
    unary: NDArray[Any] | Parts, columns: bool = False
) -> Iterator[tuple[slice, NDArray[Any]]]:
    """Yield bands of rows or columns and their costs; an array is one band."""
    if isinstance(unary, Parts):
        yield from unary.bands(columns)
    else:
        yield slice(0, unary.shape[columns]), unary


def costs_at(unary: NDArray[Any] | Parts, labels: NDArray[Any]) -> NDArray[Any]:
    """Return the cost of each pixel's label, (y, x)."""
    costs = np.empty(labels.shape, unary.dtype)
    for rows, part in bands_of(unary):
        costs[rows] = np.take_along_axis(part, labels[rows, :, np.newaxis], 2)[..., 0]
    return costs


@dataclass(frozen=True, eq=False)
class Energy:
    """An energy over labelings of a grid, which the solvers minimise.

    Parameters
    ----------
    unary : (y, x, label) uint16 or int32, or Parts
        Non-negative cost of each label at each pixel, relative to the pixel's least.
    smoothness : (label,) int32
        ``smoothness[d]`` is the cost of two neighbours whose labels differ by d; 0 for d = 0.
    weights_horizontal : (y, x - 1) int32, optional
        Non-negative factor of the edge between (y, x) and (y, x + 1); by default 1.
    weights_vertical : (y - 1, x) int32, optional
        The same between (y, x) and (y + 1, x).
    offset : int, optional
        Constant added to the energy: the sum of what was subtracted from the unary costs.

    Raises
    ------
    InputError
        If costs are so large that int32 could overflow.

    Examples
    --------
    >>> import numpy as np
    >>> from dfdbench.methods.mrf.energy import truncated_absolute
    >>> unary = np.array([[[0, 4, 9], [7, 0, 3]]], np.uint16)
    >>> energy = Energy(unary, truncated_absolute(3, cap=255))
    >>> energy.evaluate([[0, 1]])
    1
    """

    unary: Any
    smoothness: NDArray[np.int32]
    weights_horizontal: NDArray[np.int32] | None = None
    weights_vertical: NDArray[np.int32] | None = None
    offset: int = 0

    def __post_init__(self) -> None:
        """Raise if sums of costs could overflow int32."""
        for name, value in (
            ("unary costs", self.largest_cost),
            ("smoothness times weight", self.heaviest * int(self.smoothness.max())),
        ):
            if value >= COST_LIMIT:
                raise InputError(f"{name}: expected below {COST_LIMIT} (int32 sums), got {value}")

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the grid in pixels."""
        return self.unary.shape[0], self.unary.shape[1]

    @property
    def labels(self) -> int:
        """Number of labels."""
        return int(self.unary.shape[2])

    @cached_property
    def largest_cost(self) -> int:
        """The largest cost of any label at any pixel."""
        return int(self.unary.max())

    @property
    def heaviest(self) -> int:
        """The largest weight of an edge."""
        weights = (self.weights_horizontal, self.weights_vertical)
        return max(1 if weight is None else int(weight.max(initial=1)) for weight in weights)

    @cached_property
    def is_metric(self) -> bool:
        """Whether V(0) = 0 < V(d) and V(a + b) <= V(a) + V(b), V(|a - b|) <= V(a) + V(b).

        Expansion moves are then exact (Boykov, Veksler and Zabih, section 2).
        """
        table = self.smoothness.astype(np.int64)
        if table[1:].min() <= 0:
            return False
        index = np.arange(self.labels)
        for by in range(1, self.labels):
            # The three sides of a triangle of labels differ by index, by and |index - by|.
            rest = table[np.abs(index - by)]
            if np.any(table > rest + table[by]) or np.any(rest > table + table[by]):
                return False
        return True

    def held(self) -> "Energy":
        """Return the same energy with all costs in memory."""
        if not isinstance(self.unary, Parts):
            return self
        return replace(self, unary=self.unary.of(rows=slice(None), columns=slice(None))[0])

    def edge_weights(self) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """Return the weights of all edges to the right and downward, each (y, x) int32.

        Edges that would leave the grid have weight 0; edges without a given weight have 1.
        """
        right = np.zeros(self.shape, np.int32)
        down = np.zeros(self.shape, np.int32)
        right[:, :-1] = 1 if self.weights_horizontal is None else self.weights_horizontal
        down[:-1] = 1 if self.weights_vertical is None else self.weights_vertical
        return right, down

    def evaluate(self, labels: ArrayLike, costs: NDArray[Any] | None = None) -> int:
        """Return the exact energy of a labeling.

        Parameters
        ----------
        labels : (y, x) integer
            Label of every pixel.
        costs : (y, x) integer, optional
            The cost of each pixel's label, if the caller has it.
        """
        index = np.asarray(labels, np.int32)
        own = costs_at(self.unary, index) if costs is None else costs
        total = int(own.sum(dtype=np.int64))
        for axis, weights in ((1, self.weights_horizontal), (0, self.weights_vertical)):
            costs = self.smoothness[np.abs(np.diff(index, axis=axis))].astype(np.int64)
            total += int((costs if weights is None else costs * weights).sum())
        return total + self.offset


@dataclass(frozen=True, eq=False)
class Solution:
    """What a solver found.

    Attributes
    ----------
    labels : (y, x) uint8 or uint16
        Label of every pixel; uint8 for up to 256 labels.
    energy : int
        Energy of the labels, offset included.
    history : tuple of int
        Energy after each sweep over the moves, never rising; the last is `energy`.
    """

    labels: NDArray[Any]
    energy: int
    history: tuple[int, ...]
