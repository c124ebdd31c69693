"""A square board before the rig, seen by rays that are drawn at random: no scan, no image."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dfdbench.errors import SourceError
from dfdbench.rig.board_pose import (
    AGREED,
    Fitted,
    Sighting,
    fit_board,
    near_outline,
    turn_into_place,
    under_pose,
)
from dfdbench.rig.board_rays import Rays
from dfdbench.rig.geometry import Pose, Rig

RIG = Rig()
HALF, DISTANCE = 0.2, 1.5  # metres
TRUE = Pose(0.8, -0.5, 1.2)
#: In pixels of the frame: the board's left, right, upper and lower side.
LEFT, UPPER = RIG.project(np.array([-HALF, -HALF, DISTANCE]))
RIGHT, LOWER = RIG.project(np.array([HALF, HALF, DISTANCE]))
SIDES = [
    np.array(line)
    for line in ([1.0, 0.0, -LEFT], [-1.0, 0.0, RIGHT], [0.0, 1.0, -UPPER], [0.0, -1.0, LOWER])
]
#: An edge of the board's texture, well within it.
TEXTURE = np.array([1.0, 0.0, -(LEFT + 60)])


def rays(pose: Pose = TRUE) -> Rays:
    random = np.random.default_rng(5)
    across, down = random.uniform(-2 * HALF, 2 * HALF, (2, 60, 80))
    there = np.stack([across, down, np.full_like(across, DISTANCE)], axis=-1)
    hit = (np.abs(across) < HALF) & (np.abs(down) < HALF)
    turn = Rotation.from_euler("yxz", [pose.yaw, pose.pitch, pose.roll], degrees=True)
    below = there + np.array([0.0, RIG.baseline, 0.0])
    points = turn.inv().apply(below.reshape(-1, 3)).reshape(there.shape)
    return Rays(points, hit, ~hit)


def sighting(*alternatives: NDArray[np.float64], sides: int = 4) -> Sighting:
    """What was seen; the first side may have more lines, clearer than its own."""
    return Sighting(rays(), [[*alternatives, SIDES[0]], *([line] for line in SIDES[1:sides])])


def off(pose: Pose) -> float:
    """How far a pose puts the rays from where they are, at most, in pixels."""
    points = rays().points
    there = RIG.project(TRUE.to_camera(points, RIG))
    return float(np.abs(RIG.project(pose.to_camera(points, RIG)) - there).max())


def test_the_board_tells_how_the_lidar_is_turned() -> None:
    assert off(Pose()) > 20
    found = fit_board(sighting(), RIG)
    assert off(found.pose) < 2
    assert found.agreement > AGREED


def test_a_line_of_the_texture_is_not_taken_for_a_side() -> None:
    found = fit_board(sighting(TEXTURE), RIG)
    assert found.outline == pytest.approx(np.array(SIDES))
    assert off(found.pose) < 2


def test_too_few_sides_and_sides_that_disagree_are_refused() -> None:
    with pytest.raises(SourceError, match="sides are not found"):
        fit_board(sighting(sides=2), RIG)
    far = np.array([1.0, 0.0, -(LEFT + 150)])
    disagreeing = Sighting(rays(), [[far], *([line] for line in SIDES[1:])])
    with pytest.raises(SourceError, match="do not agree"):
        fit_board(disagreeing, RIG)


def test_under_a_known_pose_the_lines_that_agree_are_taken() -> None:
    found = under_pose(TRUE, sighting(TEXTURE), RIG)
    assert found.pose == TRUE
    assert found.outline == pytest.approx(np.array(SIDES))
    assert found.agreement == 1
    # An outline that agrees is kept, though it is none of the lines.
    mine = np.array(SIDES) * np.array([1, 1, 1.0001])
    assert under_pose(TRUE, sighting(TEXTURE), RIG, mine).outline == pytest.approx(mine)
    unseen = under_pose(TRUE, sighting(sides=2), RIG)
    assert (unseen.agreement, unseen.outline.shape) == (0, (0, 3))


def test_several_boards_turn_it_together() -> None:
    boards = [Fitted(sighting(), np.array(SIDES), Pose(), 0.0)] * 2
    pose = turn_into_place(boards, np.zeros(3), 200, RIG)
    assert off(pose) < 2


def test_rays_are_within_the_outline_where_they_hit() -> None:
    seen = rays()
    within, near = near_outline(seen, np.array(SIDES), TRUE, RIG)
    assert ((within > 0) == seen.hit).all()
    assert near.any()
    assert not near.all()
