"""What a build, and methods on large images and stacks, hold of memory at most."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from dfdbench.datasets.catalog import find_manifest
from tests.conftest import write_png
from tests.made_stacks import stack_of
from tests.methods.made_planes import texture
from tests.process import python

STATUS = Path("/proc/self/status")
pytestmark = pytest.mark.skipif(not STATUS.is_file(), reason=f"no {STATUS} tells of peak memory")
# What the system tells of used resources would not do: there a child begins with the most that its
# parent ever held.
_PEAK = f"""
print(next(line.split()[1] for line in open("{STATUS}") if line.startswith("VmHWM:")))
"""


def peak(code: str, *words: str | Path) -> float:
    """Megabytes that a process holds at most which does nothing else, Python included."""
    found = int(python("-c", code + _PEAK, *words).stdout) / 1024
    print(f"\n{' '.join(map(str, words))}: at most {found:.0f} MB")
    return found


_BUILD = """
import sys
from pathlib import Path
from dfdbench.building.build import build_store
from dfdbench.datasets.catalog import find_manifest
from dfdbench.building.sources import open_source
manifest = find_manifest("middlebury-default")
source = open_source(manifest, Path(sys.argv[1]))
build_store(manifest, source, sys.argv[2])
"""


def test_a_builds_memory_does_not_grow_with_the_scenes(benchmark: Any, tmp_path: Path) -> None:
    random = np.random.default_rng(0)
    noise = random.integers(0, 256, (370, 443, 3)).astype(np.uint8)
    depth = cv2.GaussianBlur(noise[..., 0], (0, 0), 30) * 3 % 200 + 20
    for number, scene in enumerate(find_manifest("middlebury").scene_names):
        for view in (1, 5):
            for place in ("few", "all") if number < 3 else ("all",):
                write_png(tmp_path / place / scene / f"view{view}.png", noise)
                write_png(tmp_path / place / scene / f"disp{view}.png", depth.astype(np.uint8))
    least = peak(_BUILD, tmp_path / "few", tmp_path / "few.zarr")
    most = benchmark.pedantic(peak, (_BUILD, tmp_path / "all", tmp_path / "all.zarr"), rounds=1)
    assert most < 1.25 * least


_SOLVE = """
import sys
import numpy as np
from dfdbench.blur import synthesize
from dfdbench.blur.recipe import RECIPES
from dfdbench.methods.registry import load
rng = np.random.default_rng(0)
side = 10 * int(sys.argv[2])
infocus = np.kron(rng.integers(0, 256, (37, 47, 3)), np.ones((side, side, 1))).astype(np.uint8)
depth = np.tile(np.linspace(60, 250, 47 * side).astype(np.uint8), (37 * side, 1))
method = load(sys.argv[1], recipe=RECIPES["published"])
method(infocus, synthesize(infocus, depth, RECIPES["published"]))
"""


@pytest.mark.parametrize("times", ["1", "3"])
@pytest.mark.parametrize("method", ["graph-cuts", "graph-cuts-rounded", "sgm"])
def test_memory_of_a_method_on_an_image_of_middlebury_and_on_thrice_that(
    benchmark: Any, method: str, times: str
) -> None:
    megabytes = benchmark.pedantic(peak, (_SOLVE, method, times), rounds=1)
    assert times != "1" or megabytes < 450


COUNT = 9


def large_stack() -> Any:
    sharp = np.tile(texture(0, 152, 152), (8, 12, 1))
    images = [cv2.GaussianBlur(sharp, (0, 0), 0.3 + 0.3 * number) for number in range(COUNT)]
    return stack_of(images, np.linspace(20, 235, COUNT).tolist(), sharp)


_OF_STACK = """
import sys
import numpy as np
from dfdbench.methods.measured_law import Calibration
from dfdbench.methods.registry import load
from dfdbench.blur.law import BlurLaw
from tests.benchmarks.test_memory import COUNT, large_stack
fitted = sys.argv[1] != "shape-from-focus"
method = load(sys.argv[1], **({"recipe": None} if fitted else {}))
if fitted:
    levels = np.arange(256)
    laws = [
        BlurLaw(tuple(0.3 + 0.01 * abs(levels - focus)), noise=(1.0,))
        for focus in np.linspace(20, 235, COUNT)
    ]
    none = np.zeros(256)
    method.calibrations = tuple(Calibration(law, none, none, none) for law in laws)
(getattr(method, "from_stack", method))(large_stack())
"""


@pytest.mark.parametrize(
    ("method", "most"), [("shape-from-focus", 10), ("graph-cuts", 60), ("local", 60)]
)
def test_memory_of_a_method_on_nine_large_images(benchmark: Any, method: str, most: float) -> None:
    megabytes = benchmark.pedantic(peak, (_OF_STACK, method), rounds=1)
    assert megabytes < most * large_stack().nbytes / 2**20
