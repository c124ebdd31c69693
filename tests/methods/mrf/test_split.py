from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from dfdbench.methods.mrf import Energy, expansion, lower_bound, split
from tests.methods.mrf.conftest import random_energy


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


def test_results_do_not_depend_on_threads(rng: np.random.Generator) -> None:
    energies = [random_energy(rng, 20, 25, 16, "absolute") for _ in range(8)]
    alone = [split(energy) for energy in energies]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(split, energies))
    for first, second in zip(alone, together, strict=True):
        assert first.history == second.history
        assert np.array_equal(first.labels, second.labels)
