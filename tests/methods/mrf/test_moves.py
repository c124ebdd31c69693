import itertools

import numpy as np
import pytest

from dfdbench.methods.mrf.moves import Mover, expansion_offer, jump_offer, snap_offer
from tests.methods.mrf.conftest import KINDS, random_energy

EXACT = (
    ("absolute", (expansion_offer(5, 3), jump_offer(5, 2), jump_offer(5, -1), snap_offer(5, 2, 1))),
    ("quadratic", (jump_offer(5, 2), jump_offer(5, -3))),
    ("potts", (expansion_offer(5, 0),)),
    ("truncated-absolute", (expansion_offer(5, 4),)),
)


def test_moves_are_the_best_ones(rng: np.random.Generator) -> None:
    for (kind, offers), weighted in itertools.product(EXACT, [False, True] * 5):
        for offer in offers:
            energy = random_energy(rng, 2, 4, 5, kind, weighted)
            labels = rng.integers(0, 5, (2, 4)).astype(np.int32)
            before = energy.evaluate(labels)
            best = min(
                energy.evaluate(np.where(np.reshape(taken, (2, 4)), offer[labels], labels))
                for taken in itertools.product([False, True], repeat=8)
            )
            change = Mover(energy, labels).move(offer)
            assert before + change == energy.evaluate(labels) == best


@pytest.mark.parametrize("kind", KINDS)
def test_no_move_raises_the_energy(rng: np.random.Generator, kind: str) -> None:
    energy = random_energy(rng, 9, 11, 8, kind, weighted=True)
    labels = rng.integers(0, 8, (9, 11)).astype(np.int32)
    mover = Mover(energy, labels)
    for _ in range(60):
        before, value = labels.copy(), energy.evaluate(labels)
        # Any offer at all, however far from submodular.
        change = mover.move(rng.integers(0, 8, 8).astype(np.int32))
        assert energy.evaluate(labels) - value <= change <= 0
        assert change < 0 or np.array_equal(before, labels)
