from typing import Any

import pytest

from dfdbench.training.saved_numbers import finite_number, finite_numbers, whole_number


@pytest.mark.parametrize("value", [-1, 1.0, True, None, "1", [1], 10**30])
def test_only_a_whole_number_within_its_bound_is_one(value: Any) -> None:
    with pytest.raises(ValueError, match=r"^step "):
        whole_number({"step": value}, "step", 9)
    assert whole_number({"step": 9}, "step", 9) == 9
    assert whole_number({"step": 10**30}, "step") == 10**30


@pytest.mark.parametrize("value", [-0.1, 2.1, float("nan"), float("inf"), True, None, "1", 10**400])
def test_only_a_number_within_its_bounds_is_one(value: Any) -> None:
    with pytest.raises(ValueError, match=r"^rate is no number from 0 to 2$"):
        finite_number({"rate": value}, "rate", 2)
    assert finite_number({"rate": 2}, "rate", 2) == 2.0


@pytest.mark.parametrize("value", [None, (1.0,), [1], [float("nan")], ["1"], [1.0] * 4])
def test_only_a_short_list_of_numbers_is_one(value: Any) -> None:
    with pytest.raises(ValueError, match=r"^losses "):
        finite_numbers({"losses": value}, "losses", 3)
    assert finite_numbers({"losses": [1.0, -2.5]}, "losses", 3) == [1.0, -2.5]
