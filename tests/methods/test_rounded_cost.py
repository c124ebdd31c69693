from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

from dfdbench.blur.recipe import BlurRecipe
from dfdbench.blur.synthesis import synthesize
from dfdbench.errors import InputError
from dfdbench.methods.rounded_cost import STEPS, rounded_cost

RECIPE = BlurRecipe(0.3, 0.12, levels=9, kernel_size=7, invert=False)
UNIT, LIMIT = 4.0, 900


def noise(shape: tuple[int, ...]) -> NDArray[np.uint8]:
    return np.random.default_rng(2).integers(0, 256, shape).astype(np.uint8)


def misfits(infocus: NDArray[np.uint8], defocus: NDArray[np.uint8]) -> NDArray[np.float64]:
    """The misfit of every label at every pixel, by its definition and SciPy's convolution."""
    labels = []
    for kernel in RECIPE.kernels():
        blurred = infocus.astype(np.float64)
        for axis in (0, 1):
            blurred = ndimage.correlate1d(blurred, kernel, axis, mode="nearest")
        off = np.maximum(np.abs(blurred - defocus) - 0.5, 0)
        off[off < 2.0**-16] = 0
        labels.append(np.sqrt((off**2).sum(axis=2)))
    return np.stack(labels, axis=-1)


def test_the_true_label_costs_nothing_and_every_other_what_its_misfit_says() -> None:
    infocus = noise((14, 17, 3))
    depth = np.random.default_rng(3).integers(0, 9, (14, 17)).astype(np.uint8)
    defocus = synthesize(infocus, depth, RECIPE)
    unary, offset = rounded_cost(infocus, defocus, RECIPE.kernels(), UNIT, LIMIT)
    assert offset == 0
    assert (np.take_along_axis(unary, depth[..., None].astype(int), axis=2) == 0).all()
    # Every pixel has a label without misfit: another cannot be at all.
    assert ((unary == 0) == (misfits(infocus, defocus) == 0)).all()
    assert set(np.unique(unary)) == {0, LIMIT}


def test_where_no_label_fits_costs_grow_with_the_square_of_the_misfit() -> None:
    infocus = noise((14, 17, 2))
    depth = np.random.default_rng(3).integers(0, 9, (14, 17)).astype(np.uint8)
    defocus = synthesize(infocus, depth, RECIPE)
    defocus[3:9, 4:12] ^= 12
    unary, offset = rounded_cost(infocus, defocus, RECIPE.kernels(), UNIT, LIMIT)
    off = np.ceil(misfits(infocus, defocus) * STEPS - 1e-6) / STEPS
    least = off.min(axis=2)
    without = least > 0
    assert 0 < without.mean() < 1
    variance = (least[without] ** 2).mean() / infocus.shape[2]
    costs = np.where(off > 0, UNIT * (math.log(1 / without.mean()) + off**2 / (2 * variance)), 0)
    expected = np.minimum(costs - costs.min(axis=2, keepdims=True), LIMIT)
    assert np.abs(unary - expected).max() <= 1.5
    assert offset == pytest.approx(costs.min(axis=2).sum(), rel=0.02)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"infocus": noise((4, 5))}, "wrong image"),
        ({"infocus": noise((4, 5, 3)).astype(float)}, "wrong image"),
        ({"defocus": noise((4, 6, 3))}, "sizes differ"),
        ({"kernels": RECIPE.kernels()[:1]}, "wrong kernels"),
        ({"kernels": RECIPE.kernels()[:, :6]}, "wrong kernels"),
        ({"limit": 0}, "wrong limit"),
        ({"limit": 65536}, "wrong limit"),
    ],
)
def test_what_it_does_not_take_is_told(changes: dict[str, object], told: str) -> None:
    right: dict[str, object] = {
        "infocus": noise((4, 5, 3)),
        "defocus": noise((4, 5, 3)),
        "kernels": RECIPE.kernels(),
        "unit": UNIT,
        "limit": LIMIT,
    }
    with pytest.raises(InputError, match=told):
        rounded_cost(**(right | changes))  # type: ignore[arg-type]
