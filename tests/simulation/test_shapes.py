import numpy as np

from dfdbench.simulation.raycast import Texture
from dfdbench.simulation.rooms import upright
from dfdbench.simulation.shapes import UPRIGHT, Panel, Round, pack

PLAIN = Texture("plain", 10)
PHOTOGRAPHS = {"plain": np.ones((4, 4, 3))}


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
