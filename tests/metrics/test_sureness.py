"""Scores of how sure a method is, against closed forms and what they must not depend on."""

import math
from functools import partial
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray
from scipy import special, stats

from dfdbench.errors import InputError
from dfdbench.metrics import sureness
from dfdbench.metrics.scores import nrmse
from dfdbench.metrics.sureness import squared_errors as errors

half = partial(sureness.surest_nrmse, share=0.5)
most = partial(sureness.surest_nrmse, share=0.9)
ALL = (sureness.density, half, most, sureness.ause, sureness.within_interval)
numbers = hnp.arrays(np.float64, (6, 10), elements=st.floats(0, 255))
spreads = hnp.arrays(np.float64, (6, 10), elements=st.floats(0.125, 50))
gaps = hnp.arrays(np.bool_, (6, 10))


def shuffled(array: NDArray[Any], seed: int) -> NDArray[Any]:
    order = np.random.default_rng(seed).permutation(array.size)
    return array.ravel()[order].reshape(array.shape)


@given(numbers, numbers, spreads, gaps, gaps, st.integers(0, 99))
def test_the_order_of_pixels_is_nothing_to_them(
    truth: Any, estimate: Any, sigma: Any, unanswered: Any, unknown: Any, seed: int
) -> None:
    estimate = np.where(unanswered, np.nan, estimate)
    moved = [shuffled(array, seed) for array in (truth, estimate, sigma, ~unknown)]
    one, other = errors(truth, estimate, sigma, ~unknown), errors(*moved)
    for score in ALL:
        assert score(one) == pytest.approx(score(other), nan_ok=True, abs=1e-12)


@given(numbers, numbers, st.floats(0.01, 9))
def test_a_sigma_in_the_order_of_the_errors_has_no_area(
    truth: Any, estimate: Any, power: float
) -> None:
    error = np.abs(truth - estimate)
    sigma = (1e-3 + error) if power > 1 else np.sqrt(1e-3 + error)
    assert sureness.ause(errors(truth, estimate, sigma)) == pytest.approx(0, abs=1e-9)


@given(numbers, numbers, spreads)
def test_the_area_is_least_in_the_order_of_the_errors_and_scale_is_nothing_to_it(
    truth: Any, estimate: Any, sigma: Any
) -> None:
    made = errors(truth, estimate, sigma)
    found = sureness.ause(made)
    assert found >= 0
    assert sureness.ause(errors(truth, estimate, 4 * sigma)) == found
    assert sureness.ause(made, data_range=510) == pytest.approx(found / 2)


@given(numbers, numbers, spreads)
def test_at_full_density_and_without_a_sigma_it_is_the_error_of_all(
    truth: Any, estimate: Any, sigma: Any
) -> None:
    whole = nrmse(truth, estimate, data_range=255)
    made = errors(truth, estimate, sigma)
    assert sureness.surest_nrmse(made, share=1) == pytest.approx(whole)
    assert half(errors(truth, estimate)) == pytest.approx(whole)
    assert half(errors(truth, estimate, np.full(truth.shape, 3))) == pytest.approx(whole)


def drawn(shape: tuple[int, int] = (400, 500)) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """A truth, an estimate with normal errors, and their true standard deviations, 1 to 10."""
    random = np.random.default_rng(7)
    sigma = random.uniform(1, 10, shape)
    truth = random.uniform(0, 255, shape)
    return truth, truth + sigma * random.standard_normal(shape), sigma


def test_normal_errors_are_as_probability_theory_has_them() -> None:
    truth, estimate, sigma = drawn()
    made = errors(truth, estimate, sigma)
    assert sureness.within_interval(made) == pytest.approx(0.9, abs=0.003)
    # The same by another book: two-sided, of a sigma that is too small by half.
    expected = 2 * stats.norm.cdf(special.ndtri(0.95) / 2) - 1
    halved = errors(truth, estimate, sigma / 2)
    assert sureness.within_interval(halved) == pytest.approx(expected, abs=0.005)
    # Sigma is even on 1 to 10, so the surest half has it even on 1 to 5.5: mean square of that.
    for share in (0.5, 0.9):
        end = 1 + 9 * share
        mean_square = (end**3 - 1) / 3 / (end - 1)
        found = sureness.surest_nrmse(made, share=share, data_range=1)
        assert found == pytest.approx(math.sqrt(mean_square), rel=0.01)


def test_a_coin_for_a_sigma_has_the_area_of_the_oracle_below_the_whole_error() -> None:
    truth, estimate, _ = drawn()
    estimate = truth + np.random.default_rng(1).standard_normal(truth.shape)
    sigma = np.random.default_rng(2).uniform(1, 2, truth.shape)
    # Of a standard normal error below the bound c that keeps d: 1 - 2 c phi(c) / d.
    kept = np.arange(1, 101) / 100
    bound = special.ndtri(np.minimum((1 + kept) / 2, 1 - 1e-12))
    oracle = np.sqrt(1 - 2 * bound * stats.norm.pdf(bound) / kept)
    found = sureness.ause(errors(truth, estimate, sigma), data_range=1)
    assert found == pytest.approx(float(np.mean(1 - oracle)), abs=0.005)


def test_pixels_as_sure_as_each_other_come_in_together() -> None:
    squares, order = np.array([0.0, 4.0, 16.0, 100.0]), np.array([1.0, 2.0, 2.0, 3.0])
    curve = sureness.error_curve(squares, order, [0.25, 0.5, 0.75, 1])
    assert curve.tolist() == [0, math.sqrt(10 / 2), math.sqrt(20 / 3), math.sqrt(30)]


def test_density_counts_known_pixels_and_the_rest_is_undefined_beyond_it() -> None:
    truth = np.arange(8.0).reshape(2, 4)
    estimate, known = truth + 1, np.array([[True] * 4, [True, True, False, False]])
    estimate[0, :3] = np.nan
    found = errors(truth, estimate, mask=known)
    assert sureness.density(found) == 0.5
    assert half(found, data_range=1) == 1
    # Without a sigma nothing is said of order and intervals.
    for score in (most, sureness.ause, sureness.within_interval):
        assert math.isnan(score(found))
    for score in ALL:
        assert math.isnan(score(errors(truth, estimate, truth + 1, known & False)))


@pytest.mark.parametrize("bad", [0.0, -1.0, math.inf, math.nan])
def test_a_sigma_that_is_none_is_refused_where_there_is_an_answer(bad: float) -> None:
    truth, sigma = np.ones((2, 3)), np.ones((2, 3))
    sigma[0, 1] = bad
    with pytest.raises(InputError, match="finite and above 0 where there is an answer"):
        errors(truth, truth, sigma)
    estimate = truth.copy()
    estimate[0, 1] = np.nan
    assert errors(truth, estimate, sigma).density == 5 / 6
    with pytest.raises(InputError, match="no standard deviations"):
        errors(truth, truth, np.ones((3, 2)))
