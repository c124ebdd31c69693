from itertools import product

import pytest

from dfdbench.datasets.manifest import Scene, Split
from dfdbench.results import run_tables
from dfdbench.results.summary import summarise
from tests.made_results import edited, make_result

PLACES = product(("a", "b"), (1, 5), (1, 2), (0, 1))
VALUES = {place: 0.01 * (1 + number) for number, place in enumerate(PLACES)}


def test_a_run_has_scores_extremes_and_times() -> None:
    summary = summarise(make_result(VALUES), "thesis")
    scores, extremes, times, _ = run_tables.all_tables(summary, None)
    assert scores.columns[:4] == ("exposure", "illumination", "NRMSE ↓", "std")
    assert "SSIM ↑" in scores.columns
    places = ["|".join(row[:2]) for row in scores.rows]
    assert places == ["0|1", "0|2", "0|overall", "1|1", "1|2", "1|overall", "overall|"]
    assert "pairs" not in scores.columns
    assert scores.rows[-1][2] == "0.0850"
    assert "range of the means of 2 groups of scenes, too few for an interval" in scores.notes[0]
    many: dict[tuple[str, int, int, int], float | None]
    many = {(scene, 1, 1, 0): 0.1 for scene in "abcdefgh"}
    notes = run_tables.run_score_table(summarise(make_result(many), "thesis")).notes
    assert "95 % interval of the overall mean, over 8 groups of scenes" in notes[0]
    # Of one of these the truth is flat: its SSIM alone is defined.
    many["h", 1, 1, 0] = None
    notes = run_tables.run_score_table(summarise(make_result(many), "thesis")).notes
    assert notes[:2] == (
        "range of the means of 7 groups of scenes, too few for an interval: "
        "NRMSE 0.1000 to 0.1000; NMAE 0.0500 to 0.0500",
        "95 % interval of the overall mean, over 8 groups of scenes: SSIM 0.6227 to 0.9682",
    )
    assert [row[0] for row in extremes.rows] == ["top"] * 5 + ["bottom"] * 5
    assert extremes.rows[0][1:5] == ("a", "1", "1", "0")
    assert extremes.rows[-1][1:5] == ("b", "5", "2", "1")
    assert times.rows[-1][2] == "0.2500"


def test_runs_have_a_row_by_region_but_for_those_that_leave_out_what_is_hard() -> None:
    values = {"edges": 0.2, "flat": None, "far": 0.1, "near": 0.05}
    result = make_result({("a", 1, 1, 0): 0.2, ("b", 1, 1, 0): 0.1})
    first = edited(result.pairs[0], regions=values | {"far": 0.3})
    whole, gaps = (
        edited(result, pairs=[first, edited(result.pairs[1], regions=values, answered=share)])
        for share in (1, 0.5)
    )
    table = run_tables.region_table({"all": whole, "most": gaps, "older": result})
    assert table.columns == ("method", "edges", "flat", "far", "near")
    assert table.rows[0] == ("all", "0.2000", "–", "0.2000", "0.0500")
    assert {cell for row in table.rows[1:] for cell in row[1:]} == {"–"}
    assert table.notes[0].startswith("edges: within 3 pixels")


def test_an_undefined_score_is_shown_as_such() -> None:
    result = make_result({("a", 1, 1, 0): 0.2, ("b", 1, 1, 0): None})
    notes = " ".join(run_tables.run_score_table(summarise(result, "thesis")).notes)
    assert "without a defined score (flat ground truth), in no mean: 1 pair" in notes


def test_failures_are_listed_by_reason_and_leave_no_score() -> None:
    result = make_result(VALUES)
    pairs = {"status": "failed", "scores": {}, "error": "raised X: y"}
    failed = edited(result, pairs=pairs, dataset={"evaluated": 0}, averages=None)
    (scores,) = run_tables.all_tables(summarise(failed, "thesis"), None)
    assert "PARTIAL" in scores.title
    assert all("–" in row for row in scores.rows)
    first = "a/view1/illumination1/exposure0"
    assert f"16 pairs failed, the first of them {first}: raised X: y" in scores.notes


def test_the_numbers_come_as_data_in_full() -> None:
    scores, extremes, *_ = run_tables.all_tables(summarise(make_result(VALUES), "thesis"), None)
    whole = {"exposure": "all", "illumination": "all", "metric": "nrmse"}
    (overall,) = (row for row in scores.records if whole.items() <= row.items())
    numbers = {"mean": 0.085, "min": 0.01, "max": 0.16, "low": 0.045, "high": 0.125, "defined": 16}
    assert {name: overall[name] for name in numbers} == pytest.approx(numbers)
    assert (overall["interval"], overall["evaluated"]) == ("range of group means", 16)
    nrmse = [record["nrmse"] for record in extremes.records]
    assert nrmse[:5] + nrmse[-1:] == pytest.approx([0.01, 0.02, 0.03, 0.04, 0.05, 0.16])


def test_tables_of_simulated_captures_say_so() -> None:
    for simulated, said in ((True, "on tiny-1 (SIMULATED), split"), (False, "on tiny-1, split")):
        result = edited(make_result(VALUES), dataset={"simulated": simulated})
        assert said in run_tables.run_score_table(summarise(result, "thesis")).title


LEVELS = {
    ("k00", 1, 1, 0): 0.4,
    ("k00", 1, 1, 1): 0.2,
    ("k01", 1, 1, 0): 0.1,
    ("k04", 1, 1, 0): 0.6,
    ("k05", 1, 1, 0): 0.3,
}


def scene(name: str, geometry: str | None, texture: int | None) -> Scene:
    return Scene(name=name, source="here", geometry=geometry, texture=texture)


def test_scores_are_parted_by_geometry_and_by_texture() -> None:
    scenes = [
        scene("k00", "flat-far", 1),
        scene("k01", "oblique-near-left", 1),
        scene("k04", "flat-far", 2),
        scene("k05", "oblique-near-left", 2),
    ]
    geometry, texture = run_tables.scene_tables(summarise(make_result(LEVELS), "thesis"), scenes)
    assert [row[:3] for row in geometry.rows] == [
        ("flat-far", "k00 k04", "0.4000"),
        ("oblique-near-left", "k01 k05", "0.2000"),
    ]
    assert [row[-1] for row in geometry.rows] == ["3/3", "2/2"]
    assert [row[:3] for row in texture.rows] == [
        ("01", "k00 k01", "0.2333"),
        ("02", "k04 k05", "0.4500"),
    ]


def test_the_spread_is_of_the_run_and_of_the_splits_within_it() -> None:
    # As the thesis's Tables 7.3 and 7.6 have it: of all pruned scenes, and of those that test.
    splits = [
        Split(name="train", partition="full", pairs=3, scenes=["k00", "k04"]),
        Split(name="test", partition="full", pairs=2, scenes=["k01", "k05"]),
        Split(name="train-pruned", partition="pruned", pairs=1, scenes=["k05"]),
        Split(name="test-pruned", partition="pruned", pairs=1, scenes=["k01"]),
        Split(name="else", partition="other", pairs=1, scenes=["k99"]),
    ]
    result = edited(make_result(LEVELS), dataset={"split": "all"})
    table = run_tables.spread_table(summarise(result, "thesis"), splits)
    assert [" ".join(row[:2]) for row in table.rows if row[0]] == [
        *("split all 5", "split train 3", "split test 2", "split train-pruned 1"),
        *("partition pruned 2", "split test-pruned 1"),
    ]
    numbers = ["minimum 0.1000", "mean 0.3200", "maximum 0.6000", "std deviation 0.1924"]
    assert [" ".join(row[2:4]) for row in table.rows[:4]] == numbers


def test_what_was_not_run_is_a_note_and_no_row() -> None:
    result = make_result(LEVELS)
    for pair in result.pairs:
        if pair.scene in ("k04", "k05"):
            object.__setattr__(pair, "status", "not-run")
    scenes = [scene(name, None, number) for number, name in enumerate(("k00", "k01", "k04", "k05"))]
    (table,) = run_tables.scene_tables(summarise(result, "thesis"), scenes)
    assert [row[0] for row in table.rows] == ["00", "01"]
    assert table.notes == ("nothing was run of texture 02, 03",)


def test_the_parts_come_as_data() -> None:
    scenes = [scene("k00", "flat-far", None), scene("k01", "oblique", None)]
    rows = run_tables.run_score_table(summarise(make_result(LEVELS), "thesis"), scenes).records
    parted = {(r["geometry"], r["metric"]): r for r in rows if r["geometry"] != "all"}
    assert len(parted) == 2 * 4
    flat = parted["flat-far", "nrmse"]
    assert flat["mean"] == pytest.approx(0.3)
    assert (flat["exposure"], flat["illumination"], flat["evaluated"]) == ("all", "all", 2)
    assert {r["geometry"] for r in rows if r["exposure"] != "all"} == {"all"}
