import hashlib
from pathlib import Path

import pytest

from dfdbench.errors import MethodError
from dfdbench.methods.method import Method


def raising(*_: object) -> None:
    raise RuntimeError("boom")


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


class Says:
    paper = "\ud800 2021"
    trained_on = "clear\x1b[2J"
    warnings = ("\ud800", 3)
    weights_sha256 = "nonsense"


def test_what_a_method_says_of_itself_can_be_kept_and_shown() -> None:
    method = Method("m", "m:m", Says())  # type: ignore[arg-type]
    assert (method.paper, method.trained_on) == ("\\ud800 2021", "clear\\x1b[2J")
    assert method.warnings == ("\\ud800", "3")
    with pytest.raises(MethodError, match="not the SHA-256 of weights"):
        _ = method.weights_sha256


class Raises:
    """A method of which one attribute cannot be read."""

    def __init__(self, attribute: str) -> None:
        self.attribute = attribute

    def __getattr__(self, name: str) -> object:
        if name == self.attribute:
            raise RuntimeError("boom")
        raise AttributeError(name)

    def __call__(self, infocus: object, defocus: object) -> None:
        pass


@pytest.mark.parametrize("name", ["warm_up", "fit", "trained_on", "paper", "warnings"])
def test_what_cannot_be_read_is_told_by_its_name(name: str) -> None:
    method = Method("m", "m:m", Raises(name))
    with pytest.raises(MethodError, match="cannot be read") as told:
        method.require_readable()
    (problem,) = told.value.problems
    assert problem.where == f"m:m: {name}"
    assert problem.got.startswith("RuntimeError: boom")
    Method("m", "m:m", Raises("calibration")).require_readable()


class Unprintable:
    def __str__(self) -> str:
        raise RuntimeError("boom")


@pytest.mark.parametrize(
    ("name", "said"), [("warnings", 3), ("warnings", [Unprintable()]), ("paper", Unprintable())]
)
def test_what_is_no_text_is_told_by_its_name(name: str, said: object) -> None:
    predict = Raises("")
    setattr(predict, name, said)
    with pytest.raises(MethodError, match="cannot be read") as told:
        Method("m", "m:m", predict).require_readable()
    assert told.value.problems[0].where == f"m:m: {name}"
