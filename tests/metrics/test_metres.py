"""AbsRel, RMSE, delta and alignment, against values worked out by hand."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from dfdbench.errors import InputError
from dfdbench.metrics.metres import abs_rel, aligned, boundary_f1, rmse_metres, share_within

Floats = NDArray[np.float64]
SHAPE = (5, 7)
metres = hnp.arrays(np.float64, SHAPE, elements=st.floats(0.125, 64, width=32))
masks = hnp.arrays(np.bool_, SHAPE)


def test_values_by_hand() -> None:
    truth = np.array([[1.0, 2.0], [4.0, 8.0]])
    test = np.array([[1.5, 2.0], [3.0, 16.0]])
    # 0.5 / 1, 0, 1 / 4, 8 / 8.
    assert abs_rel(truth, test) == pytest.approx(1.75 / 4)
    assert rmse_metres(truth, test) == pytest.approx(math.sqrt((0.25 + 0 + 1 + 64) / 4))
    # Ratios 1.5, 1, 4 / 3 and 2, against 1.25, 1.5625 and 1.953125.
    assert share_within(truth, test) == 0.25
    assert share_within(truth, test, factor=1.25**2) == 0.75
    assert share_within(truth, test, factor=1.25**3) == 0.75
    mask = np.array([[True, False], [True, False]])
    assert abs_rel(truth, test, mask=mask) == pytest.approx(0.375)
    assert rmse_metres(truth, test, mask=mask) == pytest.approx(math.sqrt(0.625))
    assert share_within(truth, test, mask=mask, factor=1.4) == 0.5


def test_the_bound_itself_is_outside() -> None:
    assert share_within([[4.0, 5.0]], [[5.0, 4.0]]) == 0


def test_boundaries_by_hand() -> None:
    # One of two edges found, at every threshold.
    assert boundary_f1([[1.0, 2.0, 2.0, 4.0]], [[1.0, 2.0, 2.0, 2.0]]) == pytest.approx(2 / 3)
    # A step of 1.1 is an edge at the three lowest thresholds; each weighs what it is.
    low = (1.05 + 1.07222 + 1.09444) / (10 * 1.15)
    assert boundary_f1([[1.0, 2.0]], [[1.0, 1.1]]) == pytest.approx(low, abs=1e-5)
    # A step of a threshold is no edge at it.
    assert boundary_f1([[1.0, 2.0]], [[1.0, 1.05]]) == 0
    assert math.isnan(boundary_f1([[1.0, 1.05]], [[1.0, 2.0]]))


def test_alignment_by_hand() -> None:
    # Inverse depths 1, 2, 3 and, estimated, 0, 0 and 3 of a unit, plus 1: means 2 and 2. The
    # scale is (-1 * -1 + 0 * -1 + 1 * 2) / (1 + 1 + 4) = 1 / 2.
    truth = 1 / np.array([[1.0, 2.0, 3.0]])
    test = 1 / np.array([[1.0, 1.0, 4.0]])
    np.testing.assert_allclose(1 / aligned(truth, test, 100.0), [[1.5, 1.5, 3.0]])


def test_inverse_depth_at_zero_or_below_counts_as_the_farthest() -> None:
    # A scale of 1 and a shift of -1 from the two known pixels: the third comes to -0.5, the
    # fourth to 0.05, beyond 10 m.
    truth = 1 / np.array([[1.0, 2.0, 1.0, 1.0]])
    test = 1 / np.array([[2.0, 3.0, 0.5, 1.05]])
    mask = np.array([[True, True, False, False]])
    np.testing.assert_allclose(aligned(truth, test, 10.0, mask), [[1.0, 0.5, 10.0, 10.0]])


def test_a_flat_estimate_becomes_the_mean_of_the_inverse_truth() -> None:
    truth = 1 / np.array([[1.0, 2.0, 6.0]])
    for level in (0.3, 1 / 3, 7.0):
        np.testing.assert_allclose(aligned(truth, np.full((1, 3), level), 10.0), 1 / 3)


def test_a_map_that_goes_the_wrong_way_is_turned() -> None:
    truth = 1 / np.array([[1.0, 2.0, 4.0]])
    np.testing.assert_allclose(aligned(truth, 1 / (5 - 1 / truth), 10.0), truth)


@given(truth=metres, mask=masks)
def test_the_truth_itself_is_perfect(truth: Floats, mask: NDArray[np.bool_]) -> None:
    assume(mask.any())
    assert abs_rel(truth, truth, mask=mask) == rmse_metres(truth, truth, mask=mask) == 0
    assert share_within(truth, truth, mask=mask) == 1


@given(truth=metres, test=metres)
def test_delta_is_the_same_both_ways_and_grows_with_its_bound(truth: Floats, test: Floats) -> None:
    shares = [share_within(truth, test, factor=1.25**power) for power in (1, 2, 3)]
    assert shares == sorted(shares)
    assert shares == [share_within(test, truth, factor=1.25**power) for power in (1, 2, 3)]


@given(truth=metres, test=metres, factor=st.sampled_from([0.25, 2.0, 8.0]))
def test_relative_errors_know_no_unit_and_rmse_does(
    truth: Floats, test: Floats, factor: float
) -> None:
    assert abs_rel(truth * factor, test * factor) == pytest.approx(abs_rel(truth, test))
    assert share_within(truth * factor, test * factor) == share_within(truth, test)
    assert rmse_metres(truth * factor, test * factor) == pytest.approx(
        factor * rmse_metres(truth, test)
    )


@given(truth=metres, test=metres, mask=masks)
def test_what_does_not_count_does_not_count(
    truth: Floats, test: Floats, mask: NDArray[np.bool_]
) -> None:
    assume(mask.any())
    other = np.where(mask, test, 1.0)
    for metric in (abs_rel, rmse_metres, share_within):
        assert metric(truth, test, mask=mask) == metric(truth, other, mask=mask)
    np.testing.assert_array_equal(
        aligned(truth, test, 64.0, mask)[mask], aligned(truth, other, 64.0, mask)[mask]
    )


@given(truth=metres, test=metres)
def test_no_other_scale_and_shift_fits_better(truth: Floats, test: Floats) -> None:
    # Where no pixel is held at the farthest, which is made all but unreachable here.
    assume(np.ptp(1 / test) > 1e-3)
    found = 1 / aligned(truth, test, 1e30)
    assume(found.min() > 1e-12)
    left = float(np.sum((found - 1 / truth) ** 2))
    rows = np.stack([1 / test.ravel(), np.ones(test.size)], axis=1)
    best = rows @ np.linalg.lstsq(rows, 1 / truth.ravel(), rcond=None)[0]
    assert left <= float(np.sum((best - 1 / truth.ravel()) ** 2)) * (1 + 1e-9) + 1e-9


@given(truth=metres, scale=st.floats(0.25, 4), shift=st.floats(0, 2))
def test_alignment_undoes_scale_and_shift(truth: Floats, scale: float, shift: float) -> None:
    assume(np.ptp(1 / truth) > 1e-3)
    moved = 1 / (scale / truth + shift)
    np.testing.assert_allclose(aligned(truth, moved, 64.0), truth, rtol=1e-5)


@given(truth=metres, test=metres)
def test_aligned_distances_are_distances(truth: Floats, test: Floats) -> None:
    found = aligned(truth, test, 64.0)
    assert np.isfinite(found).all()
    assert (found > 0).all()
    assert found.max() <= 64 * (1 + 1e-12)


def test_no_pixel_is_undefined() -> None:
    nothing = np.zeros((1, 2), bool)
    for metric in (abs_rel, rmse_metres, share_within):
        assert math.isnan(metric([[1.0, 2.0]], [[1.0, 2.0]], mask=nothing))
    assert aligned([[1.0, 2.0]], [[3.0, 4.0]], 9.0, nothing).tolist() == [[3.0, 4.0]]


@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan, math.inf])
def test_what_is_no_distance_is_refused(bad: float) -> None:
    for metric in (abs_rel, rmse_metres, share_within):
        with pytest.raises(InputError, match=r"no distance|not finite"):
            metric([[1.0, 2.0]], [[bad, 2.0]])
    with pytest.raises(InputError, match="farthest"):
        aligned([[1.0, 2.0]], [[1.0, 2.0]], bad)
