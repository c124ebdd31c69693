"""Make the defocus image that belongs to an in-focus image and its depth map."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.light import Floats, Image
from dfdbench.blur.recipe import BlurRecipe, find_recipe
from dfdbench.errors import InputError, Problem
from dfdbench.system.compiled import compiled
from dfdbench.system.vectors import LANES, all_of, load, plus, store, times

Ints = NDArray[np.int64]


def blur_by_level(image: Floats, levels: NDArray[np.integer], kernels: Floats) -> Floats:
    """Return an image blurred pixel by pixel: each is its window's mean under its level's kernel.

    Parameters
    ----------
    image : ndarray of float64, shape (y, x, channel) or (y, x)
        In any unit; the edge pixel is repeated past the border.
    levels : ndarray of int, shape (y, x)
        The index of each pixel's kernel.
    kernels : ndarray of float64, shape (level, size, size)
        One per level, of odd size, symmetric in both axes.

    Returns
    -------
    ndarray of float64
        Same shape as the image, not rounded.

    Raises
    ------
    InputError
        If shapes do not match, a pixel's level has no kernel, or a kernel is not symmetric.

    Notes
    -----
    ``out[y, x] = sum over (j, i) of kernels[levels[y, x], j, i] * image[y + j - r, x + i - r]``
    with r the kernel's radius. The order of the sums is fixed, so the last bit is the same on any
    machine, whatever else is running. Zeros at a kernel's border are skipped.

    Examples
    --------
    >>> image = np.arange(25.0).reshape(5, 5)
    >>> box = np.full((1, 3, 3), 1 / 9)
    >>> float(blur_by_level(image, np.zeros((5, 5), int), box)[2, 2].round(9))
    12.0
    """
    require_kernels(image, levels, kernels)
    channels = image if image.ndim == 3 else image[:, :, np.newaxis]
    radius = kernels.shape[1] // 2
    blurred = _gather(
        _padded_rows(channels, radius),
        np.asarray(levels, dtype=np.int64),
        np.ascontiguousarray(kernels[:, radius:, radius:], dtype=np.float64),
        reaches(kernels),
        channels.shape[2],
    )
    return np.asarray(blurred[:, : image.shape[1] * channels.shape[2]]).reshape(image.shape)


def _padded_rows(channels: NDArray[Any], radius: int) -> Floats:
    """Return rows with edge pixels repeated, and padding for vectors that run past the end."""
    padded = np.pad(channels, ((radius, radius), (radius, radius), (0, 0)), mode="edge")
    height, width, count = padded.shape
    rows = np.zeros((height, width * count + LANES), dtype=np.float64)
    rows[:, : width * count] = padded.reshape(height, -1)
    return rows


def require_kernels(image: Floats, levels: NDArray[np.integer], kernels: Floats) -> None:
    """Raise an InputError if an image cannot be blurred by these levels and kernels."""
    wrong: dict[str, str] = {}
    if image.ndim not in (2, 3) or image.shape[:2] != levels.shape or levels.size == 0:
        wrong["levels"] = f"sizes differ, {image.shape[:2]} of the image and {levels.shape}"
    if kernels.ndim != 3 or kernels.shape[1] != kernels.shape[2] or kernels.shape[1] % 2 == 0:
        wrong["kernels"] = f"wrong shape {kernels.shape}, not (level, odd, odd)"
    elif not all(np.array_equal(kernels, np.flip(kernels, axis)) for axis in (1, 2)):
        wrong["kernels"] = "a kernel is not symmetric"
    elif levels.size and not 0 <= levels.min() <= levels.max() < len(kernels):
        wrong["levels"] = f"a level of {levels.min()}..{levels.max()} has no kernel"
    InputError.raise_if(Problem(what, where=where) for where, what in wrong.items())


def reaches(kernels: Floats) -> Ints:
    """Return each kernel's reach: the distance in pixels from its centre to its last non-zero."""
    size = kernels.shape[1]
    offsets = np.abs(np.arange(size) - size // 2)
    rings = np.maximum.outer(offsets, offsets)
    return np.asarray(np.where(kernels != 0, rings, 0).max(axis=(1, 2)), dtype=np.int64)


@compiled()
def _add_opposite(rows: Floats, y: int, folded: Floats) -> None:
    """Write the sums of each two rows equally far above and below a row, nearest first."""
    # Both have the same weight for every pixel of the row, whatever its level.
    stride, radius = rows.shape[1], len(folded) - 1
    centre = (y + radius) * stride
    for i in range(0, stride - LANES, LANES):
        store(folded, i, load(rows, centre + i))
        for j in range(1, radius + 1):
            above = load(rows, centre - j * stride + i)
            store(folded, j * stride + i, plus(above, load(rows, centre + j * stride + i)))


@compiled()
def _gather(rows: Floats, levels: Ints, quadrants: Floats, reach: Ints, channels: int) -> Floats:
    # The folded window is summed column by column, for a few pixels at once; neighbours of one
    # level are done together. The order of the sums is fixed.
    height, width = levels.shape
    stride, radius = rows.shape[1], quadrants.shape[1] - 1
    middle = radius * channels
    out = np.empty((height, width * channels + LANES), np.float64)
    folded = np.empty((radius + 1, stride), np.float64)
    for y in range(height):
        _add_opposite(rows, y, folded)
        begin = 0
        while begin < width:
            end = begin + 1
            while end < width and levels[y, end] == levels[y, begin]:
                end += 1
            weights, near = quadrants[levels[y, begin]], reach[levels[y, begin]]
            for i in range(begin * channels, end * channels, LANES):
                total = all_of(0.0)
                for j in range(near + 1):
                    pixels = load(folded, j * stride + middle + i)
                    total = plus(total, times(all_of(weights[j, 0]), pixels))
                for column in range(1, near + 1):
                    place, sums = middle + i, all_of(0.0)
                    for j in range(near + 1):
                        before = load(folded, place - column * channels)
                        both = plus(before, load(folded, place + column * channels))
                        sums = plus(sums, times(all_of(weights[j, column]), both))
                        place += stride
                    total = plus(total, sums)
                store(out, y * out.shape[1] + i, total)
            begin = end
    return out


def synthesize(image: Image, depth: Image, recipe: BlurRecipe | str) -> Image:
    """Blur each pixel of an in-focus image by its own depth.

    Parameters
    ----------
    image : ndarray of uint8, shape (y, x, channel) or (y, x)
        The in-focus image.
    depth : ndarray of uint8, shape (y, x)
        Depth levels, below ``recipe.levels``. Level 0, which some sets use for unknown depth, is
        blurred as depth 0.
    recipe : BlurRecipe or str
        A recipe, or its name in `RECIPES`.

    Returns
    -------
    ndarray of uint8
        The defocus image, of the same shape as `image`.

    Raises
    ------
    InputError
        If a dtype or shape is wrong, sizes differ, or the recipe has no level for a depth, or is
        none of ours.

    Notes
    -----
    Section 3.1 of the thesis, without its stack of blurred images: a pixel reads only its own
    window. The sum is taken in float64 with the edge pixel repeated past the border, then rounded
    to float32, then half to even. Without the float32 step, ties differ from the published images.

    Examples
    --------
    >>> image = np.zeros((5, 5, 3), np.uint8)
    >>> image[2, 2] = 255
    >>> near = synthesize(image, np.full((5, 5), 255, np.uint8), "published")
    >>> far = synthesize(image, np.full((5, 5), 0, np.uint8), "published")
    >>> int(near[2, 2, 0]), int(far[2, 2, 0])
    (247, 4)
    """
    recipe = find_recipe(recipe)
    require_images(image, depth, recipe)
    return rounded(blur_by_recipe(image, depth, recipe))


def blur_by_recipe(image: NDArray[Any], depth: Image, recipe: BlurRecipe) -> Floats:
    """Blur as `synthesize` does, in any unit, without rounding or checking the arguments."""
    channels = image if image.ndim == 3 else image[:, :, np.newaxis]
    radius = recipe.kernel_size // 2
    levels = np.asarray(recipe.level_of_depth(depth.astype(np.int64)))
    half = np.ascontiguousarray(recipe.kernels()[:, radius:])
    blurred = _blur_pixels(_padded_rows(channels, radius), levels, half, channels.shape[2])
    return np.asarray(blurred[:, : image.shape[1] * channels.shape[2]]).reshape(image.shape)


def rounded(image: Floats) -> Image:
    """Return grey levels as bytes: cast to float32, rounded half to even, clipped to 0..255."""
    return np.asarray(np.clip(np.rint(image.astype(np.float32)), 0, 255), dtype=np.uint8)


def require_images(image: Any, depth: Any, recipe: BlurRecipe) -> None:
    """Raise an InputError if an image cannot be blurred by this depth map."""
    wrong: dict[str, str] = {}
    for name, array, dimensions in (("image", image, (2, 3)), ("depth", depth, (2,))):
        if not isinstance(array, np.ndarray) or array.dtype != np.uint8:
            got = getattr(array, "dtype", type(array).__name__)
            wrong[name] = f"wrong type, not a NumPy array of uint8: {got}"
        elif array.ndim not in dimensions or array.size == 0:
            shape = "(y, x, channel) or (y, x)" if name == "image" else "(y, x)"
            wrong[name] = f"wrong shape, not {shape}: {array.shape}"
    if not wrong and image.shape[:2] != depth.shape:
        wrong["depth"] = f"sizes differ, {image.shape[:2]} of the image and {depth.shape}"
    elif not wrong and int(depth.max()) >= recipe.levels:
        wrong["depth"] = f"depth {depth.max()} is beyond the levels, 0 to {recipe.levels - 1}"
    InputError.raise_if(Problem(what, where=where) for where, what in wrong.items())


@compiled()
def _blur_pixels(rows: Floats, levels: Ints, half_kernels: Floats, channels: int) -> Floats:
    # The folded window is weighted vertically first (all its columns at once), then horizontally;
    # neighbours of one level share their columns. The order of the sums is fixed, so the bytes do
    # not depend on the machine or on what else is running.
    height, width = levels.shape
    stride, radius = rows.shape[1], half_kernels.shape[1] - 1
    middle = radius * channels
    out = np.empty((height, width * channels + LANES), np.float64)
    folded = np.empty((radius + 1, stride), np.float64)
    column = np.zeros(stride + LANES, np.float64)
    for y in range(height):
        _add_opposite(rows, y, folded)
        begin = 0
        while begin < width:
            end = begin + 1
            while end < width and levels[y, end] == levels[y, begin]:
                end += 1
            kernel = half_kernels[levels[y, begin]]
            for i in range(begin * channels, (end + 2 * radius) * channels, LANES):
                total = times(all_of(kernel[0]), load(folded, i))
                for offset in range(1, radius + 1):
                    both = load(folded, offset * stride + i)
                    total = plus(total, times(all_of(kernel[offset]), both))
                store(column, i, total)
            for i in range(begin * channels, end * channels, LANES):
                total = times(all_of(kernel[0]), load(column, middle + i))
                for offset in range(1, radius + 1):
                    before = load(column, middle - offset * channels + i)
                    both = plus(before, load(column, middle + offset * channels + i))
                    total = plus(total, times(all_of(kernel[offset]), both))
                store(out, y * out.shape[1] + i, total)
            begin = end
    return out
