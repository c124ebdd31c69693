import hashlib
import os
import re
import warnings
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dfdbench.blur.recipe import RECIPES, BlurRecipe
from dfdbench.errors import MethodError, UnknownNameError
from dfdbench.methods.calling import call
from dfdbench.methods.method import Method
from dfdbench.methods.registry import load, load_method, registered_methods

IMAGE = np.zeros((4, 6, 3), np.uint8)

MODULE = """
import numpy as np

def predict(infocus, defocus):
    return np.full(infocus.shape[:2], 7)

def scaled(infocus, defocus, factor=1.0, *, offset=0.0):
    return np.full(infocus.shape[:2], factor * 10 + offset)

class Named:
    trained_on = "nothing"
    paper = "none"

    def __init__(self, recipe, level=1):
        self.recipe, self.level = recipe, level

    def __call__(self, infocus, defocus):
        return np.full(infocus.shape[:2], self.level)

class Broken:
    def __init__(self):
        raise RuntimeError("no weights")

number = 5
"""


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    path = tmp_path / "mine.py"
    path.write_text(MODULE)
    monkeypatch.chdir(tmp_path)
    return path


def test_a_file_and_a_module_give_the_same_method(module: Path) -> None:
    for name in (f"{module}:predict", "mine.py:predict", "mine:predict"):
        method = load_method(name, {}, {})
        assert method.predict(IMAGE, IMAGE).tolist() == [[7] * 6] * 4
        assert method.source_sha256 is not None


def test_parameters_reach_functions_and_classes(module: Path) -> None:
    assert load("mine.py:scaled", factor=2, offset=1)(IMAGE, IMAGE)[0, 0] == 21
    assert load("mine.py:Named", recipe="text", level=3).recipe == RECIPES["text"]  # type: ignore[attr-defined]


def test_a_class_is_handed_what_it_asks_for_and_the_user_goes_first(module: Path) -> None:
    def offer() -> BlurRecipe:
        return RECIPES["published"]

    offers: dict[str, Any] = {"recipe": offer, "training_mean": lambda: 1 / 0}
    method = load_method("mine.py:Named", {}, offers)
    assert method.uses == ("recipe",)
    assert method.predict.recipe == RECIPES["published"]  # type: ignore[attr-defined]
    assert (method.trained_on, method.paper) == ("nothing", "none")
    chosen = load_method("mine.py:Named", {"recipe": "text"}, offers)
    assert chosen.uses == ()
    assert chosen.predict.recipe == RECIPES["text"]  # type: ignore[attr-defined]
    assert chosen.parameters == {"recipe": "text"}


@pytest.mark.parametrize(
    ("name", "parameters", "told"),
    [
        ("nosuch:thing", {}, "no module named nosuch"),
        ("nosuch.py:thing", {}, "no such file"),
        ("mine.py:predikt", {}, "did you mean predict"),
        ("mine.py:number", {}, "not a method"),
        ("mine.py:", {}, "module:attribute"),
        ("mine.py:scaled", {"facto": 1}, "unknown parameter"),
        ("mine.py:predict", {"x": 1}, "no parameters"),
        ("mine.py:Named", {}, "--param recipe=VALUE"),
        ("mine.py:Named", {"recipe": "published", "lvl": 1}, "lvl"),
        ("mine.py:Broken", {}, "RuntimeError: no weights"),
        ("broken.py:predict", {}, "SyntaxError"),
        ("needs.py:predict", {}, "No module named 'nosuchpackage'"),
    ],
)
def test_what_cannot_be_loaded_says_why(
    module: Path, name: str, parameters: dict[str, Any], told: str
) -> None:
    module.with_name("broken.py").write_text("def predict(:\n")
    module.with_name("needs.py").write_text("import nosuchpackage\n")
    with pytest.raises(MethodError) as caught:
        load_method(name, parameters, {})
    assert told in str(caught.value)


def test_an_unknown_name_shows_the_near_miss() -> None:
    with pytest.raises(UnknownNameError, match="did you mean local"):
        load("locl")


def test_packages_register_through_entry_points(
    module: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    offered = [
        EntryPoint("mine", "mine:predict", "dfdbench.methods"),
        EntryPoint("local", "mine:predict", "dfdbench.methods"),
    ]
    monkeypatch.setattr("dfdbench.methods.entry_points", lambda group: EntryPoints(offered))
    assert registered_methods()["mine"] == "mine:predict"
    assert registered_methods()["local"].startswith("dfdbench.")
    assert load("mine")(IMAGE, IMAGE)[0, 0] == 7


def raising(*_: object) -> None:
    raise RuntimeError("boom")


@pytest.mark.parametrize(
    ("answer", "told"),
    [
        (np.zeros((4, 6, 3)), "returned shape (4, 6, 3)"),
        (np.zeros((6, 4)), "returned shape (6, 4)"),
        (5, "returned shape ()"),
        (None, "returned object values"),
        ("depth", "expected real numbers"),
        (np.full((4, 6), np.nan), "NaN or infinity in 24 of 24"),
        (np.full((4, 6), np.inf), "NaN or infinity"),
        (np.full((4, 6), -1.0), "levels from -1"),
        (np.full((4, 6), 255.5), "expected 0 to 255"),
        (np.zeros((4, 6), complex), "complex128"),
        (np.zeros((4, 6), bool), "bool"),
        ([[1, 2], [3]], "no array"),
    ],
)
def test_a_bad_answer_is_said_not_scored(answer: object, told: str) -> None:
    prediction = call(lambda *_: answer, IMAGE, IMAGE)
    assert prediction.depth is None
    assert told in prediction.error


class Saying:
    """Says of its second answer what it did not of its first."""

    numbers: Any = None

    def __call__(self, infocus: Any, defocus: Any) -> Any:
        if infocus.max() > 9:
            raise RuntimeError("too bright")
        self.numbers = {"energy": 12, "gap": np.float32(0.5), "note": "x", "bad": float("nan")}
        return np.zeros((4, 6))


def test_numbers_of_the_last_call_are_kept_if_they_are_numbers() -> None:
    method = Saying()
    prediction = call(method, IMAGE, IMAGE)
    assert prediction.error == ""
    assert prediction.numbers == {"energy": 12.0, "gap": 0.5}
    # A pair that failed has none, least of all those of the pair before.
    assert call(method, IMAGE + np.uint8(20), IMAGE).numbers == {}
    method.numbers = "many"
    assert call(lambda *_: np.zeros((4, 6)), IMAGE, IMAGE).numbers == {}


def test_numbers_beside_the_depth_are_refused_with_what_to_do() -> None:
    prediction = call(lambda *_: (np.zeros((4, 6)), {"energy": 1.0}), IMAGE, IMAGE)
    assert prediction.depth is None
    assert "attribute `numbers`" in prediction.error
    assert call(lambda *_: (np.zeros((4, 6)), 3), IMAGE, IMAGE).depth is None


@pytest.mark.parametrize("name", ["constant", "local", "graph-cuts", "graph-cuts-rounded"])
def test_what_is_loaded_returns_a_depth_map(name: str) -> None:
    image = np.random.default_rng(0).integers(0, 256, (24, 30, 3)).astype(np.uint8)
    given = {"training_mean": 90.0} if name == "constant" else {}
    depth = load(name, **given)(image, image)
    assert isinstance(depth, np.ndarray)
    assert (depth.shape, depth.dtype) == ((24, 30), np.float32)


def leaving(*_: object) -> None:
    raise SystemExit(0)


def test_a_method_that_raises_or_leaves_is_caught() -> None:
    assert call(raising, IMAGE, IMAGE).error == "raised RuntimeError: boom"
    assert call(leaving, IMAGE, IMAGE).error == "raised SystemExit: 0"


@pytest.mark.parametrize("dtype", [np.uint8, np.int64, np.float16, np.float32, np.float64])
def test_every_real_type_will_do(dtype: type) -> None:
    prediction = call(lambda *_: np.full((4, 6), 200, dtype), IMAGE, IMAGE)
    assert prediction.depth is not None
    assert prediction.depth.dtype == np.float32
    assert prediction.depth.tolist() == [[200.0] * 6] * 4


def test_rounding_past_the_range_is_clipped() -> None:
    prediction = call(lambda *_: np.full((4, 6), 255.00001), IMAGE, IMAGE)
    assert prediction.depth is not None
    assert prediction.depth.max() == 255


def test_what_a_method_prints_is_kept_apart(capsys: pytest.CaptureFixture[str]) -> None:
    def talking(infocus: Any, defocus: Any) -> Any:
        print("layer 1")
        return infocus[..., 0]

    assert call(talking, IMAGE, IMAGE).printed == "layer 1\n"
    assert capsys.readouterr().out == ""


def test_a_method_cannot_spoil_the_images() -> None:
    def writing(infocus: Any, defocus: Any) -> Any:
        infocus[:] = 9
        return defocus[..., 0]

    image = IMAGE.copy()
    call(writing, image, image)
    assert image.max() == 0


def test_a_method_cannot_spoil_the_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def spoiling(infocus: Any, defocus: Any) -> Any:
        os.chdir(tmp_path)
        os.environ["MINE"] = "1"
        os.environ["KEPT"] = "changed"
        del os.environ["GONE"]
        np.set_printoptions(precision=1)
        np.seterr(all="raise")
        warnings.simplefilter("error")
        if infocus.max():
            raise RuntimeError("boom")
        return infocus[..., 0]

    monkeypatch.setenv("KEPT", "as it was")
    monkeypatch.setenv("GONE", "not gone")

    def state() -> tuple[Any, ...]:
        filters = list(warnings.filters)
        return Path.cwd(), dict(os.environ), np.get_printoptions(), np.geterr(), filters

    before = state()
    for image in (IMAGE, IMAGE + np.uint8(1)):
        call(spoiling, image, image)
        assert state() == before


FIELDS = {"sigma_min": 0.2, "sigma_step": 0.006}


@pytest.mark.parametrize("form", ["mapping", "file", "path", "recipe"])
def test_a_recipe_may_be_given_in_many_forms(tmp_path: Path, form: str) -> None:
    file = tmp_path / "mine.toml"
    file.write_text("sigma_min = 0.2\nsigma_step = 0.006\n")
    expected = BlurRecipe(**FIELDS)  # type: ignore[arg-type]
    given: dict[str, Any] = {"mapping": FIELDS, "file": str(file), "path": file, "recipe": expected}
    method = load_method("local", {"recipe": given[form]}, {})
    assert method.predict._recipe == expected  # type: ignore[attr-defined]
    assert method.predict(IMAGE, IMAGE).shape == (4, 6)
    recorded = expected.as_dict() if form == "recipe" else FIELDS
    assert method.parameters == {"recipe": recorded}


@pytest.mark.parametrize(
    ("fields", "told"),
    [
        ({"sigma_min": 0.2}, "sigma_step"),
        (FIELDS | {"sigma_mni": 1}, "sigma_mni"),
        (FIELDS | {"sigma_min": "0.2"}, "parameter recipe: sigma_min"),
        (FIELDS | {"sigma_min": True}, "parameter recipe: sigma_min"),
        (FIELDS | {"sigma_min": float("nan")}, "parameter recipe: sigma_min"),
        (FIELDS | {"sigma_step": float("inf")}, "parameter recipe: sigma_step"),
        (FIELDS | {"sigma_step": 10**400}, "parameter recipe: sigma_step"),
        (FIELDS | {"sigma_step": -0.1}, "parameter recipe: sigma_step"),
        (FIELDS | {"levels": 128.5}, "parameter recipe: levels"),
        (FIELDS | {"kernel_size": 27.0}, "parameter recipe: kernel_size"),
        (FIELDS | {"invert": "no"}, "parameter recipe: invert"),
        ("nowhere.toml", "No such file"),
        ("broken.toml", "cannot read the blur recipe"),
        ("negative.toml", "negative.toml: sigma_min"),
        (5, "not a blur recipe"),
        (None, "not a blur recipe"),
    ],
)
def test_a_recipe_that_is_none_is_refused_by_name(module: Path, fields: Any, told: str) -> None:
    module.with_name("broken.toml").write_text("sigma_min =")
    module.with_name("negative.toml").write_text("sigma_min = -1\nsigma_step = 1\n")
    with pytest.raises(MethodError, match=re.escape(told)):
        load("local", recipe=fields)


def test_files_that_parameters_name_are_hashed(module: Path) -> None:
    folder = module.with_name("prior")
    (folder / "in").mkdir(parents=True)
    (folder / "in" / "a.txt").write_text("a")
    given = {"prior": "prior", "more": ["mine.py", {"deep": "mine.py"}], "window": 9, "word": "x"}

    def hashes() -> dict[str, str]:
        return Method("m", "m:m", raising, given).files_sha256

    first = hashes()
    assert set(first) == {"prior", "more.0", "more.1.deep"}
    digest = hashlib.sha256(module.read_bytes()).hexdigest()
    assert first["more.0"] == first["more.1.deep"] == digest
    (folder / "in" / "a.txt").rename(folder / "in" / "b.txt")
    renamed = hashes()
    (folder / "in" / "b.txt").write_text("b")
    assert len({first["prior"], renamed["prior"], hashes()["prior"]}) == 3
    assert hashes()["more.0"] == digest
