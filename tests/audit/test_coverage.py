import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from dfdbench.audit import coverage
from dfdbench.audit.coverage import Criterion, Rule, Verdict, compare_depths
from dfdbench.audit.sides import DepthHistogram, Side, as_ranges, sides_of
from dfdbench.blur.recipe import LEVELS
from dfdbench.datasets.dataset import Dataset

SCHEMA = Path(__file__).parents[2] / "dfdbench/results/schemas/coverage-1.json"
COUNTS = arrays(np.int64, LEVELS, elements=st.integers(0, 1000))


def side(store: Dataset, **levels: int) -> Side:
    counts = np.zeros(LEVELS, np.int64)
    for level, pixels in levels.items():
        counts[int(level[1:])] = pixels
    return Side(store, "made", {"One": DepthHistogram(counts, counts.astype(float), 0, 1)}, ())


def test_each_verdict_and_each_criterion_has_its_case(tiny_store: Dataset) -> None:
    train = side(tiny_store, l10=100_000, l20=5, l30=9_000, l50=40, l60=7)
    test = side(tiny_store, l10=1_000, l20=6, l30=1_000, l40=1, l50=40, l60=7)
    record = compare_depths(train, test, Rule(density_factor=4, density_floor=0.01))
    # 20: six pixels against five, too few for the density criterion; 30: the other way round;
    # 60: as many as in training.
    assert record.ranges_of(Verdict.missing) == "40"
    assert record.ranges_of(Criterion.thesis) == "20, 40"
    assert record.ranges_of(Criterion.density) == "30, 50"
    assert as_ranges(record.levels(Verdict.scarce)) == "20, 30, 50"
    assert as_ranges(record.levels(Verdict.covered)) == "10, 60"
    assert record.verdicts[11] is None
    assert record.shares["missing"] == pytest.approx(1 / 2054)
    assert compare_depths(test, test).covered


@given(COUNTS, COUNTS)
def test_criteria_agree_with_each_other(train: NDArray[np.int64], test: NDArray[np.int64]) -> None:
    rule = Rule()
    by = {c: rule.uncovered(train, test, c) for c in Criterion}
    assert ((by[Criterion.thesis] | by[Criterion.density]) == by[Criterion.either]).all()
    missing = (test > 0) & (train == 0)
    assert not (missing & ~by[Criterion.thesis]).any()
    assert not (by[Criterion.either] & (test == 0)).any()
    # The density criterion does not depend on the sizes of the sets, the thesis's does.
    assert (rule.uncovered(3 * train, test, Criterion.density) == by[Criterion.density]).all()


def test_the_published_schema_is_that_of_the_model() -> None:
    schema = json.dumps(coverage.CoverageRecord.model_json_schema(), indent=1, sort_keys=True)
    assert SCHEMA.read_text("utf-8") == schema + "\n"


def test_ranges_and_shares_add_up_and_criterion_and_allowance_decide(tiny_store: Dataset) -> None:
    sides = sides_of(tiny_store)
    record = compare_depths(*sides)
    assert sum(record.shares[kind] for kind in Verdict) == pytest.approx(1)
    assert sum(item.share for item in record.ranges) == pytest.approx(record.shares["either"])
    for item in record.ranges:
        assert sum(item.scenes.values()) == pytest.approx(1)
        assert item.test_pixels == sum(record.test.counts[item.first : item.last + 1])
    rows = coverage.coverage_table(record).rows
    assert [row[0] for row in rows] == [item.levels for item in record.ranges]
    assert coverage.verdict_line(record).startswith("NOT covered: ")
    allowed = compare_depths(*sides, Rule(allowed_share=1.0))
    assert "100.0 % allowed" in coverage.verdict_line(allowed)
    share = record.shares["thesis"]
    assert 0 < share < 1
    assert not compare_depths(*sides, Rule(Criterion.thesis)).covered
    assert compare_depths(*sides, Rule(Criterion.thesis, share)).covered
