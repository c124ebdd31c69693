"""Semi-global matching over the cost of each depth level."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.law import BlurLaw
from dfdbench.blur.recipe import BlurRecipe
from dfdbench.errors import MethodError, Problem
from dfdbench.methods.calibrated import Calibrated
from dfdbench.methods.fitted import Image, number_within
from dfdbench.methods.level_costs import UNIT, level_costs
from dfdbench.methods.path_costs import MOST, path_costs
from dfdbench.methods.winner import least_label


class SemiGlobal(Calibrated):
    """Depth by the sum of eight paths' least costs: smoothness along lines, not over the image.

    What a level costs a pixel is the squared difference between the defocus image and the
    in-focus image blurred at it (`level_costs`). Along each of eight directions the least cost of
    a path that ends at a pixel with a level is found by dynamic programming; a step of one level
    costs `small_step`, a larger one `large_step`. A pixel takes the level of the least sum over
    the eight, and the minimum of a parabola.

    Parameters
    ----------
    recipe : BlurRecipe or BlurLaw, optional
        How the defocus images were made; without it the law is fitted.
    small_step, large_step : float
        P1 and P2 of the paper, in nats (factors e of probability); the second not below the
        first.
    limit : float
        Nats above a pixel's least at which costs are cut off.

    Raises
    ------
    MethodError
        For a parameter out of range, all of them named; at a call without recipe or fit.

    Notes
    -----
    Hirschmüller 2008, Eq. 13 and 14, with a constant P2.

    Examples
    --------
    >>> from dfdbench.blur import RECIPES, synthesize
    >>> image = np.random.default_rng(0).integers(0, 256, (40, 40, 3)).astype(np.uint8)
    >>> defocus = synthesize(image, np.full((40, 40), 120, np.uint8), RECIPES["published"])
    >>> found = SemiGlobal(RECIPES["published"])(image, defocus)
    >>> bool(np.abs(found - 120).mean() < 1)
    True
    """

    paper = (
        "Hirschmüller, Stereo processing by semiglobal matching and mutual information, PAMI 2008"
    )

    def __init__(
        self,
        recipe: BlurRecipe | BlurLaw | None = None,
        small_step: float = 0.5,
        large_step: float = 15.0,
        limit: float = 100.0,
    ) -> None:
        most = MOST // (2 * UNIT)
        problems = number_within("small_step", small_step, 0, most)
        problems += number_within("large_step", large_step, 0, most)
        if not problems and large_step < small_step:
            # Which of the two was set is not known here: the other may be the default.
            steps = f"small_step {small_step:g}, large_step {large_step:g}"
            expected = "small_step at most large_step"
            problems.append(
                Problem(
                    "wrong parameters",
                    where="small_step and large_step",
                    expected=expected,
                    got=steps,
                )
            )
        problems += number_within("limit", limit, 0, most)
        if problems:
            raise MethodError.of(problems)
        super().__init__(recipe)
        self._limit = limit
        self._steps = round(UNIT * small_step), round(UNIT * large_step)

    def warm_up(self, infocus: Image, defocus: Image) -> None:
        """Compile what the first call would compile."""
        self(infocus[:32, :32].copy(), defocus[:32, :32].copy())

    def __call__(self, infocus: Image, defocus: Image) -> NDArray[np.float32]:
        """Return depth levels for two images of uint8, shape (y, x, 3) or, grey, (y, x)."""
        sums = path_costs(level_costs(self.blur, infocus, defocus, self._limit), *self._steps)
        return np.asarray(
            self.blur.depth_of_level(least_label(np.moveaxis(sums, 2, 0))), np.float32
        )
