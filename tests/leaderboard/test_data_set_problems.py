import json
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from dfdbench.blur.recipe import RECIPES
from dfdbench.datasets.catalog import find_manifest
from dfdbench.errors import ResultError
from dfdbench.leaderboard.data_set_problems import data_set_problems
from dfdbench.leaderboard.folder import FINGERPRINTS, UNDEFINED
from dfdbench.leaderboard.submission import submit
from dfdbench.results.record import DatasetRecord, PairScores, Result, average
from tests.made_results import make_demo_result

WHEN = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)


def with_undefined(result: Result, ids: set[str]) -> Result:
    nothing = {"thesis": PairScores(nrmse=None, nmae=None, ssim=0.5)}
    pairs = [
        pair.model_copy(update={"scores": nothing}) if pair.id in ids else pair
        for pair in result.pairs
    ]
    return result.model_copy(update={"pairs": pairs, "averages": average(pairs, ["thesis"])})


def test_a_row_leaves_out_no_score_that_the_data_define(tmp_path: Path) -> None:
    whole = make_demo_result(lambda pair: 0.1)
    all_but_one = {pair.id for pair in whole.pairs[1:]}
    with pytest.raises(ResultError, match="undefined elsewhere than the data"):
        submit(with_undefined(whole, all_but_one), tmp_path, WHEN)
    assert not list(tmp_path.rglob("*.json"))
    # Where the ground truth leaves a pair undefined, it does so for every method.
    flat = whole.pairs[0].id
    record = {whole.dataset.fingerprint: {"thesis": {flat: ["nrmse", "nmae"]}}}
    (tmp_path / UNDEFINED).write_text(json.dumps(record))
    assert not data_set_problems(with_undefined(whole, {flat}), tmp_path, "here")
    assert len(data_set_problems(whole, tmp_path, "here")) == 1
    (tmp_path / UNDEFINED).write_text("[]")
    with pytest.raises(ResultError, match="cannot read the list"):
        data_set_problems(whole, tmp_path, "here")


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("short", "middlebury"),
        ("axes", ["view"]),
        ("blocks", "view"),
        ("degradation", "noise"),
        ("simulated", True),
        ("options", {"pair": [129, 141]}),
    ],
)
def test_a_row_says_of_its_data_what_the_manifest_says(
    tmp_path: Path, field: str, value: Any
) -> None:
    result = make_demo_result(lambda pair: 0.1)
    other = result.dataset.model_copy(update={field: value})
    with pytest.raises(ResultError, match=rf"not what the manifest(.|\n)*{field}"):
        submit(result.model_copy(update={"dataset": other}), tmp_path, WHEN)


@pytest.mark.parametrize("name", ["demo", "mine.toml"])
def test_a_row_is_of_a_released_set_by_its_full_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").write_text(find_manifest("demo").toml)
    result = make_demo_result(lambda pair: 0.1)
    other = result.dataset.model_copy(update={"name": name})
    with pytest.raises(ResultError, match="unknown data set"):
        submit(result.model_copy(update={"dataset": other}), tmp_path, WHEN)


def on_track(label: str, **changes: Any) -> Result:
    result = make_demo_result(lambda pair: 0.1)
    facts = {
        "name": f"demo-1@{label}",
        "short": f"demo@{label}",
        "degradation": label,
        "recipe": {"name": "", "parameters": {}},
    }
    dataset = result.dataset.model_copy(update={**facts, **changes})
    return result.model_copy(update={"dataset": dataset})


def test_a_track_has_a_folder_and_a_fingerprint_of_its_own(tmp_path: Path) -> None:
    (path,) = submit(on_track("camera-2"), tmp_path, WHEN)
    assert path.parent == tmp_path / "results/demo-1@camera-2-test/thesis"
    pinned = {"demo-1": ["2" * 64], "demo-1@camera-2": ["3" * 64]}
    (tmp_path / FINGERPRINTS).write_text(json.dumps(pinned))
    with pytest.raises(
        ResultError, match=r"(?s)other data than demo-1@camera-2.*build demo@camera-2"
    ):
        submit(on_track("camera-2"), tmp_path, WHEN)
    submit(on_track("camera-2", fingerprint="3" * 64), tmp_path, WHEN)


def test_a_captured_set_is_held_to_its_fingerprint_too(tmp_path: Path) -> None:
    manifest = find_manifest("dfd-indoor")
    result = make_demo_result(lambda pair: 0.1)
    facts = {"name": manifest.stem, "short": manifest.short, "recipe": {"name": ""}}
    dataset = result.dataset.model_copy(update=facts)
    (tmp_path / FINGERPRINTS).write_text(json.dumps({manifest.stem: ["3" * 64]}))
    told = data_set_problems(result.model_copy(update={"dataset": dataset}), tmp_path, "here")
    assert "fingerprint of other data than dfd-indoor-1" in {problem.what for problem in told}


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"recipe": {"name": "published", "parameters": {}}}, "tells no blur recipe"),
        ({"degradation": "clean"}, "not what the manifest"),
        ({"name": "demo-1"}, "not what the manifest"),
        ({"name": "demo-1@camera-7"}, "unknown severity"),
        ({"name": "realworld-1@camera-2"}, "captured"),
    ],
)
def test_a_row_on_a_track_says_what_the_track_says(
    tmp_path: Path, changes: dict[str, Any], told: str
) -> None:
    with pytest.raises(ResultError, match=told):
        submit(on_track("camera-2", **changes), tmp_path, WHEN)


@pytest.mark.parametrize(
    "name", ["demo-1@../x-1", "demo-1@camera-0", "demo-1@camera-2\n", "demo-1@a/b-1", "@camera-2"]
)
def test_a_name_on_a_track_is_safe_in_a_path(name: str) -> None:
    content = json.loads(on_track("camera-2").dataset.model_dump_json())
    assert DatasetRecord.model_validate(content).name == "demo-1@camera-2"
    with pytest.raises(ValidationError, match="name"):
        DatasetRecord.model_validate({**content, "name": name})


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"seconds": None}, "what was measured is lacking"),
        ({"prediction_sha256": None}, "what was measured is lacking"),
        ({"status": "failed", "error": "no"}, "nothing can have been measured"),
        ({"error": "no"}, "an error of a pair that was evaluated"),
        ({"status": "not-run", "scores": {}, "prediction_sha256": None}, "nothing can have been"),
    ],
)
def test_a_row_leaves_out_no_time_and_no_hash(
    tmp_path: Path, changes: dict[str, Any], told: str
) -> None:
    result = make_demo_result(lambda pair: 0.1)
    pairs = [result.pairs[0].model_copy(update=changes), *result.pairs[1:]]
    (problem,) = data_set_problems(result.model_copy(update={"pairs": pairs}), tmp_path, "here")
    assert told in problem.what
    assert result.pairs[0].id in problem.where
    # Of depth maps made elsewhere nobody took the time.
    method = result.method.model_copy(update={"scored": "levels"})
    none = [pair.model_copy(update={"seconds": None}) for pair in result.pairs]
    scored = result.model_copy(update={"pairs": none, "method": method})
    assert not data_set_problems(scored, tmp_path, "here")


@pytest.mark.parametrize("version", [True, 1.0, "1", 2])
def test_a_protocol_is_the_released_one_to_the_letter(tmp_path: Path, version: Any) -> None:
    result = make_demo_result(lambda pair: 0.1)
    (protocol,) = result.protocols
    protocols = [{**protocol, "version": version}]
    other = result.model_copy(update={"protocols": protocols})
    problems = data_set_problems(other, tmp_path, "here")
    assert "not a released protocol" in [problem.what for problem in problems]


def test_known_data_are_of_the_recipe_that_made_them(tmp_path: Path) -> None:
    (tmp_path / FINGERPRINTS).write_text(json.dumps({"demo-1": ["2" * 64]}))
    result = make_demo_result(lambda pair: 0.1)
    assert not data_set_problems(result, tmp_path, "here")
    recipe = {"name": "text", "parameters": RECIPES["text"].as_dict()}
    dataset = result.dataset.model_copy(update={"recipe": recipe})
    (problem,) = data_set_problems(result.model_copy(update={"dataset": dataset}), tmp_path, "here")
    assert problem.what.startswith("another blur recipe")
    # Made with it, they are other data, which stand in a table of their own.
    other = dataset.model_copy(update={"fingerprint": "3" * 64})
    assert not data_set_problems(result.model_copy(update={"dataset": other}), tmp_path, "here")
