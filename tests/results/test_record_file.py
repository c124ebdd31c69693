import json
from importlib import resources
from pathlib import Path

import jsonschema
import pytest

from dfdbench.errors import ResultError
from dfdbench.results.record import Result
from dfdbench.results.record_file import load_result, save_result
from tests.made_results import make_result

VALUES = {("a", 1, 1, 0): 0.2, ("b", 1, 1, 0): 0.1, ("b", 5, 1, 0): None}


def test_what_is_saved_is_loaded(tmp_path: Path) -> None:
    result = make_result(VALUES)
    save_result(result, tmp_path / "r.json")
    assert load_result(tmp_path / "r.json") == load_result(f"{tmp_path}/r.json") == result
    with pytest.raises(ResultError, match="cannot read the result"):
        load_result("no such file")


def test_the_published_schema_is_that_of_the_code_and_holds(tmp_path: Path) -> None:
    published = (resources.files("dfdbench.results.schemas") / "result-1.json").read_text("utf-8")
    assert published == json.dumps(Result.model_json_schema(), indent=1, sort_keys=True) + "\n"
    save_result(make_result(VALUES), tmp_path / "r.json")
    jsonschema.validate(json.loads((tmp_path / "r.json").read_text()), json.loads(published))


@pytest.mark.parametrize("text", ["[]", "null", '{"a": 1}'])
def test_what_is_no_result_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "r.json").write_text(text)
    with pytest.raises(ResultError):
        load_result(tmp_path / "r.json")


@pytest.mark.parametrize("text", [None, "", "{"])
def test_where_there_is_no_result_it_says_what_to_do(tmp_path: Path, text: str | None) -> None:
    path = tmp_path / "r.json"
    if text is not None:
        path.write_text(text)
    with pytest.raises(ResultError) as raised:
        load_result(path)
    (problem,) = raised.value.problems
    assert "dfdbench run" in problem.fix
    assert "Errno" not in str(problem)


@pytest.mark.parametrize("text", ["[" * 100_000, '{"schema_version": ' + "9" * 5000 + "}"])
def test_json_that_python_does_not_take_is_told_as_damage(tmp_path: Path, text: str) -> None:
    (tmp_path / "r.json").write_text(text)
    with pytest.raises(ResultError, match="damaged"):
        load_result(tmp_path / "r.json")
