from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dfdbench.methods.mrf import (
    Energy,
    adaptive_potts_weights,
    expansion,
    potts,
    published,
    truncated_absolute,
    truncated_quadratic,
)


def test_published_table_is_absolute_difference_but_for_its_last_step() -> None:
    table = published(256)
    assert table[:229].tolist() == list(range(229))
    assert table[229:].tolist() == list(range(228, 255))


def test_adaptive_potts_weights_follow_the_threshold() -> None:
    right, down = adaptive_potts_weights(np.array([[0, 5, 11], [6, 5, 5]]), threshold=5)
    assert right.tolist() == [[2, 1], [2, 2]]
    assert down.tolist() == [[1, 2, 1]]


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: published(1), "labels: expected at least 2, got 1"),
        (lambda: potts(4, cap=0), "scale: expected 1 to"),
        (lambda: truncated_absolute(4, cap=-1), "cap: expected 1 to"),
        (lambda: truncated_quadratic(60000, cap=2**26, scale=4), "smoothness: expected below"),
        (lambda: adaptive_potts_weights(np.zeros((2, 2, 3)), 1), "image: expected a shape"),
    ],
)
def test_bad_tables_are_refused(build: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        build()


def test_adaptive_potts_moves_edges_to_where_the_image_changes() -> None:
    image = np.array([[10, 10, 10, 90, 90, 90]], np.uint8)
    right, down = adaptive_potts_weights(image, threshold=5)
    unary = np.array([[[0, 3], [0, 3], [1, 1], [1, 1], [3, 0], [3, 0]]], np.uint16)
    solution = expansion(Energy(unary, potts(2, cap=1), right, down))
    assert solution.labels.tolist() == [[0, 0, 0, 1, 1, 1]]
