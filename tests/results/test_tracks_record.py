import json
from typing import Any

import pytest
from pydantic import ValidationError

from dfdbench.results.tracks_record import TracksRecord, results_of, tracks_record
from tests.leaderboard.made_tracks import make_tracks
from tests.made_results import limited


def test_what_a_record_keeps_comes_back_as_the_results_that_it_was_made_of() -> None:
    results = make_tracks(
        value=0.1234567, labels=["gain-1"], fitted_on="demo-1@{label}, split train"
    )
    results["gain-1"] = results["gain-1"].model_copy(update={"warnings": ["mind the gap"]})
    found = results_of(tracks_record(results, "valid"))
    assert found.keys() == results.keys()
    assert found["clean"] == results["clean"]
    track = found["gain-1"]
    assert (track.dataset, track.method) == (results["gain-1"].dataset, results["gain-1"].method)
    assert track.warnings == ["mind the gap"]
    # Six digits, and an average of just these.
    assert track.pairs[0].scores == {
        "valid": {"nrmse": 0.123457, "nmae": 0.061728, "ssim": 0.876543}
    }
    assert track.averages is not None
    assert track.averages["valid"]["nrmse"] == pytest.approx(0.123457, abs=1e-12)


def test_each_pair_keeps_its_machine() -> None:
    results = make_tracks(labels=["gain-1"])
    track = results["gain-1"]
    other = track.environment.model_copy(update={"cpu": "another"})
    pairs = [pair.model_copy(update={"machine": n % 2}) for n, pair in enumerate(track.pairs)]
    results["gain-1"] = track.model_copy(update={"other_environments": [other], "pairs": pairs})
    found = results_of(tracks_record(results, "valid"))
    assert found["gain-1"].environments == results["gain-1"].environments
    assert [pair.machine for pair in found["gain-1"].pairs] == [pair.machine for pair in pairs]
    assert found["clean"] == results["clean"]


def test_a_run_that_is_incomplete_has_no_average() -> None:
    results = make_tracks(labels=["gain-1"])
    results["gain-1"] = limited(results["gain-1"], 5)
    found = results_of(tracks_record(results, "valid"))["gain-1"]
    assert (found.averages, found.dataset.evaluated) == (None, 5)
    assert found.pairs[5].status == "not-run"


def drop_clean(content: dict[str, Any]) -> None:
    del content["runs"]["clean"]


def name_no_track(content: dict[str, Any]) -> None:
    content["runs"]["gian-1"] = content["runs"].pop("gain-1")


def name_severity_0(content: dict[str, Any]) -> None:
    content["runs"]["gain-0"] = content["runs"].pop("gain-1")


def drop_a_score(content: dict[str, Any]) -> None:
    content["runs"]["gain-1"]["scores"]["nrmse"].pop()


def drop_a_metric(content: dict[str, Any]) -> None:
    del content["runs"]["gain-1"]["scores"]["nmae"]


def add_a_metric(content: dict[str, Any]) -> None:
    content["runs"]["gain-1"]["scores"]["luck"] = content["runs"]["gain-1"]["scores"]["nmae"]


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (drop_clean, "the run on clean images is lacking"),
        (name_no_track, "no such track: gian-1"),
        (name_severity_0, "severity 0 is called clean"),
        (drop_a_score, "gain-1: nrmse is of 53 pairs, not 54"),
        (drop_a_metric, "gain-1: a metric is lacking: nmae"),
        (add_a_metric, "gain-1: no such metric: luck"),
    ],
)
def test_a_record_that_does_not_fit_together_is_refused(change: Any, told: str) -> None:
    record = tracks_record(make_tracks(labels=["gain-1"]), "valid")
    content = json.loads(record.model_dump_json())
    change(content)
    with pytest.raises(ValidationError, match=told):
        TracksRecord.model_validate(content)
