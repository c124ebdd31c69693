import numpy as np
import pytest

from dfdbench.blur.law import BlurLaw
from dfdbench.blur.recipe import RECIPES
from dfdbench.methods.blurred import blurred_by
from tests.methods.made_planes import pair_of, texture

pytest.importorskip("torch")

from dfdbench.methods import volume_costs
from dfdbench.methods.networks.volume import MOST

LAW = BlurLaw(sigmas=tuple(RECIPES["published"].sigmas[::-1].tolist()))


def test_costs_are_those_of_normal_noise_over_two_by_two_pixels() -> None:
    pair = pair_of(texture(3)[:31, :40], np.full((31, 40), 90, np.uint8))
    volume, told = volume_costs.halved_costs([LAW], pair.infocus, [pair.defocus], 32, 8)
    assert volume.shape == (32, 16, 20)
    assert told.shape == (16, 20)
    blurred = blurred_by(LAW, pair.infocus, pair.defocus)
    costs = []
    for level in volume_costs.levels_of(32):
        residual = (blurred.nodes @ blurred.factors[:, level] - blurred.aim) / blurred.noise
        spread = blurred.spread[level]
        costs.append((residual**2).sum(2) / (2 * spread) + 1.5 * np.log(spread))
    nats = np.array(costs)
    nats = np.minimum(nats - nats.min(0), MOST)
    mean = nats[:, :30].reshape(32, 15, 2, 20, 2).mean((2, 4))
    expected = np.minimum(mean - mean.min(0), MOST)
    # Costs are rounded to a sixty-fourth of a nat.
    assert np.abs(volume[:, :15] - expected).max() < 0.05
