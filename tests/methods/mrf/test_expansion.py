from __future__ import annotations

import numpy as np
import pytest

from dfdbench.methods.mrf import expansion
from dfdbench.methods.mrf.moves import Mover, expansion_offer
from tests.methods.mrf.conftest import brute_force, random_energy


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
