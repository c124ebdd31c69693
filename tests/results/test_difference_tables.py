import pytest

from dfdbench.errors import ResultError
from dfdbench.results.difference_tables import change_tables, changes_to_show
from dfdbench.results.record import Result
from tests.made_results import limited, make_result

PLACES = [(scene, 1, i, e) for scene in "ab" for i in (1, 2) for e in (0, 1)]


def result(name: str, change: float) -> Result:
    return make_result(
        {place: 0.2 + (change if place[3] == 0 else -change) for place in PLACES}, name
    )


def test_wins_and_losses_are_counted_by_lighting() -> None:
    differences, pairs = change_tables(result("a", 0.0), result("b", 0.05), "thesis", 3)
    by_place = {(record["metric"], record["pairs"]): record for record in differences.records}
    assert by_place["nrmse", "exposure 0"]["losses"] == 4
    assert by_place["nrmse", "exposure 1"]["wins"] == 4
    assert by_place["ssim", "illumination 2"]["wins"] == 2
    assert by_place["nrmse", "all"]["difference"] == pytest.approx(0)
    assert len(pairs.rows) == 3
    assert "A: a, B: b" in differences.title


def test_pairs_that_changed_most_come_first() -> None:
    second = make_result({place: 0.2 + 0.01 * n for n, place in enumerate(PLACES)}, "b")
    pairs = change_tables(result("a", 0.0), second, "thesis")[1]
    changes = [abs(float(row[3])) for row in pairs.rows]
    assert changes == sorted(changes, reverse=True)
    assert pairs.rows[0][0] == "b/view1/illumination2/exposure1"


def test_nothing_in_common_is_refused_and_a_part_is_said() -> None:
    with pytest.raises(ResultError, match="no pair was scored in both"):
        change_tables(limited(result("a", 0), 0), result("b", 0), "thesis")
    part = change_tables(limited(result("a", 0), 3), result("b", 0), "thesis")[0]
    assert "3 of 8 pairs were scored in both runs" in part.notes
    # All three are of one scene: of scenes that lean one way there is nothing to say.
    assert not any("scenes" in note for note in part.notes)


def test_runs_with_the_same_depth_maps_list_no_pair() -> None:
    (differences,) = change_tables(result("a", 0.1), result("b", 0.1), "thesis")
    assert "The depth maps are the same in both runs, to the last digit." in differences.notes
    others = [p.model_copy(update={"prediction_sha256": "1" * 64}) for p in result("b", 0).pairs]
    other = result("b", 0.1).model_copy(update={"pairs": others})
    assert "depth maps" not in " ".join(change_tables(result("a", 0.1), other, "thesis")[0].notes)


def test_what_is_drawn_is_of_different_scenes_and_views() -> None:
    places = [(s, v, i, e) for s in "abc" for v in (1, 5) for i in (1, 2) for e in (0, 1)]
    before = make_result(dict.fromkeys(places, 0.2))
    # Scene a changes most, and its view 1 more than its view 5.
    after = make_result({p: 0.9 - 0.1 * "abc".index(p[0]) - 0.01 * p[1] for p in places})
    found = changes_to_show(before, after, "thesis", 4)
    assert [(c.first.scene, c.first.coordinates["view"]) for c in found] == [
        ("a", 1),
        ("a", 5),
        ("b", 1),
        ("c", 1),
    ]
    assert len(changes_to_show(before, after, "thesis", 99)) == len(places)
    assert changes_to_show(before, before, "thesis", 4) == ()


@pytest.mark.parametrize("scenes", ["abc", "abcdef"])
def test_few_scenes_are_no_95_per_cent(scenes: str) -> None:
    first, second = (make_result({(s, 1, 1, 0): v for s in scenes}) for v in (0.1, 0.2))
    table = change_tables(first, second, "thesis")[0]
    assert table.columns[2].endswith("95 %" if len(scenes) > 5 else "range of scene means")
    assert ("too few for a 95 % interval" in table.notes[0]) == (len(scenes) < 6)
