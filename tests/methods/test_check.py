from typing import Any

import numpy as np
import pytest

from dfdbench.methods.check import check_method
from dfdbench.methods.method import Method
from dfdbench.methods.registry import load_method


def problems(predict: Any) -> dict[str, str]:
    trials = check_method(Method("m", "m:m", predict))
    return {
        trial.name: trial.error or trial.warning for trial in trials if trial.error or trial.warning
    }


def test_a_baseline_passes() -> None:
    method = load_method("local", {"window": 3}, {})
    assert problems(method.predict) == {}


def test_a_method_for_even_sizes_only_is_found_out() -> None:
    def halving(infocus: Any, defocus: Any) -> Any:
        small = infocus[::2, ::2, 0]
        return np.kron(small, np.ones((2, 2)))

    assert "returned shape (242, 318)" in problems(halving)["odd sizes, 241 × 317"]


def test_division_by_a_flat_image_is_found_out() -> None:
    def dividing(infocus: Any, defocus: Any) -> Any:
        with np.errstate(all="ignore"):
            plane = infocus[..., 0].astype(float)
            return 255 * plane / plane.max()

    assert "NaN" in problems(dividing)["a black pair"]


def test_chance_writing_and_printing_are_found_out() -> None:
    random = np.random.default_rng()

    def careless(infocus: Any, defocus: Any) -> Any:
        print("hello")
        infocus[:] = 0
        return random.uniform(0, 255, infocus.shape[:2])

    found = problems(careless)
    assert "differ" in found["the same pair twice"]
    assert "changes the images" in found["leaves its input alone"]
    assert "printed" in found["a black pair"]


@pytest.mark.parametrize("answer", [None, 3])
def test_nonsense_is_found_out_everywhere(answer: Any) -> None:
    assert len(problems(lambda *_: answer)) >= 9


def test_depth_that_grows_with_distance_is_found_out() -> None:
    local = load_method("local", {"window": 3}, {})
    found = problems(lambda *images: 255 - np.asarray(local.predict(*images)))
    assert "every set wants brighter for nearer" in found.pop("brighter for nearer")
    assert found == {}
