"""Make the defocus image that belongs to an in-focus image and its depth map."""

from __future__ import annotations

import math
import numbers
from collections.abc import Mapping
from dataclasses import MISSING, asdict, dataclass, fields
from types import MappingProxyType
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dfdbench.errors import InputError, Problem, unknown_name


def _is_positive(value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        return False
    try:
        number = float(value)
    except OverflowError:
        return False
    return math.isfinite(number) and number > 0


def _is_whole(value: Any) -> bool:
    return isinstance(value, numbers.Integral) and not isinstance(value, bool)


@dataclass(frozen=True)
class BlurRecipe:
    """How much each depth level is blurred: ``sigma_i = sigma_min + i * sigma_step``.

    Parameters
    ----------
    sigma_min : float
        Standard deviation of the Gaussian at blur level 0, in pixels.
    sigma_step : float
        What each level adds, in pixels.
    levels : int
        Number of blur levels, 2 to 256.
    kernel_size : int
        Side of the square kernel in pixels, odd.
    invert : bool
        True: blur level = levels - 1 - depth (a brighter, nearer pixel is blurred less).
        False: blur level = depth.

    Notes
    -----
    Eq. 3.2 and 3.3 of the thesis; which numbers made its images: `RECIPES`.

    Examples
    --------
    >>> recipe = RECIPES["published"]
    >>> round(float(recipe.sigmas[255]), 5)
    3.18875
    >>> recipe.depth_of_level(recipe.level_of_depth(200))
    200
    """

    sigma_min: float
    sigma_step: float
    levels: int = 256
    kernel_size: int = 27
    invert: bool = True

    def __post_init__(self) -> None:
        size = self.kernel_size
        fits = {
            "sigma_min": (_is_positive(self.sigma_min), "a number > 0"),
            "sigma_step": (_is_positive(self.sigma_step), "a number > 0"),
            "levels": (_is_whole(self.levels) and 2 <= self.levels <= 256, "2 to 256"),
            "kernel_size": (_is_whole(size) and size > 0 and size % 2 == 1, "odd, positive"),
            "invert": (isinstance(self.invert, bool), "true or false"),
        }
        problems = [
            Problem(
                "wrong blur recipe", where=name, expected=expected, got=repr(getattr(self, name))
            )
            for name, (right, expected) in fits.items()
            if not right
        ]
        if problems:
            raise InputError.of(problems)

    @property
    def sigmas(self) -> NDArray[np.float64]:
        """The standard deviation of each blur level, in pixels."""
        return self.sigma_min + np.arange(self.levels, dtype=np.float64) * self.sigma_step

    def level_of_depth(self, depth: Any) -> Any:
        """Return the blur level of a depth level (number or array)."""
        return self.levels - 1 - depth if self.invert else depth

    def depth_of_level(self, level: Any) -> Any:
        """Return the depth level of a blur level: the exact inverse of `level_of_depth`."""
        return self.levels - 1 - level if self.invert else level

    def kernels(self) -> NDArray[np.float64]:
        """Return the 1-D Gaussian of each level, shape (levels, kernel_size), each of sum 1.

        The 2-D kernel is the outer product of a row with itself.
        """
        radius = self.kernel_size // 2
        offsets = np.arange(-radius, radius + 1, dtype=np.float64)
        rows = np.exp(-(offsets**2) / (2 * self.sigmas[:, np.newaxis] ** 2))
        return np.asarray(rows / rows.sum(axis=1, keepdims=True), dtype=np.float64)

    def as_dict(self) -> dict[str, float | int | bool]:
        """Return the parameters by name, fit for JSON."""
        return asdict(self)


#: The recipes by name. `published` (step 2.88 / 256) made the images published with the thesis,
#: bit for bit; `text` (step 2.56 / 256) is what its Eq. 3.2 says.
RECIPES: Mapping[str, BlurRecipe] = MappingProxyType(
    {
        "published": BlurRecipe(sigma_min=0.32, sigma_step=0.01125),
        "text": BlurRecipe(sigma_min=0.32, sigma_step=0.01),
    }
)


def find_recipe(recipe: str | Mapping[str, Any] | BlurRecipe) -> BlurRecipe:
    """Return a recipe from its name, its parameters, or itself.

    Raises
    ------
    UnknownNameError
        Where no recipe has that name.
    InputError
        Where a parameter is unknown, lacking, of the wrong type or out of range.

    Examples
    --------
    >>> find_recipe("text").sigma_step
    0.01
    """
    if isinstance(recipe, BlurRecipe):
        return recipe
    if isinstance(recipe, str):
        if recipe not in RECIPES:
            raise unknown_name("blur recipe", recipe, RECIPES)
        return RECIPES[recipe]
    known = [field.name for field in fields(BlurRecipe)]
    problems = [
        Problem(what="unknown field of a blur recipe", expected=", ".join(known), got=str(name))
        for name in recipe
        if name not in known
    ]
    problems += [
        Problem(what="a field of the blur recipe is lacking", expected=field.name)
        for field in fields(BlurRecipe)
        if field.default is MISSING and field.name not in recipe
    ]
    if problems:
        raise InputError.of(problems)
    return BlurRecipe(**recipe)


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
    >>> image = np.zeros((5, 5, 3), np.uint8)
    >>> image[2, 2] = 255
    >>> near = synthesize(image, np.full((5, 5), 255, np.uint8), RECIPES["published"])
    >>> far = synthesize(image, np.full((5, 5), 0, np.uint8), RECIPES["published"])
    >>> int(near[2, 2, 0]), int(far[2, 2, 0])
    (247, 4)
    """
    problems = _input_problems(image, depth, recipe)
    if problems:
        raise InputError.of(problems)
    channels = image if image.ndim == 3 else image[:, :, np.newaxis]
    radius = recipe.kernel_size // 2
    padded = np.pad(channels, ((radius, radius), (radius, radius), (0, 0)), mode="edge")
    rows = np.ascontiguousarray(padded, dtype=np.float64).reshape(padded.shape[0], -1)
    levels = np.asarray(recipe.level_of_depth(depth.astype(np.int64)))
    half = np.ascontiguousarray(recipe.kernels()[:, radius:])
    return _blur_pixels(rows, levels, half, channels.shape[2]).reshape(image.shape)


def _input_problems(image: Any, depth: Any, recipe: BlurRecipe) -> list[Problem]:
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


@njit(cache=True, nogil=True)
def _blur_pixels(
    rows: NDArray[np.float64],
    levels: NDArray[np.int64],
    half_kernels: NDArray[np.float64],
    channels: int,
) -> NDArray[np.uint8]:
    # The window is folded vertically first (all its columns at once, which vectorises), then
    # horizontally. The order of the sums is fixed and no fast-math is allowed, so the bytes do
    # not depend on the machine or on who else is running.
    height, width = levels.shape
    radius = half_kernels.shape[1] - 1
    span = (2 * radius + 1) * channels
    out = np.empty((height, width * channels), np.uint8)
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
                rounded = np.rint(np.float64(np.float32(total)))
                out[y, left + channel] = np.uint8(min(max(rounded, 0.0), 255.0))
    return out
