from pathlib import Path

import pytest

from dfdbench.errors import UnknownNameError
from dfdbench.metrics.metric import METRICS
from dfdbench.report.paper_table import paper_tables
from dfdbench.results.record import Result
from dfdbench.tables.render import as_latex
from dfdbench.tables.table import Marked
from tests.made_results import edited, limited, make_demo_result, saved


def scored(value: float, name: str) -> Result:
    return make_demo_result(lambda _: value, name)


def test_the_best_of_each_metric_is_marked_and_the_data_are_named(tmp_path: Path) -> None:
    runs = saved(tmp_path, scored(0.3, "c"), scored(0.1, "a"), scored(0.2, "b"))
    (table,) = paper_tables(runs, "valid")
    assert [row[0] for row in table.rows] == ["a", "b", "c"]
    marks = [[getattr(cell, "mark", "") for cell in row[2:]] for row in table.rows]
    # SSIM is the larger the better; seconds of several machines have no best.
    assert marks == [["best"] * 3 + [""], ["second"] * 3 + [""], [""] * 4]
    assert table.title.startswith("demo-1, split test (54 pairs of 3 scenes), protocol valid")
    assert f"data {'2' * 16}" in table.title
    assert r"\textbf{0.1000} & \textbf{0.0500} & \textbf{0.9000}" in as_latex(table)
    assert table.records[0]["fingerprint"] == "2" * 64


def test_what_reads_the_same_is_marked_the_same(tmp_path: Path) -> None:
    runs = saved(tmp_path, scored(0.10001, "a"), scored(0.10002, "b"), scored(0.2, "c"))
    (table,) = paper_tables(runs, "valid", ["nrmse"])
    assert [getattr(row[2], "mark", "") for row in table.rows] == ["best", "best", "second"]


def test_where_no_mean_is_shown_the_note_says_why(tmp_path: Path) -> None:
    gaps, nothing = (make_demo_result(lambda _: 0.01, name) for name in ("gaps", "nothing"))
    none = {"thesis": dict.fromkeys(METRICS), "valid": dict.fromkeys(METRICS)}
    some = [edited(pair, answered=0.5, scores=none) for pair in gaps.pairs[:4]]
    gaps = limited(edited(gaps, pairs=some + gaps.pairs[4:]), 5)
    runs = saved(tmp_path, make_demo_result(lambda _: 0.3, "whole"), gaps, limited(nothing, 0))
    (table,) = paper_tables(runs, "valid", ["nrmse"])
    assert {row[0]: row[2] for row in table.rows[1:]} == {"gaps": "–", "nothing": "–"}
    assert "gaps: not ranked: 4 pairs without an answer for every pixel" in table.notes
    assert "nothing: not ranked: 0 of 54 pairs evaluated" in table.notes


def test_an_incomplete_run_shows_what_it_has_and_is_not_marked(tmp_path: Path) -> None:
    stopped = limited(make_demo_result(lambda _: 0.01, "stopped"), 7)
    runs = saved(tmp_path, make_demo_result(lambda _: 0.3, "whole"), stopped)
    (table,) = paper_tables(runs, "valid", ["nrmse"])
    assert table.rows[1][::2] == ("stopped", "(0.0100)")
    assert not any(isinstance(cell, Marked) for row in table.rows for cell in row)
    note = "stopped: not ranked: 7 of 54 pairs evaluated; their means are in brackets"
    assert note in table.notes
    assert table.records[1]["nrmse"] is None


def test_columns_are_chosen_and_other_data_is_another_table(tmp_path: Path) -> None:
    other = make_demo_result(lambda _: 0.1, fingerprint="5" * 64)
    runs = saved(tmp_path, make_demo_result(lambda _: 0.1), other)
    tables = paper_tables(runs, "valid", ["seconds", "ssim", "seconds"])
    labels = [table.label for table in tables]
    assert labels == ["demo-1 test valid 22222222", "demo-1 test valid 55555555"]
    assert [table.columns[2:] for table in tables] == [("seconds per pair", "SSIM ↑")] * 2
    with pytest.raises(UnknownNameError, match="unknown metric of protocol valid"):
        paper_tables(saved(tmp_path, other), "valid", ["nrms"])
    with pytest.raises(UnknownNameError):
        paper_tables(saved(tmp_path, other), "thesis")
