import numpy as np
import pytest

from dfdbench.methods.winner import least_label


@pytest.mark.parametrize("where", [0.6, 1.0, 2.3, 3.49])
def test_the_minimum_of_a_parabola_is_found_exactly(where: float) -> None:
    costs = (np.arange(6.0) - where)[:, np.newaxis, np.newaxis] ** 2
    assert least_label(costs)[0, 0] == pytest.approx(where)


def test_the_ends_stay_as_they_are() -> None:
    costs = np.array([[0, 5], [1, 3], [9, 1]], np.uint16)[:, np.newaxis]
    assert least_label(costs).tolist() == [[0, 2]]


@pytest.mark.parametrize("labels", [1, 2])
def test_fewer_labels_than_a_parabola_needs(labels: int) -> None:
    assert least_label(np.arange(labels)[::-1].reshape(-1, 1, 1)).tolist() == [[labels - 1]]


def test_equal_costs_give_the_first() -> None:
    assert least_label(np.full((5, 1, 1), 7, np.uint16)).tolist() == [[0]]
