import cv2
import numpy as np
import pytest
from scipy import ndimage

from dfdbench.building.sources.matching import Placement, find_gain, find_placement, place
from dfdbench.errors import InputError
from tests.made_folder import photograph


def turned(image: np.ndarray, degrees: float, right: float, down: float) -> np.ndarray:
    """Move an image by OpenCV, which turns anticlockwise for a positive angle."""
    centre = ((image.shape[1] - 1) / 2, (image.shape[0] - 1) / 2)
    matrix = cv2.getRotationMatrix2D(centre, -degrees, 1)
    matrix[:, 2] += np.array([right, down])
    return cv2.warpAffine(image, matrix, image.shape[1::-1], flags=cv2.INTER_CUBIC)


def test_a_turned_and_moved_image_is_brought_back() -> None:
    fixed = photograph(0, (160, 200))
    defocused = cv2.GaussianBlur(turned(fixed, 0.8, 5.3, -3.6), (0, 0), 1.5)
    moved = (0.7 * defocused + 20).astype(np.uint8)
    found = find_placement(fixed, moved, "euclidean")
    assert found.degrees == pytest.approx(-0.8, abs=0.05)
    assert found.right == pytest.approx(-5.3, abs=0.1)
    assert found.down == pytest.approx(3.6, abs=0.1)
    back, covered = place(defocused.astype(float), found)
    aim = cv2.GaussianBlur(fixed, (0, 0), 1.5).astype(float)
    inner = ndimage.binary_erosion(covered, iterations=8)
    assert np.abs(back - aim)[inner].mean() < 2
    assert np.abs(defocused - aim)[inner].mean() > 10


def test_a_whole_pixel_moves_no_value() -> None:
    image = photograph(1).astype(float)
    moved, covered = place(image, Placement(2.0, -1.0, 0.0, 1.0))
    np.testing.assert_allclose(moved[:-1, 2:], image[1:, :-2], atol=1e-9)
    assert not covered[:, :2].any()
    assert not covered[-1].any()
    assert covered[:-1, 2:].all()


def test_images_of_two_scenes_are_refused() -> None:
    with pytest.raises(InputError, match="do not match"):
        find_placement(photograph(0), photograph(1), "euclidean")
    flat = np.full_like(photograph(0), 90)
    with pytest.raises(InputError, match="do not match"):
        find_placement(photograph(0), flat, "translation")


def test_the_gain_leaves_out_what_is_white() -> None:
    image = photograph(2).astype(float)
    bright = np.clip(1.25 * image, 0, 255)
    everywhere = np.ones(image.shape[:2], bool)
    assert find_gain(image, bright, everywhere) == pytest.approx(0.8, abs=0.005)
    with pytest.raises(InputError, match="differ too much"):
        find_gain(image, 0.1 * image + 6, everywhere)
    with pytest.raises(InputError, match="neither black nor white"):
        find_gain(image, np.full_like(image, 255), everywhere)
