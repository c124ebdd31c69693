import csv
import io
import json

import pytest

from dfdbench.datasets.manifest import Scene, Split
from dfdbench.results.run_data import run_as_csv, run_as_json
from dfdbench.results.scene_tables import scene_tables, spread_table
from dfdbench.results.summary import scene_labels, summarise
from tests.made_results import limited, make_result

VALUES = {
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
    geometry, texture = scene_tables(summarise(make_result(VALUES), "thesis"), scenes)
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
    result = make_result(VALUES)
    dataset = result.dataset.model_copy(update={"split": "all"})
    table = spread_table(
        summarise(result.model_copy(update={"dataset": dataset}), "thesis"), splits
    )
    assert [row[:2] for row in table.rows if row[0]] == [
        ("split all", "5"),
        ("split train", "3"),
        ("split test", "2"),
        ("split train-pruned", "1"),
        ("partition pruned", "2"),
        ("split test-pruned", "1"),
    ]
    assert [row[2:4] for row in table.rows[:4]] == [
        ("minimum", "0.1000"),
        ("mean", "0.3200"),
        ("maximum", "0.6000"),
        ("std deviation", "0.1924"),
    ]


def test_an_incomplete_run_has_no_spread() -> None:
    table = spread_table(summarise(limited(make_result(VALUES), 2), "thesis"))
    assert table.rows == ()
    assert table.notes == ("not every pair was evaluated of split test",)


def test_what_was_not_run_is_a_note_and_no_row() -> None:
    result = make_result(VALUES)
    for pair in result.pairs:
        if pair.scene in ("k04", "k05"):
            object.__setattr__(pair, "status", "not-run")
    scenes = [scene(name, None, number) for number, name in enumerate(("k00", "k01", "k04", "k05"))]
    (table,) = scene_tables(summarise(result, "thesis"), scenes)
    assert [row[0] for row in table.rows] == ["00", "01"]
    assert table.notes == ("nothing was run of texture 02, 03",)


@pytest.mark.parametrize("name", ["k00", "Art"])
def test_scenes_that_name_neither_have_no_table(name: str) -> None:
    assert (
        scene_tables(
            summarise(make_result({(name, 1, 1, 0): 0.5}), "thesis"), [scene(name, None, None)]
        )
        == []
    )


def test_the_same_parts_come_as_data() -> None:
    labels = scene_labels([scene("k00", "flat-far", None), scene("k01", "oblique", None)])
    result = make_result(VALUES)
    rows = list(csv.DictReader(io.StringIO(run_as_csv(summarise(result, "thesis"), labels))))
    parted = {(r["geometry"], r["metric"]): r for r in rows if r["geometry"] != "all"}
    assert len(parted) == 2 * 4
    flat = parted["flat-far", "nrmse"]
    assert float(flat["mean"]) == pytest.approx(0.3)
    assert (flat["exposure"], flat["illumination"], flat["evaluated"]) == ("all", "all", "2")
    assert {r["geometry"] for r in rows if r["exposure"] != "all"} == {"all"}
    content = json.loads(run_as_json(summarise(result, "thesis"), labels))
    assert [(g["geometry"], g["nrmse"]["mean"]) for g in content["by_geometry"]] == [
        ("flat-far", pytest.approx(0.3)),
        ("oblique", pytest.approx(0.1)),
    ]
