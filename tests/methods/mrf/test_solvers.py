from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

from dfdbench.methods.mrf import (
    Energy,
    Solution,
    adaptive_potts_weights,
    expansion,
    lower_bound,
    message_passing,
    potts,
    split,
    truncated_absolute,
)
from dfdbench.methods.mrf.moves import Mover, expansion_offer
from tests.methods.mrf.conftest import KINDS, brute_force, random_energy

SOLVERS: dict[str, Callable[[Energy], Solution]] = {
    "expansion": expansion,
    "message_passing": lambda energy: message_passing(energy, 8),
    "fast": lambda energy: split(energy, "fast"),
    "default": split,
    "high": lambda energy: split(energy, "high"),
}


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("weighted", [False, True])
def test_solutions_are_consistent_and_bounded(
    rng: np.random.Generator, solver: str, kind: str, weighted: bool
) -> None:
    for _ in range(3):
        energy = random_energy(rng, 2, 3, 4, kind, weighted)
        before = energy.unary.copy()
        least = brute_force(energy)
        solution = SOLVERS[solver](energy)
        assert solution.labels.shape == (2, 3)
        assert solution.labels.dtype == np.uint8
        assert isinstance(solution.energy, int)
        assert solution.energy == energy.evaluate(solution.labels) == solution.history[-1]
        assert list(solution.history) == sorted(solution.history, reverse=True)
        assert solution.energy >= least
        assert np.array_equal(before, energy.unary)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("weighted", [False, True])
def test_lower_bound_is_never_above_the_least_energy(
    rng: np.random.Generator, kind: str, weighted: bool
) -> None:
    met = 0
    for shape in ((2, 3, 4), (3, 3, 3), (1, 5, 5), (5, 1, 4), (1, 1, 3)):
        for _ in range(3):
            energy = random_energy(rng, *shape, kind, weighted)
            least = brute_force(energy)
            for iterations in (1, 2, 15):
                assert lower_bound(energy, iterations) <= least
            met += lower_bound(energy, 40) >= 0.9 * least
    assert met >= 12


def test_message_passing_solves_chains(rng: np.random.Generator) -> None:
    # On a single row the bound is tight: rows are the chains that it is exact on.
    for kind in KINDS:
        energy = random_energy(rng, 1, 6, 4, kind)
        solution = message_passing(energy, 60)
        least = brute_force(energy)
        assert solution.lower_bound is not None
        assert least - 2 <= solution.lower_bound <= least <= solution.energy


@pytest.mark.parametrize("solver", ["expansion", "fast", "default", "high"])
def test_two_labels_are_solved_exactly(rng: np.random.Generator, solver: str) -> None:
    for _ in range(10):
        energy = random_energy(rng, 3, 4, 2, "absolute", weighted=True)
        assert SOLVERS[solver](energy).energy == brute_force(energy)


@pytest.mark.parametrize("kind", ["absolute", "truncated-absolute", "potts", "published"])
def test_expansion_ends_where_no_label_lowers_the_energy(
    rng: np.random.Generator, kind: str
) -> None:
    energy = random_energy(rng, 10, 12, 8, kind, weighted=True)
    labels = expansion(energy).labels.astype(np.int32)
    for label in range(8):
        assert Mover(energy, labels).move(expansion_offer(8, label)) == 0


def test_expansion_is_within_twice_the_least_energy_for_potts(rng: np.random.Generator) -> None:
    for _ in range(10):
        energy = random_energy(rng, 2, 3, 4, "potts")
        assert expansion(energy).energy <= 2 * brute_force(energy)


def test_expansion_starts_and_stops_as_told(rng: np.random.Generator) -> None:
    energy = random_energy(rng, 6, 7, 5, "absolute")
    start = rng.integers(0, 5, (6, 7))
    solution = expansion(energy, start=start, max_sweeps=1)
    assert solution.history[0] == energy.evaluate(start)
    assert len(solution.history) == 2
    with pytest.raises(ValueError, match="labels: expected"):
        expansion(energy, start=start[:3])


@pytest.mark.parametrize("kind", ["absolute", "quadratic"])
@pytest.mark.parametrize("labels", [5, 16, 23])
def test_split_is_near_the_bound_for_convex_tables(
    rng: np.random.Generator, kind: str, labels: int
) -> None:
    # Costs as in a photograph: each pixel has a valley somewhere near a smooth surface.
    y, x = np.mgrid[:20, :30]
    surface = (labels - 1) * (0.5 + 0.4 * np.sin(y / 7) * np.cos(x / 9))
    valley = surface + rng.normal(0, 1.5, surface.shape)
    unary = np.minimum(3 * (valley[..., None] - np.arange(labels)) ** 2, 400).astype(np.uint16)
    table = random_energy(rng, 1, 1, labels, kind).smoothness
    energy = Energy(unary, table)
    bound = lower_bound(energy, 60)
    assert split(energy, "default").energy <= 1.03 * bound
    assert split(energy, "high").energy <= 1.01 * bound


def test_split_hands_potts_to_expansion(rng: np.random.Generator) -> None:
    energy = random_energy(rng, 8, 9, 6, "potts", weighted=True)
    assert split(energy).energy == expansion(energy).energy


def test_adaptive_potts_moves_edges_to_where_the_image_changes() -> None:
    image = np.array([[10, 10, 10, 90, 90, 90]], np.uint8)
    right, down = adaptive_potts_weights(image, threshold=5)
    unary = np.array([[[0, 3], [0, 3], [1, 1], [1, 1], [3, 0], [3, 0]]], np.uint16)
    solution = expansion(Energy(unary, potts(2, cap=1), right, down))
    assert solution.labels.tolist() == [[0, 0, 0, 1, 1, 1]]


@pytest.mark.parametrize("dtype", [np.uint16, np.int32])
def test_cost_types_agree(rng: np.random.Generator, dtype: type[Any]) -> None:
    energy = random_energy(rng, 5, 6, 8, "absolute", dtype=dtype)
    twin = Energy(energy.unary.astype(np.uint16), energy.smoothness, offset=energy.offset)
    for solve in (expansion, split, message_passing):
        assert solve(energy).history == solve(twin).history


@pytest.mark.parametrize("solver", SOLVERS)
def test_many_labels_and_single_pixels(rng: np.random.Generator, solver: str) -> None:
    wide = random_energy(rng, 1, 3, 300, "absolute")
    assert SOLVERS[solver](wide).labels.dtype == np.uint16
    single = Energy(np.array([[[5, 3, 0, 4]]], np.uint16), truncated_absolute(4, cap=9))
    assert SOLVERS[solver](single).labels.tolist() == [[2]]


def test_results_do_not_depend_on_threads(rng: np.random.Generator) -> None:
    energies = [random_energy(rng, 20, 25, 16, "absolute") for _ in range(8)]
    alone = [split(energy) for energy in energies]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(split, energies))
    for first, second in zip(alone, together, strict=True):
        assert first.history == second.history
        assert np.array_equal(first.labels, second.labels)


def test_bad_arguments_are_refused(rng: np.random.Generator) -> None:
    energy = random_energy(rng, 2, 2, 4, "absolute")
    with pytest.raises(ValueError, match="quality: expected one of"):
        split(energy, "superb")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="iterations: expected at least 1, got 0"):
        lower_bound(energy, 0)
