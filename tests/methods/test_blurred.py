import numpy as np
import pytest

from dfdbench.blur.law import BlurLaw
from dfdbench.blur.point_spread import point_spread_functions
from dfdbench.methods import blurred as blurring
from dfdbench.methods.information import information
from tests.methods.test_law_cost import pair

LAW = BlurLaw((2.4, 1.1, 0.4), kernel_size=9)
WHOLE = slice(None)


@pytest.mark.parametrize(("exponent", "most"), [(2.0, 20), (32.0, 40)])
def test_few_kernels_stand_for_all(exponent: float, most: int) -> None:
    planes = point_spread_functions(np.linspace(0.3, 3.2, 256), 27, exponent).reshape(256, -1)
    chosen, factors = blurring.few_kernels(planes, 2e-4)
    assert len(chosen) <= most
    # Least squares leave no more than what was left when choosing ended, but for its norm.
    assert np.abs(factors.T @ planes[chosen] - planes).sum(axis=1).max() < 4e-4


@pytest.mark.parametrize("rows", [slice(0, 1), slice(3, 9), slice(20, 21), WHOLE])
@pytest.mark.parametrize("columns", [slice(0, 5), slice(12, 26), WHOLE])
def test_a_part_is_blurred_as_in_the_whole(rows: slice, columns: slice) -> None:
    whole = blurring.blurred_by(LAW, *pair())
    part = whole.part(rows, columns)
    assert np.abs(part.nodes - whole.nodes[rows, columns]).max() < 1e-3
    assert np.array_equal(part.aim, whole.aim[rows, columns])
    assert np.array_equal(part.noise, whole.noise[rows, columns])


def test_a_large_image_has_as_much_information_in_bands(monkeypatch: pytest.MonkeyPatch) -> None:
    whole, levels = blurring.blurred_by(LAW, *pair()), np.arange(3)
    expected = information(whole, levels)
    monkeypatch.setattr(blurring, "_MOST_BYTES", 8 * whole.nodes[0].nbytes)
    bands = list(whole.bands())
    assert [len(band.aim) for band in bands] == [8, 8, 5]
    assert information(whole, levels) == pytest.approx(expected, rel=1e-5)
