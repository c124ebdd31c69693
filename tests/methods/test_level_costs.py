import pytest

from dfdbench.blur.law import BlurLaw
from dfdbench.blur.recipe import RECIPES
from dfdbench.methods.calibration import Calibration
from dfdbench.methods.level_costs import UNIT, level_costs
from tests.methods.made_planes import learned_law, plane

PUBLISHED = RECIPES["published"]


def test_a_nat_of_a_recipe_is_twice_the_variance_of_rounding() -> None:
    pair = plane(120)
    costs = level_costs(PUBLISHED, pair.infocus, pair.defocus, 50)
    assert costs.shape == (64, 80, 256)
    assert costs.max() == 50 * UNIT
    assert costs.min(2).max() == 0
    # Rounding leaves half a nat a channel, in the mean.
    right = costs[14:-14, 14:-14, 255 - 120] / UNIT
    assert 0 < right.mean() < 1.5


def test_a_law_counts_by_depth_and_weighs_by_its_noise() -> None:
    pair = plane(120)
    sigmas = tuple(float(sigma) for sigma in PUBLISHED.sigmas[::-1])
    quiet, noisy = (
        level_costs(BlurLaw(sigmas, noise=(noise,)), pair.infocus, pair.defocus, 50)
        for noise in (0.0, 5.0)
    )
    assert abs(int(quiet.sum((0, 1)).argmin()) - 120) <= 1
    assert noisy.sum() < quiet.sum() / 4


@pytest.mark.slow
def test_a_fitted_law_finds_what_a_told_recipe_finds() -> None:
    law = Calibration.of(learned_law()).law
    pair = plane(120, seed=8)
    costs = level_costs(law, pair.infocus, pair.defocus, 50)
    assert abs(int(costs.sum((0, 1)).argmin()) - 120) <= 3
