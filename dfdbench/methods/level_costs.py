"""What each depth level costs a pixel, in nats: of a recipe that is told, or of a fitted law."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.law import BlurLaw
from dfdbench.blur.recipe import BlurRecipe
from dfdbench.methods.calibration import Calibration, calibrate
from dfdbench.methods.data_cost import data_cost
from dfdbench.methods.fit import Learned
from dfdbench.methods.fitted import Fit, Image, learned_array, not_fitted
from dfdbench.methods.law_cost import blurred_by, law_cost

#: Integer cost of one nat, a factor e of probability.
UNIT = 4
# Of a recipe's residuals nothing is known but that images are rounded, which has this variance.
_ROUNDING = 1 / 12


class LevelCosts:
    """The cost volume of a pair: minus the logarithm of each level's probability, cut off.

    A level costs the squared difference between the defocus image and the in-focus image blurred
    at it, summed over the channels, over twice its variance: of a recipe, that of rounding; of a
    law, that of the noise it was measured with.

    Parameters
    ----------
    method : str
        Whose costs they are, for errors.
    recipe : BlurRecipe, BlurLaw or None
        How the defocus images were made; None where that is to be fitted.
    limit : float
        Nats above a pixel's least cost at which costs are cut off.
    """

    def __init__(self, method: str, recipe: BlurRecipe | BlurLaw | None, limit: float) -> None:
        self._method = method
        self._told = recipe is not None
        self._recipe = recipe
        self._limit = round(UNIT * limit)

    @property
    def fit(self) -> Fit | None:
        """What measures the blur law of training pairs; None where a recipe is told."""
        return None if self._told else lambda pairs: calibrate(pairs).as_learned()

    def restore(self, learned: Learned) -> None:
        """Take over what `fit` learned."""
        learned_array(learned, "sigmas", self._method, 1)
        plain = {name: np.asarray(value) for name, value in learned.items()}
        fields = {name: value if value.ndim else value.item() for name, value in plain.items()}
        self._recipe = Calibration.of(fields).law

    def __call__(self, infocus: Image, defocus: Image) -> NDArray[np.uint16]:
        """Return the costs, (y, x, label), `UNIT` a nat, each pixel's least 0."""
        sharp, blurred = np.atleast_3d(infocus), np.atleast_3d(defocus)
        if isinstance(self._recipe, BlurLaw):
            return law_cost(blurred_by(self._recipe, sharp, blurred), UNIT, self._limit)[0]
        if self._recipe is None:
            raise not_fitted(self._method)
        weight, size = UNIT / (2 * _ROUNDING), self._recipe.kernel_size
        return data_cost(sharp, blurred, self._recipe.sigmas, weight, self._limit, size)[0]

    def depth_of_label(self, label: NDArray[Any]) -> NDArray[np.float32]:
        """Return the depth level of a label or of a fraction between two."""
        if self._recipe is None:
            raise not_fitted(self._method)
        return np.asarray(self._recipe.depth_of_level(label), np.float32)
