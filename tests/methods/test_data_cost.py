from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import correlate1d

from dfdbench.methods.data_cost import data_cost

SIGMAS = 0.32 + 0.01 * np.arange(256)


def reference(
    infocus: NDArray[np.uint8], defocus: NDArray[np.uint8], sigmas: NDArray[Any], weight: float
) -> NDArray[np.int64]:
    """Follow the definition: a 27 x 27 kernel a label, float64, edge repeated, int of the sum.

    The kernel is the outer product of a row with itself, so rows and columns go one by one.
    """
    at = np.arange(-13, 14)
    costs = np.empty((*infocus.shape[:2], len(sigmas)), np.int64)
    for label, sigma in enumerate(sigmas):
        kernel = np.exp(-(at**2) / (2 * sigma**2))
        kernel /= kernel.sum()
        total = np.zeros(infocus.shape[:2])
        for channel in range(infocus.shape[2]):
            sharp = infocus[..., channel].astype(np.float64)
            down = correlate1d(sharp, kernel, axis=0, mode="nearest")
            total += (defocus[..., channel] - correlate1d(down, kernel, mode="nearest")) ** 2
        costs[..., label] = weight * total
    return costs


def textured(rng: np.random.Generator, shape: tuple[int, ...]) -> NDArray[np.uint8]:
    """Noise over steps: the hardest images for a blur, with pure black and white next to it."""
    image = rng.integers(0, 256, shape)
    image[shape[0] // 3 : shape[0] // 2] = 255
    image[:, shape[1] // 2 : shape[1] // 2 + 3] = 0
    return image.astype(np.uint8)


@pytest.mark.parametrize("shape", [(40, 53, 3), (31, 40, 1), (5, 7, 3), (1, 1, 3), (1, 60, 1)])
def test_costs_equal_the_definition(rng: np.random.Generator, shape: tuple[int, ...]) -> None:
    infocus, labels = textured(rng, shape), SIGMAS[::5]
    defocus = np.clip(infocus.astype(int) // 2 + 60 + rng.integers(-3, 4, shape), 0, 255)
    unary, offset = data_cost(infocus, defocus.astype(np.uint8), labels)
    exact = reference(infocus, defocus.astype(np.uint8), labels, 12)
    least = exact.min(-1, keepdims=True)
    assert unary.dtype == np.uint16
    # Noise of full contrast: costs run to a million, of which float32 keeps seven digits.
    assert np.abs(unary - np.minimum(exact - least, 1021)).max() <= 60
    assert abs(offset - int(least.sum())) <= 8 * least.size


def test_small_costs_are_exact_in_all_but_few_cells(rng: np.random.Generator) -> None:
    # What matters to a solver: the labels whose blur nearly explains the pixel.
    infocus = textured(rng, (60, 80, 3))
    blurred = cv2.GaussianBlur(infocus, (27, 27), 1.5, borderType=cv2.BORDER_REPLICATE)
    defocus = np.asarray(blurred, np.uint8)
    unary, offset = data_cost(infocus, defocus, SIGMAS, limit=1021)
    exact = reference(infocus, defocus, SIGMAS, 12)
    least = exact.min(-1, keepdims=True)
    below = exact - least < 1021
    error = np.abs(unary.astype(np.int64) - (exact - least))[below]
    assert np.mean(error > 1) <= 0.002
    assert error.max() <= 3
    assert abs(offset - int(least.sum())) <= 0.01 * least.size
    assert np.all(unary[~below] >= 1018)


def test_any_range_of_sigmas(rng: np.random.Generator) -> None:
    infocus = rng.integers(90, 140, (20, 24, 1)).astype(np.uint8)
    defocus = rng.integers(100, 130, (20, 24, 1)).astype(np.uint8)
    # A wide Gaussian is cut off at 13 pixels, not wider.
    for sigmas in (np.array([0.3, 0.9]), np.linspace(0.05, 0.6, 40), np.geomspace(0.2, 40, 30)):
        unary, _ = data_cost(infocus, defocus, sigmas, weight=1, limit=65535)
        exact = reference(infocus, defocus, sigmas, 1)
        relative = exact - exact.min(-1, keepdims=True)
        assert np.abs(unary - relative).max() <= 1


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)
