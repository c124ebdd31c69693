import numpy as np
import pytest

from dfdbench.blur.law import BlurLaw
from dfdbench.methods import blurred as blurring
from tests.methods.test_law_cost import blurred_at, pair

LAW = BlurLaw((2.4, 1.1, 0.4), kernel_size=9)
WHOLE = slice(None)


def test_a_large_image_has_as_much_information_in_bands(monkeypatch: pytest.MonkeyPatch) -> None:
    whole, levels = blurring.blurred_by(LAW, *pair()), np.arange(3)
    expected = blurring.information(whole, levels)
    monkeypatch.setattr(blurring, "_MOST_BYTES", 8 * whole.nodes[0].nbytes)
    bands = list(whole.bands())
    assert [len(band.aim) for band in bands] == [8, 8, 5]
    assert blurring.information(whole, levels) == pytest.approx(expected, rel=1e-5)


def test_information_is_that_of_a_pixel_alone_and_of_its_own_level() -> None:
    for noise, infocus_noise in ((1.0, 0.0), (3.0, 0.0), (2.0, 1.0)):
        # The kernels of two widths, and of what lies between: a slope that is known.
        law = BlurLaw((2.0, 1.0), kernel_size=15, noise=(noise,), infocus_noise=infocus_noise)
        infocus, defocus = pair()
        change = blurred_at(law, infocus, 1) - blurred_at(law, infocus, 0)
        spread = 1 + infocus_noise**2 * np.square(law.kernels()).sum(axis=(1, 2))
        per_pixel = np.square(change / noise).sum(axis=2).mean()
        found = blurring.information(blurring.blurred_by(law, infocus, defocus), np.array([0, 1]))
        assert found == pytest.approx((per_pixel / spread).mean(), rel=1e-3)
        far = blurring.information(blurring.blurred_by(law, infocus, defocus), np.array([0, 10]))
        assert far == pytest.approx(found / 100)
        # The kernels of three widths, evenly apart: slopes that are known.
        law = BlurLaw((3.0, 2.0, 1.0), kernel_size=15, noise=(noise,), infocus_noise=infocus_noise)
        looks = [blurred_at(law, infocus, level) for level in range(3)]
        shares = np.square(law.kernels()).sum(axis=(1, 2))
        variances = noise**2 * (1 + infocus_noise**2 * shares)
        levels = np.random.default_rng(2).integers(0, 3, infocus.shape[:2])
        at_levels = blurring.information_at(blurring.blurred_by(law, infocus, defocus), levels)
        for level, (low, high) in enumerate([(0, 1), (0, 2), (1, 2)]):
            step = high - low
            told = np.square((looks[high] - looks[low]) / step).sum(axis=2) / variances[level]
            told += 1.5 * (np.log(variances[high] / variances[low]) / step) ** 2
            there = levels == level
            assert at_levels[there] == pytest.approx(told[there], rel=2e-3, abs=1e-4)
