"""What stacks take of memory."""

from typing import Any

import cv2
import numpy as np
import pytest

from tests.benchmarks.test_mrf import OF_LINUX, STATUS
from tests.made_stacks import stack_of
from tests.methods.made_planes import texture
from tests.process import python

COUNT = 9


def large_stack() -> Any:
    sharp = np.tile(texture(0, 152, 152), (8, 12, 1))
    images = [cv2.GaussianBlur(sharp, (0, 0), 0.3 + 0.3 * number) for number in range(COUNT)]
    return stack_of(images, np.linspace(20, 235, COUNT).tolist(), sharp)


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
    widths = [0.3 + 0.01 * abs(levels - focus) for focus in np.linspace(20, 235, COUNT)]
    laws = [BlurLaw(tuple(each), noise=(1.0,)) for each in widths]
    none = np.zeros(256)
    method.calibrations = tuple(Calibration(law, none, none, none) for law in laws)
(getattr(method, "from_stack", method))(stack)
peak = next(line.split()[1] for line in open(sys.argv[2]) if line.startswith("VmHWM:"))
print(1024 * int(peak) / stack.nbytes, int(peak) / 1024**2)
"""


@OF_LINUX
@pytest.mark.parametrize(
    ("method", "most"), [("shape-from-focus", 10), ("graph-cuts", 60), ("local", 60)]
)
def test_peak_memory_of_nine_large_images(benchmark: Any, method: str, most: float) -> None:
    """Measure what a process holds at most, Python and its libraries included."""
    said = benchmark.pedantic(python, ("-c", _PEAK, method, STATUS), rounds=1).stdout
    times, gigabytes = map(float, said.split())
    benchmark.extra_info |= {"times the stack": times, "peak, GB": gigabytes}
    print(f"\n{method}: {times:.1f} times the stack, {gigabytes:.2f} GB in all")
    assert times < most
