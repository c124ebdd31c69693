import json

from dfdbench.audit.coverage_record import compare_depths
from dfdbench.audit.coverage_tables import coverage_table, each_as_json, each_table, verdict_line
from dfdbench.audit.sides import sides_of
from dfdbench.datasets.store import Store


def test_tables_hold_every_range_and_say_what_counts(tiny_store: Store) -> None:
    record = compare_depths(*sides_of(tiny_store))
    table = coverage_table(record)
    assert [row[0] for row in table.rows] == [item.levels for item in record.ranges]
    assert any("never in training" in note for note in table.notes)
    assert verdict_line(record).startswith("NOT covered: ")
    allowed = compare_depths(*sides_of(tiny_store), allowed_share=1.0)
    assert verdict_line(allowed).startswith("covered: ")
    assert "100.0 % allowed" in verdict_line(allowed)


def test_each_row_is_one_comparison(tiny_store: Store) -> None:
    records = {name: compare_depths(*sides_of(tiny_store, fold=name)) for name in ("K1", "K2")}
    table = each_table(records, "fold")
    assert [row[:2] for row in table.rows] == [("K1", "One, Two"), ("K2", "Three")]
    content = json.loads(each_as_json(records, "fold"))
    assert content["schema_version"] == 1
    assert list(content["records"]) == ["K1", "K2"]
