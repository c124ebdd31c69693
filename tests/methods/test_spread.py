"""One factor makes a spread honest."""

import numpy as np
import pytest

from dfdbench.blur.recipe import RECIPES
from dfdbench.blur.synthesis import synthesize
from dfdbench.datasets.captures import Capture
from dfdbench.errors import MethodError
from dfdbench.evaluation.check import made_pair
from dfdbench.methods.method import restore, teach
from dfdbench.methods.registry import load_method
from dfdbench.methods.spread import fit_spread
from dfdbench.metrics.sureness import REACH_90, ause, squared_errors, surest_nrmse, within_interval

SURE = ("local", "guided", "sgm", "graph-cuts", "graph-cuts-rounded", "s-transform")


@pytest.mark.parametrize("sigma", [0.25, 8.0])
def test_the_factor_makes_the_intervals_of_normal_errors_hold_nine_in_ten(sigma: float) -> None:
    random = np.random.default_rng(1)
    raw = [random.uniform(1, 5, 30_000) for _ in range(6)]
    errors = [np.abs(sigma * each * random.standard_normal(each.size)) for each in raw]
    found = fit_spread(zip(errors[:4], raw[:4], strict=True), "mine")
    assert found == pytest.approx(sigma, rel=0.02)
    for error, each in zip(errors[4:], raw[4:], strict=True):
        assert np.mean(error <= REACH_90 * found * each) == pytest.approx(0.9, abs=0.01)


def test_a_capture_counts_as_much_as_another_and_a_spread_stays_above_0() -> None:
    few, many = (np.ones(10), np.ones(10)), (np.full(900, 3.0), np.ones(900))
    # Each is a half: nine in ten of both are at the larger error, half at the smaller.
    assert fit_spread([few, many], "mine") == pytest.approx(3 / REACH_90)
    assert fit_spread([few] * 10 + [many], "mine") == pytest.approx(1 / REACH_90)
    assert fit_spread([(np.zeros(9), np.ones(9))], "mine") > 0
    with pytest.raises(MethodError, match="nothing to fit to"):
        fit_spread([(np.zeros(0), np.zeros(0))], "mine")


def made(seed: int) -> Capture:
    """A pair with a wavy depth, half of it with little texture."""
    random = np.random.default_rng(seed)
    rows, columns = np.mgrid[:72, :96]
    depth = (120 + 60 * np.sin(rows / 14 + seed) + 40 * np.cos(columns / 17)).astype(np.uint8)
    image = random.integers(0, 256, (72, 96, 3)).astype(np.float64)
    image[:, 48:] = 128 + (image[:, 48:] - 128) / 64
    sharp = image.astype(np.uint8)
    return made_pair(sharp, synthesize(sharp, depth, RECIPES["published"]), depth, depth >= 0)


@pytest.mark.parametrize("name", SURE)
def test_who_is_sure_says_so_where_it_is_asked_and_is_right_to_be(name: str) -> None:
    plain = load_method(name, {"recipe": "published"}, {})
    sure = load_method(name, {"recipe": "published", "sure": True}, {})
    assert plain.learner is None
    with pytest.raises(MethodError, match="seen no training captures"):
        sure(made(1).infocus, made(1).defocus)
    learned = teach(sure, [made(seed) for seed in range(4)])[0]
    assert learned is not None
    assert list(learned) == ["spread"]
    test = made(9)
    depth, sigma = sure(test.infocus, test.defocus)
    assert np.array_equal(depth, plain(test.infocus, test.defocus)), "depth is as without"
    assert (sigma.dtype, sigma.shape) == (np.float32, depth.shape)
    found = squared_errors(test.depth, depth, sigma)
    assert 0.75 < within_interval(found) < 0.99
    coin = np.random.default_rng(0).permutation(sigma.ravel()).reshape(sigma.shape)
    assert ause(found) < 0.7 * ause(squared_errors(test.depth, depth, coin))
    assert surest_nrmse(found, share=0.5) < 0.65 * surest_nrmse(found, share=1)
    other = load_method(name, {"recipe": "published", "sure": True}, {})
    restore(other, learned)
    assert np.array_equal(other(test.infocus, test.defocus)[1], sigma)


def test_a_fit_of_the_law_learns_the_factor_besides() -> None:
    method = load_method("local", {"recipe": None, "sure": True}, {})
    learned = teach(method, [made(0)])[0]
    assert learned is not None
    assert learned.keys() >= {"spread", "sigmas"}
    assert method(made(0).infocus, made(0).defocus)[1].min() > 0
