"""How much each depth level is blurred."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field

from dfdbench.errors import InputError, unknown_name
from dfdbench.system.strict import Positive, check_fields, made_of

#: The number of depth levels, since a byte holds one, and the last level.
LEVELS = 256
LAST_LEVEL = LEVELS - 1


def _odd(size: int) -> int:
    if size % 2 == 0:
        raise ValueError("odd")
    return size


#: The side of a square kernel.
KernelSize = Annotated[int, Field(ge=1), AfterValidator(_odd)]


@dataclass(frozen=True)
class BlurRecipe:
    """How much each depth level is blurred: ``sigma_i = sigma_min + i * sigma_step``.

    Parameters
    ----------
    sigma_min : float
        Standard deviation of the Gaussian at blur level 0, in pixels.
    sigma_step : float
        How much each level adds, in pixels.
    levels : int
        Number of blur levels, 2 to 256.
    kernel_size : int
        Side of the square kernel in pixels, odd; no level's sigma may be larger. Otherwise the
        kernel would hold only the flat middle of the Gaussian: its edge would weigh exp(-1/8),
        0.88, of its centre, and the levels would hardly differ.
    invert : bool
        True: blur level = levels - 1 - depth (a brighter, nearer pixel is blurred less).
        False: blur level = depth.

    Notes
    -----
    Eq. 3.2 and 3.3 of the thesis; `RECIPES` has the numbers that made its images.

    Examples
    --------
    >>> recipe = RECIPES["published"]
    >>> round(float(recipe.sigmas[255]), 5)
    3.18875
    >>> recipe.depth_of_level(recipe.level_of_depth(200))
    200
    """

    sigma_min: Positive
    sigma_step: Positive
    levels: Annotated[int, Field(ge=2, le=LEVELS)] = LEVELS
    kernel_size: KernelSize = 27
    invert: bool = True

    def __post_init__(self) -> None:
        check_fields(self, "blur recipe")
        largest = self.sigma_min + (self.levels - 1) * self.sigma_step
        if largest > self.kernel_size:
            what = f"sigma_min + {self.levels - 1} * sigma_step, {largest:g}, is above kernel_size"
            fix = "a smaller sigma, or a larger kernel_size"
            raise InputError(what, where="kernel_size", fix=fix)

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
        return gaussian_rows(self.sigmas, self.kernel_size // 2)

    def as_dict(self) -> dict[str, float | int | bool]:
        """Return the parameters by name, fit for JSON."""
        return asdict(self)


def gaussian_rows(sigmas: NDArray[np.float64], radius: int) -> NDArray[np.float64]:
    """Sample a Gaussian for each sigma, each of sum 1: shape (sigma, 2 * radius + 1)."""
    offsets = np.arange(-radius, radius + 1, dtype=np.float64)
    rows = np.exp(-(offsets**2) / (2 * sigmas[:, np.newaxis] ** 2))
    return np.asarray(rows / rows.sum(axis=1, keepdims=True), dtype=np.float64)


#: The recipes by name. `published` (step 2.88 / 256) made the images published with the thesis,
#: bit for bit; `text` (step 2.56 / 256) is what its Eq. 3.2 says.
RECIPES: Mapping[str, BlurRecipe] = {
    "published": BlurRecipe(sigma_min=0.32, sigma_step=0.01125),
    "text": BlurRecipe(sigma_min=0.32, sigma_step=0.01),
}


def find_recipe(recipe: str | Mapping[str, Any] | BlurRecipe) -> BlurRecipe:
    """Return a recipe from its name, its parameters, or itself.

    Raises
    ------
    UnknownNameError
        If no recipe has that name.
    InputError
        If a parameter is unknown, missing, of the wrong type or out of range.

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
    return made_of(BlurRecipe, recipe, "blur recipe")
