"""SSIM against scikit-image's, in one run."""

from typing import Any

import numpy as np
import pytest

from dfdbench.metrics.scores import ssim
from tests.metrics.test_scores import skimage_ssim


@pytest.mark.benchmark(group="ssim 370 x 463")
@pytest.mark.parametrize("way", [ssim, skimage_ssim], ids=["ours", "scikit-image"])
def test_ssim(benchmark: Any, way: Any) -> None:
    random = np.random.default_rng(0)
    truth = random.integers(0, 256, (370, 463)).astype(np.uint8)
    test = np.clip(truth + random.normal(0, 20, truth.shape), 0, 255)
    way(truth, test)
    value = benchmark.pedantic(way, args=(truth, test), rounds=20)
    assert abs(value - ssim(truth, test)) < 1e-6
