import cv2
import numpy as np
import pytest

from dfdbench.blur.formation import move
from dfdbench.methods import alignment

SCENE = cv2.GaussianBlur(
    np.random.default_rng(2).uniform(20, 230, (90, 110, 3)).astype(np.float32), (0, 0), 1.2
).astype(np.float64)


@pytest.mark.parametrize("sigma", [0.8, 2.5])
def test_blur_does_not_hide_how_an_image_was_moved(sigma: float) -> None:
    blurred = np.asarray(cv2.GaussianBlur(SCENE, (0, 0), sigma), np.float64)
    found = alignment.find_alignment(SCENE, 0.9 * move(blurred, -0.7, 0.4))
    assert (found.down, found.right) == pytest.approx((-0.7, 0.4), abs=0.05)
    assert found.gain == pytest.approx(0.9, abs=0.002)
    back = alignment.aim_of(0.9 * move(blurred, -0.7, 0.4), False, found)
    assert np.abs(back - blurred)[10:-10, 10:-10].max() < 3


@pytest.mark.parametrize("shape", [(40, 60, 3), (12, 9, 3), (1, 1, 1)])
@pytest.mark.parametrize("level", [0, 128, 255])
def test_images_that_tell_nothing_stay_where_they_are(shape: tuple[int, ...], level: int) -> None:
    flat = np.full(shape, level, np.uint8)
    assert alignment.find_alignment(flat, flat) == alignment.Alignment(0.0, 0.0, 1.0)


def test_two_images_of_two_scenes_are_not_pulled_over_one_another() -> None:
    other = np.random.default_rng(5).uniform(0, 255, SCENE.shape)
    found = alignment.find_alignment(SCENE, 255 - SCENE + other)
    assert abs(found.down) + abs(found.right) <= 12
    assert 0.25 <= found.gain <= 4
