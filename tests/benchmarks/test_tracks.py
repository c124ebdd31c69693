"""A pair on each track against the clean blur, in one run, on one thread.

Nothing is asserted of times.
"""

import time
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from dfdbench.blur.formation import form_pair
from dfdbench.blur.recipe import RECIPES
from dfdbench.blur.synthesis import synthesize
from dfdbench.blur.tracks import TRACKS, find_degradation
from tests.benchmarks.ledger import cpu

RECIPE = RECIPES["published"]
LABELS = [f"{name}-{severity}" for name in TRACKS for severity in (1, 2, 3)]
# The processor's time: others at work on the machine do not count.
SECONDS_OF_A_PAIR = pytest.mark.benchmark(
    group="a pair 370 x 463 x 3 on a track", timer=time.process_time
)
Pair = tuple[NDArray[np.uint8], NDArray[np.uint8]]


@pytest.fixture(scope="module")
def pair() -> Pair:
    """Noise on a slanted ground with boards before it: each of the 256 levels lies on a line."""
    image = np.random.default_rng(0).integers(0, 256, (370, 463, 3)).astype(np.uint8)
    y, x = np.mgrid[:370, :463]
    depth = 0.3 * y + 0.1 * x + 90 * ((y // 90 + x // 110) % 2)
    return image, depth.astype(np.uint8)


@pytest.fixture(scope="module")
def clean_seconds(pair: Pair) -> float:
    return cpu(lambda: synthesize(*pair, RECIPE), 6)


@SECONDS_OF_A_PAIR
def test_clean(benchmark: Any, pair: Pair) -> None:
    benchmark.pedantic(synthesize, args=(*pair, RECIPE), rounds=5, warmup_rounds=1)


@SECONDS_OF_A_PAIR
@pytest.mark.parametrize("label", LABELS)
def test_a_track(benchmark: Any, pair: Pair, clean_seconds: float, label: str) -> None:
    arguments = (*pair, RECIPE, find_degradation(label), "Art/view1")
    benchmark.pedantic(form_pair, args=arguments, rounds=5, warmup_rounds=1)
    ratio = benchmark.stats["min"] / clean_seconds
    benchmark.extra_info["times the clean blur"] = ratio
    print(f"\n{label}: {ratio:.1f} times the clean blur")
