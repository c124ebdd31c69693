"""Shape from focus against its focus measures alone, and what stacks take of memory.

Run as tests/benchmarks/test_mrf.py says. Nothing is asserted of times.
"""

import subprocess
import sys
from functools import partial
from typing import Any

import cv2
import numpy as np
import pytest

from dfdbench.methods.shape_from_focus import MEASURES, ShapeFromFocus, grey_of_image
from tests.benchmarks.ledger import cpu
from tests.benchmarks.test_mrf import _STATUS
from tests.made_stacks import stack_of
from tests.methods.made_planes import texture

SIZE = (1216, 1824)
COUNT = 9


def large_stack() -> Any:
    sharp = np.tile(texture(0, 152, 152), (8, 12, 1))
    images = [cv2.GaussianBlur(sharp, (0, 0), 0.3 + 0.3 * number) for number in range(COUNT)]
    return stack_of(images, np.linspace(20, 235, COUNT).tolist(), sharp)


@pytest.mark.parametrize("measure", MEASURES)
def test_shape_from_focus_against_its_measure_alone(benchmark: Any, measure: str) -> None:
    stack = large_stack()
    cv2.setNumThreads(1)
    function, method = MEASURES[measure][0], ShapeFromFocus(measure)
    method(stack)

    def alone() -> None:
        for image in stack.values[1:]:
            cv2.boxFilter(function(grey_of_image(image)), cv2.CV_32F, (21, 21))

    ratios = sorted(cpu(lambda: method(stack)) / cpu(alone) for _ in range(5))
    benchmark.extra_info["times of the measure"] = ratios[2]
    benchmark.pedantic(method, (stack,), rounds=1)
    print(f"\n{measure}: {ratios[2]:.2f} of its measure and a box filter by OpenCV")


_PEAK = """
import sys
import numpy as np
from dfdbench.methods.measured_law import Calibration
from dfdbench.methods.registry import load
from dfdbench.blur.law import BlurLaw
from tests.benchmarks.test_stacks import COUNT, large_stack
fitted = sys.argv[1] != "shape-from-focus"
method = load(sys.argv[1], **({"recipe": None} if fitted else {}))
stack = large_stack()
if fitted:
    levels = np.arange(256)
    laws = [
        BlurLaw(tuple(0.3 + 0.01 * abs(levels - focus)), noise=(1.0,))
        for focus in np.linspace(20, 235, COUNT)
    ]
    none = np.zeros(256)
    method.calibrations = tuple(Calibration(law, none, none, none) for law in laws)
(getattr(method, "from_stack", method))(stack)
peak = next(line.split()[1] for line in open(sys.argv[2]) if line.startswith("VmHWM:"))
print(1024 * int(peak) / stack.nbytes, int(peak) / 1024**2)
"""


@pytest.mark.parametrize(
    ("method", "most"), [("shape-from-focus", 10), ("graph-cuts", 60), ("local", 60)]
)
def test_peak_memory_of_nine_large_images(benchmark: Any, method: str, most: float) -> None:
    """Measure what a process holds at most, Python and its libraries included."""
    if not _STATUS.is_file():
        pytest.skip(f"no {_STATUS} here tells of peak memory")
    command = [sys.executable, "-c", _PEAK, method, str(_STATUS)]
    run = partial(subprocess.run, command, capture_output=True, text=True, check=True)
    times, gigabytes = map(float, benchmark.pedantic(run, rounds=1).stdout.split())
    benchmark.extra_info |= {"times the stack": times, "peak, GB": gigabytes}
    print(f"\n{method}: {times:.1f} times the stack, {gigabytes:.2f} GB in all")
    assert times < most
