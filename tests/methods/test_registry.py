import sys
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from dfdbench.blur.recipe import RECIPES
from dfdbench.errors import MethodError
from dfdbench.methods.registry import entry_of, load, load_method, registered_methods

IMAGE = np.zeros((4, 6, 3), np.uint8)


def of_two(a: Any, b: Any) -> Any:
    return a[..., 0]


def test_parameters_reach_functions_and_classes(module: Path) -> None:
    assert load("mine.py:scaled", factor=2, offset=1)(IMAGE, IMAGE)[0, 0] == 21
    assert load("mine.py:Named", recipe="text", level=3).recipe == RECIPES["text"]  # type: ignore[attr-defined]


def test_a_place_that_no_result_could_name_is_refused_before_a_run(tmp_path: Path) -> None:
    (tmp_path / "a\x1b[31m.py").write_text("def predict(infocus, defocus): return infocus[..., 0]")
    with pytest.raises(MethodError, match="cannot be printed"):
        load_method(f"{tmp_path}/a\x1b[31m.py:predict", {}, {})


def test_a_class_is_handed_what_it_asks_for_and_the_user_goes_first(module: Path) -> None:
    offers: dict[str, Any] = {"recipe": lambda: RECIPES["published"]}
    offers["training_mean"] = lambda: 1 / 0
    method = load_method("mine.py:Named", {}, offers)
    assert method.uses == ("recipe",)
    assert method.predict.recipe == RECIPES["published"]  # type: ignore[attr-defined]
    assert (method.trained_on, method.paper) == ("nothing", "none")
    chosen = load_method("mine.py:Named", {"recipe": "text"}, offers)
    assert chosen.uses == ()
    assert chosen.predict.recipe == RECIPES["text"]  # type: ignore[attr-defined]
    assert chosen.parameters == {"recipe": "text"}


@pytest.mark.usefixtures("module")
def test_what_cannot_be_made_with_these_parameters_says_why() -> None:
    wrong: list[tuple[str, dict[str, Any], str]] = [
        ("mine.py:scaled", {"facto": 1}, "did you mean factor"),
        ("mine.py:scaled", {"offset": "abc"}, "parameter offset is text"),
        ("mine.py:number", {}, "an int"),
        ("mine.py:predict", {"x": 1}, "no parameters"),
        ("tests.methods.test_registry:of_two", {"x": 1}, "expected no parameters"),
        ("tests.methods.test_registry:of_two", {"a": 1}, "expected no parameters"),
        ("mine.py:Named", {}, "--param recipe=VALUE"),
        ("mine.py:Broken", {}, "RuntimeError: no weights"),
    ]
    for name, parameters, told in wrong:
        with pytest.raises(MethodError) as caught:
            load_method(name, parameters, {})
        assert told in str(caught.value)


def test_packages_register_entry_points(module: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    offered = [
        EntryPoint("mine", "mine:predict", "dfdbench.methods"),
        EntryPoint("local", "mine:predict", "dfdbench.methods"),
    ]
    monkeypatch.setattr("dfdbench.system.packages.entry_points", lambda group: EntryPoints(offered))
    assert registered_methods()["mine"] == "mine:predict"
    assert registered_methods()["local"].startswith("dfdbench.")
    assert load("mine")(IMAGE, IMAGE)[0, 0] == 7


def test_what_is_piped_into_python_has_no_name(monkeypatch: pytest.MonkeyPatch) -> None:
    piped = ModuleType("piped")
    exec("def predict(infocus, defocus): return infocus[..., 0]", piped.__dict__)
    piped.__file__ = "<stdin>"
    monkeypatch.setitem(sys.modules, "piped", piped)
    with pytest.raises(MethodError, match="no name under which it could be found again"):
        entry_of(piped.predict)


def test_what_a_function_or_an_object_says_holds_with_parameters_too() -> None:
    def distance(infocus: Any, defocus: Any, scale: float = 2.0) -> Any:
        return np.full(infocus.shape[:2], scale)

    distance.unit, distance.trained_on = "metres", "demo-1, split test"  # type: ignore[attr-defined]
    method = load_method(distance, {"scale": 3}, {})
    assert (method.answers_in("levels"), method.trained_on) == ("metres", "demo-1, split test")
    assert method(IMAGE, IMAGE)[0, 0] == 3

    class Both:
        def fit(self, pairs: Any) -> None:
            self.level = 7

        def __call__(self, infocus: Any, defocus: Any, scale: int = 1) -> Any:
            return scale * self.level

        def from_stack(self, stack: Any, scale: int = 1) -> Any:
            return -scale * self.level

    fitted = load_method(Both(), {"scale": 3}, {}).fit([])
    assert (fitted.predict(IMAGE, IMAGE), fitted.attribute("from_stack")(IMAGE)) == (21, -21)
    stacks = load_method(lambda stack, scale: stack, {"scale": 3}, {})
    assert stacks.takes_stack
