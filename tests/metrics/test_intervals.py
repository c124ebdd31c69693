import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dfdbench.metrics.intervals import bootstrap_interval, scene_interval


@given(
    values=st.lists(st.floats(0, 1), min_size=4, max_size=12),
    shift=st.floats(-5, 5),
    seed=st.integers(0, 3),
)
def test_the_interval_holds_the_mean_of_equal_scenes_and_moves_with_it(
    values: list[float], shift: float, seed: int
) -> None:
    scenes = [f"s{number % 4}" for number in range(len(values))]
    interval = bootstrap_interval(values, scenes, seed)
    assert interval is not None
    low, high = interval
    assert min(values) - 1e-9 <= low <= high <= max(values) + 1e-9
    moved = bootstrap_interval([value + shift for value in values], scenes, seed)
    assert moved == pytest.approx((low + shift, high + shift), abs=1e-9)


def test_of_many_scenes_it_holds_95_percent() -> None:
    values = [float(number) for number in range(100)]
    scenes = [str(value) for value in values]
    found = [bootstrap_interval(values, scenes, seed) or (np.nan, np.nan) for seed in range(10)]
    ends = np.mean(found, axis=0)
    # As a normal distribution's: 1.96 standard errors to either side.
    errors = (ends - np.mean(values)) / (np.std(values) / 10)
    assert errors == pytest.approx([-1.96, 1.96], abs=0.05)


def test_one_scene_has_no_interval() -> None:
    assert bootstrap_interval([1.0, 2.0], ["a", "a"]) is None


def test_scenes_are_drawn_not_pairs() -> None:
    # Two scenes, 50 equal pairs each: drawing pairs would give a narrow interval.
    interval = bootstrap_interval([0.0] * 50 + [1.0] * 50, ["a"] * 50 + ["b"] * 50)
    assert interval == (0.0, 1.0)
    assert not math.isnan(interval[0])


@pytest.mark.parametrize("count", [2, 3, 4, 5, 6, 9])
def test_few_scenes_give_the_range_of_their_means_and_six_an_interval(count: int) -> None:
    scenes = [f"s{number}" for number in range(count) for _ in range(2)]
    values = [float(number) for number in range(2 * count)]
    means = [2 * number + 0.5 for number in range(count)]
    if count < 6:
        assert scene_interval(values, scenes) == (means[0], means[-1])
    else:
        interval = scene_interval(values, scenes)
        assert interval == bootstrap_interval(values, scenes)
        assert interval is not None
        assert means[0] < interval[0] < interval[1] < means[-1]
    assert scene_interval([1.0, 2.0], ["a", "a"]) is None
