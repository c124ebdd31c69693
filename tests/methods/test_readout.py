import numpy as np
import pytest

from dfdbench.methods.readout import least_label, read_out


@pytest.mark.parametrize("where", [0.6, 1.0, 2.3, 3.49])
def test_the_minimum_of_a_parabola_is_found_exactly(where: float) -> None:
    costs = (np.arange(6.0) - where)[:, np.newaxis, np.newaxis] ** 2
    assert least_label(costs)[0, 0] == pytest.approx(where)


# At either end, of fewer labels than a parabola needs, and of equal costs the first.
@pytest.mark.parametrize(
    ("costs", "label"), [([0, 1, 9], 0), ([5, 3, 1], 2), ([0], 0), ([1, 0], 1), ([7] * 5, 0)]
)
def test_a_label_without_a_parabola_stays_whole(costs: list[int], label: int) -> None:
    assert least_label(np.array(costs, np.uint16).reshape(-1, 1, 1)).tolist() == [[label]]


@pytest.mark.parametrize("sharpness", [0.5, 1, 4])
def test_the_median_of_a_bell_is_its_middle(sharpness: float) -> None:
    labels = np.arange(100.0)[:, np.newaxis, np.newaxis]
    middles = np.array([[40.0, 50.3, 61.7]])
    found = read_out((labels - middles) ** 2 / 50, sharpness)
    np.testing.assert_allclose(found, middles, atol=0.02)


def test_the_median_of_two_heaps_lies_in_the_heavier() -> None:
    shares = np.zeros(100)
    shares[10], shares[79:82] = 0.4, 0.2
    costs = -np.log(np.maximum(shares, 1e-9))[:, np.newaxis, np.newaxis]
    assert read_out(costs, 0) == 10
    assert 78.5 < read_out(costs, 1)[0, 0] < 80
