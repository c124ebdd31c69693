"""The medians of an upsampled LIDAR image against SciPy's filter in two dimensions, in one run."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

from dfdbench.rig.lidar import median_cross


def plain(values: NDArray[np.float64], length: int) -> NDArray[np.float64]:
    down = ndimage.median_filter(values, size=(length, 1), mode="reflect")
    return np.asarray(ndimage.median_filter(down, size=(1, length), mode="reflect"))


@pytest.mark.benchmark(group="medians 13 x 1 and 1 x 13, 1152 x 1800")
@pytest.mark.parametrize("way", [median_cross, plain], ids=["ours", "scipy 2-D"])
def test_medians(benchmark: Any, way: Any) -> None:
    levels = np.random.default_rng(0).integers(0, 256, (1152, 1800)).astype(float)
    filtered = benchmark.pedantic(way, args=(levels, 13), rounds=5)
    assert (filtered == median_cross(levels, 13)).all()
