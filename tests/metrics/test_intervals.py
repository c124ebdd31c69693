"""Intervals hold what they say, tests agree with them, and Holm's correction corrects."""

import itertools
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import optimize, stats

from dfdbench.metrics.intervals import (
    GROUPS_TO_TELL,
    INTERVAL_GROUPS,
    chance,
    group_interval,
    holm,
    interval_name,
)

#: Errors of group means, each with the mean 0.
DRAWN: dict[str, Callable[[np.random.Generator, tuple[int, int]], NDArray[np.float64]]] = {
    "normal": lambda random, shape: random.normal(size=shape),
    "lognormal": lambda random, shape: random.lognormal(0, 0.5, shape) - np.exp(0.125),
    "exponential": lambda random, shape: random.exponential(size=shape) - 1,
}


def covered(values: NDArray[np.float64], groups: list[str]) -> float:
    ends = np.array([group_interval(row, groups) for row in values.tolist()])
    return float(np.mean((ends[:, 0] <= 0) & (ends[:, 1] >= 0)))


@pytest.mark.parametrize("drawn", DRAWN)
@pytest.mark.parametrize("count", [8, 16, 24])
def test_of_100_intervals_95_hold_the_true_mean(drawn: str, count: int) -> None:
    values = DRAWN[drawn](np.random.default_rng(count), (6000, count))
    assert 0.93 <= covered(values, [f"g{number}" for number in range(count)]) <= 0.97


@pytest.mark.parametrize("count", [8, 16, 24])
def test_of_very_long_tails_fewer_intervals_hold_the_true_mean(count: int) -> None:
    values = np.random.default_rng(count).lognormal(0, 1, (6000, count)) - np.exp(0.5)
    assert 0.89 <= covered(values, [f"g{number}" for number in range(count)]) <= 0.945


@pytest.mark.parametrize("drawn", DRAWN)
def test_groups_of_several_sizes_keep_intervals_wide(drawn: str) -> None:
    # As Middlebury's families: either all scenes of a group err alike, or none has to do with it.
    sizes = [1] * 10 + [2] * 5 + [3, 4]
    random = np.random.default_rng(0)
    alike = np.repeat(DRAWN[drawn](random, (3000, len(sizes))), sizes, axis=1)
    alone = DRAWN[drawn](random, (3000, sum(sizes)))
    groups = [f"g{number}" for number, size in enumerate(sizes) for _ in range(size)]
    for errors in (alike, alone):
        assert 0.94 <= covered(errors, groups) <= 0.985


def test_each_end_is_the_farther_of_student_s_and_hall_s() -> None:
    values = stats.expon.rvs(size=24, random_state=3)
    count, spread, skewness = 24, values.std(ddof=1), stats.skew(values, bias=False)
    quantile = stats.t.ppf(0.975, count - 1)

    def hall(mean: float) -> float:
        t = (values.mean() - mean) / spread
        even = t + skewness * t**2 / 3 + skewness**2 * t**3 / 27 + skewness / (6 * count)
        return float(np.sqrt(count) * even)

    wide = [values.mean() - 3 * spread, values.mean() + 3 * spread]
    ends = [optimize.brentq(lambda m, e=end: hall(m) - e, *wide) for end in (quantile, -quantile)]
    student = stats.ttest_1samp(values, 0).confidence_interval(0.95)
    expected = min(ends[0], student.low), max(ends[1], student.high)
    assert group_interval(values.tolist(), list(map(str, range(count)))) == pytest.approx(expected)
    assert expected[0] == student.low
    assert expected[1] > student.high


def test_values_that_mirror_each_other_have_student_s_interval_and_chance() -> None:
    values = np.array([0.1, 0.3, 0.4, 0.5, 0.7, 0.8, 0.9, 1.1])
    found = stats.ttest_1samp(values, 0)
    groups = list("abcdefgh")
    assert group_interval(values.tolist(), groups) == pytest.approx(found.confidence_interval(0.95))
    assert chance(values.tolist(), groups) == pytest.approx(found.pvalue)


@given(
    values=st.lists(st.floats(-1, 1).map(lambda v: round(v, 6)), min_size=9, max_size=30),
    shift=st.floats(-2, 2),
)
def test_chance_is_below_5_percent_if_0_is_outside(values: list[float], shift: float) -> None:
    assume(np.std(values) > 1e-5)
    groups = [f"g{number % 9}" for number in range(len(values))]
    moved = [value + shift for value in values]
    interval, p = group_interval(moved, groups), chance(moved, groups)
    assert interval is not None
    assert p is not None
    assert (p < 0.05) == (not interval[0] <= 0 <= interval[1])
    low, high = group_interval(values, groups) or (np.nan, np.nan)
    assert interval == pytest.approx((low + shift, high + shift), abs=1e-6)
    assert low <= np.mean(values) <= high


def test_chance_agrees_with_the_interval_at_other_levels(monkeypatch: pytest.MonkeyPatch) -> None:
    random, groups = np.random.default_rng(2), [str(number) for number in range(12)]
    for level in (0.01, 0.002):
        monkeypatch.setattr("dfdbench.metrics.intervals.LEVEL", level)
        told = []
        for shift in np.linspace(0.3, 3, 150):
            values = (random.exponential(size=12) - 1 - shift).tolist()
            low, high = group_interval(values, groups) or (np.nan, np.nan)
            told.append(not low <= 0 <= high)
            assert told[-1] == ((chance(values, groups) or 0) < level)
        assert 20 < sum(told) < 140


def test_chance_falls_as_a_skewed_difference_grows() -> None:
    # Two rooms of 24 lean far the other way: without its limit the cubic would be flat here.
    values = stats.zscore([-3.0, -1.0, *[0.2] * 22], ddof=1)
    groups = [str(number) for number in range(24)]
    found = [chance((values + mean).tolist(), groups) or 0 for mean in (1, 1.2, 1.4, 1.6, 2, 2.5)]
    assert found[0] < 0.05
    assert all(after < 0.3 * before for before, after in itertools.pairwise(found))
    assert found[-1] < 1e-6


def test_more_captures_of_the_same_groups_tell_no_more() -> None:
    values, groups = [0.1, 0.2, 0.4, 0.1, 0.3, 0.7, 0.2, 0.5], list("abcdefgh")
    assert group_interval(values * 50, groups * 50) == pytest.approx(group_interval(values, groups))


@pytest.mark.parametrize("count", range(2, 11))
def test_few_groups_give_the_range_of_their_means(count: int) -> None:
    groups = [f"s{number}" for number in range(count) for _ in range(2)]
    values = [float(number) for number in range(2 * count)]
    ends = (0.5, 2 * count - 1.5)
    assert (group_interval(values, groups) == ends) == (count < INTERVAL_GROUPS)
    assert (chance(values, groups) is None) == (count < INTERVAL_GROUPS)
    assert (interval_name(count) == "95 %") == (count >= INTERVAL_GROUPS)


def test_one_group_has_no_interval_and_what_never_differs_is_no_chance() -> None:
    assert group_interval([1.0, 2.0], ["a", "a"]) is None
    groups = [str(number) for number in range(GROUPS_TO_TELL)]
    assert chance([0.0] * GROUPS_TO_TELL, groups) == 1
    assert chance([0.5] * GROUPS_TO_TELL, groups) == pytest.approx(0)
    assert group_interval([0.5] * GROUPS_TO_TELL, groups) == pytest.approx((0.5, 0.5))


@given(st.lists(st.floats(0, 1), min_size=1, max_size=12))
def test_holm_rejects_step_by_step(chances: list[float]) -> None:
    # As the procedure is told: the smallest against 0.05 / m, the next against 0.05 / (m - 1), ...
    rejected = 0
    for p in sorted(chances):
        if p >= 0.05 / (len(chances) - rejected):
            break
        rejected += 1
    assume(all(abs(p * k - 0.05) > 1e-9 for p in chances for k in range(1, 13)))
    found = [p for p in holm(chances) if p is not None]
    assert sum(p < 0.05 for p in found) == rejected
    assert [found[at] for at in np.argsort(chances, kind="stable")] == sorted(found)
    assert all(p <= c <= 1 for p, c in zip(chances, found, strict=True))


def test_of_tables_without_any_difference_5_percent_call_one_real() -> None:
    random = np.random.default_rng(1)
    groups = [str(number) for number in range(12)]
    errors = random.normal(size=(1500, 8, 12))
    tables = [[chance(row.tolist(), groups) for row in table] for table in errors]
    told = [min(p for p in holm(table) if p is not None) < 0.05 for table in tables]
    assert 0.02 <= np.mean(told) <= 0.06
