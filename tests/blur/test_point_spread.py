import math

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import gamma

from dfdbench.blur.point_spread import point_spread_functions
from dfdbench.blur.recipe import RECIPES
from dfdbench.blur.tracks import DISK

SIZE = 27


def one_kernel(sigma: float, exponent: float) -> list[list[float]]:
    """The definition word for word: a sum a pixel, and a root found by another's solver."""
    offsets = range(-(SIZE // 2), SIZE // 2 + 1)

    def kernel(scale: float, power: float) -> list[list[float]]:
        plain = [
            [math.exp(-((math.hypot(x, y) / scale) ** power)) for x in offsets] for y in offsets
        ]
        total = math.fsum(map(math.fsum, plain))
        return [[weight / total for weight in row] for row in plain]

    def variance(weights: list[list[float]]) -> float:
        return math.fsum(w * x**2 for row in weights for w, x in zip(row, offsets, strict=True))

    wanted = variance(kernel(math.sqrt(2) * sigma, 2))
    scale = brentq(
        lambda c: variance(kernel(c, exponent)) / wanted - 1, 0.4, 12, xtol=1e-15, rtol=1e-15
    )
    return kernel(float(scale), exponent)


@pytest.mark.parametrize("exponent", [3, 8, DISK])
@pytest.mark.parametrize("sigma", [0.32, 0.9, 3.18875])
def test_it_is_the_definition(sigma: float, exponent: float) -> None:
    ours = point_spread_functions(np.array([sigma]), SIZE, exponent)[0]
    assert np.abs(ours - one_kernel(sigma, exponent)).max() < 1e-12


def test_exponent_2_is_the_recipe_s_gaussian() -> None:
    for recipe in RECIPES.values():
        rows = recipe.kernels()
        ours = point_spread_functions(recipe.sigmas, recipe.kernel_size)
        assert np.abs(ours - np.einsum("lj,li->lji", rows, rows)).max() < 1e-12


@pytest.mark.parametrize("exponent", [1, 3, 8, DISK])
def test_each_level_is_as_wide_as_the_recipe_s_and_no_two_look_alike(exponent: float) -> None:
    recipe = RECIPES["published"]
    squares = np.arange(-13, 14) ** 2
    ours = point_spread_functions(recipe.sigmas, SIZE, exponent)
    variances = np.einsum("lji,i->l", ours, squares)
    assert np.allclose(variances, recipe.kernels() @ squares, rtol=1e-12)
    assert np.allclose(ours.sum(axis=(1, 2)), 1, rtol=1e-12)
    assert (np.abs(np.diff(ours, axis=0)).max(axis=(1, 2)) > 5e-5).all()
    assert np.array_equal(ours, ours.transpose(0, 2, 1))
    assert np.array_equal(ours, ours[:, ::-1])


def test_a_wide_disk_is_flat_and_of_twice_sigma() -> None:
    disk = point_spread_functions(np.array([6.0]), 41, DISK)[0]
    y, x = np.mgrid[-20:21, -20:21]
    distance = np.hypot(y, x)
    assert np.ptp(disk[distance < 10.5]) < 0.01 * disk.max()
    assert disk[distance > 14].max() < 1e-12
    continuous = 6 * math.sqrt(2 * gamma(2 / DISK) / gamma(4 / DISK))
    assert continuous == pytest.approx(12, rel=0.05)
    assert disk.max() == pytest.approx(1 / (math.pi * continuous**2), rel=0.05)
