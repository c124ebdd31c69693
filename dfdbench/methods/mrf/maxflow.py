"""Minimum cuts on a 4-connected grid, the one primitive that every move-making solver needs.

First, rows and columns are solved by themselves, in linear time. For the rest of the flow, two
search trees grow from the terminals and are repaired after each augmenting path, as in Boykov and
Kolmogorov ("An experimental comparison of min-cut/max-flow algorithms for energy minimization in
vision", PAMI 2004). They grow breadth first, and every node knows its distance from the terminal
(Goldberg et al., "Maximum flows by incremental breadth-first search", ESA 2011), which is slightly
faster on these grids, and polynomial. A neighbour's number is the node's plus a constant, so there
are no adjacency lists, and a border of nodes without edges avoids tests for the image's edge. The
module is long because its parts share ten arrays and are one algorithm; the search is one long
function because shorter ones would have to pass its state around.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfdbench.system.compiled import compiled

# Directions of the four edges that leave a node; `direction ^ 1` is the way back.
RIGHT, LEFT, DOWN, UP = 0, 1, 2, 3

# Values of `parent` other than a direction.
TERMINAL, ORPHAN = 4, 5

# If the sources have this many times what the sinks need, only the sinks' tree is grown, since a
# source is near every sink.
ABUNDANT = 10

# Values of `tree`; FREE for nodes that are not active. In arrays whose first axis is the tree,
# SOURCE's part is at 0 and SINK's at 1.
FREE, SOURCE, SINK = 0, 1, 2

Array = NDArray[Any]
#: What a search changes: capacity, tree, parent, distance, orphans; and fronts, counts, listed.
Trees = tuple[Array, Array, Array, Array, Array, tuple[Array, Array, Array]]


class GridGraph:
    """A grid of nodes with terminal and neighbour links, solved in place and reused between cuts.

    Nodes are in flat arrays with a border of idle nodes: pixel (y, x) is node
    ``first + y * pitch + x``. Fill ``terminal`` and ``capacity``, call `cut`, read `sink_side`.
    A solve uses up the capacities, so fill them anew for every cut.

    Parameters
    ----------
    height, width : int
        Size of the grid, at least 1 x 1.

    Attributes
    ----------
    terminal : (node,) int32
        Cost of the sink side minus the cost of the source side: positive is a link from the
        source, negative a link to the sink.
    capacity : (4 * node,) int32
        Non-negative; ``capacity[4 * node + direction]`` is paid when the node is on the source
        side and its neighbour in that direction is on the sink side.
    active : (n,) int32
        Nodes that take part in a cut, ascending; at first all. The others must have no links.
    nodes : (height * width,) int32
        Memory for a shorter `active`.

    Examples
    --------
    >>> graph = GridGraph(1, 2)
    >>> graph.terminal[graph.first] = 5  # the left pixel pays 5 on the sink side
    >>> graph.terminal[graph.first + 1] = -3  # the right one pays 3 on the source side
    >>> graph.capacity[4 * graph.first + RIGHT] = 2
    >>> graph.cut(), graph.sink_side().tolist()
    (2, [[False, True]])
    """

    def __init__(self, height: int, width: int) -> None:
        self.height = height
        self.width = width
        # One idle column serves as the right border of a row and the left border of the next.
        self.pitch = width + 1
        self.first = self.pitch + 1
        nodes = (height + 2) * self.pitch + 1
        self.terminal: NDArray[np.int32] = np.zeros(nodes, np.int32)
        self.capacity: NDArray[np.int32] = np.zeros(4 * nodes, np.int32)
        self.tree: NDArray[np.uint8] = np.zeros(nodes, np.uint8)
        rows = self.pitch * np.arange(1, height + 1)[:, np.newaxis]
        self.active: NDArray[np.int32] = (rows + np.arange(1, width + 1)).ravel().astype(np.int32)
        self.nodes = self.active.copy()
        self._given = np.zeros(nodes, np.int32)
        self._carried = np.zeros(nodes, np.int32)
        parent, (distance, orphans) = np.zeros(nodes, np.uint8), np.zeros((2, nodes), np.int32)
        # Nodes to grow from, for both trees, at even and odd distances.
        fronts, counts = np.zeros((2, 2, nodes), np.int32), np.zeros((2, 2), np.int64)
        lists = fronts, counts, np.zeros((2, nodes), np.int32)
        self._trees = self.capacity, self.tree, parent, distance, orphans, lists

    def clear(self) -> None:
        """Remove the links of the active nodes, which then belong to neither side."""
        _clear(self.active, self.terminal, self.capacity, self.tree)

    def cut(self) -> int:
        """Find a minimum cut and return its value (equal to the maximum flow)."""
        # Most of the flow runs straight: nine tenths on the energies here.
        flow = 0
        for direction in (RIGHT, DOWN):
            links = self.terminal, self.capacity
            flow += _push_along(
                self.pitch, direction, self.active, *links, self._given, self._carried
            )
        flow += _grow_and_augment(self.pitch, self.active, self.terminal, self._trees)
        return int(flow)

    def sink_side(self) -> NDArray[np.bool_]:
        """Return which pixels the last cut put on the sink side, as a (y, x) bool array.

        If several cuts are minimal, this is the one with the fewest pixels on the sink side.
        """
        rows = self.tree[self.pitch : (self.height + 1) * self.pitch]
        side: NDArray[np.bool_] = rows.reshape(self.height, self.pitch)[:, 1:] == SINK
        return side


@compiled()
def _clear(active: Array, terminal: Array, capacity: Array, tree: Array) -> None:
    for node in active:
        terminal[node] = 0
        capacity[4 * node : 4 * node + 4] = 0
        tree[node] = FREE


@compiled()
def _push_along(
    pitch: int,
    direction: int,
    active: Array,
    terminal: Array,
    capacity: Array,
    given: Array,
    carried: Array,
) -> int:
    # The maximum flow within each row (RIGHT) or column (DOWN), in two scans without a search.
    step = 1 if direction == RIGHT else pitch
    flow = 0
    for node in active:
        given[node] = terminal[node]
        flow += max(terminal[node], 0)
    # Each node passes on what its link lets through, whether it is needed or not.
    for node in active:
        other = node + step
        forth, back = 4 * node + direction, 4 * other + (direction ^ 1)
        push = max(min(terminal[node], capacity[forth]), -capacity[back])
        if push == 0:
            continue
        carried[node] = push
        terminal[node] -= push
        terminal[other] += push
        capacity[forth] -= push
        capacity[back] += push
    # Return what no node needed to where it came from.
    for at in range(active.size - 1, -1, -1):
        node = active[at]
        before = node - step
        forth, back = 4 * before + direction, 4 * node + (direction ^ 1)
        push = carried[before]
        if push != 0:
            carried[before] = 0
            if push > 0:
                push = min(push, max(terminal[node] - max(given[node], 0), 0))
            else:
                push = max(push, min(terminal[node] - min(given[node], 0), 0))
            terminal[node] -= push
            terminal[before] += push
            capacity[forth] += push
            capacity[back] -= push
        flow -= max(terminal[node], 0)
    return flow


@compiled()
def _grow_and_augment(pitch: int, active: Array, terminal: Array, trees: Trees) -> int:
    capacity, tree, parent, distance, _, lists = trees
    fronts, counts, listed = lists
    step = (1, -1, pitch, -pitch)
    counts[:] = 0
    ends = np.zeros(2, np.int64)
    amounts = np.zeros(2, np.int64)
    for node in active:
        listed[0, node] = 0
        listed[1, node] = 0
        distance[node] = 1
        parent[node] = TERMINAL
        if terminal[node] == 0:
            tree[node] = FREE
            continue
        which = 0 if terminal[node] > 0 else 1
        amounts[which] += abs(terminal[node])
        tree[node] = which + 1
        listed[which, node] = 1
        fronts[which, 1, ends[which]] = node
        ends[which] += 1
    # One by one: numba takes seconds to compile the error message for an assignment of arrays.
    counts[0, 1], counts[1, 1] = ends[0], ends[1]
    scarce = amounts[0] < ABUNDANT * amounts[1]
    flow = 0
    # The greatest distance up to which each tree is complete, and from which it still has to grow.
    depths = np.ones(2, np.int64)
    # The sink's tree grows to its end, so that it has all nodes that can reach the sink. The
    # source's tree first grows to twice its depth, which was fastest on the energies here.
    while counts[1, depths[1] & 1] > 0:
        shallow = scarce and depths[0] <= 2 * depths[1]
        side = SOURCE if shallow and counts[0, depths[0] & 1] > 0 else SINK
        depth = depths[side - 1]
        front = fronts[side - 1, depth & 1]
        at = 0
        while at < counts[side - 1, depth & 1]:
            node = int(front[at])
            at += 1
            direction = 0
            # Nodes that were cut off or moved since they were listed are listed again elsewhere.
            while direction < 4 and tree[node] == side and distance[node] == depth:
                other = node + step[direction]
                forth, back = 4 * node + direction, 4 * other + (direction ^ 1)
                if side == SINK:
                    forth, back = back, forth
                if capacity[forth] == 0 or tree[other] == side:
                    direction += 1
                    continue
                if tree[other] == FREE:
                    tree[other] = side
                    parent[other] = direction ^ 1
                    distance[other] = depth + 1
                    _list(side, other, depth + 1, lists)
                    direction += 1
                    continue
                upper, lower = (node, other) if side == SOURCE else (other, node)
                push = _narrowest(step, upper, lower, capacity[forth], terminal, capacity, parent)
                flow += push
                capacity[forth] -= push
                capacity[back] += push
                # The side is a constant in each call, so that the compiler makes a faster copy.
                ends_at = depths[0], depths[0] + (side == SOURCE)
                _take(SOURCE, push, upper, step, terminal, trees, ends_at)
                ends_at = depths[1], depths[1] + (side == SINK)
                _take(SINK, push, lower, step, terminal, trees, ends_at)
        counts[side - 1, depth & 1] = 0
        depths[side - 1] += 1
    return flow


@compiled()
def _list(side: int, node: int, depth: int, lists: tuple[Array, Array, Array]) -> None:
    fronts, counts, listed = lists
    # A node may get the same distance twice, but must be grown from only once.
    if listed[side - 1, node] != depth:
        listed[side - 1, node] = depth
        fronts[side - 1, depth & 1, counts[side - 1, depth & 1]] = node
        counts[side - 1, depth & 1] += 1


@compiled()
def _narrowest(
    step: tuple[int, int, int, int],
    upper: int,
    lower: int,
    across: int,
    terminal: Array,
    capacity: Array,
    parent: Array,
) -> Any:
    # What the path source .. upper -> lower .. sink lets through, `across` its middle link.
    push = across
    at = upper
    while parent[at] != TERMINAL:
        before = at + step[parent[at]]
        push = min(push, capacity[4 * before + (parent[at] ^ 1)])
        at = before
    push = min(push, terminal[at])
    at = lower
    while parent[at] != TERMINAL:
        push = min(push, capacity[4 * at + parent[at]])
        at += step[parent[at]]
    return min(push, -terminal[at])


@compiled(inline="always")
def _take(
    side: int,
    push: int,
    at: int,
    step: tuple[int, int, int, int],
    terminal: Array,
    trees: Trees,
    depths: tuple[int, int],
) -> None:
    capacity, _, parent, _, orphans, _ = trees
    # Subtract the flow from the links of one tree's part of the path; nodes cut off are adopted.
    waiting = 0
    while parent[at] != TERMINAL:
        direction = parent[at]
        beside = at + step[direction]
        outward, inward = 4 * at + direction, 4 * beside + (direction ^ 1)
        forth, back = (inward, outward) if side == SOURCE else (outward, inward)
        capacity[forth] -= push
        capacity[back] += push
        if capacity[forth] == 0:
            parent[at] = ORPHAN
            orphans[waiting] = at
            waiting += 1
        at = beside
    terminal[at] += -push if side == SOURCE else push
    if terminal[at] == 0:
        parent[at] = ORPHAN
        orphans[waiting] = at
        waiting += 1
    _adopt(side, step, waiting, trees, depths)


@compiled(inline="always")
def _adopt(
    side: int, step: tuple[int, int, int, int], waiting: int, trees: Trees, depths: tuple[int, int]
) -> None:
    capacity, tree, parent, distance, orphans, lists = trees
    depth, limit = depths
    # Every orphan takes the nearest possible parent. They queue, so that children come after
    # parents. `limit` is the greatest distance that the tree may have while it grows.
    head, tail = 0, waiting
    while waiting > 0:
        orphan = int(orphans[head])
        head = head + 1 if head + 1 < orphans.size else 0
        waiting -= 1
        best, nearest = -1, limit
        for direction in range(4):
            other = orphan + step[direction]
            if tree[other] != side or distance[other] >= nearest:
                continue
            forth = 4 * other + (direction ^ 1) if side == SOURCE else 4 * orphan + direction
            if capacity[forth] > 0:
                best, nearest = direction, distance[other]
                if nearest == distance[orphan] - 1:
                    break
        if best >= 0 and nearest == distance[orphan] - 1:
            parent[orphan] = best
            continue
        # The orphan moves away from the terminal or leaves the tree, so its children are orphans.
        for direction in range(4):
            other = orphan + step[direction]
            if tree[other] == side and parent[other] == (direction ^ 1):
                parent[other] = ORPHAN
                orphans[tail] = other
                tail = tail + 1 if tail + 1 < orphans.size else 0
                waiting += 1
        if best < 0:
            tree[orphan] = FREE
            continue
        parent[orphan] = best
        distance[orphan] = nearest + 1
        if nearest + 1 >= depth:
            _list(side, orphan, nearest + 1, lists)
