"""A spread is the moments' of the posterior."""

import numpy as np
import pytest

from dfdbench.methods.posterior import Posterior


@pytest.mark.parametrize("order", [1, -1])
def test_a_posterior_has_the_moments_of_its_definition(order: int) -> None:
    random = np.random.default_rng(3)
    costs = random.uniform(0, 900, (256, 5, 7)).astype(np.float32)
    costs[:, 0] = 3.0
    answer = random.uniform(0, 255, (5, 7))
    posterior = Posterior((5, 7), 1, 0.5, 20.0)
    levels = np.arange(256)[::order]
    posterior.add_all(levels, costs[levels], 4)
    weights = np.exp(-0.5 * np.minimum(costs / 4, 20).astype(np.float64))
    away = np.square(np.arange(256)[:, None, None] - answer)
    expected = np.sqrt((weights * away).sum(0) / weights.sum(0) + 1 / 12)
    np.testing.assert_allclose(posterior.spread_about(answer), expected, rtol=1e-4)


def test_a_window_shares_what_pixels_say() -> None:
    posterior = Posterior((9, 9), 3, 1.0, np.inf)
    for level in (0, 10):
        cost = np.zeros((9, 9))
        cost[4, 4] = 90.0 * (level > 0)
        posterior.add(level, cost)
    spread = posterior.spread_about(np.zeros((9, 9)))
    assert spread[0, 0] == pytest.approx(np.sqrt(50 + 1 / 12))
    # 90 nats of one pixel are 10 for each of nine.
    assert (spread[3:6, 3:6] < 0.3).all()
