from __future__ import annotations

import numpy as np
import pytest

from dfdbench.errors import InputError
from dfdbench.methods.mrf import Energy, expansion, repair, truncated_absolute
from tests.methods.mrf.conftest import random_energy


@pytest.mark.parametrize("kind", ["absolute", "quadratic", "potts"])
def test_no_round_raises_the_energy(rng: np.random.Generator, kind: str) -> None:
    energy = random_energy(rng, 14, 17, 20, kind, weighted=True)
    start = rng.integers(0, 20, energy.shape)
    solution = repair(energy, start, [(8, 4), (-8,), (2, 1), (0,), (-3, 16, 0)])
    assert len(solution.history) == 6
    assert list(solution.history) == sorted(solution.history, reverse=True)
    assert solution.history[-1] < solution.history[0] == energy.evaluate(start)
    assert solution.energy == energy.evaluate(solution.labels)


def test_a_jump_is_as_long_as_it_says_and_goes_both_ways(rng: np.random.Generator) -> None:
    for target, start, reached in ((9, 5, 9), (1, 5, 1), (7, 5, 5)):
        unary = np.full((4, 5, 10), 9, np.uint16)
        unary[..., target] = 0
        energy = Energy(unary, truncated_absolute(10, cap=3))
        found = repair(energy, np.full((4, 5), start), [(4,)]).labels
        assert (found == reached).all()


@pytest.mark.parametrize("target", range(10))
def test_snaps_reach_every_label_within_half_a_period(target: int) -> None:
    unary = np.full((4, 5, 10), 9, np.uint16)
    unary[..., target] = 0
    energy = Energy(unary, truncated_absolute(10, cap=3))
    for start in range(max(0, target - 2), min(10, target + 3)):
        found = repair(energy, np.full((4, 5), start), [(-5,)]).labels
        assert (found == target).all()


def test_lines_go_where_no_jump_does(rng: np.random.Generator) -> None:
    energy = random_energy(rng, 1, 6, 9, "absolute", weighted=True)
    start = energy.unary.argmin(2)
    # All labels of a row at once: as good as any labeling of a grid that is one row.
    assert repair(energy, start, [(0,)]).energy <= expansion(energy, start).energy


def test_lengths_beyond_the_labels_change_nothing(rng: np.random.Generator) -> None:
    energy = random_energy(rng, 6, 7, 3, "absolute")
    start = energy.unary.argmin(2)
    kept = repair(energy, start, [(3, 128)])
    assert np.array_equal(kept.labels, start)
    # A period longer than the range offers each label to all: one sweep of expansions.
    swept = repair(energy, start, [(-16,)]).energy
    assert swept <= expansion(energy, start, max_sweeps=1).history[0]


def test_nothing_to_do_gives_back_the_start(rng: np.random.Generator) -> None:
    energy = random_energy(rng, 6, 7, 3, "absolute")
    start = rng.integers(0, 3, energy.shape)
    solution = repair(energy, start, [])
    assert np.array_equal(solution.labels, start)
    assert solution.history == (energy.evaluate(start),)


def test_a_start_of_another_size_is_an_error(rng: np.random.Generator) -> None:
    with pytest.raises(InputError):
        repair(random_energy(rng, 6, 7, 3, "absolute"), np.zeros((6, 8), int), [(1,)])
