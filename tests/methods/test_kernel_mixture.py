import numpy as np
import pytest

from dfdbench.blur.point_spread import point_spread_functions
from dfdbench.methods.kernel_mixture import few_kernels


@pytest.mark.parametrize(("exponent", "most"), [(2.0, 20), (32.0, 40)])
def test_few_kernels_stand_for_all(exponent: float, most: int) -> None:
    planes = point_spread_functions(np.linspace(0.3, 3.2, 256), 27, exponent).reshape(256, -1)
    chosen, factors = few_kernels(planes, 2e-4)
    assert len(chosen) <= most
    # Least squares leave no more than what was left when choosing ended, but for its norm.
    assert np.abs(factors.T @ planes[chosen] - planes).sum(axis=1).max() < 4e-4
