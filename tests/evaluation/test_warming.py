from pathlib import Path

import pytest

from tests.process import python

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
def test_after_it_nothing_is_left_to_compile(tmp_path: Path) -> None:
    def machine_code() -> set[Path]:
        return {path.relative_to(tmp_path) for path in tmp_path.rglob("*.nbc")}

    done = python("-m", "dfdbench", "doctor", "--warm", NUMBA_CACHE_DIR=str(tmp_path))
    assert done.returncode == 0, done.stderr
    compiled = machine_code()
    assert len(compiled) > 40
    done = python("-c", FIRST_CALLS, NUMBA_CACHE_DIR=str(tmp_path))
    assert done.returncode == 0, done.stderr
    assert machine_code() == compiled
