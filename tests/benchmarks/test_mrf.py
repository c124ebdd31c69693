"""Times of graph-cuts and its solvers, and their ratios to named peers in the same process.

Run with one thread: NUMBA_NUM_THREADS=1 OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1, and `-s` to see
the ratios, which are of CPU time. Nothing is asserted of them but what docs/graph_cuts.md says.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, get_args

import cv2
import numpy as np
import pytest

from dfdbench.blur.recipe import RECIPES
from dfdbench.blur.synthesis import synthesize
from dfdbench.datasets.dataset import Dataset
from dfdbench.methods import mrf
from dfdbench.methods.graph_cuts import GraphCuts
from dfdbench.methods.rounded_graph_cuts import RoundedGraphCuts
from tests.benchmarks.ledger import Ledger, cpu, timed
from tests.benchmarks.test_blur import separable, stack
from tests.conftest import read_rgb
from tests.process import python


@pytest.fixture(params=["Aloe", "Art", "Reindeer"])
def scene(request: pytest.FixtureRequest, shared_data: Path) -> Any:
    """Give view 1 of a scene at default lighting, its depth and its blur; ThirdSize."""
    folder = shared_data / "middlebury/ThirdSize" / request.param
    if not (folder / "view1.png").is_file():
        pytest.skip(f"no {request.param} here")
    infocus, levels = read_rgb(folder / "view1.png"), read_rgb(folder / "disp1.png")[..., 0].copy()
    return infocus, synthesize(infocus, levels, RECIPES["published"]), levels


@pytest.mark.parametrize(
    "method", [GraphCuts(), RoundedGraphCuts()], ids=lambda m: type(m).__name__
)
def test_method_against_blurring_whole(benchmark: Any, scene: Any, method: Any) -> None:
    """Compare with what filtering the whole image at every level takes, in two ways."""
    infocus, defocus, depth = scene
    cv2.setNumThreads(1)
    method.warm_up(infocus, defocus)
    peers = {"dense float64": stack, "separable float32": separable}
    ratios: dict[str, list[float]] = {name: [] for name in peers}
    for _ in range(3):
        own = cpu(lambda: method(infocus, defocus))
        for name, peer in peers.items():
            ratios[name].append(own / cpu(partial(peer, infocus, depth, RECIPES["published"])))
    middle = {name: sorted(found)[1] for name, found in ratios.items()}
    benchmark.extra_info |= middle
    benchmark.pedantic(method, (infocus, defocus), rounds=1)
    for name, ratio in middle.items():
        print(f"\n{type(method).__name__}: {ratio:.2f} of 256 {name} filterings of the image")
    assert middle["dense float64"] < 0.5
    assert middle["separable float32"] > 1


# One method in a process of its own, so that nothing but it counts. What the system tells of used
# resources would not do: there a child begins with the most that its parent ever held.
STATUS = Path("/proc/self/status")
OF_LINUX = pytest.mark.skipif(not STATUS.is_file(), reason=f"no {STATUS} tells of peak memory")
_PEAK = """
import sys
import numpy as np
from dfdbench.blur import synthesize
from dfdbench.blur.recipe import RECIPES
from dfdbench.methods.registry import load
rng = np.random.default_rng(0)
side = 10 * int(sys.argv[3])
infocus = np.kron(rng.integers(0, 256, (37, 47, 3)), np.ones((side, side, 1))).astype(np.uint8)
depth = np.tile(np.linspace(60, 250, 47 * side).astype(np.uint8), (37 * side, 1))
method = load(sys.argv[1], recipe=RECIPES["published"])
method(infocus, synthesize(infocus, depth, RECIPES["published"]))
print(next(line.split()[1] for line in open(sys.argv[2]) if line.startswith("VmHWM:")))
"""


@OF_LINUX
@pytest.mark.parametrize("times", [1, 3])
@pytest.mark.parametrize("method", ["graph-cuts", "graph-cuts-rounded", "sgm"])
def test_peak_memory(benchmark: Any, method: str, times: int) -> None:
    """Measure what a process holds at most that solves an image of Middlebury, and thrice that."""
    said = benchmark.pedantic(python, ("-c", _PEAK, method, STATUS, str(times)), rounds=1).stdout
    peak = int(said) / 1024
    benchmark.extra_info["peak, MB"] = peak
    print(f"\n{method}, {370 * times} x {470 * times}: at most {peak:.0f} MB")
    assert times > 1 or peak < 450


@pytest.fixture(params=[1, 2], ids=["aloe-exposure1", "aloe-exposure2"])
def photograph(request: pytest.FixtureRequest, aloe: Callable[[int], mrf.Energy]) -> mrf.Energy:
    """The published energy of the two published pairs with step 0.01."""
    return aloe(request.param)


def by_pymaxflow(energy: mrf.Energy) -> Any:
    import maxflow

    costs, start = energy.unary.astype(np.int64), np.zeros(energy.shape, np.int64)
    return maxflow.fastmin.aexpansion_grid(costs, pairwise(energy), labels=start)


def by_gco(energy: mrf.Energy) -> Any:
    import gco

    costs = energy.unary.astype(np.int32)
    found = gco.cut_grid_graph_simple(costs, pairwise(energy).astype(np.int32))
    return found.reshape(energy.shape)


def pairwise(energy: mrf.Energy) -> Any:
    index = np.arange(energy.unary.shape[2])
    return energy.smoothness[np.abs(index[:, None] - index)].astype(np.int64)


@pytest.mark.parametrize(
    ("package", "solve"), [("PyMaxflow", by_pymaxflow), ("gco-wrapper", by_gco)]
)
def test_a_demo_pair(
    benchmark: Any, ledger: Ledger, demo_store: Dataset, package: str, solve: Any
) -> None:
    """Compare graph-cuts' energy with alpha-expansion to convergence; minutes."""
    images = demo_store.read(demo_store.manifest.pairs("test")[2])
    energy = GraphCuts().energy(images.infocus, images.defocus)
    mrf.split(energy)
    solution = benchmark.pedantic(mrf.split, (energy,), rounds=1)
    title = "graph-cuts' energy, 240 x 320 x 256"
    if not ledger.require(title, package):
        return
    seconds, found = timed(partial(solve, energy))
    change = 1000 * (solution.energy / energy.evaluate(found) - 1)
    own = cpu(lambda: mrf.split(energy), 3)
    ledger.note(title, own, package, "alpha-expansion", seconds, f"energy {change:+.1f} ‰")


def test_against_pymaxflow(
    benchmark: Any, request: pytest.FixtureRequest, photograph: mrf.Energy
) -> None:
    """Compare with PyMaxflow's alpha-expansion to convergence; a minute and more a pair."""
    pytest.importorskip("maxflow", reason="the peer PyMaxflow is not installed")
    energy = photograph
    seconds, found = timed(partial(benchmark.pedantic, by_pymaxflow, (energy,), rounds=1))
    reached = energy.evaluate(found)
    print(f"\n{request.node.name}: aexpansion_grid {seconds:.1f} s CPU, energy {reached}")
    solvers: dict[str, Callable[[], Any]] = {
        f"split {quality}": partial(mrf.split, energy, quality) for quality in get_args(mrf.Quality)
    }
    solvers["expansion"] = partial(mrf.expansion, energy)
    solvers["split fast"]()
    for name, solve in solvers.items():
        own, solution = timed(solve)
        change = 100 * (solution.energy / reached - 1)
        print(
            f"{name}: {own:.2f} s CPU, 1/{seconds / own:.1f} of aexpansion_grid, "
            f"energy {solution.energy} ({change:+.4f} %)"
        )
