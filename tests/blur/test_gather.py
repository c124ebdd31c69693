from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
import scipy.ndimage
from numpy.typing import NDArray

from dfdbench.blur.gather import blur_by_level
from dfdbench.blur.point_spread import DISK, point_spread_functions
from dfdbench.errors import InputError

RANDOM = np.random.default_rng(7)
IMAGE = RANDOM.uniform(0, 255, (17, 23, 3))
LEVELS = RANDOM.integers(0, 5, (17, 23))


def whole_images(
    image: NDArray[np.float64], levels: NDArray[Any], kernels: NDArray[np.float64]
) -> NDArray[np.float64]:
    out = np.zeros_like(image)
    for level, kernel in enumerate(kernels):
        for channel in range(image.shape[2]):
            blurred = scipy.ndimage.correlate(image[..., channel], kernel, mode="nearest")
            out[..., channel][levels == level] = blurred[levels == level]
    return out


@pytest.mark.parametrize("kind", ["skewed", "disk"])
def test_it_is_whole_images_filtered_then_picked(kind: str) -> None:
    kernels = (
        RANDOM.uniform(0, 1, (5, 9, 9))
        if kind == "skewed"
        else point_spread_functions(np.linspace(0.3, 2, 5), 9, DISK)
    )
    ours = blur_by_level(IMAGE, LEVELS, kernels)
    assert np.allclose(ours, whole_images(IMAGE, LEVELS, kernels), rtol=1e-12)
    grey = blur_by_level(IMAGE[..., 1], LEVELS, kernels)
    assert np.array_equal(grey, ours[..., 1])


def test_threads_at_work_at_once_change_nothing() -> None:
    kernels = point_spread_functions(np.linspace(0.3, 2, 5), 9, 3)
    alone = blur_by_level(IMAGE, LEVELS, kernels)
    with ThreadPoolExecutor(4) as pool:
        many = list(pool.map(lambda _: blur_by_level(IMAGE, LEVELS, kernels), range(8)))
    assert all(np.array_equal(one, alone) for one in many)


@pytest.mark.parametrize(
    ("image", "levels", "kernels", "told"),
    [
        (IMAGE, LEVELS[:4], np.ones((5, 3, 3)), "sizes differ"),
        (IMAGE, LEVELS, np.ones((5, 4, 4)), "odd size"),
        (IMAGE, LEVELS, np.ones((4, 3, 3)), "no kernel"),
        (IMAGE, LEVELS - 1, np.ones((5, 3, 3)), "no kernel"),
    ],
)
def test_wrong_input_is_named(
    image: NDArray[np.float64], levels: NDArray[Any], kernels: NDArray[np.float64], told: str
) -> None:
    with pytest.raises(InputError, match=told):
        blur_by_level(image, levels, kernels)
