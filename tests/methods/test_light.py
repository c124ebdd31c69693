import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dfdbench.blur.law import BlurLaw
from dfdbench.methods.alignment import Alignment
from dfdbench.methods.light import ROUNDING, aim_of, grey_of, light_of, noise_of, rounding_at

GREYS = np.arange(256, dtype=np.uint8).reshape(16, 16, 1)
AS_IT_IS = Alignment(0.0, 0.0, 1.0)


@pytest.mark.parametrize("linear", [False, True])
def test_grey_levels_come_back_from_light(linear: bool) -> None:
    light = light_of(GREYS, linear).astype(np.float64)
    assert (light.min(), light.max()) == (0, pytest.approx(255))
    assert np.abs(grey_of(light, linear) - GREYS).max() < 0.01


@pytest.mark.parametrize("linear", [False, True])
def test_gain_and_offset_are_of_light(linear: bool) -> None:
    assert np.array_equal(aim_of(GREYS, linear, AS_IT_IS), light_of(GREYS, linear))
    brighter = aim_of(GREYS, linear, Alignment(0.0, 0.0, 2.0), offset=10)
    assert np.allclose(brighter, (light_of(GREYS, linear) - 10) / 2, atol=1e-4)


def test_rounding_weighs_little_in_the_dark_of_linear_light() -> None:
    greys = np.array([2.0, 128.0, 250.0])
    assert rounding_at(greys, linear=False).tolist() == [ROUNDING] * 3
    dark, middle, bright = rounding_at(greys, linear=True)
    # The sRGB curve begins with a slope of 1 / 12.92.
    assert dark == pytest.approx(ROUNDING / 12.92)
    assert dark < middle < bright


@given(st.integers(0, 255), st.booleans())
def test_a_pixels_own_noise_does_not_choose_its_weight(level: int, linear: bool) -> None:
    law = BlurLaw((1.0, 2.0), noise=(1.0, 9.0), linear=linear)
    even = np.full((21, 21, 1), 100, np.uint8)
    speck = even.copy()
    speck[10, 10] = level
    before, after = (noise_of(law, light_of(image, linear))[10, 10, 0] for image in (even, speck))
    alone = noise_of(law, light_of(np.full_like(even, level), linear))[10, 10, 0]
    assert abs(after - before) <= 0.1 * abs(alone - before) + 0.15
