import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy import fft, ndimage

from dfdbench.optics.sharpness import dct_sharpness, laplacian_energy, sharpest, spectrum_sum

images = hnp.arrays(np.uint8, (16, 12), elements=st.integers(0, 255))


def blurred(sigma: float) -> np.ndarray:
    image = np.random.default_rng(0).integers(0, 256, (64, 64)).astype(float)
    return np.asarray(np.rint(ndimage.gaussian_filter(image, sigma)), np.uint8)


def test_both_measures_fall_as_blur_grows() -> None:
    stack = [blurred(sigma) for sigma in (0.3, 0.7, 1.5, 3.0)]
    for measure in (spectrum_sum, dct_sharpness, laplacian_energy):
        values = [measure(image) for image in stack]
        assert values == sorted(values, reverse=True)
        assert values[0] > 1.5 * values[-1]
    assert sharpest(stack[::-1]) == 3


@given(images)
def test_the_cosine_measure_counts_coefficients(image: np.ndarray) -> None:
    # By the definition: along each axis the type-II transform of the orthonormal kind.
    first = fft.dct(image.astype(float), axis=0, norm="ortho")
    both = fft.dct(first, axis=1, norm="ortho")
    clear = np.abs(np.abs(both) - 1) > 1e-9
    share = dct_sharpness(image)
    assert share == pytest.approx((np.abs(both) >= 1).mean(), abs=(~clear).mean() + 1e-12)
    assert 0 <= share <= 1


def test_colour_is_measured_by_its_luma() -> None:
    grey = blurred(1.0)
    assert dct_sharpness(np.repeat(grey[..., None], 3, axis=2)) == dct_sharpness(grey)
