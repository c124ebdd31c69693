import pytest

from dfdbench.change_tables import change_tables
from dfdbench.errors import ResultError
from dfdbench.result import Result
from tests.results import limited, make_result

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
