"""Binary moves: one minimum cut (`maxflow`) chooses which of two labels each pixel takes.

A move offers every pixel another label, the same one to all pixels of one label: an expansion
offers label a to all, a jump offers l + d, a snap the nearest of some labels. Offers that keep the
order of labels are submodular if the smoothness is linear, since |x - y| then never prefers a mixed
choice. Expansions are submodular for every metric, jumps for every convex table. If a pair's costs
are not submodular, we raise the cost of a mixed choice (Rother, Kumar, Kolmogorov and Blake,
"Digital tapestry", CVPR 2005), so the cut still never raises the energy.

If the smoothness is a slope up to a cap, lines may move too, with more than two labels to choose
from (`lines`).
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfdbench.methods.mrf.energy import Energy, bands_of, costs_at
from dfdbench.methods.mrf.lines import Array, best_lines
from dfdbench.methods.mrf.maxflow import DOWN, FREE, RIGHT, SINK, SOURCE, GridGraph
from dfdbench.system.compiled import compiled

#: The table of the smoothness, and the weights of edges to the right and down.
Edges = tuple[Array, Array, Array]
#: Labels and their costs, the label offered to each, and the cost of that at each pixel.
State = tuple[Array, Array, Array, Array]


def expansion_offer(labels: int, target: int) -> NDArray[np.int32]:
    """Offer one label to all (Boykov, Veksler and Zabih, PAMI 2001).

    Examples
    --------
    >>> expansion_offer(4, 2).tolist()
    [2, 2, 2, 2]
    """
    return np.full(labels, target, np.int32)


def jump_offer(labels: int, step: int) -> NDArray[np.int32]:
    """Offer each label l the label l + step, limited to 0 and the last label (Veksler's jumps).

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
    """Apply moves to a labeling of one energy, allocating the cut's memory only once.

    Parameters
    ----------
    energy : Energy
        The energy to lower.
    labels : (y, x) int32
        The initial labels; every move changes them in place, and nothing else may.
    graph : GridGraph, optional
        Memory of the same height and width to reuse.
    """

    def __init__(
        self, energy: Energy, labels: NDArray[np.int32], graph: GridGraph | None = None
    ) -> None:
        self.graph = GridGraph(*energy.shape) if graph is None else graph
        self._unary = energy.unary
        # Numba would compile everything again for an array with strides.
        self._table = np.ascontiguousarray(energy.smoothness)
        self._gains = _largest_gains(self._table)
        self._energy = energy
        self._right, self._down = energy.edge_weights()
        self._weights = self._right + self._down
        self._weights[:, 1:] += self._right[:, :-1]
        self._weights[1:] += self._down[:-1]
        self._slope = max(int(self._table[1]), 1)
        self._cap = max(int(self._table.max()) // self._slope, 1)
        self._favoured: NDArray[np.int32] | None = None
        self._labels = labels
        self._costs = costs_at(energy.unary, labels)
        self._offered = np.empty_like(self._costs)

    def move(self, offer: NDArray[np.int32], costs: NDArray[Any] | None = None) -> int:
        """Move the best set of pixels from their label l to ``offer[l]``.

        Parameters
        ----------
        offer : (label,) int32
            The label offered to each label; itself if it is to stay.
        costs : (y, x) of the energy's type, optional
            The cost of each pixel's offered label, if the caller has it.

        Returns
        -------
        int
            Change of the energy; 0 if nothing moved. If terms were not submodular, the true change
            is this or lower.
        """
        graph, labels = self.graph, self._labels
        if costs is None:
            costs = self._offered
            for rows, part in bands_of(self._unary):
                _costs_of(part, labels[rows], offer, costs[rows])
        graph.clear()
        state, edges = (labels, self._costs, offer, costs), (self._table, self._right, self._down)
        graph.active = _choose(state, self._gains, self._weights, graph.nodes, graph.tree)
        # A pixel beside some that stay has less to gain, so drop it if it gains nothing. This pays
        # only if fewer than half take part, and needs submodular terms: others would then be cut
        # differently.
        few = 2 * graph.active.size < labels.size
        if few and bool((offer == offer[0]).all()) and self._energy.is_metric:
            graph.active = _drop(edges, self._gains, state, graph.active, graph.tree)
        links = graph.terminal, graph.capacity
        change = int(_propose(edges, state, graph.active, links, graph.tree)) + graph.cut()
        if change < 0:
            _apply(state, graph.active, graph.tree)
        return change

    def move_lines(self, columns: bool) -> int:
        """Give every row or column its best labels among a few (`lines`).

        Each line is solved as if the smoothness were ``slope * min(d, cap)``. If it is not, and the
        energy would rise, nothing moves.

        Returns
        -------
        int
            Change of the energy.
        """
        favoured = np.empty_like(self._labels) if self._favoured is None else self._favoured
        labels, costs = self._labels.copy(), self._costs.copy()
        edges = (self._down, self._right) if columns else (self._right, self._down)
        law = self._slope, self._cap
        for lines, part in bands_of(self._unary, columns):
            if self._favoured is None:
                favoured[(slice(None), lines) if columns else lines] = part.argmin(2)
            best_lines(part, labels, costs, favoured, *law, *edges, columns, lines.start)
        self._favoured = favoured
        change = self._energy.evaluate(labels, costs) - self.value()
        if change < 0:
            self._labels[...], self._costs[...] = labels, costs
        return min(change, 0)

    def value(self) -> int:
        """Return the energy of the current labels."""
        return self._energy.evaluate(self._labels, self._costs)


def _largest_gains(table: Array) -> Array:
    # The most that an edge can save if one of its ends changes its label by 0, 1, ...
    costs = table[np.abs(np.arange(1 - table.size, table.size))]
    steps = range(table.size)
    return np.array([(costs[step:] - costs[: costs.size - step]).max() for step in steps])


@compiled()
def _costs_of(unary: Array, labels: Array, offer: Array, costs: Array) -> None:
    height, width = labels.shape
    for y in range(height):
        for x in range(width):
            costs[y, x] = unary[y, x, offer[labels[y, x]]]


@compiled()
def _choose(state: State, gains: Array, weights: Array, nodes: Array, tree: Array) -> Array:
    # A pixel whose own cost rises by more than all its edges together can save is in no best set,
    # so it takes no part in the cut. Those that do are listed, and marked in `tree`.
    labels, costs, offer, offered = state
    height, width = labels.shape
    count = 0
    for y in range(height):
        for x in range(width):
            label = labels[y, x]
            gain = weights[y, x] * gains[abs(offer[label] - label)]
            if np.int32(offered[y, x]) - np.int32(costs[y, x]) < gain:
                node = (y + 1) * (width + 1) + 1 + x
                nodes[count] = node
                tree[node] = SOURCE
                count += 1
    return nodes[:count]


@compiled(inline="always")
def _saved(table: Array, label: int, new: int, beside: int) -> Any:
    # How much an edge saves if one end changes its label and the other keeps its own.
    return table[abs(label - beside)] - table[abs(new - beside)]


@compiled()
def _drop(edges: Edges, gains: Array, state: State, active: Array, tree: Array) -> Array:
    # As in `_choose`, but the saving of an edge to a pixel that stays is now known exactly.
    (table, right, down), (labels, costs, offer, offered) = edges, state
    height, width = labels.shape
    pitch = width + 1
    count, y, start = 0, 0, pitch + 1
    for node in active:
        while node >= start + width:
            y, start = y + 1, start + pitch
        x = node - start
        label = labels[y, x]
        new = offer[label]
        most = gains[abs(new - label)]
        gain = 0
        if x > 0:
            known = _saved(table, label, new, labels[y, x - 1])
            gain += right[y, x - 1] * (most if tree[node - 1] else known)
        if x + 1 < width:
            known = _saved(table, label, new, labels[y, x + 1])
            gain += right[y, x] * (most if tree[node + 1] else known)
        if y > 0:
            known = _saved(table, label, new, labels[y - 1, x])
            gain += down[y - 1, x] * (most if tree[node - pitch] else known)
        if y + 1 < height:
            known = _saved(table, label, new, labels[y + 1, x])
            gain += down[y, x] * (most if tree[node + pitch] else known)
        if np.int32(offered[y, x]) - np.int32(costs[y, x]) < gain:
            active[count] = node
            count += 1
        else:
            tree[node] = FREE
    return active[:count]


@compiled()
def _apply(state: State, active: Array, tree: Array) -> None:
    labels, costs, offer, offered = state
    pitch = labels.shape[1] + 1
    for node in active:
        if tree[node] == SINK:
            y, x = node // pitch - 1, node % pitch - 1
            labels[y, x] = offer[labels[y, x]]
            costs[y, x] = offered[y, x]


# One long loop nest: shorter functions would need a dozen arrays and counters for every pixel.
@compiled()
def _propose(
    edges: Edges, state: State, active: Array, links: tuple[Array, Array], tree: Array
) -> int:
    (table, right, down), (labels, costs, offer, offered) = edges, state
    terminal, capacity = links
    height, width = labels.shape
    pitch = width + 1
    for node in active:
        y, x = node // pitch - 1, node % pitch - 1
        label = labels[y, x]
        new = offer[label]
        terminal[node] += np.int32(offered[y, x]) - np.int32(costs[y, x])
        # Of the edges to the left and up, only those to pixels that stay remain.
        if x > 0 and tree[node - 1] == FREE:
            terminal[node] -= right[y, x - 1] * _saved(table, label, new, labels[y, x - 1])
        if y > 0 and tree[node - pitch] == FREE:
            terminal[node] -= down[y - 1, x] * _saved(table, label, new, labels[y - 1, x])
        for direction in (RIGHT, DOWN):
            if direction == RIGHT:
                if x + 1 == width:
                    continue
                weight, other, beside = right[y, x], node + 1, labels[y, x + 1]
            else:
                if y + 1 == height:
                    continue
                weight, other, beside = down[y, x], node + pitch, labels[y + 1, x]
            # Costs of the edge, minus its cost if neither pixel moves.
            same = table[abs(label - beside)]
            alone = weight * (table[abs(new - beside)] - same)
            if tree[other] == FREE:
                terminal[node] += alone
                continue
            beyond = offer[beside]
            both = weight * (table[abs(new - beyond)] - same)
            first = alone - both
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
    # The change of a cut is its value minus the value of the cut in which nothing moves.
    stay = 0
    for node in active:
        if terminal[node] < 0:
            stay += terminal[node]
    return stay
