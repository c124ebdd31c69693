import json
from collections.abc import Callable
from importlib import resources
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from dfdbench.errors import ResultError
from dfdbench.metrics.protocol import RELEASED
from dfdbench.results.record import Result, load_result, save_result
from tests.made_results import make_result

VALUES = {("a", 1, 1, 0): 0.2, ("b", 1, 1, 0): 0.1, ("b", 5, 1, 0): None}
WRONG = "wrong value"
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


def test_a_result_that_contradicts_itself_or_attacks_is_refused(tmp_path: Path) -> None:
    cases: list[tuple[Callable[[dict[str, Any]], Any], str]] = [
        (lambda c: c["pairs"].pop(0), "do not add up"),
        (lambda c: c["pairs"].__setitem__(1, c["pairs"][0]), "do not add up"),
        (lambda c: c["pairs"][0].update(scores={}), "not scored under"),
        (lambda c: c["pairs"][0].update(machine=1), "machine that is not listed"),
        (lambda c: c["dataset"].update(colour="red"), "colour"),
        (lambda c: c.update(schema_version=7), "schema_version"),
        (lambda c: c["dataset"].update(blocks="colour"), "not among the axes"),
        (lambda c: c["pairs"][0]["coordinates"].pop("view"), "its name says"),
        (lambda c: c["dataset"]["axes"].append("view"), "listed twice"),
        # What is impossible, or an attack.
        (lambda c: c["pairs"][0].update(seconds=-1), WRONG),
        (lambda c: c["pairs"][0].update(scene="../../elsewhere"), WRONG),
        (lambda c: c["pairs"][0]["coordinates"].update(view=10**400), WRONG),
        (lambda c: c["pairs"][0]["scores"]["thesis"].update(nrmse=float("nan")), WRONG),
        (lambda c: c["pairs"][0]["scores"]["metric"].update(delta_125=1.1), WRONG),
        (lambda c: c["protocols"][1].update(metrics=["nrmse"]), WRONG),
        (lambda c: c["protocols"][0].update(name="../thesis"), WRONG),
        (lambda c: c["dataset"].update(name=EVIL), WRONG),
        (lambda c: c["method"].update(name="local\x1b[2J"), WRONG),
        (lambda c: c["method"].update(parameters={"a": "\ud800"}), "lone surrogate"),
        (lambda c: c["method"].update(parameters={"a": float("inf")}), WRONG),
    ]
    assert read(made(), tmp_path).pairs[0].score("metric", "abs_rel") == 0.1
    for tamper, said in cases:
        content = made()
        tamper(content)
        with pytest.raises(ResultError, match=said):
            read(content, tmp_path)


def test_averages_follow_from_pairs(tmp_path: Path) -> None:
    content = made()
    content["averages"]["thesis"]["nrmse"] = 0.05
    assert read(content, tmp_path).averages["thesis"]["nrmse"] == pytest.approx(0.15)
    content["pairs"][0]["status"] = "failed"
    content["dataset"]["evaluated"] = 2
    assert read(content, tmp_path).averages is None


def test_the_published_schema_is_that_of_the_code_and_holds(tmp_path: Path) -> None:
    published = (resources.files("dfdbench.results.schemas") / "result-1.json").read_text("utf-8")
    assert published == json.dumps(Result.model_json_schema(), indent=1, sort_keys=True) + "\n"
    result = make_result(VALUES)
    save_result(result, tmp_path / "r.json")
    assert load_result(tmp_path / "r.json") == result
    jsonschema.validate(json.loads((tmp_path / "r.json").read_text()), json.loads(published))


def test_where_there_is_no_result_it_says_what_to_do(tmp_path: Path) -> None:
    (tmp_path / "empty.json").touch()
    (tmp_path / "torn.json").write_text("{")
    for name in ("none", "empty", "torn"):
        with pytest.raises(ResultError) as raised:
            load_result(tmp_path / f"{name}.json")
        (problem,) = raised.value.problems
        assert "dfdbench run" in problem.fix
        assert "Errno" not in str(problem)
