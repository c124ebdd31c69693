import json
from collections.abc import Callable
from importlib import resources
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from dfdbench.errors import ResultError
from dfdbench.metrics.protocol import RELEASED
from dfdbench.results.record import Result, first_protocol, load_result, save_result
from tests.made_results import make_result

VALUES = {("a", 1, 1, 0): 0.2, ("b", 1, 1, 0): 0.1, ("b", 5, 1, 0): None}
EVIL = "x/../../../../elsewhere/evil"
SCORES = {
    **{"abs_rel": 0.1, "rmse_m": 0.5, "delta_105": 0.5, "delta_115": 0.75},
    **{"delta_125": 1.0, "boundary_f1": 0.3},
}


def made() -> dict[str, Any]:
    """The content of a result, scored in levels and in metres."""
    content: dict[str, Any] = json.loads(make_result(VALUES).model_dump_json())
    content["protocols"].append(RELEASED["metric"].as_dict())
    for pair in content["pairs"]:
        pair["scores"]["metric"] = dict(SCORES)
    return content


def read(content: dict[str, Any], folder: Path) -> Any:
    (folder / "r.json").write_text(json.dumps(content))
    return load_result(folder / "r.json")


def test_a_result_that_contradicts_itself_is_refused(tmp_path: Path) -> None:
    cases: list[tuple[Callable[[dict[str, Any]], Any], str]] = [
        (lambda c: c["pairs"].pop(0), "do not add up"),
        (lambda c: c["pairs"].__setitem__(1, c["pairs"][0]), "do not add up"),
        (lambda c: c["pairs"][0].update(status="failed"), "do not add up"),
        (lambda c: c["pairs"][0].update(scores={}), "not scored under"),
        (lambda c: c["pairs"][0].update(machine=1), "machine that is not listed"),
        (lambda c: c["dataset"].update(colour="red"), "colour"),
        (lambda c: c.update(schema_version=7), "schema_version"),
        (lambda c: c["dataset"].update(blocks="colour"), "not among the axes"),
        (lambda c: c["pairs"][0]["coordinates"].pop("view"), "its name says"),
        (lambda c: c["pairs"][0].update(id="../x"), "its name says"),
        (lambda c: c["dataset"]["axes"].append("view"), "listed twice"),
        (lambda c: c["protocols"].append(c["protocols"][0]), "listed twice"),
    ]
    for tamper, said in cases:
        content = made()
        tamper(content)
        with pytest.raises(ResultError, match=said):
            read(content, tmp_path)


def test_averages_follow_from_pairs_whatever_is_written(tmp_path: Path) -> None:
    content = made()
    for value in (0.05, None):
        content["averages"]["thesis"]["nrmse"] = value
        assert read(content, tmp_path).averages["thesis"]["nrmse"] == pytest.approx(0.15)
    content["pairs"][0]["status"] = "failed"
    content["dataset"]["evaluated"] = 2
    assert read(content, tmp_path).averages is None


def test_values_that_are_impossible_or_an_attack_are_refused(tmp_path: Path) -> None:
    assert read(made(), tmp_path).pairs[0].score("metric", "abs_rel") == 0.1
    changes: list[Callable[[dict[str, Any]], Any]] = [
        lambda c: c["pairs"][0].update(seconds=-1),
        lambda c: c["pairs"][0].update(scene="../../elsewhere"),
        lambda c: c["pairs"][0]["coordinates"].update(view=10**400),
        lambda c: c["pairs"][0]["scores"]["thesis"].update(nrmse=-9),
        lambda c: c["pairs"][0]["scores"]["thesis"].pop("ssim"),
        lambda c: c["pairs"][0]["scores"]["thesis"].update(ssim=1.7),
        lambda c: c["pairs"][0]["scores"]["thesis"].update(nrmse=float("nan")),
        lambda c: c["pairs"][0]["scores"]["metric"].update(delta_125=1.1),
        lambda c: c["pairs"][0]["scores"]["metric"].update(nrmse=0.1),
        lambda c: c["protocols"][1].update(metrics=["nrmse"]),
        lambda c: c["protocols"][0].update(name="../thesis"),
        lambda c: c["dataset"].update(name=EVIL),
        lambda c: c["dataset"].update(axes=["view", "illumination", EVIL]),
        lambda c: c["dataset"].update(recipe={}),
        lambda c: c["method"].update(name="local\x1b[2J"),
        lambda c: c["method"].update(parameters={"a": "\ud800"}),
        lambda c: c["method"].update(parameters={"a": float("inf")}),
        lambda c: c.update(seed=-1),
    ]
    for tamper in changes:
        content = made()
        tamper(content)
        with pytest.raises(ResultError, match=r"wrong value|lone surrogate|damaged|unknown field"):
            read(content, tmp_path)


def test_sets_with_printed_tables_are_headed_by_the_thesis_all_else_by_known_pixels() -> None:
    assert first_protocol("middlebury") == first_protocol("middlebury-default") == "thesis"
    assert first_protocol("middlebury@camera-2") == first_protocol("demo") == "valid"
    assert first_protocol("mine") == first_protocol("realworld-synthetic@law-1") == "valid"


def test_the_published_schema_is_that_of_the_code_and_holds(tmp_path: Path) -> None:
    published = (resources.files("dfdbench.results.schemas") / "result-1.json").read_text("utf-8")
    assert published == json.dumps(Result.model_json_schema(), indent=1, sort_keys=True) + "\n"
    save_result(make_result(VALUES), tmp_path / "r.json")
    jsonschema.validate(json.loads((tmp_path / "r.json").read_text()), json.loads(published))


def test_where_there_is_no_result_it_says_what_to_do(tmp_path: Path) -> None:
    for text in (None, "", "{"):
        path = tmp_path / "r.json"
        if text is not None:
            path.write_text(text)
        with pytest.raises(ResultError) as raised:
            load_result(path)
        (problem,) = raised.value.problems
        assert "dfdbench run" in problem.fix
        assert "Errno" not in str(problem)
