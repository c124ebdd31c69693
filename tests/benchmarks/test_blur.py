"""The blur against a stack of 256 images filtered whole with OpenCV, in one run."""

import time
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from dfdbench.blur.recipe import RECIPES, BlurRecipe
from dfdbench.blur.synthesis import synthesize
from tests.benchmarks.ledger import Ledger, cpu

SHAPE = (370, 463)


Image = NDArray[np.uint8]


def stack(image: Image, depth: Image, recipe: BlurRecipe) -> Image:
    """Filter the whole image at every level, then pick: the way of the thesis's program."""

    def filtered(plane: Any, row: Any, _: float) -> Any:
        kernel = np.outer(row, row)
        return cv2.filter2D(plane, cv2.CV_64F, kernel, borderType=cv2.BORDER_REPLICATE)

    return picked(image, depth, recipe, np.float64, filtered)


def separable(image: Image, depth: Image, recipe: BlurRecipe) -> Image:
    """Do the same with rows and columns in float32, cut at four sigmas: faster, less exact."""

    def filtered(plane: Any, row: Any, sigma: float) -> Any:
        middle = len(row) // 2
        reach = min(middle, int(np.ceil(4 * sigma)))
        kernel = row[middle - reach : middle + reach + 1]
        return cv2.sepFilter2D(plane, cv2.CV_32F, kernel, kernel, borderType=cv2.BORDER_REPLICATE)

    return picked(image, depth, recipe, np.float32, filtered)


def picked(image: Image, depth: Image, recipe: BlurRecipe, kind: Any, filtered: Any) -> Image:
    levels, plane = recipe.level_of_depth(depth.astype(int)), image.astype(kind)
    out = np.empty_like(plane)
    for level, (sigma, row) in enumerate(zip(recipe.sigmas, recipe.kernels(), strict=True)):
        out[levels == level] = filtered(plane, row, sigma)[levels == level]
    return np.clip(np.rint(out.astype(np.float32)), 0, 255).astype(np.uint8)


@pytest.fixture
def pair() -> tuple[Image, Image]:
    random = np.random.default_rng(0)
    image = random.integers(0, 256, (*SHAPE, 3)).astype(np.uint8)
    return image, random.integers(0, 256, SHAPE).astype(np.uint8)


@pytest.mark.usefixtures("one_thread")
@pytest.mark.benchmark(group="blur 370 x 463 x 3, 256 levels", timer=time.process_time)
@pytest.mark.parametrize(
    ("way", "peer"), [(separable, "256 sepFilter2D, float32"), (stack, "256 filter2D, float64")]
)
def test_blur(benchmark: Any, ledger: Ledger, pair: tuple[Any, Any], way: Any, peer: str) -> None:
    arguments = (*pair, RECIPES["published"])
    ours = benchmark.pedantic(synthesize, arguments, rounds=5, warmup_rounds=1)
    theirs = way(*arguments)
    seconds = cpu(lambda: way(*arguments), 2)
    differing = (ours != theirs).mean()
    if way is stack:
        assert not differing
    result = f"1 value in {1 / differing:.0f} differs" if differing else "the same bytes"
    title = "blur of a pair, 370 x 463 x 3, 256 levels"
    ledger.note(title, benchmark.stats["min"], "opencv-python-headless", peer, seconds, result)
