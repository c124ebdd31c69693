"""What each depth level costs a pixel, in nats: of a recipe that is told, or of a fitted law."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.law import ROUNDING_VARIANCE, BlurLaw
from dfdbench.blur.recipe import BlurRecipe
from dfdbench.methods.data_cost import data_cost
from dfdbench.methods.law_cost import blurred_by, law_cost

#: Integer cost of one nat, a factor e of probability.
UNIT = 4


def level_costs(
    blur: BlurRecipe | BlurLaw, infocus: NDArray[np.uint8], defocus: NDArray[np.uint8], limit: float
) -> NDArray[np.uint16]:
    """Return a pair's cost volume: minus the logarithm of each level's probability, cut off.

    A level costs the squared difference between the defocus image and the in-focus image blurred
    at it, summed over the channels, over twice its variance: of a recipe, that of rounding; of a
    law, that of the noise it was measured with. Unlike the data cost of `graph-cuts` it compares
    RGB, which is not rounded a second time.

    Parameters
    ----------
    blur : BlurRecipe or BlurLaw
        How the defocus image was made.
    infocus, defocus : ndarray of uint8, shape (y, x, channel) or (y, x)
        The pair.
    limit : float
        Nats above a pixel's least cost at which costs are cut off.

    Returns
    -------
    ndarray of uint16, shape (y, x, label)
        `UNIT` a nat, each pixel's least 0. The blur's ``depth_of_level`` gives a label's depth.

    Examples
    --------
    >>> from dfdbench.blur.recipe import RECIPES
    >>> flat = np.full((2, 3), 90, np.uint8)
    >>> costs = level_costs(RECIPES["published"], flat, flat, 20)
    >>> costs.shape, int(costs.max())
    ((2, 3, 256), 0)
    """
    sharp, blurred = np.atleast_3d(infocus), np.atleast_3d(defocus)
    most = round(UNIT * limit)
    if isinstance(blur, BlurLaw):
        return law_cost(blurred_by(blur, sharp, blurred), UNIT, most)[0]
    # Of a recipe's residuals nothing is known but that images are rounded.
    weight = UNIT / (2 * ROUNDING_VARIANCE)
    return data_cost(sharp, blurred, blur.sigmas, weight, most, blur.kernel_size)[0]
