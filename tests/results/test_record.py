from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from dfdbench.errors import ResultError
from dfdbench.metrics.protocol import RELEASED
from dfdbench.results.record import first_protocol
from dfdbench.results.record_file import load_result, save_result
from tests.made_results import make_result

VALUES = {("a", 1, 1, 0): 0.2, ("b", 1, 1, 0): 0.1, ("b", 5, 1, 0): None}


def drop_pair(content: dict[str, Any]) -> None:
    del content["pairs"][0]


def repeat_pair(content: dict[str, Any]) -> None:
    content["pairs"][1] = content["pairs"][0]


def edit_average(content: dict[str, Any]) -> None:
    content["averages"]["thesis"]["nrmse"] = 0.05


def drop_average(content: dict[str, Any]) -> None:
    content["averages"]["thesis"]["nrmse"] = None


def edit_score(content: dict[str, Any]) -> None:
    content["pairs"][0]["scores"]["thesis"]["nrmse"] = 0.15


def fail_pair(content: dict[str, Any]) -> None:
    content["pairs"][0]["status"] = "failed"


def hide_failure(content: dict[str, Any]) -> None:
    content["pairs"][0]["status"] = "failed"
    content["dataset"]["evaluated"] = 2


def drop_scores(content: dict[str, Any]) -> None:
    content["pairs"][0]["scores"] = {}


def add_field(content: dict[str, Any]) -> None:
    content["dataset"]["colour"] = "red"


def other_version(content: dict[str, Any]) -> None:
    content["schema_version"] = 7


@pytest.mark.parametrize(
    ("tamper", "told"),
    [
        (drop_pair, "pairs do not add up"),
        (repeat_pair, "2 different"),
        (edit_average, "average does not follow"),
        (drop_average, "average does not follow"),
        (edit_score, "average does not follow"),
        (fail_pair, "evaluated pairs do not add up"),
        (hide_failure, "the run is incomplete"),
        (drop_scores, "scores are missing"),
        (add_field, "colour"),
        (other_version, "another version"),
    ],
)
def test_a_tampered_result_is_refused(
    tmp_path: Path, tamper: Callable[[dict[str, Any]], None], told: str
) -> None:
    path = tmp_path / "r.json"
    save_result(make_result(VALUES), path)
    content = json.loads(path.read_text())
    tamper(content)
    path.write_text(json.dumps(content))
    with pytest.raises(ResultError, match=told):
        load_result(path)


@pytest.mark.parametrize(
    ("name", "value"), [("nrmse", -9), ("nmae", -0.1), ("ssim", 1.7), ("ssim", -1.1), ("nmae", 5)]
)
def test_an_impossible_score_is_refused(tmp_path: Path, name: str, value: float) -> None:
    path = tmp_path / "r.json"
    save_result(make_result(VALUES), path)
    content = json.loads(path.read_text())
    scores = [pair["scores"]["thesis"] for pair in content["pairs"]]
    scores[0][name] = value
    defined = [each[name] for each in scores if each[name] is not None]
    content["averages"]["thesis"][name] = sum(defined) / len(defined)
    path.write_text(json.dumps(content))
    with pytest.raises(ResultError, match=rf"wrong value(.|\n)*\.{name}|NMAE is larger than NRMSE"):
        load_result(path)


@pytest.mark.parametrize(
    ("tamper", "told"), [(lambda content: content["pairs"][0].update(seconds=-1), "seconds")]
)
def test_an_impossible_time_is_refused(
    tmp_path: Path, tamper: Callable[[dict[str, Any]], None], told: str
) -> None:
    path = tmp_path / "r.json"
    save_result(make_result(VALUES), path)
    content = json.loads(path.read_text())
    tamper(content)
    path.write_text(json.dumps(content))
    with pytest.raises(ResultError, match=f"wrong value(.|\n)*{told}"):
        load_result(path)


def test_not_a_number_is_no_score(tmp_path: Path) -> None:
    path = tmp_path / "r.json"
    save_result(make_result(VALUES), path)
    path.write_text(path.read_text().replace('"nrmse": 0.2', '"nrmse": NaN', 1))
    with pytest.raises(ResultError):
        load_result(path)


EVIL = "x/../../../../elsewhere/evil"


def test_the_attack_of_the_trial_is_refused_on_reading(tmp_path: Path) -> None:
    path = tmp_path / "r.json"
    save_result(make_result(VALUES), path)
    tampers: list[Callable[[dict[str, Any]], object]] = [
        lambda content: content["dataset"].update(name=EVIL),
        lambda content: content["dataset"].update(short="s3://elsewhere/evil"),
        lambda content: content["dataset"].update(short="/elsewhere/evil.zarr"),
        lambda content: content["dataset"].update(split=".."),
        lambda content: content["dataset"].update(axes=["view", "illumination", EVIL]),
        lambda content: content["pairs"][0].update(scene="../../elsewhere"),
        lambda content: content["protocols"][0].update(name="../thesis"),
        lambda content: content["protocols"][0].pop("name"),
        lambda content: content["dataset"].update(recipe={}),
        lambda content: content["method"].update(name="local\x1b[2J"),
        lambda content: content["method"].update(parameters={"a": "\ud800"}),
        lambda content: content["method"].update(parameters={"a": float("inf")}),
        lambda content: content.update(seed=-1),
        lambda content: content.update(seed=2**32),
        lambda content: content["pairs"][0].update(seconds=1.7e308),
        lambda content: content["pairs"][0].update(numbers={"energy": 1.7e308}),
        lambda content: content["pairs"][0]["scores"]["thesis"].update(nrmse=1.7e308),
        lambda content: content["pairs"][0]["coordinates"].update(view=10**400),
    ]
    for tamper in tampers:
        content = json.loads(make_result(VALUES).model_dump_json())
        tamper(content)
        path.write_text(json.dumps(content))
        with pytest.raises(ResultError, match=r"wrong value in the result|lone surrogate"):
            load_result(path)


@pytest.mark.parametrize(
    ("tamper", "told"),
    [
        (lambda content: content["dataset"].update(blocks="colour"), "no such axis"),
        (lambda content: content["dataset"].update(rows="colour"), "no such axis"),
        (lambda content: content["dataset"].update(axes=["view"]), "not on the axes"),
        (lambda content: content["pairs"][0]["coordinates"].pop("view"), "not on the axes"),
        (lambda content: content["pairs"][0]["coordinates"].update(view=5), "its name says"),
        (lambda content: content["pairs"][0].update(id="../x"), "its name says"),
        (lambda content: content["dataset"]["axes"].append("view"), "listed twice"),
        (lambda content: content["protocols"].append(content["protocols"][0]), "listed twice"),
    ],
)
def test_pairs_that_are_not_on_the_axes_are_refused(
    tmp_path: Path, tamper: Callable[[dict[str, Any]], None], told: str
) -> None:
    content = json.loads(make_result(VALUES).model_dump_json())
    tamper(content)
    (tmp_path / "r.json").write_text(json.dumps(content))
    with pytest.raises(ResultError, match=told):
        load_result(tmp_path / "r.json")


def metric_result() -> dict[str, Any]:
    content: dict[str, Any] = json.loads(make_result(VALUES).model_dump_json())
    scores = {"abs_rel": 0.1, "rmse_m": 0.5, "delta_105": 0.5, "delta_115": 0.75}
    scores |= {"delta_125": 1.0, "boundary_f1": 0.3}
    content["protocols"].append(RELEASED["metric"].as_dict())
    for pair in content["pairs"]:
        pair["scores"]["metric"] = dict(scores)
    content["averages"]["metric"] = dict(scores)
    return content


@pytest.mark.parametrize(
    ("tamper", "told"),
    [
        (lambda scores: scores.pop("rmse_m"), "not scored by the same metrics"),
        (lambda scores: scores.update(delta_105=0.8), "fewer pixels lie within a wider bound"),
        (lambda scores: scores.update(delta_125=1.1), "delta_125"),
        (lambda scores: scores.update(abs_rel=-0.1), "abs_rel"),
        (lambda scores: scores.update(nrmse=0.1), "nrmse"),
        (lambda scores: scores.update(abs_rel=0.3), "average does not follow"),
    ],
)
def test_scores_in_metres_are_held_to_what_they_can_be(
    tmp_path: Path, tamper: Callable[[dict[str, float]], Any], told: str
) -> None:
    content = metric_result()
    (tmp_path / "r.json").write_text(json.dumps(content))
    assert load_result(tmp_path / "r.json").pairs[0].score("metric", "abs_rel") == 0.1
    tamper(content["pairs"][0]["scores"]["metric"])
    (tmp_path / "r.json").write_text(json.dumps(content))
    with pytest.raises(ResultError, match=told):
        load_result(tmp_path / "r.json")


@pytest.mark.parametrize("metrics", [5, "abs_rel", ["nrmse"], [5]])
def test_a_protocol_of_metrics_that_are_none_is_refused(tmp_path: Path, metrics: Any) -> None:
    content = metric_result()
    content["protocols"][1]["metrics"] = metrics
    (tmp_path / "r.json").write_text(json.dumps(content))
    with pytest.raises(ResultError, match="wrong value in the result"):
        load_result(tmp_path / "r.json")


def test_sets_with_printed_tables_are_headed_by_the_thesis_others_and_tracks_by_known_pixels() -> (
    None
):
    assert first_protocol("middlebury") == first_protocol("realworld") == "thesis"
    assert first_protocol("middlebury-default") == first_protocol("mine") == "valid"
    assert first_protocol("demo@camera-2") == first_protocol("realworld-synthetic@law-1") == "valid"
