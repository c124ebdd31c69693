from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy import fft, ndimage

from dfdbench.errors import SourceError
from dfdbench.optics import sharpness
from dfdbench.simulation.board_scene import write_lens_test
from tests.conftest import write_png

images = hnp.arrays(np.uint8, (16, 12), elements=st.integers(0, 255))


def blurred(sigma: float) -> np.ndarray:
    image = np.random.default_rng(0).integers(0, 256, (64, 64)).astype(float)
    return np.asarray(np.rint(ndimage.gaussian_filter(image, sigma)), np.uint8)


def test_both_measures_fall_as_blur_grows() -> None:
    stack = [blurred(sigma) for sigma in (0.3, 0.7, 1.5, 3.0)]
    for measure in (sharpness.spectrum_sum, sharpness.dct_sharpness, sharpness.laplacian_energy):
        values = [measure(image) for image in stack]
        assert values == sorted(values, reverse=True)
        assert values[0] > 1.5 * values[-1]
    assert sharpness.sharpest(stack[::-1]) == 3


@given(images)
def test_the_cosine_measure_counts_coefficients(image: np.ndarray) -> None:
    # By the definition: along each axis the type-II transform of the orthonormal kind.
    first = fft.dct(image.astype(float), axis=0, norm="ortho")
    both = fft.dct(first, axis=1, norm="ortho")
    clear = np.abs(np.abs(both) - 1) > 1e-9
    share = sharpness.dct_sharpness(image)
    assert share == pytest.approx((np.abs(both) >= 1).mean(), abs=(~clear).mean() + 1e-12)
    assert 0 <= share <= 1


def test_a_lens_test_shows_warming_and_hysteresis(tmp_path: Path) -> None:
    assert write_lens_test(tmp_path) == 12 + 2 * 17
    found = sharpness.read_lens_captures(tmp_path)
    warm = found["temperature"]
    assert [m.temperature for m in warm] == sorted(m.temperature for m in warm)
    assert warm[-1].sharpness > 1.5 * warm[0].sharpness
    # The noise grows as well, and does not explain all of it.
    assert warm[-1].background > warm[0].background
    assert all(m.background < m.sharpness for m in warm)
    steps = [m.step for m in found["up"]]
    assert steps == list(range(127, 144)) == [m.step for m in found["down"]]
    both = zip(found["up"], found["down"], strict=True)
    gap = {up.step: up.sharpness - down.sharpness for up, down in both}
    assert gap[133] < -0.01 < 0.01 < gap[138]


def test_only_the_dot_is_replaced() -> None:
    image = np.random.default_rng(0).integers(10, 14, (64, 64)).astype(np.uint8)
    dotted = image.copy()
    dotted[30:34, 30:34] = 240
    cleaned = sharpness.without_dot(dotted)
    far = np.ones(image.shape, bool)
    far[25:39, 25:39] = False
    assert (cleaned[far] == image[far]).all()
    assert cleaned.max() < 14


def test_files_that_cannot_be_used_are_all_told(tmp_path: Path) -> None:
    dot = np.zeros((32, 32, 3), np.uint8)
    dot[14:18, 14:18] = 200
    write_png(tmp_path / "temperature/image_135_40.00.png", dot)
    write_png(tmp_path / "up/dot.png", dot)
    write_png(tmp_path / "up/image_127_30.00.png", np.zeros((32, 32, 3), np.uint8))
    (tmp_path / "up/image_128_30.00.png").write_bytes(b"no image")
    with pytest.raises(SourceError) as said:
        sharpness.read_lens_captures(tmp_path)
    assert [problem.what for problem in said.value.problems] == [
        "the name is not image_STEP_EXPOSURE_TEMPERATURE.png",
        "the name is not image_STEP_EXPOSURE.png",
        "no white dot on black in the image",
        "not a PNG image",
    ]
    with pytest.raises(SourceError, match="simulate lens"):
        sharpness.read_lens_captures(tmp_path / "none")
