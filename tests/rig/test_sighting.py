"""A board in pictures, in scans, and before a rig whose rays are drawn at random."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dfdbench.errors import SourceError
from dfdbench.rig import sighting as sights
from dfdbench.rig.geometry import CaptureRig, Pose
from dfdbench.rig.lidar import read_beams
from dfdbench.simulation.board_scene import SimulatedScene

RIG = CaptureRig()
HALF, DISTANCE = 0.2, 1.5  # metres
TRUE = Pose(0.8, -0.5, 1.2)
#: In pixels of the frame: the board's left, right, upper and lower side.
LEFT, UPPER = RIG.project(np.array([-HALF, -HALF, DISTANCE]))
RIGHT, LOWER = RIG.project(np.array([HALF, HALF, DISTANCE]))
LINES = [1.0, 0.0, -LEFT], [-1.0, 0.0, RIGHT], [0.0, 1.0, -UPPER], [0.0, -1.0, LOWER]
SIDES = [np.array(line) for line in LINES]
#: An edge of the board's texture, well within it.
TEXTURE = np.array([1.0, 0.0, -(LEFT + 60)])


def rays(pose: Pose = TRUE) -> sights.Rays:
    across, down = np.random.default_rng(5).uniform(-2 * HALF, 2 * HALF, (2, 60, 80))
    there = np.stack([across, down, np.full_like(across, DISTANCE)], axis=-1)
    hit = (np.abs(across) < HALF) & (np.abs(down) < HALF)
    turn = Rotation.from_euler("yxz", [pose.yaw, pose.pitch, pose.roll], degrees=True)
    below = there + np.array([0.0, RIG.baseline, 0.0])
    points = turn.inv().apply(below.reshape(-1, 3)).reshape(there.shape)
    return sights.Rays(points, hit, ~hit)


def sighting(*alternatives: NDArray[np.float64], sides: int = 4) -> sights.Sighting:
    """What was seen; the first side may have more lines, clearer than its own."""
    lines = [[*alternatives, SIDES[0]], *([line] for line in SIDES[1:sides])]
    return sights.Sighting(rays(), lines)


def off(pose: Pose) -> float:
    """How far a pose puts the rays from where they are, at most, in pixels."""
    points = rays().points
    there = RIG.project(TRUE.to_camera(points, RIG))
    return float(np.abs(RIG.project(pose.to_camera(points, RIG)) - there).max())


def test_the_board_tells_how_the_lidar_is_turned() -> None:
    assert off(Pose()) > 20
    found = sights.fit_board(sighting(), RIG)
    assert off(found.pose) < 2
    assert found.agreement > sights.AGREED


def test_a_line_of_the_texture_is_not_taken_for_a_side() -> None:
    found = sights.fit_board(sighting(TEXTURE), RIG)
    assert found.outline == pytest.approx(np.array(SIDES))
    assert off(found.pose) < 2


def test_too_few_sides_and_sides_that_disagree_are_refused() -> None:
    with pytest.raises(SourceError, match="only 2 of the board's sides"):
        sights.fit_board(sighting(sides=2), RIG)
    far = np.array([1.0, 0.0, -(LEFT + 150)])
    disagreeing = sights.Sighting(rays(), [[far], *([line] for line in SIDES[1:])])
    with pytest.raises(SourceError, match="rays agree with the board"):
        sights.fit_board(disagreeing, RIG)


def test_under_a_known_pose_the_lines_that_agree_are_taken() -> None:
    found = sights.under_pose(TRUE, sighting(TEXTURE), RIG)
    assert found.pose == TRUE
    assert found.outline == pytest.approx(np.array(SIDES))
    assert found.agreement == 1
    # An outline that agrees is kept, though it is none of the lines.
    mine = np.array(SIDES) * np.array([1, 1, 1.0001])
    assert sights.under_pose(TRUE, sighting(TEXTURE), RIG, mine).outline == pytest.approx(mine)
    unseen = sights.under_pose(TRUE, sighting(sides=2), RIG)
    assert (unseen.agreement, unseen.outline.shape) == (0, (0, 3))


def test_rays_are_parted_where_the_board_ends() -> None:
    scene = SimulatedScene(3, pose=Pose())
    rays = sights.board_rays(scene.scan(read_beams(), 0).astype(float), read_beams())
    assert not (rays.hit & rays.passed).any()
    places = rays.points - np.array([0, RIG.baseline, 0])
    # The plane is found to a millimetre, so the board's edge is where it is to less than two.
    beyond = (np.abs(places[..., :2]) - np.array(scene.board.size) / 2).max(axis=-1)
    assert beyond[rays.hit].max() < 0.002
    assert beyond[rays.passed].min() > -0.002
    assert rays.hit.sum() > 3000
    # All of them are where the board's plane is.
    assert np.abs(places[rays.hit][:, 2] - 1.5).max() < 0.01


def test_a_scan_without_a_board_is_refused() -> None:
    with pytest.raises(SourceError, match="sees no board"):
        sights.board_rays(np.full((64, 2048), 5000.0), read_beams())


CORNERS = np.array([[60.0, 50], [340, 70], [330, 300], [70, 310]])
MIDDLE = CORNERS.mean(axis=0)


def pictured(texture: np.ndarray) -> np.ndarray:
    inside = np.zeros((360, 400), np.uint8)
    cv2.fillPoly(inside, [CORNERS.astype(np.int32)], 1)
    image = np.where(inside > 0, texture, 40).astype(np.uint8)
    return np.repeat(image[..., np.newaxis], 3, axis=2)


def expected(shift: float) -> list[tuple[np.ndarray, np.ndarray]]:
    moved = CORNERS + shift
    return [(moved[n], moved[(n + 1) % 4]) for n in range(4)]


def distance_to(line: np.ndarray, side: int) -> float:
    return float(np.abs(CORNERS[[side, (side + 1) % 4]] @ line[:2] + line[2]).max())


@pytest.mark.parametrize("shift", [0.0, 25.0, -40.0])
def test_the_sides_of_a_textured_board_are_found_from_afar(shift: float) -> None:
    texture = np.random.default_rng(0).integers(90, 230, (360, 400))
    found = sights.find_sides(pictured(texture), expected(shift), MIDDLE + shift)
    for side, lines in enumerate(found):
        assert distance_to(lines[0], side) < 1.5
        # Distances grow inwards.
        assert MIDDLE @ lines[0][:2] + lines[0][2] > 0


def test_where_a_line_of_the_texture_is_clearer_the_side_is_among_the_candidates() -> None:
    texture = np.full((360, 400), 44)
    texture[:, 100:] = 200
    found = sights.find_sides(pictured(texture), expected(0.0), MIDDLE)
    assert distance_to(found[3][0], 3) > 20
    assert min(distance_to(line, 3) for line in found[3]) < 2
