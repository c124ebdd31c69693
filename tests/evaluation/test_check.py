from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import ndimage

from dfdbench.evaluation.check import check_method
from dfdbench.methods.method import Method
from dfdbench.methods.registry import load_method
from tests.process import python


def problems(predict: Any) -> dict[str, str]:
    trials = check_method(Method("m", "m:m", predict))
    told = {trial.name: trial.error or trial.warning for trial in trials}
    return {name: text for name, text in told.items() if text}


def test_a_method_for_even_sizes_only_is_found_out() -> None:
    found = problems(lambda infocus, _: np.kron(infocus[::2, ::2, 0], np.ones((2, 2))))
    assert "returned shape (122, 164)" in found["odd sizes, 121 × 163"]


def test_division_by_a_flat_image_is_found_out() -> None:
    def dividing(infocus: Any, defocus: Any) -> Any:
        with np.errstate(all="ignore"):
            plane = infocus[..., 0].astype(float)
            return 255 * plane / plane.max()

    assert "NaN" in problems(dividing)["a black pair"]


def test_pixels_without_an_answer_are_said() -> None:
    def half(infocus: Any, defocus: Any) -> Any:
        depth = np.full(infocus.shape[:2], 100.0)
        depth[:, ::2] = np.nan
        return depth

    found = problems(half)
    assert any("no answer in 50 % of the pixels" in text for text in found.values()), found


def test_chance_writing_and_printing_are_found_out() -> None:
    random = np.random.default_rng()

    def careless(infocus: Any, defocus: Any) -> Any:
        print("hello")
        infocus[:] = 0
        return random.uniform(0, 255, infocus.shape[:2])

    def unsure(infocus: Any, defocus: Any) -> Any:
        return infocus.mean(2), random.uniform(1, 9, infocus.shape[:2])

    assert "its sigma differs in" in problems(unsure)["the same pair again"]
    found = problems(careless)
    assert "of 76800 pixels, by up to" in found["the same pair again"]
    assert "changes the images" in found["leaves its input alone"]
    assert "printed" in found["a black pair"]


def test_depth_from_0_to_1_is_found_out() -> None:
    found = problems(lambda infocus, _: infocus.mean(2) / 255)
    assert "all levels between 0 and 10" in found["levels from 0 to 255"]
    assert "levels from 0 to 255" not in problems(lambda infocus, _: infocus.mean(2))


MANY = """
import os
import numpy as np

def process(infocus, defocus):
    return np.random.default_rng(os.getpid()).uniform(0, 255, infocus.shape[:2])

def seeded(infocus, defocus):
    return np.random.uniform(0, 255, infocus.shape[:2])
"""


def test_another_process_answers_the_same(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(MANY)
    trial = "the same pair in another process"
    for name, failed in (("process", [trial]), ("seeded", [])):
        load = partial(load_method, f"{tmp_path / 'mine.py'}:{name}", {}, {})
        trials = check_method(load(), load=load)
        assert trial in [each.name for each in trials]
        assert [each.name for each in trials if each.error] == failed


#: In a file, as a user has it: the source of a method is read.
OF_TORCH = """
import torch

def with_gradient(infocus, defocus):
    return torch.full(infocus.shape[:2], 7.0, requires_grad=True)

class Net(torch.nn.Module):
    def forward(self, infocus, defocus):
        return torch.from_numpy(infocus[..., 0])
"""


def test_what_torch_could_do_without_is_told(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(OF_TORCH)
    told = []
    for name in ("with_gradient", "Net"):
        trials = check_method(load_method(f"{tmp_path / 'mine.py'}:{name}", {}, {}))
        assert not any(trial.error for trial in trials)
        told.append({trial.name: trial.warning for trial in trials})
    assert "no_grad() would save memory" in told[0]["leaves its input alone"]
    assert "a torch module: run with eval() and no_grad()" in told[1]


def test_nonsense_is_found_out_everywhere() -> None:
    for answer in (None, 3):
        assert len(problems(lambda *_, answer=answer: answer)) >= 9


@pytest.mark.slow
def test_depth_that_grows_with_distance_is_found_out() -> None:
    local = load_method("local", {"window": 3}, {})
    found = problems(lambda *images: 255 - np.asarray(local.predict(*images)))
    assert "every set wants brighter for nearer" in found.pop("brighter for nearer")
    assert found == {}


class Fitted:
    """Learns one level; on two made pairs, or on their changed depth."""

    def __init__(self, change: bool = False, learned: Any = None) -> None:
        self.change, self.learned, self.level = change, learned, 0.0

    def fit(self, pairs: Any) -> Any:
        assert [pair.infocus.shape for pair in pairs] == [(144, 192, 3)] * 2
        assert set(np.unique(pairs[0].levels)) == set(np.unique(pairs[1].levels))
        if self.change:
            pairs[1].depth[0, 0] += 1
        return self.learned

    def restore(self, learned: Any) -> None:
        self.level = learned["level"]

    def __call__(self, infocus: Any, defocus: Any) -> Any:
        return np.full(infocus.shape[:2], self.level)


def test_a_fit_is_tried_what_is_wrong_with_it_found_out_and_what_it_learned_used() -> None:
    assert problems(Fitted(learned={"level": 90.0})) == {}
    assert "levels from 300 to 300" in problems(Fitted(learned={"level": 300.0}))["a black pair"]
    assert "changes the pairs" in problems(Fitted(True, {"level": 1}))["fit, on two made pairs"]
    assert "not with --workers" in problems(Fitted())["fit, on two made pairs"]
    found = problems(Fitted(learned={"level": "near"}))
    assert list(found) == ["fit, on two made pairs"]
    assert "cannot be kept" in found["fit, on two made pairs"]


def test_a_method_of_stacks_is_tried_on_stacks_in_its_unit() -> None:
    class Sharpest:
        unit = "metres"

        def __call__(self, stack: Any) -> Any:
            assert stack["role"].values.tolist() == ["infocus", *["defocus"] * 4]
            assert stack.attrs["unit"] == "metres"
            sharp = np.abs(np.diff(stack.values[1:].astype(float), axis=2, append=0)).sum(-1)
            wide = ndimage.uniform_filter(sharp, (0, 9, 9))
            return stack["focus_distance"].values[1:][wide.argmax(0)]

    assert problems(Sharpest()) == {}

    class Turned(Sharpest):
        def __call__(self, stack: Any) -> Any:
            return 5.5 - super().__call__(stack)

    assert "distances seem to fall" in problems(Turned())["farther is more"]


#: What a first command would wait for: a solver, a filter over a stack, the blur of a track.
FIRST_CALLS = """
import numpy
from dfdbench.blur.formation import form_pair
from dfdbench.blur.recipe import RECIPES
from dfdbench.blur.tracks import find_degradation
from dfdbench.methods import load

image = numpy.random.default_rng(0).integers(0, 256, (50, 70, 3)).astype("u1")
for name in ("graph-cuts", "graph-cuts-rounded", "sgm", "guided"):
    load(name, recipe="published")(image, image)
form_pair(image, image[..., 0], RECIPES["published"], find_degradation("lens-2"), "a")
"""


@pytest.mark.slow
def test_after_warming_up_nothing_is_left_to_compile(tmp_path: Path) -> None:
    def machine_code() -> set[Path]:
        return {path.relative_to(tmp_path) for path in tmp_path.rglob("*.nbc")}

    done = python("-m", "dfdbench", "doctor", "--warm", NUMBA_CACHE_DIR=str(tmp_path))
    assert done.returncode == 0, done.stderr
    compiled = machine_code()
    assert len(compiled) > 40
    done = python("-c", FIRST_CALLS, NUMBA_CACHE_DIR=str(tmp_path))
    assert done.returncode == 0, done.stderr
    assert machine_code() == compiled
