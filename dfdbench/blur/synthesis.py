"""Make the defocus image that belongs to an in-focus image and its depth map."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.recipe import BlurRecipe
from dfdbench.errors import InputError, Problem
from dfdbench.system.compiled import compiled


def blur_by_level(
    image: NDArray[np.float64], levels: NDArray[np.integer], kernels: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return an image of which each pixel is the mean of its window under its level's kernel.

    Parameters
    ----------
    image : ndarray of float64, shape (y, x, channel) or (y, x)
        In any unit; the edge pixel is repeated past the border.
    levels : ndarray of int, shape (y, x)
        Which kernel each pixel has.
    kernels : ndarray of float64, shape (level, size, size)
        One a level, of odd size.

    Returns
    -------
    ndarray of float64
        Of the image's shape, not rounded.

    Raises
    ------
    InputError
        Where shapes do not fit one another, or a pixel's level has no kernel.

    Notes
    -----
    ``out[y, x] = sum over (j, i) of kernels[levels[y, x], j, i] * image[y + j - r, x + i - r]``
    with r the kernel's radius. The order of the sums is fixed, so that the last bit is the same
    on any machine, whatever else is running. Where a kernel ends in zeros they are left out.

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
    padded = np.pad(channels, ((radius, radius), (radius, radius), (0, 0)), mode="edge")
    rows = np.ascontiguousarray(padded, dtype=np.float64).reshape(padded.shape[0], -1)
    # A weight a channel, so that a row of the window is one run of products.
    spread = np.repeat(np.asarray(kernels, dtype=np.float64), channels.shape[2], axis=2)
    own = np.asarray(levels, dtype=np.int64)
    blurred: NDArray[np.float64] = _gather(rows, own, spread, reaches(kernels), channels.shape[2])
    return blurred.reshape(image.shape)


def require_kernels(
    image: NDArray[np.float64], levels: NDArray[np.integer], kernels: NDArray[np.float64]
) -> None:
    """Raise an InputError if an image cannot be blurred by these levels and kernels."""
    wrong: dict[str, str] = {}
    if image.ndim not in (2, 3) or image.shape[:2] != levels.shape or levels.size == 0:
        wrong["levels"] = f"sizes differ, {image.shape[:2]} of the image and {levels.shape}"
    if kernels.ndim != 3 or kernels.shape[1] != kernels.shape[2] or kernels.shape[1] % 2 == 0:
        wrong["kernels"] = f"wrong shape {kernels.shape}, not (level, odd, odd)"
    elif levels.size and not 0 <= levels.min() <= levels.max() < len(kernels):
        wrong["levels"] = f"a level of {levels.min()}..{levels.max()} has no kernel"
    if wrong:
        raise InputError.of(Problem(what, where=where) for where, what in wrong.items())


def reaches(kernels: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return how many pixels from its centre each kernel's last weight that is not 0 lies."""
    size = kernels.shape[1]
    offsets = np.abs(np.arange(size) - size // 2)
    rings = np.maximum.outer(offsets, offsets)
    return np.asarray(np.where(kernels != 0, rings, 0).max(axis=(1, 2)), dtype=np.int64)


@compiled()
def _gather(
    rows: NDArray[np.float64],
    levels: NDArray[np.int64],
    kernels: NDArray[np.float64],
    reach: NDArray[np.int64],
    channels: int,
) -> NDArray[np.float64]:
    # Row by row of the window into one row of products, which vectorises; no fast-math.
    height, width = levels.shape
    radius = kernels.shape[1] // 2
    out = np.empty((height, width * channels), np.float64)
    column = np.empty(kernels.shape[2], np.float64)
    for y in range(height):
        for x in range(width):
            level = levels[y, x]
            near = reach[level]
            span = (2 * near + 1) * channels
            first = (radius - near) * channels
            left = x * channels + first
            for i in range(span):
                column[i] = 0.0
            for j in range(radius - near, radius + near + 1):
                weights = kernels[level, j, first : first + span]
                pixels = rows[y + j, left : left + span]
                for i in range(span):
                    column[i] += weights[i] * pixels[i]
            for channel in range(channels):
                total = 0.0
                for i in range(channel, span, channels):
                    total += column[i]
                out[y, x * channels + channel] = total
    return out


def synthesize(
    image: NDArray[np.uint8], depth: NDArray[np.uint8], recipe: BlurRecipe
) -> NDArray[np.uint8]:
    """Blur each pixel of an in-focus image by its own depth.

    Parameters
    ----------
    image : ndarray of uint8, shape (y, x, channel) or (y, x)
        The in-focus image.
    depth : ndarray of uint8, shape (y, x)
        Depth levels, below ``recipe.levels``. Level 0, unknown in some sets, is taken as it is.
    recipe : BlurRecipe
        See `RECIPES`.

    Returns
    -------
    ndarray of uint8
        The defocus image, of the same shape as `image`.

    Raises
    ------
    InputError
        For a wrong dtype or shape, sizes that differ, or a depth the recipe has no level for.

    Notes
    -----
    Thesis 3.1 without the stack of blurred images: a pixel reads only its own window. The sum
    is taken in float64 with the edge pixel repeated past the border, then rounded to float32,
    then half to even: without the float32 step, ties differ from the published images.

    Examples
    --------
    >>> from dfdbench.blur.recipe import RECIPES
    >>> image = np.zeros((5, 5, 3), np.uint8)
    >>> image[2, 2] = 255
    >>> near = synthesize(image, np.full((5, 5), 255, np.uint8), RECIPES["published"])
    >>> far = synthesize(image, np.full((5, 5), 0, np.uint8), RECIPES["published"])
    >>> int(near[2, 2, 0]), int(far[2, 2, 0])
    (247, 4)
    """
    require_images(image, depth, recipe)
    return rounded(blur_by_recipe(image, depth, recipe))


def blur_by_recipe(
    image: NDArray[Any], depth: NDArray[np.uint8], recipe: BlurRecipe
) -> NDArray[np.float64]:
    """Blur as `synthesize` does, in any unit and not rounded; the arguments are not checked."""
    channels = image if image.ndim == 3 else image[:, :, np.newaxis]
    radius = recipe.kernel_size // 2
    padded = np.pad(channels, ((radius, radius), (radius, radius), (0, 0)), mode="edge")
    rows = np.ascontiguousarray(padded, dtype=np.float64).reshape(padded.shape[0], -1)
    levels = np.asarray(recipe.level_of_depth(depth.astype(np.int64)))
    half = np.ascontiguousarray(recipe.kernels()[:, radius:])
    blurred: NDArray[np.float64] = _blur_pixels(rows, levels, half, channels.shape[2])
    return blurred.reshape(image.shape)


def rounded(image: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return grey levels as bytes: to float32, then half to even, then cut to 0 and 255."""
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
    if wrong:
        raise InputError.of(Problem(what, where=where) for where, what in wrong.items())


@compiled()
def _blur_pixels(
    rows: NDArray[np.float64],
    levels: NDArray[np.int64],
    half_kernels: NDArray[np.float64],
    channels: int,
) -> NDArray[np.float64]:
    # The window is folded vertically first (all its columns at once, which vectorises), then
    # horizontally; pixels of one level that lie side by side share their columns. The order of the
    # sums is fixed and no fast-math is allowed, so the bytes do not depend on the machine or on who
    # else is running.
    height, width = levels.shape
    radius = half_kernels.shape[1] - 1
    out = np.empty((height, width * channels), np.float64)
    folded = np.empty((width + 2 * radius) * channels, np.float64)
    for y in range(height):
        begin = 0
        while begin < width:
            end = begin + 1
            while end < width and levels[y, end] == levels[y, begin]:
                end += 1
            kernel = half_kernels[levels[y, begin]]
            left, right = begin * channels, (end + 2 * radius) * channels
            centre = rows[y + radius, left:right]
            for i in range(right - left):
                folded[i] = kernel[0] * centre[i]
            for offset in range(1, radius + 1):
                above = rows[y + radius - offset, left:right]
                below = rows[y + radius + offset, left:right]
                weight = kernel[offset]
                for i in range(right - left):
                    folded[i] += weight * (above[i] + below[i])
            count = (end - begin) * channels
            middle = radius * channels
            for i in range(count):
                out[y, left + i] = kernel[0] * folded[middle + i]
            for offset in range(1, radius + 1):
                step = offset * channels
                weight = kernel[offset]
                for i in range(count):
                    before, after = folded[middle - step + i], folded[middle + step + i]
                    out[y, left + i] += weight * (before + after)
            begin = end
    return out
