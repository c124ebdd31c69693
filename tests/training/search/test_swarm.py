from __future__ import annotations

from collections.abc import Callable
from statistics import fmean

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dfdbench.training.search import swarm as module
from dfdbench.training.search.swarm import (
    KAPPA,
    Box,
    Numbers,
    Swarm,
    begun,
    constriction,
    judged,
    moved,
    search,
)


def sphere(x: Numbers) -> Numbers:
    return np.asarray((x**2).sum(-1))


def rastrigin(x: Numbers) -> Numbers:
    return np.asarray((x**2 - 10 * np.cos(2 * np.pi * x) + 10).sum(-1))


def ackley(x: Numbers) -> Numbers:
    distance, waves = np.sqrt((x**2).mean(-1)), np.cos(2 * np.pi * x).mean(-1)
    return np.asarray(-20 * np.exp(-0.2 * distance) - np.exp(waves) + 20 + np.e)


def cube(side: float, components: int, share: float = 1.0) -> Box:
    sides = np.full(components, side)
    return Box(-sides, sides, share * sides, share * sides, np.zeros(components, bool))


def values(function: Callable[[Numbers], Numbers]) -> Callable[[Swarm], Numbers]:
    return lambda swarm: function(swarm.positions)


def test_kappa_is_a_half_and_that_of_equal_constants_is_clerc_and_kennedy_s() -> None:
    assert KAPPA == 0.5
    assert constriction(2.05, 2.05) == pytest.approx(0.7298437881)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("function", "side", "goal", "published"),
    [(sphere, 100.0, 0.01, (395, 530)), (rastrigin, 5.12, 100.0, (182, 213))],
)
def test_it_comes_to_the_goal_as_soon_as_was_published(
    function: Callable[[Numbers], Numbers],
    side: float,
    goal: float,
    published: tuple[int, int],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # Mean iterations to the goal of 30 particles in 30 dimensions, velocities limited to the box's
    # half side, both constants 2.05: Trelea 2003, and Eberhart and Shi, CEC 2000.
    for name, value in (("COGNITIVE", 2.05), ("SOCIAL", 2.05), ("KAPPA", constriction(2.05, 2.05))):
        monkeypatch.setattr(module, name, value)
    taken = []
    for seed in range(4):
        course = search(values(function), cube(side, 30), 30, 800, seed)
        taken.append(next(found.iteration for found in course if found.best_value < goal))
    assert 0.8 * published[0] < fmean(taken) < 1.2 * published[1]


@pytest.mark.parametrize(
    ("function", "side", "components", "within"),
    [(sphere, 100.0, 5, 1e-8), (rastrigin, 5.12, 2, 1.0), (ackley, 32.0, 4, 1e-5)],
)
def test_with_the_thesis_s_constants_it_finds_the_minimum(
    function: Callable[[Numbers], Numbers], side: float, components: int, within: float
) -> None:
    found = []
    for seed in range(5):
        *_, last = search(values(function), cube(side, components, 0.25), 20, 150, seed)
        assert last.best_value == function(last.best)
        found.append(last.best_value)
    assert sorted(found)[2] < within


def test_an_iteration_is_eq_c2_and_c3_by_hand() -> None:
    box = cube(10.0, 2, 0.1)
    swarm = judged(begun(box, 2, 7), np.array([2.0, 1.0]))
    swarm = judged(moved(swarm, box, 7), np.array([3.0, 3.0]))
    after = moved(swarm, box, 7)
    for i in range(2):
        r, s = np.random.default_rng((7, 2, i)).random((2, 2))
        x, v = swarm.positions[i], swarm.velocities[i]
        expected = 0.5 * (v + 2.4 * r * (swarm.own[i] - x) + 2.1 * s * (swarm.best - x))
        expected = np.clip(expected, -1, 1)
        assert np.allclose(after.velocities[i], expected, rtol=0, atol=1e-15)
        assert np.allclose(after.positions[i], np.clip(x + expected, -10, 10), rtol=0, atol=1e-15)


def mixed(whole: bool) -> Box:
    """A width, a filter's side, an activation, which goes round, and a bit."""
    low, high, fastest, first = np.array(
        [[8, 512, 16, 8], [0, 4, 2, 1], [0, 5, 1, 1], [0, 1, 1, 1]], float
    ).T
    return Box(low, high, fastest, first, np.array([False, False, True, False]), whole)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.booleans(), st.integers(1, 5))
def test_it_stays_in_its_box_and_the_best_never_gets_worse(
    seed: int, whole: bool, particles: int
) -> None:
    box, random = mixed(whole), np.random.default_rng(seed)

    def judge(swarm: Swarm) -> Numbers:
        drawn = random.normal(size=particles).round(1)
        drawn[random.random(particles) < 0.2] = np.inf
        drawn[random.random(particles) < 0.1] = np.nan
        return drawn

    before = None
    for swarm in search(judge, box, particles, 12, seed):
        for position in (*swarm.positions, *swarm.own, swarm.best):
            assert np.array_equal(box.limited(position), position)
            assert not whole or np.array_equal(position, np.rint(position))
        limit = box.fastest_first if before is None else box.fastest
        assert np.all(np.abs(swarm.velocities) <= limit)
        assert swarm.best_value == swarm.own_values.min()
        if before is not None:
            assert swarm.best_value <= before.best_value
            assert np.all(swarm.own_values <= before.own_values)
        before = swarm


def test_only_what_is_strictly_better_takes_a_place() -> None:
    box = cube(1.0, 3)
    first = judged(begun(box, 3, 0), np.array([2.0, 1.0, 1.0]))
    assert first.best_at == (0, 1)
    same = judged(moved(first, box, 0), np.array([2.0, 1.0, np.nan]))
    assert np.array_equal(same.own, first.own)
    assert same.best_at == (0, 1)
    better = judged(moved(same, box, 0), np.array([3.0, np.inf, 0.5]))
    assert better.best_at == (2, 2)
    assert np.array_equal(better.best, better.positions[2])
    assert better.own_values.tolist() == [2.0, 1.0, 0.5]


def test_where_all_fail_nothing_is_best() -> None:
    *_, last = search(lambda swarm: np.full(2, np.inf), cube(1.0, 2), 2, 3, 0)
    assert last.best_value == np.inf
    assert np.all(np.isfinite(last.positions))


def test_what_goes_round_comes_in_again() -> None:
    box = mixed(whole=False)
    given = np.array([[0.0, 5.0, -0.25, -1.0], [600.0, 2.2, 6.0, 0.3], [9.0, 0.0, 5.9, 2.0]])
    expected = [[8.0, 4.0, 5.75, 0.0], [512.0, 2.2, 0.0, 0.3], [9.0, 0.0, 5.9, 1.0]]
    assert box.limited(given) == pytest.approx(np.array(expected))
    # A remainder of next to nothing below is rounded to the divisor.
    assert box.limited(np.array([8.0, 0.0, -1e-17, 0.0]))[2] == 0.0
    assert mixed(whole=True).limited(np.array([8.5, 1.4, 5.6, 0.5])).tolist() == [9, 1, 0, 1]


def test_a_known_particle_begins_where_it_is_known() -> None:
    box, known = mixed(whole=True), np.array([128.0, 1.0, 1.0, 1.0])
    swarm = begun(box, 3, 5, known)
    assert np.array_equal(swarm.positions[0], known)
    assert np.array_equal(swarm.positions[1:], begun(box, 3, 5).positions[1:])
