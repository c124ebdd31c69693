import itertools

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from dfdbench.methods.mrf.moves import Mover
from tests.methods.mrf.conftest import KINDS, all_energies, random_energy


def test_a_line_takes_its_best_labels(rng: np.random.Generator) -> None:
    # So few labels are all candidates: nothing that one line can do is better.
    kinds = ("absolute", "truncated-absolute", "potts")
    for kind, weighted in itertools.product(kinds, [False, True] * 10):
        energy = random_energy(rng, 1, 5, 4, kind, weighted)
        labels = rng.integers(0, 4, (1, 5)).astype(np.int32)
        before = energy.evaluate(labels)
        change = Mover(energy, labels).move_lines(columns=False)
        assert before + change == energy.evaluate(labels) == all_energies(energy).min()


def test_a_line_heeds_what_is_beside_it(rng: np.random.Generator) -> None:
    for columns in [False, True] * 5:
        energy = random_energy(rng, 3, 4, 4, "absolute", weighted=True)
        labels = rng.integers(0, 4, (3, 4)).astype(np.int32)
        Mover(energy, labels).move_lines(columns)
        # The last line is the one whose neighbours are still as it found them.
        last = np.s_[:, -1] if columns else np.s_[-1]
        for choice in itertools.product(range(4), repeat=labels[last].size):
            tried = labels.copy()
            tried[last] = choice
            assert energy.evaluate(tried) >= energy.evaluate(labels)


@settings(max_examples=40)
@given(st.sampled_from(KINDS), st.integers(2, 40), st.integers(0, 2**32 - 1))
def test_no_line_raises_the_energy(kind: str, labels: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    height, width = (int(length) for length in rng.integers(1, 8, 2))
    energy = random_energy(rng, height, width, labels, kind, weighted=True)
    found = rng.integers(0, labels, energy.shape).astype(np.int32)
    mover, value = Mover(energy, found), energy.evaluate(found)
    for columns in (False, True, False):
        value += mover.move_lines(columns)
        assert value == energy.evaluate(found) == mover.value()
