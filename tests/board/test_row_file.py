"""A row's file: what it keeps of runs, and what it refuses."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from dfdbench.board.row_file import Row, read_row, row_of, row_problems, row_text, training_problems
from dfdbench.errors import ResultError
from dfdbench.results.record import Result
from tests.board.made_boards import make_tracks
from tests.made_results import edited, limited, make_demo_result

WEIGHTS = "5" * 64


def saved(folder: Path, results: list[Result]) -> Path:
    path = folder / "row.json"
    path.write_text(row_text(row_of(results, ["clean"])), "utf-8")
    return path


def test_a_row_gives_back_every_number_of_its_runs(tmp_path: Path) -> None:
    runs = make_tracks("mine", 1 / 3, ["noise-1", "camera-2"], fitted_on="demo-1@{label}, train")
    clean = make_demo_result(lambda pair: 1 / 7, protocols=("thesis", "valid"))
    clean = edited(clean, pairs={"numbers": {"energy": 1.5}})
    elsewhere = edited(clean.environment, cpu="another")
    part = limited(runs["noise-1"], 5)
    stopped = edited(part, other_environments=[elsewhere], pairs={"machine": 1})
    results = [clean, stopped, runs["camera-2"]]
    assert list(read_row(saved(tmp_path, results)).results) == results


def drop_pair(content: dict[str, Any]) -> None:
    del content["pairs"][0]
    for run in content["runs"]:
        for column in (run["status"], run["seconds"], run["prediction_sha256"]):
            del column[0]
        for scores in run["scores"].values():
            for column in scores.values():
                del column[0]


def change(*places: str | int, to: object) -> Callable[[dict[str, Any]], None]:
    def tamper(content: Any) -> None:
        for place in places[:-1]:
            content = content[place]
        content[places[-1]] = to

    return tamper


RUN = ("runs", 0)
SCORE = (*RUN, "scores", "valid", "nrmse", 3)


def test_a_file_that_contradicts_itself_is_refused(tmp_path: Path) -> None:
    path = saved(tmp_path, [make_demo_result(lambda pair: 0.1)])
    whole = path.read_text("utf-8")
    for tamper, told in (
        (drop_pair, "not those of demo-1, split test: Kitchen/view1/illumination1/exposure0"),
        (change("dataset", to="demmo-1"), "unknown data set"),
        (change("suites", to=["tracks-9"]), "no such suite"),
        (change("status", to="reproduced"), "unknown field"),
        (change(*SCORE, to=-0.1), "nrmse should be from 0 to 255"),
        (change(*RUN, "scores", "valid", "nmae", to=[]), "0 places for 54 pairs"),
        (change(*RUN, "scores", to={"mine": {}}), "no such protocol"),
        (change(*RUN, "scores", "valid", to={}), "metrics should be nrmse"),
        (change(*RUN, "seconds", 0, to=None), "an evaluated pair has no seconds"),
        (change(*RUN, "prediction_sha256", 0, to=None), "no prediction_sha256"),
        (change(*RUN, "status", 0, to="failed"), "of a pair that was not evaluated"),
        (change(*RUN, "label", to="fog-1"), "no such run"),
        (change(*RUN, "machine", to=[1] * 54), "a machine that is not listed"),
        (change(*RUN, "environment", to={"gpus": 3}), "environment.gpus: Extra inputs"),
        (change(*RUN, "method", to={"fitted_on": 5}), "method.fitted_on: Input should be a valid"),
        # What would be imported is the row's, which is checked.
        (change(*RUN, "method", to={"entry": "evil:predict"}), "method.entry is the same in all"),
        (change(*RUN, "method", to={"weights_sha256": "0" * 64}), "method.weights_sha256 is the"),
        (lambda content: content["runs"].append(content["runs"][0]), "is there twice"),
    ):
        content = json.loads(whole)
        tamper(content)
        path.write_text(json.dumps(content))
        with pytest.raises(ResultError, match=told) as caught:
            read_row(path)
        assert str(path) in str(caught.value)


def a_row() -> Row:
    return row_of([make_demo_result(lambda pair: 0.1)], ["clean"])


def problems(folder: Path, **changes: Any) -> str:
    return "\n".join(map(str, row_problems(edited(a_row(), **changes), folder, "here")))


def test_other_data_and_another_method_of_a_known_name_are_told(tmp_path: Path) -> None:
    assert not problems(tmp_path)
    runs = [run.model_copy(update={"scores": {}}) for run in a_row().runs]
    assert "no scores under valid" in problems(tmp_path, runs=runs)
    assert "another manifest" in problems(tmp_path, manifest_sha256="9" * 64)
    (tmp_path / "fingerprints.json").write_text(json.dumps({"demo-1": ["8" * 64]}))
    assert "run on other data than demo-1 (here: clean, fingerprint)" in problems(tmp_path)
    (tmp_path / "fingerprints.json").write_text(json.dumps({"demo-1": ["2" * 64]}))
    assert not problems(tmp_path)
    method = make_demo_result(lambda pair: 0.1, "graph-cuts").method
    assert "graph-cuts is another method here" in problems(tmp_path, method=method)
    (tmp_path / "fingerprints.json").write_text("[]")
    with pytest.raises(ResultError, match="list of fingerprints"):
        problems(tmp_path)


def test_a_fit_that_saw_the_test_is_told(tmp_path: Path) -> None:
    for fitted_on, told in (("demo-1, split train", ""), ("demo-1, all but Attic", "Kitchen")):
        method = edited(make_demo_result(lambda pair: 0.1).method, fitted_on=fitted_on)
        found = problems(tmp_path, method=method)
        assert (f"fitted on scenes of the test, {told}" in found) is bool(told)


def test_scenes_that_weights_were_trained_on_are_named() -> None:
    for trained_on, dataset, split, scenes in (
        ("demo-1, split train", "demo-1", "all", "Attic, Barn, Cabin, Depot, Forge, Garage"),
        ("demo-1, all but Attic", "demo-1", "test", "Kitchen, Library, Market"),
        ("middlebury-third-1, split train", "middlebury-default-1", "Aloe", "Aloe"),
        ("demo-1, split train", "demo-1", "test", None),
        ("demo-1, all but Attic", "demo-1", "Attic", None),
        ("unseen-0-1, split train; demo-1, split train", "demo-1", "Barn", "Barn"),
        ("photographs of my own", "demo-1", "all", None),
        ("mine-1, split train", "demo-1", "all", None),
        (None, "demo-1", "all", None),
    ):
        found = [p.what for p in training_problems(trained_on, WEIGHTS, dataset, split, "here")]
        what = f"the weights were trained on scenes of the test, {scenes}"
        assert found == ([what] if scenes else [])
