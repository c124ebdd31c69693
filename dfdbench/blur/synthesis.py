"""Make the defocus image that belongs to an in-focus image and its depth map."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.recipe import BlurRecipe
from dfdbench.errors import InputError, Problem
from dfdbench.system.compiled import compiled


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
    problems = input_problems(image, depth, recipe)
    if problems:
        raise InputError.of(problems)
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


def input_problems(image: Any, depth: Any, recipe: BlurRecipe) -> list[Problem]:
    """Return what keeps an image from being blurred by this depth map."""
    problems = []
    for name, array, dimensions in (("image", image, (2, 3)), ("depth", depth, (2,))):
        if not isinstance(array, np.ndarray) or array.dtype != np.uint8:
            got = str(getattr(array, "dtype", type(array).__name__))
            problems.append(
                Problem("wrong type", where=name, expected="a NumPy array of uint8", got=got)
            )
        elif array.ndim not in dimensions or array.size == 0:
            shape = "(y, x, channel) or (y, x)" if name == "image" else "(y, x)"
            problems.append(
                Problem("wrong shape", where=name, expected=shape, got=str(array.shape))
            )
    if problems:
        return problems
    if image.shape[:2] != depth.shape:
        problems.append(
            Problem(
                "sizes differ",
                where="depth",
                expected=f"{image.shape[:2]}, as the image",
                got=str(depth.shape),
            )
        )
    if int(depth.max()) >= recipe.levels:
        problems.append(
            Problem(
                "depth has no blur level",
                where="depth",
                expected=f"0 to {recipe.levels - 1}",
                got=f"up to {int(depth.max())}",
            )
        )
    return problems


@compiled()
def _blur_pixels(
    rows: NDArray[np.float64],
    levels: NDArray[np.int64],
    half_kernels: NDArray[np.float64],
    channels: int,
) -> NDArray[np.float64]:
    # The window is folded vertically first (all its columns at once, which vectorises), then
    # horizontally. The order of the sums is fixed and no fast-math is allowed, so the bytes do
    # not depend on the machine or on who else is running.
    height, width = levels.shape
    radius = half_kernels.shape[1] - 1
    span = (2 * radius + 1) * channels
    out = np.empty((height, width * channels), np.float64)
    column = np.empty(span, np.float64)
    for y in range(height):
        for x in range(width):
            kernel = half_kernels[levels[y, x]]
            left = x * channels
            centre = rows[y + radius, left : left + span]
            for i in range(span):
                column[i] = kernel[0] * centre[i]
            for offset in range(1, radius + 1):
                above = rows[y + radius - offset, left : left + span]
                below = rows[y + radius + offset, left : left + span]
                weight = kernel[offset]
                for i in range(span):
                    column[i] += weight * (above[i] + below[i])
            for channel in range(channels):
                middle = radius * channels + channel
                total = kernel[0] * column[middle]
                for offset in range(1, radius + 1):
                    step = offset * channels
                    total += kernel[offset] * (column[middle - step] + column[middle + step])
                out[y, left + channel] = total
    return out
