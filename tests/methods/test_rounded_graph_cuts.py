import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

from dfdbench.blur.law import BlurLaw
from dfdbench.blur.recipe import LEVELS, RECIPES, BlurRecipe
from dfdbench.blur.synthesis import synthesize
from dfdbench.methods.graph_cuts import GraphCuts
from dfdbench.methods.measured_law import Calibration
from dfdbench.methods.rounded_graph_cuts import STEPS, RoundedGraphCuts, rounded_cost
from dfdbench.metrics.scores import nmae, nrmse, ssim
from tests.conftest import read_rgb

Image = NDArray[np.uint8]


def test_costs_beyond_its_memory_give_the_same_map(monkeypatch: pytest.MonkeyPatch) -> None:
    random = np.random.default_rng(8)
    infocus = random.integers(0, 256, (41, 60, 3)).astype(np.uint8)
    depth = np.full((41, 60), 120, np.uint8)
    depth[:20, 10:45] = 190
    exact = synthesize(infocus, depth, RECIPES["published"])
    noisy = np.clip(exact + random.integers(-2, 3, exact.shape), 0, 255).astype(np.uint8)
    expected = [RoundedGraphCuts()(infocus, defocus) for defocus in (exact, noisy)]
    monkeypatch.setattr("dfdbench.methods.mrf.MOST_HELD", 0)
    for defocus, whole in zip((exact, noisy), expected, strict=True):
        assert np.array_equal(RoundedGraphCuts()(infocus, defocus), whole)


@pytest.mark.parametrize("truncation", [1, 8, 4095])
def test_what_rounding_rules_out_is_never_taken(truncation: int) -> None:
    infocus = np.random.default_rng(6).integers(0, 256, (30, 40, 3)).astype(np.uint8)
    infocus[10:20] //= 8
    depth = np.random.default_rng(7).integers(60, 200, (6, 8)).repeat(5, 0).repeat(5, 1)
    recipe = RECIPES["published"]
    defocus = synthesize(infocus, depth.astype(np.uint8), recipe)
    found = RoundedGraphCuts(recipe, truncation)(infocus, defocus)
    assert np.array_equal(synthesize(infocus, found.astype(np.uint8), recipe), defocus)


def test_no_level_is_proposed_that_training_did_not_show() -> None:
    infocus = np.random.default_rng(5).integers(0, 256, (40, 60, 3)).astype(np.uint8)
    depth = np.full((40, 60), 90, np.uint8)
    depth[:, 30:] = 150
    defocus = synthesize(infocus, depth, RECIPES["published"])
    widths = RECIPES["published"].sigmas[::-1]
    # Beyond what was measured the curve turns back: each width has two levels.
    turned = np.where(np.arange(LEVELS) < 80, widths[160 - np.arange(LEVELS)], widths)
    law, found = BlurLaw(tuple(turned.tolist())), {}
    for first in (0, 80):
        pixels = np.where((np.arange(LEVELS) >= first) & (np.arange(LEVELS) < 200), 100, 0)
        method = RoundedGraphCuts(None)
        method.restore(dict(Calibration(law, widths, pixels, np.zeros(LEVELS)).as_learned()))
        found[first] = method(infocus, defocus)
    assert np.abs(found[80] - depth).mean() < 1
    assert np.abs(found[0] - depth).mean() > 2


@pytest.mark.slow
def test_it_beats_the_thesis_energy_on_real_scenes(shared_data: Path) -> None:
    folder = shared_data / "middlebury/ThirdSize/Dolls"
    infocus = read_rgb(folder / "view1.png")
    depth = read_rgb(folder / "disp1.png")[..., 0].copy()
    defocus = synthesize(infocus, depth, RECIPES["published"])
    found = RoundedGraphCuts()(infocus, defocus)
    plain = GraphCuts()(infocus, defocus)
    assert nrmse(depth, found) < 0.016
    assert nmae(depth, found) < 0.0025
    assert ssim(depth, found) > 0.987
    assert nrmse(depth, found) < nrmse(depth, plain)


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
