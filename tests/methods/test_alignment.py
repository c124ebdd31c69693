import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dfdbench.blur.formation import move
from dfdbench.blur.law import BlurLaw
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
    back = alignment.undo(found, 0.9 * move(blurred, -0.7, 0.4))
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


GREYS = np.arange(256, dtype=np.uint8).reshape(16, 16, 1)
AS_IT_IS = alignment.Alignment(0.0, 0.0, 1.0)


@pytest.mark.parametrize("linear", [False, True])
def test_gain_and_offset_are_of_light_and_grey_levels_come_back(linear: bool) -> None:
    assert np.array_equal(
        alignment.aim_of(GREYS, linear, AS_IT_IS), alignment.light_of(GREYS, linear)
    )
    brighter = alignment.aim_of(GREYS, linear, alignment.Alignment(0.0, 0.0, 2.0), offset=10)
    assert np.allclose(brighter, (alignment.light_of(GREYS, linear) - 10) / 2, atol=1e-4)

    light = alignment.light_of(GREYS, linear).astype(np.float64)
    assert (light.min(), light.max()) == (0, pytest.approx(255))
    assert np.abs(alignment.grey_of(light, linear) - GREYS).max() < 0.01


@given(st.integers(0, 255), st.booleans())
def test_a_pixels_own_noise_does_not_choose_its_weight(level: int, linear: bool) -> None:
    law = BlurLaw((1.0, 2.0), noise=(1.0, 9.0), linear=linear)
    even = np.full((21, 21, 1), 100, np.uint8)
    speck = even.copy()
    speck[10, 10] = level
    before, after = (
        alignment.noise_of(law, alignment.light_of(image, linear))[10, 10, 0]
        for image in (even, speck)
    )
    alone = alignment.noise_of(law, alignment.light_of(np.full_like(even, level), linear))[
        10, 10, 0
    ]
    assert abs(after - before) <= 0.1 * abs(alone - before) + 0.15
