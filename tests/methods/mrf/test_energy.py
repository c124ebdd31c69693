from typing import Any

import numpy as np
import pytest

from dfdbench.methods import mrf
from tests.methods.mrf.conftest import KINDS, all_energies, random_energy


@pytest.mark.parametrize(
    ("table", "metric"),
    [
        (mrf.published(256), True),
        (mrf.truncated_absolute(8, cap=255), True),
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


GOOD: dict[str, Any] = {
    "unary": np.zeros((2, 3, 4), np.uint16),
    "smoothness": np.arange(4, dtype=np.int32),
}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"unary": np.zeros((2, 3), np.uint16)}, r"unary: expected a shape"),
        ({"unary": np.zeros((0, 3, 4), np.uint16)}, r"unary: expected a shape"),
        ({"unary": np.zeros((2, 3, 4))}, r"unary: expected uint16 or int32, got float64"),
        ({"unary": np.zeros((2, 3, 1), np.uint16)}, r"unary: expected 2 to 65536 labels, got 1"),
        ({"unary": np.full((2, 3, 4), -1, np.int32)}, r"non-negative costs, got -1"),
        ({"unary": np.full((2, 3, 4), 2**30, np.int32)}, r"unary costs: expected below"),
        ({"smoothness": np.arange(3, dtype=np.int32)}, r"smoothness: expected shape \(4,\)"),
        ({"smoothness": np.arange(4.0)}, r"smoothness: expected integers, got float64"),
        ({"smoothness": np.arange(1, 5, dtype=np.int32)}, r"smoothness\[0\]: expected 0, got 1"),
        ({"smoothness": -np.arange(4, dtype=np.int32)}, r"smoothness: expected 0\.\."),
        ({"weights_horizontal": np.ones((2, 3), np.int32)}, r"weights_horizontal: expected shape"),
        ({"weights_vertical": np.ones((1, 3))}, r"weights_vertical: expected integers"),
        (
            {"weights_vertical": np.full((1, 3), 2**26, np.int32)},
            r"smoothness times weight: expected below",
        ),
    ],
)
def test_bad_energies_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        mrf.Energy(**{**GOOD, **changes})


def test_published_table_is_absolute_difference_but_for_its_last_step() -> None:
    table = mrf.published(256)
    assert table[:229].tolist() == list(range(229))
    assert table[229:].tolist() == list(range(228, 255))


def test_adaptive_potts_weights_follow_the_threshold() -> None:
    right, down = mrf.adaptive_potts_weights(np.array([[0, 5, 11], [6, 5, 5]]), threshold=5)
    assert right.tolist() == [[2, 1], [2, 2]]
    assert down.tolist() == [[1, 2, 1]]


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: mrf.published(1), "labels: expected at least 2, got 1"),
        (lambda: mrf.potts(4, cap=0), "scale: expected 1 to"),
        (lambda: mrf.truncated_absolute(4, cap=-1), "cap: expected 1 to"),
        (lambda: mrf.truncated_quadratic(60000, cap=2**26, scale=4), "smoothness: expected below"),
        (lambda: mrf.adaptive_potts_weights(np.zeros((2, 2, 3)), 1), "image: expected a shape"),
    ],
)
def test_bad_tables_are_refused(build: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        build()


def test_adaptive_potts_moves_edges_to_where_the_image_changes() -> None:
    image = np.array([[10, 10, 10, 90, 90, 90]], np.uint8)
    right, down = mrf.adaptive_potts_weights(image, threshold=5)
    unary = np.array([[[0, 3], [0, 3], [1, 1], [1, 1], [3, 0], [3, 0]]], np.uint16)
    solution = mrf.expansion(mrf.Energy(unary, mrf.potts(2, cap=1), right, down))
    assert solution.labels.tolist() == [[0, 0, 0, 1, 1, 1]]
