from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.ndimage
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from dfdbench.blur.light import Floats
from dfdbench.blur.point_spread import point_spread_functions
from dfdbench.blur.recipe import RECIPES, BlurRecipe
from dfdbench.blur.synthesis import blur_by_level, blur_by_recipe, synthesize
from dfdbench.blur.tracks import DISK
from dfdbench.errors import InputError
from tests.conftest import aloe_depth, aloe_pair

Image = NDArray[np.uint8]


def whole_images(image: Floats, levels: NDArray[Any], kernels: Floats) -> Floats:
    """Filter whole images, then pick a level a pixel."""
    out = np.zeros_like(image)
    for level in np.unique(levels):
        for channel in range(image.shape[2]):
            blurred = scipy.ndimage.correlate(image[..., channel], kernels[level], mode="nearest")
            out[..., channel][levels == level] = blurred[levels == level]
    return out


def stack_of_filtered_images(image: Image, depth: Image, recipe: BlurRecipe) -> Image:
    """The thesis's way, word for word."""
    radius = recipe.kernel_size // 2
    y, x = np.mgrid[-radius : radius + 1, -radius : radius + 1].astype(np.float64)
    sigmas = recipe.sigma_min + recipe.sigma_step * np.arange(recipe.levels)
    kernels = [np.exp(-(x**2 + y**2) / (2 * sigma**2)) for sigma in sigmas]
    levels = recipe.level_of_depth(depth.astype(int))
    normed = np.stack([kernel / kernel.sum() for kernel in kernels])
    out = whole_images(image.astype(np.float64), levels, normed)
    return np.clip(np.rint(out.astype(np.float32)), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("exposure", [1, 2])
def test_the_published_images_come_out_identical(shared_data: Path, exposure: int) -> None:
    infocus, published = aloe_pair(shared_data, exposure)
    depth = aloe_depth(shared_data)
    ours = synthesize(infocus, depth, RECIPES["published"])
    assert np.array_equal(ours, published)
    assert not np.array_equal(synthesize(infocus, depth, RECIPES["text"]), published)


@settings(max_examples=15, deadline=None)
@given(
    image=hnp.arrays(np.uint8, (9, 14, 3)),
    depth=hnp.arrays(np.uint8, (9, 14)),
    recipe=st.sampled_from(
        [RECIPES["published"], RECIPES["text"], BlurRecipe(0.5, 0.02, invert=False)]
    ),
)
def test_it_equals_filtered_images(image: Image, depth: Image, recipe: BlurRecipe) -> None:
    ours = synthesize(image, depth, recipe)
    assert np.array_equal(ours, stack_of_filtered_images(image, depth, recipe))


@settings(max_examples=20, deadline=None)
@given(image=hnp.arrays(np.uint8, (8, 9, 3)), depth=hnp.arrays(np.uint8, (8, 9)))
def test_it_commutes_with_mirroring_and_channel_order(image: Image, depth: Image) -> None:
    recipe = RECIPES["published"]
    plain = synthesize(image, depth, recipe)
    mirrored = synthesize(image[:, ::-1].copy(), depth[:, ::-1].copy(), recipe)
    assert np.array_equal(mirrored[:, ::-1], plain)
    swapped = synthesize(image[..., ::-1].copy(), depth, recipe)
    assert np.array_equal(swapped[..., ::-1], plain)


def test_brighter_depth_is_blurred_less_and_inversion_is_explicit() -> None:
    image = np.zeros((31, 31, 3), np.uint8)
    image[15, 15] = 255
    peaks = [
        int(synthesize(image, np.full((31, 31), level, np.uint8), RECIPES["published"]).max())
        for level in (255, 200, 100, 0)
    ]
    assert peaks == sorted(peaks, reverse=True)
    forward = BlurRecipe(0.32, 0.01125, invert=False)
    near = synthesize(image, np.full((31, 31), 255, np.uint8), forward)
    assert int(near.max()) == peaks[-1]


def test_a_grey_image_and_a_strided_one() -> None:
    random = np.random.default_rng(0)
    image = random.integers(0, 256, (20, 40, 3)).astype(np.uint8)
    depth = random.integers(0, 256, (20, 40)).astype(np.uint8)
    whole = synthesize(image, depth, RECIPES["published"])
    grey = synthesize(image[..., 1], depth, RECIPES["published"])
    assert np.array_equal(grey, whole[..., 1])
    strided = synthesize(image[:, ::2], depth[:, ::2], RECIPES["published"])
    packed = synthesize(image[:, ::2].copy(), depth[:, ::2].copy(), RECIPES["published"])
    assert np.array_equal(strided, packed)


def test_wrong_input_is_named() -> None:
    image, depth = np.zeros((4, 4, 3), np.uint8), np.full((4, 4), 64, np.uint8)
    wrong: list[tuple[Any, Any, str]] = [
        (image.astype(float), depth, "float64"),
        (image, depth.astype(float), "float64"),
        (image, depth[:, 1:], "sizes differ"),
        (image[0, :, 0], depth, "wrong shape"),
        (image[:0], depth[:0], "wrong shape"),
        ([[1]], depth[:1, :1], "list"),
    ]
    for each, levels, said in wrong:
        with pytest.raises(InputError, match=said):
            synthesize(each, levels, RECIPES["published"])
    with pytest.raises(InputError, match="0 to 63"):
        synthesize(image, depth, BlurRecipe(0.3, 0.05, levels=64))
    for axis in (1, 2):
        with pytest.raises(InputError, match="a kernel is not symmetric"):
            blur_by_level(IMAGE, LEVELS, np.roll(symmetric(5), 1, axis))


RANDOM = np.random.default_rng(7)
IMAGE = RANDOM.uniform(0, 255, (17, 23, 3))
LEVELS = RANDOM.integers(0, 5, (17, 23))


def symmetric(count: int) -> Floats:
    """Return kernels of random weights, as much to the left as to the right, but not turned."""
    away = np.abs(np.arange(-4, 5))
    return RANDOM.uniform(0, 1, (count, 5, 5))[:, away[:, np.newaxis], away]


@pytest.mark.parametrize("kind", ["any", "disk"])
def test_it_is_whole_images_filtered_then_picked(kind: str) -> None:
    disks = point_spread_functions(np.linspace(0.3, 2, 5), 9, DISK)
    kernels = symmetric(5) if kind == "any" else disks
    ours = blur_by_level(IMAGE, LEVELS, kernels)
    assert np.allclose(ours, whole_images(IMAGE, LEVELS, kernels), rtol=1e-12)
    grey = blur_by_level(IMAGE[..., 1], LEVELS, kernels)
    assert np.array_equal(grey, ours[..., 1])


@pytest.mark.parametrize("channels", [1, 3, 9])
@pytest.mark.parametrize("shape", [(1, 1), (4, 37)])
def test_sums_are_in_their_order_to_the_last_bit(shape: tuple[int, int], channels: int) -> None:
    image = RANDOM.uniform(0, 255, (*shape, channels))
    levels = np.sort(RANDOM.integers(0, 256, shape).astype(np.uint8), axis=1) // 9 * 9
    levels[:, ::5] = 250
    recipe = BlurRecipe(0.32, 0.01125, kernel_size=9, invert=False)
    rows, kernels = recipe.kernels(), symmetric(256)
    padded = np.pad(image, ((4, 4), (4, 4), (0, 0)), mode="edge")
    folded, gathered = np.empty_like(image), np.empty_like(image)
    for y, x in np.ndindex(shape):
        window, row = padded[y : y + 9, x : x + 9], rows[levels[y, x]]
        kernel = kernels[levels[y, x]][..., np.newaxis]
        # Opposite weights are one; columns first, then rows.
        column = row[4] * window[4]
        for offset in range(1, 5):
            column = column + row[4 + offset] * (window[4 - offset] + window[4 + offset])
        folded[y, x] = row[4] * column[4]
        for offset in range(1, 5):
            folded[y, x] += row[4 + offset] * (column[4 - offset] + column[4 + offset])
        # Opposite rows are one, then opposite columns; column by column from the middle one.
        tall = [window[4], *(window[4 - j] + window[4 + j] for j in range(1, 5))]
        wide = [[row[4], *(row[4 - i] + row[4 + i] for i in range(1, 5))] for row in tall]
        gathered[y, x] = sum(
            sum(kernel[4 + j, 4 + i] * wide[j][i] for j in range(5)) for i in range(5)
        )
    assert np.array_equal(blur_by_recipe(image, levels, recipe), folded)
    assert np.array_equal(blur_by_level(image, levels, kernels), gathered)


def test_threads_at_work_at_once_change_nothing() -> None:
    image = RANDOM.integers(0, 256, (60, 80, 3)).astype(np.uint8)
    depth = RANDOM.integers(0, 256, (60, 80)).astype(np.uint8)
    kernels = point_spread_functions(np.linspace(0.3, 2, 5), 9, 3)
    blurs: list[Callable[[int], Any]] = [
        lambda _: synthesize(image, depth, RECIPES["published"]),
        lambda _: blur_by_level(IMAGE, LEVELS, kernels),
    ]
    for blur in blurs:
        alone = blur(0)
        with ThreadPoolExecutor(8) as pool:
            assert all(np.array_equal(one, alone) for one in list(pool.map(blur, range(16))))
