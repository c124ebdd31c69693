import runpy
from pathlib import Path

import numpy as np
import pytest

from dfdbench.simulation import tracing
from dfdbench.simulation.lighting import Lamp, lit
from dfdbench.simulation.raycast import Texture
from dfdbench.simulation.rooms import upright
from dfdbench.simulation.shapes import UPRIGHT, Panel, Round, Scene, Shape, pack

PLAIN = Texture("plain", 10)
WALL = Panel((0, 0, 3), UPRIGHT, (4, 4), PLAIN)
LAMP = Lamp((0.0, 0.0, 1.0), 0.01, 8.0)


def made(lamps: list[Lamp], ambient: float, *shapes: Shape) -> Scene:
    return lit(pack(shapes, {"plain": np.ones((4, 4, 3))}), lamps, ambient, (9.0, 9.0))


def at(scene: Scene, u: float, v: float, surface: int = 0) -> float:
    return float(tracing.light_at(scene.lightmap, scene.charts, surface, u, v))


def test_a_lamp_falls_off_by_lambert_and_the_square_of_the_distance() -> None:
    scene = made([LAMP], 0.0, WALL)
    for u, v in ((0.0, 0.0), (1.5, 0.0), (-1.0, 1.0)):
        square = 4 + u * u + v * v
        assert at(scene, u, v) == pytest.approx(8 * 2 / square**1.5, rel=0.01)


def test_what_stands_between_casts_a_shadow_soft_by_the_lamp() -> None:
    # Half way to the wall, so that the shadow is twice as wide.
    board = Panel((0, 0, 2), UPRIGHT, (0.6, 0.6), PLAIN)
    hard = made([LAMP], 0.0, WALL, board)
    assert at(hard, 0.5, 0) == 0
    assert at(hard, 0.7, 0) > 1
    soft = made([Lamp(LAMP.place, 0.2, 8.0)], 0.0, WALL, board)
    assert 0 < at(soft, 0.55, 0) < at(soft, 0.7, 0) < at(soft, 0.85, 0)


def test_a_corner_gets_less_ambient_light_than_a_free_wall() -> None:
    across, down, away = upright(np.pi / 2)
    scene = made([], 1.0, WALL, Panel((0.5, 0, 2), (across, down, away), (4, 4), PLAIN))
    assert at(scene, -1.5, 0) == pytest.approx(1)
    assert at(scene, 0.4, 0) < 0.8


def test_a_ball_is_lit_on_the_side_of_the_lamp() -> None:
    lamp, ball = Lamp((3.0, 0.0, 2.0), 0.01, 9.0), Round((0, 0, 2), UPRIGHT, 0.5, PLAIN)
    scene = made([lamp], 0.1, ball)
    assert at(scene, 0.5 * np.pi / 2, 0) == pytest.approx(9 / 2.5**2 + 0.1, rel=0.02)
    assert at(scene, -0.5 * np.pi / 2, 0) == pytest.approx(0.1, abs=1e-3)


def test_a_far_lamp_shades_by_the_angle_and_casts_no_shadow() -> None:
    ball = Round((0, 0, 2), UPRIGHT, 0.5, PLAIN)
    shaded = runpy.run_path(str(Path(__file__).parents[2] / "docs/tracks_by_rays.py"))["shaded"]
    scene = shaded(pack([WALL, ball], {"plain": np.ones((4, 4, 3))}), (0.0, -0.6, -0.8), 0.5)
    assert at(scene, 0, 0) == pytest.approx(0.5 + 0.5 * 0.8)
    exact = 0.5 + 0.5 * (0.6 * 0.6 + 0.8 * 0.8)
    assert at(scene, 0, -0.3, surface=1) == pytest.approx(exact, abs=2e-3)
