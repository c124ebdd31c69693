import csv
import io
import json

import pytest

from dfdbench.errors import UnknownNameError
from dfdbench.results.run_data import run_as_csv, run_as_json
from dfdbench.results.run_tables import run_tables
from dfdbench.results.summary import summarise
from dfdbench.tables.render import as_rich, render
from dfdbench.tables.table import Format, Table
from tests.made_results import make_result

VALUES = {
    (scene, view, illumination, exposure): 0.01 * (1 + number)
    for number, (scene, view, illumination, exposure) in enumerate(
        (s, v, i, e) for s in ("a", "b") for v in (1, 5) for i in (1, 2) for e in (0, 1)
    )
}


def test_a_run_has_scores_extremes_and_times() -> None:
    scores, extremes, times = run_tables(summarise(make_result(VALUES), "thesis"))
    assert scores.columns[:4] == ("exposure", "illumination", "NRMSE ↓", "std")
    assert "SSIM ↑" in scores.columns
    places = [row[:2] for row in scores.rows]
    assert places == [
        ("0", "1"),
        ("0", "2"),
        ("0", "overall"),
        ("1", "1"),
        ("1", "2"),
        ("1", "overall"),
        ("overall", ""),
    ]
    assert "pairs" not in scores.columns
    assert scores.rows[-1][2] == "0.0850"
    assert "range of the means of 2 scenes, too few for an interval" in scores.notes[0]
    many = {(scene, 1, 1, 0): 0.1 for scene in "abcdef"}
    notes = run_tables(summarise(make_result(many), "thesis"))[0].notes
    assert "95 % interval of the overall mean, bootstrapped over 6 scenes" in notes[0]
    assert [row[0] for row in extremes.rows] == ["top"] * 5 + ["bottom"] * 5
    assert extremes.rows[0][1:5] == ("a", "1", "1", "0")
    assert extremes.rows[-1][1:5] == ("b", "5", "2", "1")
    assert times.rows[-1][2] == "0.2500"


def test_few_pairs_are_not_both_best_and_worst() -> None:
    few = dict(list(VALUES.items())[:6])
    extremes = run_tables(summarise(make_result(few), "thesis"))[1]
    assert len(extremes.rows) == 6


def test_an_undefined_score_is_shown_as_such() -> None:
    result = make_result({("a", 1, 1, 0): 0.2, ("b", 1, 1, 0): None})
    notes = " ".join(run_tables(summarise(result, "thesis"))[0].notes)
    assert "without a defined score (flat ground truth), in no mean: 1 pair" in notes


def test_failures_are_listed_by_reason_and_leave_no_score() -> None:
    result = make_result(VALUES)
    pairs = [
        pair.model_copy(update={"status": "failed", "scores": {}, "error": "raised X: y"})
        for pair in result.pairs
    ]
    dataset = result.dataset.model_copy(update={"evaluated": 0})
    failed = result.model_copy(update={"pairs": pairs, "dataset": dataset, "averages": None})
    scores, failures = run_tables(summarise(failed, "thesis"))
    assert "PARTIAL" in scores.title
    assert all("–" in row for row in scores.rows)
    assert failures.rows == (("raised X: y", "a/view1/illumination1/exposure0", "16"),)
    json.loads(run_as_json(summarise(failed, "thesis")))


def test_a_protocol_that_was_not_scored() -> None:
    with pytest.raises(UnknownNameError, match="valid"):
        run_tables(summarise(make_result(VALUES), "valid"))


@pytest.mark.parametrize(
    "name", ["a|b", "<script>alert(1)</script>", "[red]x[/red]", 'q"uote', "🐟"]
)
def test_a_name_is_text_never_markup(name: str) -> None:
    markdown = render(run_tables(summarise(make_result(VALUES, name), "thesis")), Format.markdown)
    assert "<script>" not in markdown
    assert "a|b" not in markdown
    title, *_ = as_rich(Table(name, (name,), ((name,),), "l"))
    assert str(title) == name
    rows = list(
        csv.DictReader(io.StringIO(run_as_csv(summarise(make_result(VALUES, name), "thesis"))))
    )
    assert rows[0]["method"] == name


def test_tables_of_simulated_captures_say_so() -> None:
    captured = make_result(VALUES)
    dataset = captured.dataset.model_copy(update={"simulated": True})
    simulated = captured.model_copy(update={"dataset": dataset})
    assert "on tiny-1 (SIMULATED), split" in run_tables(summarise(simulated, "thesis"))[0].title
    assert "on tiny-1, split" in run_tables(summarise(captured, "thesis"))[0].title
