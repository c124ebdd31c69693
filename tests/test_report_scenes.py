import csv
import io
import json

import pytest

from dfdbench.manifest import Scene
from dfdbench.report import run_as_csv, run_as_json
from dfdbench.report_scenes import scene_tables
from dfdbench.summary import scene_labels
from tests.results import make_result

VALUES = {
    ("k00", 1, 1, 0): 0.4, ("k00", 1, 1, 1): 0.2, ("k01", 1, 1, 0): 0.1,
    ("k04", 1, 1, 0): 0.6, ("k05", 1, 1, 0): 0.3,
}  # fmt: skip


def scene(name: str, geometry: str | None, texture: int | None) -> Scene:
    return Scene(name=name, source="here", geometry=geometry, texture=texture)


def test_scores_are_parted_by_geometry_and_by_texture() -> None:
    scenes = [
        scene("k00", "flat-far", 1), scene("k01", "oblique-near-left", 1),
        scene("k04", "flat-far", 2), scene("k05", "oblique-near-left", 2),
    ]  # fmt: skip
    geometry, texture = scene_tables(make_result(VALUES), "thesis", scenes)
    assert [row[:3] for row in geometry.rows] == [
        ("flat-far", "k00 k04", "0.4000"),
        ("oblique-near-left", "k01 k05", "0.2000"),
    ]
    assert [row[-1] for row in geometry.rows] == ["3/3", "2/2"]
    assert [row[:3] for row in texture.rows] == [
        ("01", "k00 k01", "0.2333"),
        ("02", "k04 k05", "0.4500"),
    ]


def test_what_was_not_run_is_a_note_and_no_row() -> None:
    result = make_result(VALUES)
    for pair in result.pairs:
        if pair.scene in ("k04", "k05"):
            object.__setattr__(pair, "status", "not-run")
    scenes = [scene(name, None, number) for number, name in enumerate(("k00", "k01", "k04", "k05"))]
    (table,) = scene_tables(result, "thesis", scenes)
    assert [row[0] for row in table.rows] == ["00", "01"]
    assert table.notes == ("nothing was run of texture 02, 03",)


@pytest.mark.parametrize("name", ["k00", "Art"])
def test_scenes_that_name_neither_have_no_table(name: str) -> None:
    assert (
        scene_tables(make_result({(name, 1, 1, 0): 0.5}), "thesis", [scene(name, None, None)]) == []
    )


def test_the_same_parts_come_as_data() -> None:
    labels = scene_labels([scene("k00", "flat-far", None), scene("k01", "oblique", None)])
    result = make_result(VALUES)
    rows = list(csv.DictReader(io.StringIO(run_as_csv(result, "thesis", labels))))
    parted = {(r["geometry"], r["metric"]): r for r in rows if r["geometry"] != "all"}
    assert len(parted) == 2 * 4
    flat = parted["flat-far", "nrmse"]
    assert float(flat["mean"]) == pytest.approx(0.3)
    assert (flat["exposure"], flat["illumination"], flat["evaluated"]) == ("all", "all", "2")
    assert {r["geometry"] for r in rows if r["exposure"] != "all"} == {"all"}
    content = json.loads(run_as_json(result, "thesis", labels))
    assert [(g["geometry"], g["nrmse"]["mean"]) for g in content["by_geometry"]] == [
        ("flat-far", pytest.approx(0.3)),
        ("oblique", pytest.approx(0.1)),
    ]
