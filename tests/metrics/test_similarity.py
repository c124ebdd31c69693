import numpy as np
import pytest
from numpy.typing import NDArray
from skimage.metrics import structural_similarity

from dfdbench.metrics.similarity import mean_similarity

RADIUS = 5
C1, C2 = (0.01 * 255) ** 2, (0.03 * 255) ** 2


def gaussian() -> NDArray[np.float64]:
    """The weights of Wang's window along an axis, from its centre outwards."""
    weights = np.exp(-(np.arange(-RADIUS, RADIUS + 1) ** 2) / (2 * 1.5**2))
    return np.asarray(weights / weights.sum())[RADIUS:]


def images(seed: int, shape: tuple[int, int]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    random = np.random.default_rng(seed)
    truth = random.integers(0, 256, shape).astype(np.float64)
    return truth, np.clip(truth + random.normal(0, 30, shape), 0, 255)


@pytest.mark.parametrize("shape", [(11, 11), (24, 31), (40, 13)])
def test_it_is_what_scikit_image_computes(shape: tuple[int, int]) -> None:
    truth, test = images(1, shape)
    found = mean_similarity(truth, test, np.ones(shape, bool), False, gaussian(), C1, C2)
    # Its own mean leaves out the border where the window does not fit, as ours does.
    expected = structural_similarity(  # type: ignore[no-untyped-call]
        truth, test, data_range=255, gaussian_weights=True, sigma=1.5, use_sample_covariance=False
    )
    assert found == pytest.approx(expected, abs=1e-12)


def test_pixels_that_do_not_count_have_no_say() -> None:
    truth, test = images(3, (30, 34))
    counts = np.random.default_rng(4).random(truth.shape) < 0.8
    masked = [
        mean_similarity(truth * counts, other * counts, counts, True, gaussian(), C1, C2)
        for other in (test, np.where(counts, test, 255 - test))
    ]
    assert masked[0] == masked[1] != pytest.approx(1)
    whole = np.ones(truth.shape, bool)
    plain = mean_similarity(truth, test, whole, False, gaussian(), C1, C2)
    assert mean_similarity(truth, test, whole, True, gaussian(), C1, C2) == pytest.approx(plain)
