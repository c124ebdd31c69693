import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pytest

from dfdbench.errors import MethodError
from dfdbench.methods.method import Method
from dfdbench.methods.registry import load_method
from dfdbench.methods.sources import ABSENT, changes
from tests.process import python

IMAGE = np.zeros((4, 6, 3), np.uint8)
MINE = """
import json
from pathlib import Path
import numpy as np
import mine_helper
from mine_package import level

HERE = Path(__file__).parent

def predict(infocus, defocus):
    import mine_late
    coefficients = json.loads((HERE / "coef.json").read_text())
    for name in ("absent.txt", "written.txt"):
        try:
            (HERE / name).read_text()
        except FileNotFoundError:
            pass
    (HERE / "written.txt").write_text("again")
    return np.full(infocus.shape[:2], coefficients["level"])
"""


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    # For what is imported late; while a file is loaded its folder comes first anyway.
    monkeypatch.syspath_prepend(str(tmp_path / "own"))
    folder = tmp_path / "own"
    (folder / "mine_package").mkdir(parents=True)
    for name, text in {
        "mine.py": MINE,
        "mine_helper.py": "import json\n",
        "mine_late.py": "import mine_later\n",
        "mine_later.py": "",
        "mine_not.py": "",
        "coef.json": '{"level": 9}',
        "mine_package/__init__.py": "",
        "mine_package/level.py": "from dfdbench.blur.recipe import RECIPES\n",
    }.items():
        (folder / name).write_text(text)
    yield folder
    for name in [name for name in sys.modules if name.startswith("mine")]:
        del sys.modules[name]


def call(method: Method) -> None:
    with method.sources.watch():
        method.predict(IMAGE, IMAGE)


GAIN = 0.3


def gained(values: Any) -> Any:
    return values * GAIN


def by_gain(infocus: Any, defocus: Any) -> Any:
    return gained(defocus.mean(axis=2))


def test_modules_are_those_that_it_imports_at_once_or_late(own: Path) -> None:
    used = load_method(f"{own / 'mine.py'}:predict", {}, {}).used
    assert {name for name in used if name.startswith("mine")} == {
        "mine.py",
        "mine_helper.py",
        "mine_late.py",
        "mine_later.py",
        "mine_package/__init__.py",
        "mine_package/level.py",
    }
    # What it uses of dfdbench counts too, if it computes.
    assert "dfdbench.blur.recipe" in used
    assert "dfdbench.errors" not in used


def test_files_are_those_that_it_opens_and_what_changed_is_named(own: Path) -> None:
    name = f"{own / 'mine.py'}:predict"
    method = load_method(name, {}, {})
    assert "coef.json" not in method.used
    call(method)
    before = method.used
    assert before["coef.json"] is not None
    assert before["absent.txt"] == ABSENT
    # Its own work is not compared.
    assert before["written.txt"] is None
    assert not any("site-packages" in name or name.endswith(".pyc") for name in before)
    assert changes(before, method.used_again(before)) == []
    (own / "coef.json").write_text('{"level": 10}')
    (own / "absent.txt").write_text("no longer")
    (own / "written.txt").write_text("by hand")
    (own / "mine_later.py").unlink()
    told = changes(before, load_method(name, {}, {}).used_again(before))
    assert told == ["absent.txt is new", "coef.json has changed", "mine_later.py is gone"]


def test_a_value_that_a_script_sets_anew_is_noticed() -> None:
    before = load_method(by_gain, {}, {}).used
    # What is not made yet is no change.
    for value, said in ((0.3, []), (None, []), (0.6, ["value of GAIN has changed"])):
        with mock.patch(f"{__name__}.GAIN", value):
            now = load_method(by_gain, {}, {})
        for used in (now.used, now.used_again(before)):
            assert changes(before, used) == said
    new = mock.patch.object(by_gain, "__defaults__", (IMAGE,))
    with new, mock.patch(f"{__name__}.gained", lambda values: values):
        told = changes(before, load_method(by_gain, {}, {}).used)
    assert told == ["value of by_gain has changed", "value of gained has changed"]


def test_labels_do_not_depend_on_where_the_folder_lies(own: Path) -> None:
    before = load_method(f"{own / 'mine.py'}:predict", {}, {}).used
    moved = own.rename(own.with_name("moved"))
    for name in [name for name in sys.modules if name.startswith("mine")]:
        del sys.modules[name]
    assert load_method(f"{moved / 'mine.py'}:predict", {}, {}).used == before
    # A module that is edited after its import is refused.
    (moved / "mine_helper.py").write_text("level = 3\n")
    with pytest.raises(MethodError, match="edited after") as told:
        _ = load_method(f"{moved / 'mine.py'}:predict", {}, {}).used
    assert "mine_helper.py" in str(told.value)


def test_a_module_of_a_package_has_all_of_the_package_for_its_own(own: Path) -> None:
    (own / "mine_package/deep").mkdir()
    (own / "mine_package/deep/__init__.py").write_text("")
    (own / "mine_package/deep/method.py").write_text(
        "from ..level import RECIPES\n"
        "from . import beside\n"
        "def predict(infocus, defocus):\n    return infocus[..., 0]\n"
    )
    (own / "mine_package/deep/beside.py").write_text("")
    used = load_method("mine_package.deep.method:predict", {}, {}).used
    assert {name for name in used if name.startswith("mine")} == {
        "mine_package/__init__.py",
        "mine_package/level.py",
        "mine_package/deep/__init__.py",
        "mine_package/deep/method.py",
        "mine_package/deep/beside.py",
    }


def test_a_built_in_method_is_what_computes_it() -> None:
    used = load_method("local", {}, {}).used
    assert {"dfdbench.methods.baselines", "dfdbench.blur.recipe"} <= set(used)
    assert not {"dfdbench.methods.sgm", "dfdbench.methods.registry"} & set(used)
    assert all(name.startswith(("dfdbench.methods.", "dfdbench.blur.")) for name in used)


def test_another_process_finds_the_same(own: Path) -> None:
    # There, everything is opened for the first time.
    name = f"{own / 'mine.py'}:predict"
    load = "from dfdbench.methods.registry import load_method as load"
    found = python("-c", f"{load}; print(*load({name!r}, {{}}, {{}}).used, sep='|')")
    assert found.stdout.strip().split("|") == list(load_method(name, {}, {}).used)
