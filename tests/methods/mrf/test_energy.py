from typing import Any

import numpy as np
import pytest

from dfdbench.errors import InputError
from dfdbench.methods import mrf
from tests.methods.mrf.conftest import KINDS, all_energies, random_energy


@pytest.mark.parametrize(
    ("table", "metric"),
    [
        (mrf.published(256), True),
        (mrf.truncated_absolute(8, cap=3), True),
        (mrf.potts(8, cap=3), True),
        (mrf.truncated_quadratic(8, cap=100), False),
        (np.zeros(4, np.int32), False),
    ],
)
def test_tables_that_are_metrics(table: Any, metric: bool) -> None:
    energy = mrf.Energy(np.zeros((1, 1, len(table)), np.uint16), table)
    assert energy.is_metric == metric


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("weighted", [False, True])
def test_evaluate_adds_up_every_term(rng: np.random.Generator, kind: str, weighted: bool) -> None:
    energy = random_energy(rng, 2, 3, 6, kind, weighted)
    expected = all_energies(energy)
    for labels in rng.integers(0, 6, (20, 2, 3)):
        assert energy.evaluate(labels) == expected[tuple(labels.ravel())]


def test_evaluate_does_not_overflow() -> None:
    unary = np.full((200, 200, 2), 2**26, np.int32)
    energy = mrf.Energy(unary, mrf.potts(2, cap=1), offset=2**40)
    assert energy.evaluate(np.zeros((200, 200), np.uint8)) == 200 * 200 * 2**26 + 2**40


def test_published_table_is_absolute_difference_but_for_its_last_step() -> None:
    table = mrf.published(256)
    assert table[:229].tolist() == list(range(229))
    assert table[229:].tolist() == list(range(228, 255))


def test_adaptive_potts_weights_follow_the_threshold() -> None:
    right, down = mrf.adaptive_potts_weights(np.array([[0, 5, 11], [6, 5, 5]]), threshold=5)
    assert right.tolist() == [[2, 1], [2, 2]]
    assert down.tolist() == [[1, 2, 1]]


@pytest.mark.parametrize(
    ("cap", "scale", "message"),
    [(2**27, 1, "cap: expected 1 to"), (2**26, 4, "smoothness: expected below")],
)
def test_a_smoothness_too_large_is_refused(cap: int, scale: int, message: str) -> None:
    """As a user may ask for it."""
    with pytest.raises(InputError, match=message):
        mrf.truncated_quadratic(60000, cap, scale)
