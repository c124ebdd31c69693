import pytest

from dfdbench.manifest import Scene
from dfdbench.report_scenes import scene_tables
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
