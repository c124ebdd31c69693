import numpy as np

from dfdbench.simulation.raycast import Board, Texture
from dfdbench.simulation.rooms import upright
from dfdbench.simulation.shapes import UPRIGHT, Panel, Round, Shape, pack

PLAIN = Texture("plain", 10)
PHOTOGRAPHS = {"plain": np.ones((4, 4, 3))}


def test_a_hull_holds_the_corners() -> None:
    panel = Panel((1, 2, 3), upright(0.7), (2, 4), PLAIN)
    board = Board((1, 2, 3), (2, 4), PLAIN, slant=0.5, tilt=-0.3)
    (a, _, b), _, _ = panel.frame
    shapes: dict[Shape, tuple[float, float, float]] = {panel: (a, b, 0.0), board: (1, 0.5, -0.3)}
    for shape, (right, ahead, fall) in shapes.items():
        hull = pack([shape], PHOTOGRAPHS).hull(0)
        for x, y in ((-1, -2), (-1, 2), (1, -2), (1, 2)):
            corner = (1 + x * right, 2 + y, 3 + ahead * x + fall * y)
            assert np.abs(hull - corner).sum(axis=1).min() < 1e-6


def test_surfaces_share_a_texture_and_know_their_own() -> None:
    shapes = [Round((0, 0, 2), UPRIGHT, 0.5, Texture(name, 1)) for name in ("b", "a", "b")]
    images = {"a": np.zeros((9, 9, 3)), "b": np.ones((8, 6, 3))}
    scene = pack(shapes, images)
    firsts = scene.levels[scene.starts[scene.textures]]
    assert firsts[:, 1:].tolist() == [[6, 8], [9, 9], [6, 8]]
    assert [scene.atlas[first, 0] for first in firsts[:, 0]] == [1, 0, 1]


def test_a_pyramid_keeps_the_mean() -> None:
    values = np.random.default_rng(1).random((16, 16, 3))
    scene = pack([Round((0, 0, 2), UPRIGHT, 0.5, PLAIN)], {"plain": values})
    for first, width, height in scene.levels:
        level = scene.atlas[first : first + width * height]
        assert np.allclose(level.mean(axis=0), values.mean(axis=(0, 1)), atol=1e-6)


def test_the_back_of_a_closed_panel_is_left_out() -> None:
    across, down, away = upright(0.0)
    front = Panel((0, 0, 2), (across, down, away), (1, 1), PLAIN, closed=True)
    back = Panel((0, 0, 3), (across, down, (0.0, 0.0, -1.0)), (1, 1), PLAIN, closed=True)
    assert pack([front, back], PHOTOGRAPHS).near.tolist() == [2, np.inf]
