import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dfdbench.blur.recipe import BlurRecipe
from dfdbench.errors import MethodError
from dfdbench.methods.parameters import files_sha256
from dfdbench.methods.registry import load, load_method

IMAGE = np.zeros((4, 6, 3), np.uint8)


FIELDS = {"sigma_min": 0.2, "sigma_step": 0.006}


@pytest.mark.parametrize("form", ["mapping", "file", "path", "recipe"])
def test_a_recipe_may_be_given_in_many_forms(tmp_path: Path, form: str) -> None:
    file = tmp_path / "mine.toml"
    file.write_text("sigma_min = 0.2\nsigma_step = 0.006\n")
    expected = BlurRecipe(**FIELDS)  # type: ignore[arg-type]
    given: dict[str, Any] = {"mapping": FIELDS, "file": str(file), "path": file, "recipe": expected}
    method = load_method("local", {"recipe": given[form]}, {})
    assert method.predict.blur == expected  # type: ignore[attr-defined]
    assert method.predict(IMAGE, IMAGE).shape == (4, 6)
    recorded = expected.as_dict() if form == "recipe" else FIELDS
    assert method.parameters == {"recipe": recorded}


def test_a_recipe_that_is_none_is_refused_by_name(module: Path) -> None:
    module.with_name("broken.toml").write_text("sigma_min =")
    module.with_name("negative.toml").write_text("sigma_min = -1\nsigma_step = 1\n")
    refused: list[tuple[Any, str]] = [
        ({"sigma_min": 0.2}, "sigma_step"),
        (FIELDS | {"sigma_mni": 1}, "sigma_mni"),
        (FIELDS | {"sigma_min": True}, "parameter recipe: sigma_min"),
        (FIELDS | {"sigma_step": float("inf")}, "parameter recipe: sigma_step"),
        (FIELDS | {"sigma_step": 10**400}, "parameter recipe: sigma_step"),
        (FIELDS | {"invert": "no"}, "parameter recipe: invert"),
        ("nowhere.toml", "No such file"),
        ("broken.toml", "cannot read the blur recipe"),
        ("negative.toml", "negative.toml: sigma_min"),
        (5, "not a blur recipe"),
    ]
    for fields, told in refused:
        with pytest.raises(MethodError, match=re.escape(told)):
            load("local", recipe=fields)


def test_what_no_result_can_keep_is_refused_before_a_run(module: Path) -> None:
    given = {"level": float("nan"), "deep": [1, {"a": float("-inf")}], "text": "a\udcff", "b": 1.5}
    with pytest.raises(MethodError, match="no result can keep") as told:
        load_method(f"{module}:predict", given, {})
    where = [problem.where.removeprefix("parameter ") for problem in told.value.problems]
    assert where == ["level", "deep.1.a", "text"]


@pytest.mark.parametrize("bound", ["_MOST_FILES", "_MOST_BYTES"])
def test_a_folder_too_large_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, bound: str
) -> None:
    (tmp_path / "deep").mkdir()
    for name in ("a", "deep/b", "deep/c"):
        (tmp_path / name).write_text("x")
    assert set(files_sha256({"w": str(tmp_path)})) == {"w"}
    monkeypatch.setattr(f"dfdbench.methods.parameters.{bound}", 2)
    with pytest.raises(MethodError, match="too large to hash"):
        files_sha256({"w": str(tmp_path)})
