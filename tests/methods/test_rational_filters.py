import cv2
import numpy as np
import pytest

from dfdbench.blur.law import BlurLaw
from dfdbench.blur.recipe import BlurRecipe
from dfdbench.errors import MethodError
from dfdbench.methods.rational_filters import RationalFilters, design
from tests.methods.made_planes import plane


@pytest.mark.parametrize("frequency", [0.3, 0.7, 1.2])
def test_one_set_of_filters_holds_for_waves_of_different_frequencies(frequency: float) -> None:
    before, filters = design(0.32, 3.19, 2.0, 27)
    wave = np.tile(np.cos(frequency * np.arange(-40, 41)), (81, 1))

    def passed(kernel: np.ndarray) -> float:
        return float(cv2.filter2D(wave, cv2.CV_64F, kernel)[40, 40])

    for width in (0.1, 0.4, 0.7):
        sigma = 0.32 + width * (3.19 - 0.32)
        left = np.exp(-((sigma * frequency) ** 2) / 2)
        powers = width ** np.arange(4)
        asked = passed(before) * (1 - left)
        found = float(np.dot(powers, [passed(kernel) for kernel in filters])) * (1 + left)
        assert found == pytest.approx(asked, abs=0.08 * passed(before))


def test_filters_are_blind_to_brightness_and_symmetric() -> None:
    before, filters = design(0.32, 3.19, 2.0, 27)
    for kernel in (before, *filters):
        assert abs(kernel.sum()) < 1e-9
        np.testing.assert_allclose(kernel, kernel.T, atol=1e-12)
        np.testing.assert_allclose(kernel, kernel[::-1], atol=1e-12)


def test_it_follows_a_law_that_turns() -> None:
    # In focus in the middle of the range: nothing tells the two sides apart, but the width.
    sigmas = tuple((0.4 + np.abs(np.arange(256) - 60) * 0.012).tolist())
    pair = plane(140, 6, recipe=BlurRecipe(0.4, 0.012, invert=False))
    found = RationalFilters(BlurLaw(sigmas))(pair.infocus, pair.defocus)
    assert abs(float(np.median(found)) - 200) < 10


def test_a_blur_without_depth_is_refused() -> None:
    pair = plane(3)
    with pytest.raises(MethodError, match="same at every depth"):
        RationalFilters(BlurLaw((1.0, 1.0)))(pair.infocus, pair.defocus)
