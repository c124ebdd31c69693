import math

import numpy as np
import pytest

from dfdbench.simulation import tracing
from dfdbench.simulation.raycast import Texture
from dfdbench.simulation.shapes import UPRIGHT, Panel, Round, pack

PLAIN = Texture("plain", 10)
PHOTOGRAPHS = {"plain": np.ones((4, 4, 3))}


def met(shape: Panel | Round, origin: tuple[float, ...], way: tuple[float, ...]) -> float:
    scene = pack([shape], PHOTOGRAPHS)
    return float(tracing.meet(scene.kinds[0], tracing.row_of(scene.rows, 0), *origin, *way))


def test_a_cylinder_is_met_outside_and_inside_and_missed_past_its_ends() -> None:
    post = Round((0, 0, 3), UPRIGHT, 0.5, PLAIN, half_height=1.0)
    assert met(post, (0, 0, 0), (0, 0, 1)) == pytest.approx(2.5)
    assert met(post, (0, 0, 3), (0, 0, 1)) == pytest.approx(0.5)
    assert met(post, (0, 0, 0), (0, 0.5, 1)) == math.inf
    # Above its end in front, the far side is seen over it.
    assert met(post, (0, -1.2, 0), (0, 0.1, 1)) == pytest.approx(2.5)
    assert met(post, (0, -1.28, 0), (0, 0.1, 1)) == pytest.approx(3.5)


def test_a_lattice_lets_rays_through_between_its_bars() -> None:
    fence = Panel((0, 0, 1), UPRIGHT, (2, 2), PLAIN, "lattice", pitch=0.5, bar=0.2)
    seen = [met(fence, (0, 0, 0), (-1 + x, -0.8, 1)) < math.inf for x in (0.05, 0.2, 0.55, 0.7)]
    assert seen == [True, False, True, False]


def test_angles_are_right_to_1e_5() -> None:
    for angle in np.linspace(-3.1, 3.1, 97):
        found = tracing.arctan2(2 * math.sin(angle), 2 * math.cos(angle))
        assert found == pytest.approx(angle, abs=2e-5)


def test_a_texture_is_mirrored_past_its_edge_and_coarse_where_asked() -> None:
    values = np.arange(64.0).reshape(8, 8, 1).repeat(3, axis=2)
    scene = pack([Panel((0, 0, 1), UPRIGHT, (9, 9), Texture("t", 1))], {"t": values})

    def at(u: float, v: float, finest: float = 0.1) -> float:
        textures = (scene.atlas, scene.levels, scene.starts, 0)
        return float(tracing.colour_at(*textures, u, v, 1.0, finest)[0])

    assert at(0, 0) == values[4, 4, 0]
    assert at(0.5, 0) == pytest.approx(values[4, 4:6, 0].mean())
    assert at(4.0, 0) == at(2.0, 0)
    assert at(0.5, 0.5, finest=2.0) == pytest.approx(values[4:6, 4:6].mean())
