import numpy as np
import pytest

from dfdbench.simulation.raycast import Ball, Board, Floor, Surface, Texture, look

PLAIN = Texture("plain", 100)
PHOTOGRAPHS = {"plain": np.full((8, 8, 3), 0.5)}


def distances(*surfaces: Surface, offset: float = 0.0) -> np.ndarray:
    return look(surfaces, PHOTOGRAPHS, offset, (41, 61), 60.0).distance


def test_a_slanted_board_follows_its_equation() -> None:
    found = distances(Board((0.2, 0.1, 3), (99, 99), PLAIN, slant=0.5, tilt=-0.2))
    x = (np.arange(61) - 30) / 60 * found
    y = ((np.arange(41) - 20) / 60)[:, np.newaxis] * found
    assert np.allclose(found, 3 + 0.5 * (x - 0.2) - 0.2 * (y - 0.1))


def test_a_floor_and_what_lies_above_the_horizon() -> None:
    found = distances(Floor(1.0, PLAIN))
    assert np.isinf(found[:21]).all()
    assert found[40, 0] == pytest.approx(60 / 20)


def test_a_ball_shows_its_near_side_and_a_cylinder_is_flat_along_its_axis() -> None:
    ball = distances(Ball((0, 0, 3), 0.5, PLAIN))
    assert ball[20, 30] == pytest.approx(2.5)
    assert np.isinf(ball[0, 0])
    cylinder = distances(Ball((0, 0, 3), 0.5, PLAIN, upright=0.4))
    assert np.allclose(cylinder[15:26, 30], 2.5)
    assert np.isinf(cylinder[0, 30])


def test_the_nearest_surface_is_seen_and_a_second_view_shifts_by_the_disparity() -> None:
    wall, board = Board((0, 0, 4), (99, 99), PLAIN), Board((0, 0, 2), (0.4, 0.4), PLAIN)
    left, right = (distances(wall, board, offset=offset) for offset in (-0.1, 0.1))
    assert left[20, 33] == 2
    shift = round(60 * 0.2 / 2)
    assert np.array_equal(left[:, shift:] == 2, right[:, :-shift] == 2)


def test_colour_is_of_four_rays_a_pixel_and_distance_of_its_centre() -> None:
    # The near board's left edge is 0.1 pixels left of the middle column: half of its rays pass.
    near = Board((0.5 - 0.1 / 60, 0.0, 1.0), (1.0, 99.0), PLAIN)
    far = Board((0.0, 0.0, 3.0), (99.0, 99.0), Texture("plain", 100, (0.5, 0.5, 0.5)))
    seen = look((near, far), PHOTOGRAPHS, 0.0, (41, 61), 60.0)
    assert np.allclose(seen.reflectance[20, 29:32, 0], [0.25, 0.375, 0.5])
    assert np.allclose(seen.distance[20, 29:32], [3, 1, 1])
