import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from dfdbench.audit.coverage import Coverage, Criterion, DensityBound, Verdict, uncovered
from dfdbench.audit.depth_histogram import DepthHistogram, depth_histogram
from dfdbench.audit.level_ranges import as_ranges
from dfdbench.blur.recipe import LEVELS
from dfdbench.errors import InputError

COUNTS = arrays(np.int64, LEVELS, elements=st.integers(0, 1000))


def histogram(**levels: int) -> DepthHistogram:
    counts = np.zeros(LEVELS, np.int64)
    for level, pixels in levels.items():
        counts[int(level[1:])] = pixels
    return DepthHistogram(counts, counts.astype(np.float64), 0, 1)


def test_each_verdict_and_each_criterion_has_its_case() -> None:
    train = histogram(l10=100_000, l20=5, l30=9_000, l50=40)
    test = histogram(l10=1_000, l20=6, l30=1_000, l40=1, l50=40)
    coverage = Coverage(train, test, DensityBound(factor=4, floor=0.01))
    assert as_ranges(coverage.missing) == "40"
    # 20: six pixels against five, too few for the density criterion; 30: the other way round.
    assert as_ranges(coverage.uncovered(Criterion.thesis)) == "20, 40"
    assert as_ranges(coverage.uncovered(Criterion.density)) == "30, 50"
    assert as_ranges(coverage.scarce) == "20, 30, 50"
    assert coverage.verdicts[10] is Verdict.covered
    assert coverage.verdicts[40] is Verdict.missing
    assert coverage.verdicts[11] is None
    assert coverage.share(coverage.missing) == pytest.approx(1 / 2047)


def test_a_count_as_large_as_in_training_is_covered() -> None:
    coverage = Coverage(histogram(l9=7), histogram(l9=7))
    assert not coverage.uncovered(Criterion.thesis).any()


@given(COUNTS, COUNTS)
def test_criteria_agree_with_each_other(train: NDArray[np.int64], test: NDArray[np.int64]) -> None:
    bound = DensityBound()
    by = {c: uncovered(train, test, c, bound) for c in Criterion}
    assert ((by[Criterion.thesis] | by[Criterion.density]) == by[Criterion.either]).all()
    missing = (test > 0) & (train == 0)
    assert not (missing & ~by[Criterion.thesis]).any()
    assert not (by[Criterion.either] & (test == 0)).any()
    # The density criterion does not depend on the sizes of the sets, the thesis's does.
    assert (uncovered(3 * train, test, Criterion.density, bound) == by[Criterion.density]).all()


def test_a_set_that_trains_and_tests_is_covered() -> None:
    random = np.random.default_rng(0)
    depth = random.integers(0, 256, (40, 50)).astype(np.uint8)
    side = depth_histogram(depth, depth > 0)
    assert Coverage(side, side).share(Coverage(side, side).uncovered()) == 0


def test_what_is_no_bound_is_refused() -> None:
    with pytest.raises(InputError, match="density factor"):
        DensityBound(factor=0.5)
    with pytest.raises(InputError, match="density floor"):
        DensityBound(floor=float("nan"))
