import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dfdbench.methods.calling import TorchMethod, call
from dfdbench.methods.registry import load_method

IMAGE = np.zeros((4, 6, 3), np.uint8)


def test_a_bad_answer_is_said_not_scored() -> None:
    bad: list[tuple[Any, str]] = [
        (np.zeros((4, 6, 3)), "returned shape (4, 6, 3)"),
        (5, "returned shape ()"),
        (None, "returned None; expected a depth map: is a `return` missing?"),
        ("depth", "expected real numbers"),
        (np.full((4, 6), np.nan), "NaN, no answer, in all of 24"),
        (np.where(np.eye(4, 6), np.inf, 1), "infinity in 4 of 24"),
        (np.full((4, 6), -1.0), "levels from -1"),
        (np.full((4, 6), 255.5), "expected 0 to 255"),
        (np.zeros((4, 6), bool), "bool"),
        ([[1, 2], [3]], "no array"),
        (np.ma.masked_less(np.arange(24).reshape(4, 6), 3), "3 masked pixels"),
        ((np.zeros((4, 6)), {"energy": 1.0}), "attribute `numbers`"),
        ((np.zeros((4, 6)), 3), "sigma of shape (); expected (4, 6), one number a pixel"),
        ((np.zeros((4, 6)), np.eye(4, 6)), "sigma of 0 to 1; expected finite numbers above 0"),
        ((np.zeros((4, 6)), np.full((4, 6), np.nan)), "sigma of nan to nan"),
        ((np.zeros((4, 6)), np.full((4, 6), 1e60)), "sigma of inf to inf"),
        ((np.zeros((4, 6)), "much"), "sigma of <U4 values; expected real numbers"),
        ((np.zeros((6, 4)), np.ones((4, 6))), "returned shape (6, 4)"),
        ((np.zeros((4, 6)), np.zeros((4, 6)), 1), "a tuple of 3; expected depth, or a tuple"),
    ]
    for answer, told in bad:
        prediction = call(lambda *_, answer=answer: answer, IMAGE, IMAGE)
        assert prediction.depth is None
        assert told in prediction.error


def test_numbers_of_the_last_call_are_kept_if_they_are_numbers() -> None:
    def predict(infocus: Any, defocus: Any) -> Any:
        if infocus.max() > 9:
            raise RuntimeError("too bright")
        return np.zeros((4, 6))

    said = {"energy": 12, "gap": np.float32(0.5), "note": "x", "bad": float("nan")}
    predict.numbers = said  # type: ignore[attr-defined]
    prediction = call(predict, IMAGE, IMAGE)
    assert (prediction.error, prediction.numbers) == ("", {"energy": 12.0, "gap": 0.5})
    # A pair that failed has none, least of all those of the pair before.
    assert call(predict, IMAGE + np.uint8(20), IMAGE).numbers == {}
    # More than a table has room for are refused.
    predict.numbers = {str(index): index for index in range(100)}  # type: ignore[attr-defined]
    assert len(call(predict, IMAGE, IMAGE).numbers) == 100
    predict.numbers["101"] = 1  # type: ignore[attr-defined]
    prediction = call(predict, IMAGE, IMAGE)
    assert prediction.error == "keeps 101 values in `numbers`; expected 100 at most"
    assert prediction.depth is None


def test_a_library_that_raises_is_told_by_the_line_that_called_it() -> None:
    def inner(image: Any) -> Any:
        return np.linalg.inv(image[..., 0])

    def predict(infocus: Any, defocus: Any) -> Any:
        return inner(infocus)

    line = inner.__code__.co_firstlineno + 1
    assert call(predict, IMAGE, IMAGE).error.endswith(f"(test_calling.py:{line} in inner)")


def test_a_method_cannot_spoil_the_images() -> None:
    def writing(infocus: Any, defocus: Any) -> Any:
        infocus[:] = 9
        return defocus[..., 0]

    image = IMAGE.copy()
    call(writing, image, image)
    assert image.max() == 0


def test_what_a_method_says_is_kept_apart_and_can_be_written_to_a_file(
    capsys: pytest.CaptureFixture[str],
) -> None:
    def odd(infocus: Any, defocus: Any) -> Any:
        print("level \udc80")
        raise ValueError("depth \ud800")

    prediction = call(odd, IMAGE, IMAGE)
    assert prediction.error.startswith("raised ValueError: depth \\ud800 (")
    assert prediction.printed == "level \\udc80\n"
    assert capsys.readouterr().out == ""


def test_whatever_is_raised_costs_the_pair_alone_but_ctrl_c_stops_the_run() -> None:
    def raising(error: BaseException) -> Any:
        def predict(infocus: Any, defocus: Any) -> Any:
            raise error

        return predict

    line = raising.__code__.co_firstlineno + 2
    for error, told in (
        (RuntimeError("boom"), f"raised RuntimeError: boom (test_calling.py:{line} in predict)"),
        (SystemExit(0), "raised SystemExit: 0 ("),
        (BaseException("out of band"), "raised BaseException: out of band"),
        (GeneratorExit(), "raised GeneratorExit"),
    ):
        assert call(raising(error), IMAGE, IMAGE).error.startswith(told)
    with pytest.raises(KeyboardInterrupt):
        call(raising(KeyboardInterrupt()), IMAGE, IMAGE)


NETWORK = """
import numpy as np
import torch

class Net(torch.nn.Module):
    trained_on = "nothing"

    def __init__(self):
        super().__init__()
        self.norm = torch.nn.BatchNorm2d(6)
        self.modes = []

    def fit(self, pairs):
        self.train()

    def forward(self, infocus, defocus, factor=1.0):
        self.modes.append((self.training, self.norm.training, torch.is_grad_enabled()))
        both = np.concatenate([infocus, defocus], 2).transpose(2, 0, 1)[None]
        return self.norm(torch.from_numpy(both.astype(np.float32)))[0, 0].clamp(0, 255) * factor

net = Net()
"""


@pytest.fixture
def network(tmp_path: Path) -> Path:
    path = tmp_path / "network.py"
    path.write_text(NETWORK)
    return path


@pytest.mark.parametrize(("name", "factor"), [("Net", 1.0), ("net", 1.0), ("net", 0.5)])
def test_batch_norm_answers_as_it_learned(network: Path, name: str, factor: float) -> None:
    given = {} if factor == 1 else {"factor": factor}
    method = load_method(f"{network}:{name}", given, {})
    image = np.random.default_rng(0).integers(0, 256, (9, 12, 3)).astype(np.uint8)
    answer = call(method.predict, image, image)
    # In training mode it would be normalised to mean 0 and variance 1.
    assert answer.depth is not None
    assert np.allclose(answer.depth, image[..., 0] * factor, atol=0.01)


def test_a_fit_that_trains_leaves_no_trace(network: Path) -> None:
    method = load_method(f"{network}:Net", {}, {})
    assert method.trained_on == "nothing"
    method.fit([])
    assert call(method.predict, IMAGE, IMAGE).depth is not None
    assert isinstance(method.predict, TorchMethod)
    assert method.predict.modes == [(False, False, False)]


def test_a_method_that_closes_its_standard_output_costs_nothing() -> None:
    def predict(infocus: Any, defocus: Any) -> Any:
        print("before")
        sys.stdout.close()
        return np.zeros(infocus.shape[:2])

    found = call(predict, IMAGE, IMAGE)
    assert (found.error, found.printed) == ("", "before\n")
    print("standard output is open")
