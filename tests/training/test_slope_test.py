from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import linregress, norm

from dfdbench.training.slope_test import (
    probability_of_fall,
    steps_without_progress,
    without_largest,
)


def one_by_one(losses: list[float], probability: float = 0.51) -> int:
    """The definition, a regression for each stretch."""
    longest = 0
    for n in range(3, len(losses) + 1):
        fit = linregress(np.arange(n), losses[-n:])
        falling = norm.cdf(-fit.slope / fit.stderr) if fit.stderr > 1e-12 else fit.slope < -1e-12
        if fit.stderr <= 1e-12 and abs(fit.slope) <= 1e-12:
            falling = 0.5
        if falling < probability:
            longest = n
    return longest


def noisy(values: np.ndarray, seed: int = 0, sigma: float = 0.05) -> list[float]:
    random = np.random.default_rng(seed)
    return [float(value) for value in values + random.normal(0, sigma, len(values))]


@pytest.mark.parametrize("seed", range(5))
def test_it_is_the_definition_worked_out_at_once(seed: int) -> None:
    losses = noisy(np.concatenate([np.linspace(3, 1, 60), np.full(60, 1.0)]), seed)
    assert steps_without_progress(losses) == one_by_one(losses)


def test_a_loss_that_falls_has_made_progress() -> None:
    assert steps_without_progress(noisy(np.linspace(5, 0, 1000))) < 100


def test_a_loss_that_is_level_or_rises_has_not() -> None:
    assert steps_without_progress(noisy(np.linspace(1, 1.5, 400))) == 400
    assert steps_without_progress([1.0] * 50) == 50


def test_the_plateau_after_a_fall_is_found_and_no_more() -> None:
    # By chance, a level loss seems to fall half of the time: the trainer asks again and again.
    losses = np.concatenate([np.linspace(6, 1, 2000), np.full(3000, 1.0)])
    found = [steps_without_progress(noisy(losses, seed)) for seed in range(20)]
    assert max(found) < 3300
    assert sum(steps > 2000 for steps in found) >= 5


@pytest.mark.parametrize("seed", range(5))
def test_the_probability_of_a_fall_is_that_of_the_line_through_all(seed: int) -> None:
    losses = np.linspace(1.03, 1, 200) + np.random.default_rng(seed).normal(0, 0.1, 200)
    fit = linregress(np.arange(200), losses)
    assert probability_of_fall(losses) == pytest.approx(norm.cdf(-fit.slope / fit.stderr))
    assert (probability_of_fall(losses) < 0.51) == (steps_without_progress(losses) == 200)


def test_the_largest_tenth_is_left_out_and_what_equals_its_least_is_kept() -> None:
    losses = np.random.default_rng(2).permutation(2500).astype(float)
    assert without_largest(losses).tolist() == [loss for loss in losses if loss <= 2249]
    assert without_largest([1.0] * 30).tolist() == [1.0] * 30


def test_too_few_losses_say_nothing() -> None:
    assert steps_without_progress([]) == steps_without_progress([2.0, 1.0]) == 0


@given(
    st.lists(st.floats(0, 10), min_size=3, max_size=40), st.floats(-100, 100), st.integers(-6, 6)
)
def test_neither_shift_nor_scale_matter(losses: list[float], shift: float, power: int) -> None:
    rounded = [round(loss, 3) for loss in losses]
    scaled = [2.0**power * loss for loss in rounded]
    assert steps_without_progress(scaled) == steps_without_progress(rounded)
    assert 0 <= steps_without_progress([loss + shift for loss in rounded]) <= len(losses)
