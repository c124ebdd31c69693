from functools import cache

import cv2
import numpy as np
import pytest

from dfdbench.errors import SourceError
from dfdbench.lens import read_lens_table
from dfdbench.lidar import average_scans, depth_image, warp
from dfdbench.lidar_files import read_beams
from dfdbench.raycast import View
from dfdbench.registration import matrix_for, nominal, register
from dfdbench.rig import Pose, Rig
from dfdbench.simulator import MOUNTED, SimulatedScene, defocus

PLACES = np.array([[[10.0, 10], [620, 10], [620, 620], [10, 620], [315, 315]]])


@cache
def seen(number: int) -> tuple[View, np.ndarray]:
    scene = SimulatedScene(number)
    view = scene.look()
    light = defocus(view, read_lens_table(), 135)
    frames = [scene.frame(light, 40, (135, 40, n)) for n in range(4)]
    return view, np.mean(frames, axis=0).astype(np.uint8)


def scanned(number: int, pose: Pose) -> np.ndarray:
    scene = SimulatedScene(number, pose=pose)
    return average_scans([scene.scan(read_beams(), n) for n in range(5)])


def largest_shift(found: np.ndarray, truth: np.ndarray) -> float:
    """How far apart two transforms put the corners and the middle of the image, in pixels."""
    source = cv2.perspectiveTransform(PLACES, np.linalg.inv(truth))
    moved = cv2.perspectiveTransform(source, found)
    return float(np.linalg.norm(moved - PLACES, axis=-1).max())


@pytest.mark.parametrize("number", [1, 3, 32, 50])
@pytest.mark.parametrize("pose", [MOUNTED, Pose(-0.8, 0.6, 1.2)])
def test_a_known_misalignment_is_recovered_within_three_pixels(number: int, pose: Pose) -> None:
    beams, rig = read_beams(), Rig()
    view, image = seen(number)
    ranges = scanned(number, pose)
    truth = matrix_for(ranges, beams, rig, pose)
    assert largest_shift(nominal(ranges, beams, rig).matrix, truth) > 15
    found = register(image, ranges, beams, rig)
    assert largest_shift(found.matrix, truth) < 3
    assert found.agreement > 0.98
    # And so is the distance that lay before the rig, to two levels on 95 % of what is valid.
    levels, valid = warp(*depth_image(ranges, beams), found.matrix, (630, 630))
    expected = SimulatedScene(number).truth(view).astype(int) // 10
    assert valid.mean() > 0.95
    assert (np.abs(levels.astype(int) - expected) <= 2)[valid].mean() > 0.95


def test_an_image_without_a_board_is_refused() -> None:
    plain = np.full((728, 736, 3), 90, np.uint8)
    with pytest.raises(SourceError, match="sides are not found"):
        register(plain, scanned(3, MOUNTED), read_beams(), Rig())


def test_a_scan_without_a_board_is_refused() -> None:
    _, image = seen(3)
    with pytest.raises(SourceError, match="sees no board"):
        register(image, np.full((64, 2048), 5000.0), read_beams(), Rig())
