from dataclasses import replace

import numpy as np
import pytest

from dfdbench.metrics.metric import METRICS
from dfdbench.results.frame import frame_of, group_means, scores_of, severities_table, track_means
from dfdbench.results.record import Result
from tests.board.made_boards import make_tracks
from tests.made_results import edited, limited, make_demo_result, make_result

SCORES = {("One", 1, 1, 0): 0.2, ("One", 1, 1, 1): None, ("Two", 5, 1, 0): 0.1}


def test_a_row_a_pair_with_its_place_and_scores() -> None:
    frame = frame_of(make_result(SCORES))
    columns = "scene view illumination exposure status nrmse nmae ssim seconds"
    assert " ".join(frame.columns) == columns
    assert frame.index.name == "pair"
    assert frame.loc["One/view1/illumination1/exposure0", "nmae"] == 0.1
    assert frame["nrmse"].isna().tolist() == [False, True, False]
    assert frame.groupby("scene")["nrmse"].mean().to_dict() == {"One": 0.2, "Two": 0.1}


def test_a_mean_leaves_out_what_is_undefined_and_needs_every_pair() -> None:
    whole = group_means(scores_of([make_result(SCORES)]), "metric")
    assert whole["nrmse"] == pytest.approx(0.15)
    stopped = scores_of([limited(make_demo_result(lambda pair: 0.1), 53)])
    means = group_means(stopped[stopped["metric"] == "nrmse"], "scene")
    assert means.isna().tolist() == [False, False, True]


def run_of(label: str, value: float) -> Result:
    result = make_demo_result(lambda pair: value)
    if label == "clean":
        return edited(result, method={"uses": ["recipe"]})
    on_track = {"name": f"demo-1@{label}", "short": f"demo@{label}", "degradation": label}
    return edited(result, dataset=on_track, method={"fitted_on": f"demo-1@{label}, split train"})


RUNS = {
    "clean": run_of("clean", 0.125),
    **{f"gain-{number}": run_of(f"gain-{number}", 0.25 * number) for number in (1, 2, 3)},
    **{f"noise-{number}": run_of(f"noise-{number}", 0.5) for number in (1, 2, 3)},
}


def test_a_row_has_clean_the_severities_and_their_mean_without_clean() -> None:
    table = severities_table(list(RUNS.values()), "valid")
    assert ["|".join(row) for row in (table.columns, *table.rows)] == [
        "track|clean|1|2|3|mean of severities|range of group means",
        "gain|0.1250|0.2500|0.5000|0.7500|0.5000|0.5000 to 0.5000",
        "noise|0.1250|0.5000|0.5000|0.5000|0.5000|0.5000 to 0.5000",
    ]
    assert table.records[0]["nmae mean"] == 0.25
    assert "demo-1, split test, protocol valid" in table.title


@pytest.mark.parametrize(
    ("scenes", "name"), [("abcdefg", "range of group means"), ("abcdefgh", "95 %")]
)
def test_a_flat_truth_is_no_group_of_a_track_s_mean(scenes: str, name: str) -> None:
    values: dict[tuple[str, int, int, int], float | None] = {
        (each, 1, 1, 0): 0.1 for each in scenes
    }
    flat = make_result(values | {("z", 1, 1, 0): None})
    data = {"name": "tiny-1@gain-1", "short": "tiny@gain-1", "degradation": "gain-1"}
    table = severities_table([edited(flat, dataset=data)], "thesis")
    assert (table.columns[-1], table.records[0]["interval"]) == (name, name)


def test_runs_from_before_a_metric_have_none_of_it(monkeypatch: pytest.MonkeyPatch) -> None:
    younger = dict(METRICS, younger=replace(METRICS["nmae"], name="younger", younger=True))
    monkeypatch.setattr("dfdbench.results.frame.metrics_of", lambda protocol: younger)
    gain = severities_table(list(RUNS.values()), "valid").records[0]
    assert gain["nmae 3"] == 0.375
    assert {gain[f"younger {at}"] for at in ("clean", 1, 3, "mean")} == {None}


def test_what_was_told_is_said_of_clean_and_of_tracks() -> None:
    notes = severities_table(list(RUNS.values()), "valid").notes
    assert notes[:2] == ("given on clean images: the blur", "given on tracks: training pairs")


def test_a_severity_that_is_incomplete_or_was_not_run_leaves_no_mean() -> None:
    runs = {**RUNS, "gain-2": limited(RUNS["gain-2"], 3)}
    del runs["noise-3"]
    table = severities_table(list(runs.values()), "valid")
    assert table.rows[0][2:] == ("0.2500", "–", "0.7500", "–", "–")
    assert table.rows[1][2:] == ("0.5000", "0.5000", "–", "–", "–")
    assert any(note.startswith("gain-2: 3 of 54 pairs") for note in table.notes)
    means = track_means(scores_of(list(runs.values())), "valid", "nrmse")
    assert np.isnan(means.to_numpy()[0]).tolist() == [False, False, True, False]


def test_any_number_of_runs_are_one_long_table() -> None:
    runs = make_tracks("solver", 0.5, ["camera-2"], parameters={"window": 9})
    scores = scores_of([make_result(SCORES), *runs.values()])
    assert scores.groupby("run").size().tolist() == [3 * 3, 54 * 3, 54 * 3]
    last = scores.iloc[-1]
    names = ["dataset", "track", "severity", "method", "parameters"]
    assert last[names].tolist() == ["demo-1", "camera", 2, "solver (window=9)", "window=9"]
    assert last["coordinates"] == {"view": 5, "illumination": 3, "exposure": 2}
    assert scores.loc[scores["metric"] == "nrmse", "value"].isna().sum() == 1
