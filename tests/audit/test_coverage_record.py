from pathlib import Path

import pytest

from dfdbench.audit.coverage import Criterion, Verdict
from dfdbench.audit.coverage_record import compare_depths, coverage_schema
from dfdbench.audit.sides import sides_of
from dfdbench.datasets.store import Store

SCHEMA = Path(__file__).parents[2] / "dfdbench/results/schemas/coverage-1.json"


def test_the_published_schema_is_that_of_the_model() -> None:
    assert SCHEMA.read_text("utf-8") == coverage_schema()


def test_ranges_and_shares_add_up(tiny_store: Store) -> None:
    record = compare_depths(*sides_of(tiny_store))
    pixels = record.test.known_pixels
    assert sum(record.test.counts) == pixels
    total = record.shares["missing"] + record.shares["scarce"] + record.shares["covered"]
    assert total == pytest.approx(1)
    assert sum(item.share for item in record.ranges) == pytest.approx(record.shares["either"])
    for item in record.ranges:
        assert sum(item.scenes.values()) == pytest.approx(1)
        assert item.test_pixels == sum(record.test.counts[item.first : item.last + 1])
    missing = record.levels(Verdict.missing)
    assert [
        n > 0 and m == 0 for n, m in zip(record.test.counts, record.train.counts, strict=True)
    ] == missing


def test_criterion_and_allowance_decide(tiny_store: Store) -> None:
    sides = sides_of(tiny_store)
    share = compare_depths(*sides, criterion=Criterion.thesis).uncovered_share
    assert 0 < share < 1
    assert not compare_depths(*sides, criterion=Criterion.thesis).covered
    assert compare_depths(*sides, criterion=Criterion.thesis, allowed_share=share).covered
