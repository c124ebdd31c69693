from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from dfdbench.errors import ResultError, UnknownNameError
from dfdbench.metrics.intervals import holm
from dfdbench.metrics.metric import METRICS
from dfdbench.metrics.protocol import RELEASED
from dfdbench.report.objects import Comparison
from dfdbench.results.differences import (
    PairChange,
    PairedDifference,
    change_tables,
    changes,
    changes_to_show,
    check_comparable,
    corrected,
    paired_difference,
    paired_differences,
)
from dfdbench.results.record import Result
from dfdbench.results.saved_run import SavedRun
from tests.made_results import edited, limited, make_result

SCENES = "abcdefghij"
PLACES = [(scene, 1, i, e) for scene in SCENES for i in (1, 2) for e in (0, 1)]


def difference(changes: tuple[PairChange, ...], metric: str) -> PairedDifference:
    groups = [change.first.scene for change in changes]
    found = paired_difference([change.difference for change in changes], groups, metric)
    assert found is not None
    return found


def result(value: float, name: str = "mine", scenes: str = SCENES) -> Result:
    values: dict[tuple[str, int, int, int], float | None] = {
        place: value + 0.001 * n for n, place in enumerate(PLACES) if place[0] in scenes
    }
    return make_result(values, name)


def test_the_mean_difference_is_that_of_the_means() -> None:
    first, second = result(0.2), result(0.15)
    found = difference(changes(first, second, "thesis", "nrmse"), "nrmse")
    assert found.mean == pytest.approx(-0.05)
    assert (found.wins, found.losses, found.ties, found.verdict) == (len(PLACES), 0, 0, "real")
    ssim = difference(changes(first, second, "thesis", "ssim"), "ssim")
    assert ssim.mean == pytest.approx(0.05)
    assert ssim.wins == len(PLACES)
    same = difference(changes(first, first, "thesis", "nrmse"), "nrmse")
    assert (same.wins, same.losses, same.ties) == (0, 0, len(PLACES))


def test_below_ten_scenes_there_is_no_verdict() -> None:
    for scenes in ("a", "abc", SCENES[:9], SCENES):
        both = (result(0.2, scenes=scenes), result(0.1, scenes=scenes))
        found = difference(changes(*both, "thesis", "nrmse"), "nrmse")
        assert found.verdict == ("real" if scenes == SCENES else "too few scenes to tell")
        assert str(found).endswith(f", {found.verdict}")
        assert (found.low is None) == (len(scenes) == 1)


def test_rows_over_fewer_groups_than_the_others_are_named() -> None:
    first, second = result(0.2), result(0.1)
    failed = [
        edited(pair, status="failed", scores={}) if few and pair.scene in "abcd" else pair
        for pair, few in ((pair, pair.coordinates["exposure"] == 1) for pair in second.pairs)
    ]
    second = edited(second, pairs=failed, dataset={"evaluated": 32}, averages=None)
    table, _ = change_tables(first, second, "thesis")
    where = [f"{metric}, exposure 1" for metric in ("NRMSE", "NMAE", "SSIM")]
    note = f"over another number of groups, so the range of group means: {'; '.join(where)}"
    assert (table.columns[2], table.notes[1]) == ("B minus A, 95 %", note)


def test_scenes_of_one_room_do_not_count_as_several() -> None:
    first, second = result(0.2), result(0.1)
    whole = change_tables(first, second, "thesis")[0]
    assert whole.rows[0][2].endswith(", real")
    assert "over 10 groups of scenes" in whole.notes[0]
    rooms = {"groups": {"a": "hall", "b": "hall"}}
    one, other = (edited(run, dataset=rooms) for run in (first, second))
    parted = change_tables(one, other, "thesis")[0]
    assert parted.rows[0][2].endswith(", too few scenes to tell")
    assert "over 9 groups of scenes" in parted.notes[0]
    assert parted.records[0]["difference"] == whole.records[0]["difference"]


def test_what_is_real_alone_may_be_chance_among_many() -> None:
    changed = (0.03, 0.01, 0.02, -0.01, 0.02, 0.03, -0.005, 0.01, 0.015, -0.002)
    alone = paired_difference(changed, list(SCENES), "nrmse")
    assert alone is not None
    assert stats.ttest_1samp(changed, 0).pvalue <= (alone.p or 0) < 0.05
    assert alone.verdict == "real"
    many = corrected([None, alone, *[replace(alone, p=0.9)] * 9])
    assert many[0] is None
    assert many[1] is not None
    assert many[1].p == pytest.approx(10 * (alone.p or 0))
    assert many[1].verdict == "may be chance"
    assert (many[1].low, many[1].high) == (alone.low, alone.high)
    same = paired_difference([0.0] * 10, list(SCENES), "nrmse")
    assert same is not None
    assert same.verdict == "none"


def test_runs_beside_one_another_are_corrected_together(tmp_path: Path) -> None:
    random = np.random.default_rng(5)
    results = [
        make_result({place: 0.2 + 0.01 * random.random() for place in PLACES}, name)
        for name in "abcd"
    ]
    runs = [
        SavedRun(tmp_path / name, run, None, "") for name, run in zip("abcd", results, strict=True)
    ]
    shown = Comparison(runs, "thesis").table()["p"].tolist()
    alone = [
        difference.p
        for run in results[1:]
        for difference in paired_differences(results[0], run, "thesis").values()
        if difference is not None
    ]
    assert len(shown) == len(alone) > 9
    assert shown == holm(alone)


def test_only_pairs_scored_in_both_count() -> None:
    assert len(changes(limited(result(0.2), 5), result(0.1), "thesis", "nrmse")) == 5
    undefined = make_result(dict.fromkeys(PLACES))
    assert changes(undefined, result(0.1), "thesis", "nrmse") == ()
    assert paired_difference((), (), "nrmse") is None


def test_other_data_and_other_protocols_are_not_compared() -> None:
    first, second = result(0.2), result(0.1)
    other = edited(second, dataset={"fingerprint": "7" * 64, "split": "train"})
    with pytest.raises(ResultError, match="fingerprint") as raised:
        check_comparable(first, other, "thesis")
    assert len(raised.value.problems) == 2
    with pytest.raises(ResultError, match="manifest_sha256"):
        check_comparable(first, edited(second, dataset={"manifest_sha256": "7" * 64}), "thesis")
    with pytest.raises(UnknownNameError, match="valid"):
        check_comparable(first, second, "valid")
    redefined = [{**second.protocols[0], "pixels": "known"}]
    with pytest.raises(ResultError, match="defined differently"):
        check_comparable(first, edited(second, protocols=redefined), "thesis")


LIT = [(scene, 1, i, e) for scene in "ab" for i in (1, 2) for e in (0, 1)]


def made(name: str, change: float) -> Result:
    return make_result({place: 0.2 + (change if place[3] == 0 else -change) for place in LIT}, name)


def test_wins_and_losses_are_counted_by_lighting() -> None:
    differences, pairs = change_tables(made("a", 0.0), made("b", 0.05), "thesis", 3)
    by_place = {(record["metric"], record["pairs"]): record for record in differences.records}
    assert by_place["nrmse", "exposure 0"]["losses"] == 4
    assert by_place["nrmse", "exposure 1"]["wins"] == 4
    assert by_place["ssim", "illumination 2"]["wins"] == 2
    assert by_place["nrmse", "all"]["difference"] == pytest.approx(0)
    assert len(pairs.rows) == 3
    assert "A: a, B: b" in differences.title


def test_pairs_that_changed_most_come_first() -> None:
    second = make_result({place: 0.2 + 0.01 * n for n, place in enumerate(LIT)}, "b")
    pairs = change_tables(made("a", 0.0), second, "thesis")[1]
    changes = [abs(float(row[3])) for row in pairs.rows]
    assert changes == sorted(changes, reverse=True)
    assert pairs.rows[0][0] == "b/view1/illumination2/exposure1"


def test_nothing_in_common_is_refused_and_a_part_is_said() -> None:
    with pytest.raises(ResultError, match="no pair was scored in both"):
        change_tables(limited(made("a", 0), 0), made("b", 0), "thesis")
    none = {"thesis": dict.fromkeys(METRICS)}
    gaps = edited(made("a", 0), pairs={"answered": 0.5, "scores": none})
    with pytest.raises(ResultError, match="without an answer: answer them all"):
        change_tables(gaps, made("b", 0), "thesis")
    gaps = edited(gaps, protocols=[*gaps.protocols, RELEASED["sure"].as_dict()])
    with pytest.raises(ResultError, match="without an answer: compare by --protocol sure"):
        change_tables(gaps, gaps, "thesis")
    part = change_tables(limited(made("a", 0), 3), made("b", 0), "thesis")[0]
    assert "3 of 8 pairs were scored in both runs" in part.notes
    # All three are of one scene: of scenes that lean one way there is nothing to say.
    assert not any("scenes" in note for note in part.notes)


def test_runs_with_the_same_depth_maps_list_no_pair() -> None:
    (differences,) = change_tables(made("a", 0.1), made("b", 0.1), "thesis")
    assert "The depth maps are the same in both runs, to the last digit." in differences.notes
    other = edited(made("b", 0.1), pairs={"prediction_sha256": "1" * 64})
    assert "depth maps" not in " ".join(change_tables(made("a", 0.1), other, "thesis")[0].notes)


def test_what_is_drawn_is_of_different_scenes_and_views() -> None:
    places = [(s, v, i, e) for s in "abc" for v in (1, 5) for i in (1, 2) for e in (0, 1)]
    before = make_result(dict.fromkeys(places, 0.2))
    # Scene a changes most, and its view 1 more than its view 5.
    after = make_result({p: 0.9 - 0.1 * "abc".index(p[0]) - 0.01 * p[1] for p in places})
    found = changes_to_show(before, after, "thesis", 4)
    views = [(change.first.scene, change.first.coordinates["view"]) for change in found]
    assert views == [("a", 1), ("a", 5), ("b", 1), ("c", 1)]
    assert len(changes_to_show(before, after, "thesis", 99)) == len(places)
    assert changes_to_show(before, before, "thesis", 4) == ()
