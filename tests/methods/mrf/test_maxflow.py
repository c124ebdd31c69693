from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from dfdbench.methods.mrf.maxflow import DOWN, LEFT, RIGHT, SINK, UP, GridGraph

Grid = tuple[NDArray[np.int32], NDArray[np.int32]]


def random_grid(rng: np.random.Generator, height: int, width: int) -> Grid:
    """Terminal links (y, x), and capacities (y, x, direction) without any out of the grid."""
    most = int(rng.choice([1, 3, 30, 10**6]))
    terminal = rng.integers(-2 * most, 2 * most + 1, (height, width)).astype(np.int32)
    terminal[rng.random((height, width)) < rng.choice([0, 0.5, 0.9])] = 0
    capacity = rng.integers(0, most + 1, (height, width, 4)).astype(np.int32)
    capacity[:, -1, RIGHT] = capacity[:, 0, LEFT] = 0
    capacity[-1, :, DOWN] = capacity[0, :, UP] = 0
    return terminal, capacity


def fill(graph: GridGraph, terminal: NDArray[Any], capacity: NDArray[Any]) -> None:
    y, x = np.mgrid[: graph.height, : graph.width]
    node = graph.first + y * graph.pitch + x
    graph.terminal[node] = terminal
    for direction in range(4):
        graph.capacity[4 * node + direction] = capacity[..., direction]


def sink_side(graph: GridGraph) -> NDArray[np.bool_]:
    """Tell which pixels the last cut put on the sink side, as a (y, x) bool array."""
    rows = graph.tree[graph.pitch : (graph.height + 1) * graph.pitch]
    return np.asarray(rows.reshape(graph.height, graph.pitch)[:, 1:] == SINK)


def cut_value(terminal: NDArray[Any], capacity: NDArray[Any], side: NDArray[np.bool_]) -> int:
    """Add up what a cut costs, by its definition."""
    cost = int(terminal[side & (terminal > 0)].sum()) - int(terminal[~side & (terminal < 0)].sum())
    for direction, (dy, dx) in {RIGHT: (0, 1), LEFT: (0, -1), DOWN: (1, 0), UP: (-1, 0)}.items():
        # Pixels that wrap round have capacity 0.
        beside = np.roll(side, (-dy, -dx), (0, 1))
        cost += int(capacity[..., direction][~side & beside].sum())
    return cost


SMALL = [(1, 1), (1, 9), (2, 3), (4, 4), (7, 5), (9, 9)]


@pytest.mark.parametrize("shape", [*SMALL, (61, 47), (1, 3000), (200, 300)])
def test_flow_is_pymaxflow_s(rng: np.random.Generator, shape: tuple[int, int]) -> None:
    maxflow = pytest.importorskip("maxflow", reason="the peer PyMaxflow is not installed")
    graph = GridGraph(*shape)
    for _ in range(60 if shape in SMALL else 6):
        terminal, capacity = random_grid(rng, *shape)
        fill(graph, terminal, capacity)
        peer = maxflow.Graph[int]()
        nodes = peer.add_grid_nodes(shape)
        peer.add_grid_tedges(nodes, np.maximum(terminal, 0), np.maximum(-terminal, 0))
        for direction, (dy, dx) in enumerate(((0, 1), (0, -1), (1, 0), (-1, 0))):
            structure = np.zeros((3, 3), int)
            structure[1 + dy, 1 + dx] = 1
            peer.add_grid_edges(
                nodes, np.ascontiguousarray(capacity[..., direction]), structure, symmetric=False
            )
        flow = graph.cut()
        assert flow == peer.maxflow()
        # A cut that costs as much as the flow is a least one.
        assert flow == cut_value(terminal, capacity, sink_side(graph))
