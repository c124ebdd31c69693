"""What a method may be told of a track: how its images come about, as a blur law.

What a run says that it was told is `dfdbench.results.told`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.formation import decode, kernel_size_of, law_of
from dfdbench.blur.law import ROUNDING_VARIANCE, BlurLaw
from dfdbench.blur.recipe import LAST_LEVEL, LEVELS, BlurRecipe
from dfdbench.blur.tracks import Formation


def told_law(recipe: BlurRecipe, formation: Formation) -> BlurLaw:
    """Return the blur law that tells a track's formation as far as a law can.

    Parameters
    ----------
    recipe : BlurRecipe
        The data set's own.
    formation : Formation
        What the track makes of it.

    Returns
    -------
    BlurLaw
        The true width at every depth level, shape of the kernel and noise at every grey level;
        whether light is linear, and whether pairs are moved and made brighter.

    Notes
    -----
    A law does not say three things: where each pair is moved to and how much brighter it is made,
    only that it is; and that surfaces cover each other. Of noise it says the standard deviation
    at a grey level, rounding included, but not that images are cut to 0 and 255.

    Examples
    --------
    >>> from dfdbench.blur.recipe import RECIPES
    >>> from dfdbench.blur.tracks import find_degradation
    >>> law = told_law(RECIPES["published"], find_degradation("psf-3").formation)
    >>> law.exponent, round(law.sigmas[255], 5), round(law.sigmas[0], 5)
    (32.0, 0.32, 3.18875)
    """
    own = law_of(recipe, formation)
    depths = np.arange(own.levels)
    noisy = bool(formation.noise or formation.read_noise or formation.full_well)
    return BlurLaw(
        sigmas=tuple(float(sigma) for sigma in own.sigmas[own.level_of_depth(depths)]),
        exponent=formation.exponent,
        kernel_size=kernel_size_of(own, formation.layers),
        noise=tuple(map(float, _noise(formation))) if noisy else (ROUNDING_VARIANCE**0.5,),
        # Both images go through the same sensor.
        infocus_noise=float(noisy),
        linear=formation.linear,
        registered=not formation.shift,
        even=not formation.gain,
    )


def _noise(formation: Formation) -> NDArray[np.float64]:
    """Return the standard deviation at each grey level, in the unit of a law's noise: (256,)."""
    if not formation.linear:
        return np.full(LEVELS, math.sqrt(formation.noise**2 + ROUNDING_VARIANCE))
    light = decode(np.arange(LAST_LEVEL + 1.0))
    variance = np.full(LEVELS, formation.read_noise**2)
    if formation.full_well:
        variance += light / formation.full_well
    # A grey level is as wide in light as the curve of the camera makes it.
    variance += ROUNDING_VARIANCE * np.square(np.gradient(light))
    return np.asarray(LAST_LEVEL * np.sqrt(variance), np.float64)
