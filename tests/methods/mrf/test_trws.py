from __future__ import annotations

import numpy as np
import pytest

from dfdbench.methods.mrf import lower_bound, message_passing
from tests.methods.mrf.conftest import KINDS, brute_force, random_energy


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
