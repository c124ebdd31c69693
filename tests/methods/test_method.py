import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from dfdbench.errors import MethodError, StoreError
from dfdbench.evaluation.check import made_pair
from dfdbench.methods.method import Method, TrainingPair, teach


def raising(*_: object) -> None:
    raise RuntimeError("boom")


def test_a_method_is_shown_by_its_name_and_what_was_set() -> None:
    assert repr(Method("local", "m:m", raising, {"window": 9})) == "<local window=9>"
    assert repr(Method("mine.py:predict", "m:m", raising)) == "<mine.py:predict>"
    shown = Method("<b>", "m:m", raising, {"window": 9, "entry": "one"})._repr_html_()
    assert "m:m" in shown
    assert "&lt;b&gt;" in shown
    assert ">window<" in shown


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


PAIR = made_pair(*(np.zeros((2, 2, 3), np.uint8),) * 2, np.full((2, 2), 9, np.uint8), np.eye(2) > 0)


class Learning:
    """Learns whatever it is told to return."""

    def __init__(self, returned: Any = None) -> None:
        self.returned = returned
        self.given: Any = {}

    def fit(self, pairs: Sequence[TrainingPair]) -> Any:
        if isinstance(self.returned, BaseException):
            raise self.returned
        return self.returned

    def restore(self, learned: dict[str, Any]) -> None:
        self.given = learned

    def __call__(self, infocus: NDArray[np.uint8], defocus: NDArray[np.uint8]) -> Any:
        return infocus[..., 0]


def method(predict: Any) -> Method:
    return Method("learning", "m:Learning", predict)


def test_what_was_learned_comes_back_as_numbers_and_arrays() -> None:
    sigmas = np.linspace(0, 1, 3)
    learning = Learning({"sigmas": sigmas, "gain": np.float32(1.5), "count": 3, "odd": True})
    learned, seconds = teach(method(learning), [PAIR])
    assert learned is not None
    assert seconds >= 0
    assert np.array_equal(learning.given.pop("sigmas"), sigmas)
    assert learning.given == {"gain": 1.5, "count": 3, "odd": True}
    assert type(learning.given["gain"]) is float
    # What the method does with its own does not reach what is kept.
    learned["sigmas"][0] = 7  # type: ignore[index]
    assert sigmas[0] == 0
    # A fit that keeps its knowledge in itself is not given any.
    itself = Learning(None)
    assert teach(method(itself), [PAIR])[0] is None
    assert itself.given == {}
    with pytest.raises(StoreError, match="damaged"):
        teach(method(Learning(StoreError("damaged"))), [PAIR])


def test_a_fit_that_raises_or_returns_nonsense_says_why() -> None:
    for returned, told in (
        ([1.0], "a mapping of names"),
        ({"law": object()}, "'law'"),
        ({"name": "disk"}, "'name'"),
        ({3: 1.0}, r"no text as name: 3"),
        ({"gain": np.inf}, r"not finite: inf .*'gain'"),
        ({"levels": np.full(3, np.nan)}, r"not finite: nan .*'levels'"),
        ({"ragged": [[1], [1, 2]]}, "'ragged'"),
        (ValueError("too dark"), "cannot be fitted.*fit.*ValueError: too dark"),
        (SystemExit(3), "cannot be fitted.*fit.*SystemExit: 3"),
    ):
        with pytest.raises(MethodError, match=told):
            teach(method(Learning(returned)), [PAIR])


def test_nothing_that_takes_it_back_and_no_fit_to_call_are_refused() -> None:
    class Forgetful(Learning):
        restore = None  # type: ignore[assignment]

    class Odd(Learning):
        fit = "sigma"  # type: ignore[assignment]

    with pytest.raises(MethodError, match=r"nothing takes it back[\s\S]*restore\(learned\)"):
        teach(method(Forgetful({"level": 3})), [PAIR])
    with pytest.raises(MethodError, match="fit cannot be called"):
        teach(method(Odd()), [PAIR])
    assert method(Learning).learner is not None
    assert method(lambda infocus, defocus: infocus).learner is None


def test_a_fit_is_seeded_prints_to_standard_error_and_leaves_the_process_alone(
    capsys: pytest.CaptureFixture[str],
) -> None:
    class Loud(Learning):
        def fit(self, pairs: Any) -> Any:
            print("epoch 1")
            np.seterr(all="raise")
            return {"drawn": np.random.uniform()}

    first, again = (teach(method(Loud()), [PAIR], seed=4)[0] for _ in range(2))
    assert first == again
    assert np.geterr()["invalid"] == "warn"
    told = capsys.readouterr()
    assert (told.out, told.err) == ("", "epoch 1\n" * 2)


def test_other_images_than_it_takes_are_refused() -> None:
    image = np.zeros((4, 6, 3), np.uint8)
    with pytest.raises(MethodError, match="takes a stack"):
        Method("m", "m:m", lambda stack: stack)(image, image)
    with pytest.raises(MethodError, match=r"got \(4, 6, 3\) and \(2, 6, 3\)"):
        Method("m", "m:m", lambda infocus, defocus: infocus)(image, image[:2])
