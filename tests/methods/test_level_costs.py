import numpy as np
import pytest

from dfdbench.blur.law import BlurLaw
from dfdbench.blur.recipe import RECIPES
from dfdbench.errors import MethodError
from dfdbench.methods.level_costs import UNIT, LevelCosts
from tests.methods.made_planes import learned_law, plane


def test_a_nat_of_a_recipe_is_twice_the_variance_of_rounding() -> None:
    pair = plane(120)
    costs = LevelCosts("mine", RECIPES["published"], 50)(pair.infocus, pair.defocus)
    assert costs.shape == (64, 80, 256)
    assert costs.max() == 50 * UNIT
    assert costs.min(2).max() == 0
    # Rounding leaves half a nat a channel, in the mean.
    right = costs[14:-14, 14:-14, 255 - 120] / UNIT
    assert 0 < right.mean() < 1.5


def test_a_law_counts_by_depth_and_weighs_by_its_noise() -> None:
    pair = plane(120)
    sigmas = tuple(float(sigma) for sigma in RECIPES["published"].sigmas[::-1])
    quiet, noisy = (LevelCosts("mine", BlurLaw(sigmas, noise=noise), 50) for noise in (0.0, 5.0))
    found = quiet(pair.infocus, pair.defocus).sum((0, 1)).argmin()
    assert abs(int(found) - 120) <= 1
    assert quiet.depth_of_label(np.array([2.5])) == 2.5
    sums = [costs(pair.infocus, pair.defocus).sum() for costs in (quiet, noisy)]
    assert sums[1] < sums[0] / 4


def test_a_fitted_law_finds_what_a_told_recipe_finds() -> None:
    costs = LevelCosts("mine", None, 50)
    assert costs.fit is not None
    costs.restore(learned_law())
    pair = plane(120, seed=8)
    assert abs(int(costs(pair.infocus, pair.defocus).sum((0, 1)).argmin()) - 120) <= 3


def test_told_it_has_no_fit_and_unfitted_no_costs() -> None:
    assert LevelCosts("mine", RECIPES["text"], 5).fit is None
    pair = plane(3)
    with pytest.raises(MethodError, match="mine"):
        LevelCosts("mine", None, 5)(pair.infocus, pair.defocus)
    with pytest.raises(MethodError, match="sigmas"):
        LevelCosts("mine", None, 5).restore({})
