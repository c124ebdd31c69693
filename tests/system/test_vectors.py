from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from dfdbench.system.compiled import compiled
from dfdbench.system.vectors import LANES, all_of, load, plus, store, times, where_below

Numbers = hnp.arrays(np.float64, LANES + 3, elements=st.floats(-1e9, 1e9))


@compiled()
def _multiplied(numbers: Any, factor: float, sums: Any, at: int) -> None:
    store(sums, at, plus(load(sums, at), times(load(numbers, at), all_of(factor))))


@given(Numbers, Numbers, st.floats(-1e9, 1e9), st.integers(0, 3))
def test_products_and_sums_are_rounded_one_by_one(
    numbers: Any, sums: Any, factor: float, at: int
) -> None:
    eight = slice(at, at + LANES)
    exact = sums.copy()
    exact[eight] = sums[eight] + numbers[eight] * factor
    _multiplied(numbers, factor, sums, at)
    assert np.array_equal(sums, exact)


@compiled()
def _kept(numbers: Any, levels: Any, at: int, limit: int, out: Any) -> None:
    store(out, 0, where_below(levels, at, limit, load(numbers, 0)))


@pytest.mark.parametrize("dtype", [np.int16, np.int64])
@pytest.mark.parametrize("limit", [-5, 0, 3])
def test_numbers_are_kept_below_a_limit_and_dropped_from_it_on(dtype: Any, limit: int) -> None:
    numbers, out = np.arange(1.0, LANES + 1), np.full(LANES, np.nan)
    levels = np.array([9, -5, 3, 2, 3, -6, 0, -1, 4, 2], dtype)
    _kept(numbers, levels, 1, limit, out)
    assert np.array_equal(out, np.where(levels[1 : 1 + LANES] < limit, numbers, 0))
