import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from skimage.metrics import structural_similarity

from dfdbench.errors import InputError
from dfdbench.metrics.scores import nmae, nrmse, ssim

Floats = NDArray[np.float64]

SHAPE = (13, 17)
levels = hnp.arrays(np.uint8, SHAPE)
not_flat = levels.filter(lambda image: image.min() < image.max())


def skimage_ssim(truth: NDArray[Any], test: NDArray[Any]) -> float:
    images = truth.astype(np.float64), test.astype(np.float64)
    how: Any = {"gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False}
    found = structural_similarity(*images, data_range=255, **how)  # type: ignore[no-untyped-call]
    return float(found)


@given(image=not_flat)
def test_identity(image: Floats) -> None:
    assert nrmse(image, image) == 0
    assert nmae(image, image) == 0
    assert ssim(image, image) == pytest.approx(1, abs=1e-12)


@given(truth=not_flat, test=levels)
def test_nrmse_is_never_below_nmae(truth: Floats, test: Floats) -> None:
    assert nrmse(truth, test) >= nmae(truth, test) - 1e-12


@given(image=not_flat, shift=st.floats(-500, 500))
def test_a_shift_is_the_same_in_both_errors(image: Floats, shift: float) -> None:
    span = float(np.ptp(image))
    assert nrmse(image, image + shift) == pytest.approx(abs(shift) / span, abs=1e-9)
    assert nmae(image, image + shift) == pytest.approx(abs(shift) / span, abs=1e-9)


@given(truth=not_flat, test=levels, factor=st.floats(0.01, 100), shift=st.floats(-100, 100))
def test_own_range_makes_errors_free_of_scale_and_shift(
    truth: Floats, test: Floats, factor: float, shift: float
) -> None:
    for metric in (nrmse, nmae):
        moved = metric(truth * factor + shift, test * factor + shift)
        assert moved == pytest.approx(metric(truth, test), rel=1e-6, abs=1e-9)


@given(truth=not_flat, test=levels, noise=levels, mask=hnp.arrays(np.bool_, SHAPE))
def test_what_is_masked_out_does_not_count(
    truth: Floats, test: Floats, noise: Floats, mask: NDArray[np.bool_]
) -> None:
    other_truth, other_test = np.where(mask, truth, noise), np.where(mask, test, noise[::-1])
    for metric in (nrmse, nmae, ssim):
        plain = metric(truth, test, data_range=255, mask=mask)
        changed = metric(other_truth, other_test, data_range=255, mask=mask)
        assert plain == pytest.approx(changed, rel=1e-9, nan_ok=True)


@given(truth=levels, test=levels)
def test_ssim_is_that_of_scikit_image_and_symmetric(truth: Floats, test: Floats) -> None:
    ours = ssim(truth, test)
    assert ours == pytest.approx(skimage_ssim(truth, test), abs=1e-6)
    assert ours == pytest.approx(ssim(test, truth), abs=1e-12)
    everything = np.ones(SHAPE, bool)
    assert ssim(truth, test, mask=everything) == pytest.approx(ours, abs=1e-9)
    assert ours <= 1


def test_ssim_weighs_a_window_by_its_known_pixels() -> None:
    random = np.random.default_rng(6)
    truth, test = random.uniform(0, 255, (2, 20, 24))
    mask = random.random(truth.shape) < 0.7

    def local(values: Floats) -> Floats:
        known = gaussian_filter(mask.astype(float), 1.5, radius=5)
        return np.asarray(gaussian_filter(values * mask, 1.5, radius=5) / known)

    a, b, c1, c2 = local(truth), local(test), 2.55**2, 7.65**2
    variances = local(truth**2) - a**2 + local(test**2) - b**2
    covariance = local(truth * test) - a * b
    similar = (2 * a * b + c1) * (2 * covariance + c2) / ((a**2 + b**2 + c1) * (variances + c2))
    inner = np.s_[5:-5, 5:-5]
    expected = similar[inner][mask[inner]].mean()
    assert ssim(truth, test, mask=mask) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("shape", [(11, 11), (12, 40), (40, 13), (370, 463)])
def test_ssim_on_real_sizes(shape: tuple[int, int]) -> None:
    random = np.random.default_rng(5)
    truth = random.integers(0, 256, shape).astype(np.uint8)
    test = np.clip(truth + random.normal(0, 20, shape), 0, 255)
    assert ssim(truth, test) == pytest.approx(skimage_ssim(truth, test), abs=1e-12)


def test_the_shift_and_noise_rows_of_table_3_5() -> None:
    # Fig. 3.14 is a depth map of range 215; a mean shift of 10: NMAE = NRMSE = 0.0465.
    truth = np.array([[20.0, 100.0, 235.0]])
    assert round(nrmse(truth, truth + 10), 4) == round(nmae(truth, truth + 10), 4) == 0.0465
    # Integer noise, uniform on [-17, 17], on a range of 215: NRMSE 0.0470, NMAE 0.0407.
    noise = np.tile(np.arange(-17, 18), (2, 1)).astype(np.float64)
    truth = np.zeros_like(noise)
    truth[1] = 215
    assert nrmse(truth, truth + noise) == pytest.approx(math.sqrt((35**2 - 1) / 12) / 215)
    assert round(nrmse(truth, truth + noise), 4) == 0.0470
    assert round(nmae(truth, truth + noise), 4) == 0.0407


def test_the_cases_of_table_3_4() -> None:
    errors = np.array([[2, 2, 2, 2], [1, 1, 3, 3], [1, 1, 1, 5], [0, 0, 1, 7], [0, 0, 0, 8]])
    expected = [2.00, 2.24, 2.65, 3.54, 4.00]
    for case, rmse in zip(errors, expected, strict=True):
        truth = np.zeros((1, 4))
        assert nmae(truth, case[np.newaxis], data_range=1) == 2
        assert nrmse(truth, case[np.newaxis], data_range=1) == pytest.approx(rmse, abs=0.005)


def test_the_errors_are_not_symmetric() -> None:
    truth, test = np.array([[0.0, 10.0]]), np.array([[0.0, 20.0]])
    assert nrmse(truth, test) == 2 * nrmse(test, truth)


def test_a_flat_ground_truth_is_undefined_not_zero() -> None:
    flat, test = np.full((20, 20), 80), np.arange(400.0).reshape(20, 20) % 256
    assert math.isnan(nrmse(flat, test))
    assert math.isnan(nmae(flat, flat))
    assert nrmse(flat, test, data_range=255) > 0
    assert ssim(flat, flat) == pytest.approx(1)


def test_no_pixel_that_counts_is_undefined() -> None:
    image, nothing = np.arange(400.0).reshape(20, 20), np.zeros((20, 20), bool)
    assert math.isnan(nrmse(image, image, data_range=255, mask=nothing))
    assert math.isnan(nmae(image, image, mask=nothing))
    assert math.isnan(ssim(image, image, mask=nothing))
    assert math.isnan(ssim(np.zeros((10, 30)), np.zeros((10, 30))))


@pytest.mark.parametrize("metric", [nrmse, nmae, ssim])
def test_wrong_input_is_named(metric: object) -> None:
    assert callable(metric)
    good = np.zeros((12, 12))
    for truth, test, extra, told in (
        (good, good[1:], {}, "sizes differ"),
        (good, good + np.nan, {}, "not finite"),
        (good, np.ma.masked_equal(good, 0), {}, "masked pixels would count"),
        (good, good.astype(complex), {}, "complex128"),
        (good[0], good[0], {}, "wrong shape"),
        (good[:0], good[:0], {}, "wrong shape"),
        (good, good, {"data_range": 0}, "wrong range"),
        (good, good, {"mask": np.ones((12, 12))}, "wrong mask"),
        (good, good, {"mask": np.ones((3, 3), bool)}, "wrong mask"),
    ):
        with pytest.raises(InputError, match=told):
            metric(truth, test, **extra)
