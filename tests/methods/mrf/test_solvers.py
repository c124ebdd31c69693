from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from dfdbench.methods.mrf import Energy, Solution, expansion, split, truncated_absolute
from tests.methods.mrf.conftest import KINDS, brute_force, random_energy

SOLVERS: dict[str, Callable[[Energy], Solution]] = {
    "expansion": expansion,
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


@pytest.mark.parametrize("solver", ["expansion", "fast", "default", "high"])
def test_two_labels_are_solved_exactly(rng: np.random.Generator, solver: str) -> None:
    for _ in range(10):
        energy = random_energy(rng, 3, 4, 2, "absolute", weighted=True)
        assert SOLVERS[solver](energy).energy == brute_force(energy)


@pytest.mark.parametrize("dtype", [np.uint16, pytest.param(np.int32, marks=pytest.mark.slow)])
def test_cost_types_agree(rng: np.random.Generator, dtype: type[Any]) -> None:
    energy = random_energy(rng, 5, 6, 8, "absolute", dtype=dtype)
    twin = Energy(energy.unary.astype(np.uint16), energy.smoothness, offset=energy.offset)
    for solve in (expansion, split):
        assert solve(energy).history == solve(twin).history


@pytest.mark.parametrize("solver", SOLVERS)
def test_many_labels_and_single_pixels(rng: np.random.Generator, solver: str) -> None:
    wide = random_energy(rng, 1, 3, 300, "absolute")
    assert SOLVERS[solver](wide).labels.dtype == np.uint16
    single = Energy(np.array([[[5, 3, 0, 4]]], np.uint16), truncated_absolute(4, cap=9))
    assert SOLVERS[solver](single).labels.tolist() == [[2]]


def test_bad_arguments_are_refused(rng: np.random.Generator) -> None:
    energy = random_energy(rng, 2, 2, 4, "absolute")
    with pytest.raises(ValueError, match="quality: expected one of"):
        split(energy, "superb")  # type: ignore[arg-type]
