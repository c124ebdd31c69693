import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dfdbench.blur.recipe import RECIPES
from dfdbench.errors import MethodError, StoreError
from dfdbench.methods.calling import call
from dfdbench.methods.fit import restore, teach
from dfdbench.methods.isolated import Order, load_isolated
from dfdbench.methods.isolated_process import ShownPair
from dfdbench.methods.method import Method

IMAGE = np.arange(4 * 6 * 3, dtype=np.uint8).reshape(4, 6, 3)

CODE = '''
import ctypes, json, os, random, signal, sys
from pathlib import Path

import numpy as np


def half(infocus, defocus):
    print("half of", infocus.shape)
    infocus[:] = infocus // 2
    return infocus[..., 0]


class Asking:
    warnings = ()
    trained_on = "demo-1, split train"

    def __init__(self, recipe, training_mean, seed, file="none", times=1):
        self.recipe, self.mean, self.file, self.times = recipe, training_mean, file, times
        self.numbers = {}

    def __call__(self, infocus, defocus):
        self.numbers = {"levels": self.recipe.levels, "drawn": np.random.random()}
        self.warnings = (f"{Path(self.file).read_text()} {random.random()}",)
        return np.full(infocus.shape[:2], self.mean * self.times)


class Ending:
    """Ends its process by the value of the first pixel, else answers with what it learned."""

    level = 0.0
    warmed = 0

    def __init__(self, keep=True):
        self.keep = keep

    def warm_up(self, infocus, defocus):
        self.warmed = 100

    def fit(self, pairs):
        assert len(pairs) == 3 and len(pairs[1:]) == 2 and pairs[-1].valid.all()
        self.level = float(np.mean([pair.depth[pair.valid].mean() for pair in pairs]))
        return {"level": self.level, "all": np.arange(3)} if self.keep else None

    def restore(self, learned):
        self.level = learned["level"] + learned["all"][0]

    def __call__(self, infocus, defocus):
        match infocus[0, 0, 0]:
            case 1:
                os._exit(7)
            case 2:
                ctypes.string_at(0)
            case 3:
                os.kill(os.getpid(), signal.SIGKILL)
            case 4:
                raise RuntimeError("too dark")
            case 5:
                return infocus
            case 6:
                os.closerange(3, 64)
            case 7:
                raise KeyboardInterrupt
            case 8:
                json.dumps = None
        return np.full(infocus.shape[:2], self.level + self.warmed)


class Dying:
    def __init__(self):
        os._exit(5)


class Wrong:
    def fit(self, pairs):
        pairs[99]

    def __call__(self, infocus, defocus):
        return infocus[..., 0]


class Needing:
    def __init__(self, rig):
        raise AssertionError("never")
'''
Load = Callable[..., Method]
ENDINGS = [
    (1, "its process ended with status 7"),
    (2, "killed by signal 11, SIGSEGV"),
    (3, "killed by signal 9, SIGKILL, perhaps for want of memory"),
    (4, "raised RuntimeError: too dark (theirs.py:"),
    (5, "returned shape (4, 6, 3)"),
    (6, "its process"),
    (7, "its process ended with status 1"),
    (8, "its process ended with status 1"),
]


@pytest.fixture
def theirs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Load:
    (tmp_path / "theirs.py").write_text(CODE)
    monkeypatch.chdir(tmp_path)

    def load(attribute: str, offers: dict[str, Any] | None = None, **parameters: Any) -> Method:
        order = Order(f"theirs.py:{attribute}", parameters, offers or {}, {}, 3, ())
        return load_isolated(order, ())

    return load


def offers() -> dict[str, Any]:
    facts = {"recipe": RECIPES["published"], "training_mean": 20.5, "seed": 3}
    return {name: (lambda fact=fact: fact) for name, fact in facts.items()}


def filled(first: int) -> Any:
    return np.full((4, 6, 3), first, np.uint8)


def test_it_answers_as_the_method_would_here_and_is_not_imported_here(theirs: Load) -> None:
    before = {*sys.modules}
    method = theirs("half")
    prediction = call(method.predict, IMAGE, IMAGE)
    assert prediction.depth is not None
    assert prediction.depth.tolist() == (IMAGE[..., 0] // 2).tolist()
    assert prediction.printed == "half of (4, 6, 3)\n"
    assert prediction.seconds > 0
    assert (method.entry, method.parameters, method.uses) == ("theirs.py:half", {}, ())
    assert method.fit is None
    assert method.warm_up is None
    assert method.apart_from == ()
    new = {*sys.modules} - before
    assert not [name for name in new if name.startswith("dfdbench_method_")]


def test_it_is_told_what_it_asks_for_and_files_that_parameters_name(
    theirs: Load, tmp_path: Path
) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder/note.txt").write_text("note")
    method = theirs("Asking", offers(), file="folder/note.txt", times=2)
    assert method.uses == ("recipe", "training_mean", "seed")
    # As it was given: a result is no place for folders of this machine.
    assert method.parameters == {"file": "folder/note.txt", "times": 2}
    assert [*method.files_sha256] == ["file"]
    assert method.trained_on == "demo-1, split train"
    first = call(method.predict, IMAGE, IMAGE)
    assert first.depth is not None
    assert first.depth.max() == 41
    assert first.numbers["levels"] == 256
    # Seeded before each call, as every method's.
    assert method.warnings[0].startswith("note 0.2379")
    assert call(method.predict, IMAGE, IMAGE).numbers == first.numbers


@pytest.mark.skipif(sys.platform != "linux", reason="signals of Linux")
@pytest.mark.parametrize(
    ("keep", "endings"), [(True, ENDINGS[:1]), pytest.param(False, ENDINGS, marks=pytest.mark.slow)]
)
def test_a_method_that_ends_its_process_costs_the_pair_and_no_more(
    theirs: Load, keep: bool, endings: list[tuple[int, str]], capfd: pytest.CaptureFixture[str]
) -> None:
    method = theirs("Ending", keep=keep)
    depth = np.full((4, 6), 40, np.uint8)
    pair = ShownPair(IMAGE, IMAGE, depth, depth > 0)
    lesson = teach(method, [pair] * 3)
    assert (lesson.learned is None) is not keep
    assert method.warm_up is not None
    call(method.warm_up, IMAGE, IMAGE)
    for first, told in endings:
        prediction = call(method.predict, filled(first), IMAGE)
        assert prediction.depth is None
        assert told in prediction.error
        # The next is answered by one that knows what was learned, and is warm.
        after = call(method.predict, filled(9), IMAGE)
        assert after.depth is not None, after.error
        assert set(after.depth.ravel()) == {140.0}
    said = capfd.readouterr().err
    assert "Traceback" not in said
    assert said.count("the method broke its process") == sum(first >= 6 for first, _ in endings)


def test_what_was_learned_earlier_is_given_back(theirs: Load) -> None:
    method = theirs("Ending")
    restore(method, {"level": 30.0, "all": np.array([1, 2])})
    prediction = call(method.predict, filled(9), IMAGE)
    assert prediction.depth is not None
    assert prediction.depth.max() == 31
    with pytest.raises(MethodError, match="does not take back"):
        restore(method, {"other": 1.0})


@pytest.mark.slow
def test_what_goes_wrong_in_loading_and_fitting_is_told_as_here(theirs: Load) -> None:
    with pytest.raises(MethodError, match="has no nothing"):
        theirs("nothing")
    with pytest.raises(MethodError, match="unknown parameter"):
        theirs("half", size=3)
    with pytest.raises(MethodError, match="ended with status 5"):
        theirs("Dying")
    with pytest.raises(MethodError, match=r"(?s)cannot be fitted.*IndexError"):
        teach(theirs("Wrong"), [])


def test_a_fact_that_there_is_not_is_refused_as_here(theirs: Load) -> None:
    def none_here() -> Any:
        raise StoreError("the store holds no training depth")

    with pytest.raises(StoreError, match="no training depth"):
        theirs("Needing", {"rig": none_here})


@pytest.mark.slow
def test_a_module_beside_the_user_and_a_registered_name_are_found(
    theirs: Load, tmp_path: Path
) -> None:
    method = load_isolated(Order("theirs:half", {}, {}, {}, 0, (tmp_path / "results",)), ())
    assert call(method.predict, IMAGE, IMAGE).error == ""
    constant = load_isolated(
        Order("constant", {"training_mean": 3.0}, {}, {}, 0, (tmp_path,)), (tmp_path,)
    )
    assert constant.entry == "dfdbench.methods.baselines:Constant"
    assert call(constant.predict, IMAGE, IMAGE).error == ""
    assert "theirs" not in sys.modules
    assert os.getcwd() == str(tmp_path)
