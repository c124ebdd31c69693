import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dfdbench.rig.geometry import CaptureRig, Pose, beam_directions, depth_image_places
from dfdbench.rig.lidar import UPSAMPLING, Beams

ANGLES = st.floats(-10, 10)
POSES = st.builds(Pose, ANGLES, ANGLES, ANGLES)
AHEAD = np.array([[0.3, -0.2, 1.5], [0.0, 0.0, 2.5], [-0.4, 0.1, 0.9]])


def rotation(pose: Pose) -> Rotation:
    return Rotation.from_euler("yxz", [pose.yaw, pose.pitch, pose.roll], degrees=True)


@settings(max_examples=20)
@given(pose=POSES)
def test_a_turn_is_a_rotation_and_has_an_inverse(pose: Pose) -> None:
    turned = pose.turn(AHEAD)
    # Lengths and angles stay, and right-handed stays right-handed.
    assert turned @ turned.T == pytest.approx(AHEAD @ AHEAD.T, abs=1e-12)
    assert np.linalg.det(turned) == pytest.approx(np.linalg.det(AHEAD), abs=1e-12)
    assert rotation(pose).inv().apply(turned) == pytest.approx(AHEAD, abs=1e-12)


@settings(max_examples=20)
@given(pose=POSES, baseline=st.floats(0, 0.5))
def test_the_lidar_lies_above_the_camera(pose: Pose, baseline: float) -> None:
    rig = CaptureRig(baseline=baseline)
    # Its own place is what no turn moves; y points down.
    assert pose.to_camera(np.zeros(3), rig) == pytest.approx([0, -baseline, 0])
    moved = pose.to_camera(AHEAD, rig) - pose.to_camera(np.zeros(3), rig)
    assert moved == pytest.approx(pose.turn(AHEAD), abs=1e-12)


@settings(max_examples=20)
@given(x=st.floats(0, 735), y=st.floats(0, 727), depth=st.floats(0.4, 4))
def test_projecting_takes_back_a_pixels_ray(x: float, y: float, depth: float) -> None:
    rig = CaptureRig()
    height, width = rig.frame_size
    ray = np.array([x - (width - 1) / 2, y - (height - 1) / 2, rig.focal_length])
    assert rig.project(ray * depth / rig.focal_length) == pytest.approx([x, y], abs=1e-8)


def test_the_crop_is_the_frames_middle() -> None:
    rig = CaptureRig()
    assert rig.crop_offset == (49, 53)
    frame = np.arange(728 * 736).reshape(728, 736)
    assert (rig.crop(frame) == frame[49 : 49 + 630, 53 : 53 + 630]).all()


def beams(altitude: list[float], azimuth: list[float]) -> Beams:
    return Beams(np.array(altitude), np.array(azimuth), np.zeros(len(altitude), np.int64))


def angles_of(directions: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    x, y, z = np.moveaxis(directions, -1, 0)
    return np.degrees(np.arcsin(-y)), np.degrees(np.arctan2(x, z))


def test_beams_look_where_their_angles_say() -> None:
    columns = np.array([900, 1023, 1024, 1100])
    found = beam_directions(beams([10.0, 0.0, -16.6], [3.1, 0.0, -3.1]), columns)
    assert found.shape == (3, 4, 3)
    assert np.linalg.norm(found, axis=-1) == pytest.approx(1)
    up, across = angles_of(found)
    assert up == pytest.approx(np.repeat([[10.0], [0.0], [-16.6]], 4, axis=1))
    # The turn's middle, between columns 1023 and 1024, is straight ahead.
    expected = (columns - 1023.5) * 360 / 2048
    assert across == pytest.approx(expected + np.array([[3.1], [0.0], [-3.1]]))


def test_a_cell_lands_in_the_middle_of_its_block() -> None:
    down, across = UPSAMPLING[-1]
    places = depth_image_places(3, 4)
    assert places.shape == (3, 4, 2)
    for row in range(3):
        for column in range(4):
            y, x = np.mgrid[row * down : (row + 1) * down, column * across : (column + 1) * across]
            assert places[row, column] == pytest.approx([x.mean(), y.mean()])
