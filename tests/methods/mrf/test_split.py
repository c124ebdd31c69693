from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from dfdbench.methods.mrf import Energy, Quality, expansion, split
from tests.methods.mrf.conftest import random_energy


@pytest.mark.parametrize("kind", ["absolute", "quadratic"])
@pytest.mark.parametrize("labels", [5, 16, 23])
def test_split_is_near_expansion_for_convex_tables(
    rng: np.random.Generator, kind: str, labels: int
) -> None:
    # Costs as in a photograph: each pixel has a valley somewhere near a smooth surface.
    y, x = np.mgrid[:20, :30]
    surface = (labels - 1) * (0.5 + 0.4 * np.sin(y / 7) * np.cos(x / 9))
    valley = surface + rng.normal(0, 1.5, surface.shape)
    unary = np.minimum(3 * (valley[..., None] - np.arange(labels)) ** 2, 400).astype(np.uint16)
    table = random_energy(rng, 1, 1, labels, kind).smoothness
    energy = Energy(unary, table)
    swept = expansion(energy).energy
    assert split(energy, "default").energy <= 1.03 * swept
    assert split(energy, "high").energy <= 1.01 * swept


@pytest.mark.parametrize("quality", ["fast", "default"])
@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (2, 3), (7, 5)])
@pytest.mark.parametrize("weighted", [False, True])
def test_blocks_need_no_even_size(
    rng: np.random.Generator, quality: Quality, shape: tuple[int, int], weighted: bool
) -> None:
    energy = random_energy(rng, *shape, 40, "absolute", weighted)
    solution = split(energy, quality)
    assert solution.labels.shape == shape
    assert solution.energy == energy.evaluate(solution.labels) == solution.history[-1]
    assert list(solution.history) == sorted(solution.history, reverse=True)


def test_costs_too_large_for_blocks_are_solved_on_pixels(rng: np.random.Generator) -> None:
    energy = random_energy(rng, 4, 5, 20, "absolute")
    large = replace(energy, unary=energy.unary.astype(np.int32))
    large.unary[0, 0, 3] = 2**26
    solution = split(large)
    assert solution.labels[0, 0] != 3
    assert solution.energy == large.evaluate(solution.labels)


def test_without_smoothness_every_pixel_has_its_least_cost(rng: np.random.Generator) -> None:
    energy = random_energy(rng, 9, 7, 33, "absolute")
    alone = replace(energy, smoothness=np.zeros(33, np.int32))
    assert split(alone).energy == int(alone.unary.min(axis=2).sum()) + alone.offset


def test_split_hands_potts_to_expansion(rng: np.random.Generator) -> None:
    energy = random_energy(rng, 8, 9, 6, "potts", weighted=True)
    assert split(energy).energy == expansion(energy).energy


def test_results_do_not_depend_on_threads(rng: np.random.Generator) -> None:
    energies = [random_energy(rng, 20, 25, 16, "absolute") for _ in range(8)]
    alone = [split(energy) for energy in energies]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(split, energies))
    for first, second in zip(alone, together, strict=True):
        assert first.history == second.history
        assert np.array_equal(first.labels, second.labels)
