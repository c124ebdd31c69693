"""How far two depth levels must lie apart before a pixel's blur can tell them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dfdbench.blur import BlurRecipe, synthesize
from dfdbench.errors import InputError, Problem

#: The steps tried, in depth levels.
STEPS = (1, 2, 4, 8, 16, 32, 64, 128)
#: Given where no step tried is seen.
UNSEEN = 256
#: The greatest error of rounding to whole grey levels.
ROUNDING = 0.5


@dataclass(frozen=True)
class Difficulty:
    """What a pair's blur shows of its depth.

    Parameters
    ----------
    step : ndarray of int64, shape (y, x)
        The smallest of `STEPS` that changes the defocus pixel by more than the noise, up and
        down; `UNSEEN` where none does.
    valid : ndarray of bool, shape (y, x)
        True where the depth is known; only these count.
    """

    step: NDArray[np.int64]
    valid: NDArray[np.bool_]

    def share_above(self, step: int) -> float:
        """Return the share of known pixels that need a larger step than this one.

        For step 1: pixels whose blur cannot tell neighbouring levels apart.
        """
        return float((self.step[self.valid] > step).mean()) if self.valid.any() else float("nan")

    @property
    def median(self) -> float:
        """The median step over the known pixels."""
        return float(np.median(self.step[self.valid])) if self.valid.any() else float("nan")


def smallest_step(
    infocus: NDArray[np.uint8],
    depth: NDArray[np.uint8],
    valid: NDArray[np.bool_],
    recipe: BlurRecipe,
    noise: float = ROUNDING,
) -> Difficulty:
    """Find the smallest level step that each pixel's blur shows.

    The in-focus image is blurred at each pixel's own level and at levels a step above and
    below. A step is seen where, on either side, some channel changes by more than the noise.

    Parameters
    ----------
    infocus : ndarray of uint8, shape (y, x, 3)
        The in-focus image.
    depth : ndarray of uint8, shape (y, x)
        Depth levels in the sense of the recipe, brighter for nearer.
    valid : ndarray of bool, shape (y, x)
        True where the depth is known.
    recipe : BlurRecipe
        How the defocus image was made.
    noise : float
        Grey levels that a change must exceed; by default the greatest error of rounding.

    Raises
    ------
    InputError
        For images that do not fit, or noise that is no number from 0 up.

    Notes
    -----
    In a synthetic pair each defocus pixel is made from the in-focus image and its own depth
    alone (Eq. 3.1 to 3.4). So what is not seen here is in no pixel of the pair: a method can
    only guess it from the depth around.

    Examples
    --------
    >>> from dfdbench.blur import RECIPES
    >>> flat = np.full((30, 30, 3), 90, np.uint8)
    >>> depth = np.full((30, 30), 120, np.uint8)
    >>> smallest_step(flat, depth, depth > 0, RECIPES["published"]).share_above(1)
    1.0
    """
    if not noise >= 0:
        raise InputError(Problem("wrong noise", "noise", "grey levels, 0 or more", str(noise)))
    here = synthesize(infocus, depth, recipe).astype(np.int16)
    found = np.full(depth.shape, UNSEEN, np.int64)
    for step in STEPS:
        seen = np.ones(depth.shape, bool)
        tried = np.zeros(depth.shape, bool)
        for move in (-step, step):
            level = depth.astype(np.int64) + move
            inside = (level >= 0) & (level < recipe.levels)
            moved = np.where(inside, level, depth).astype(np.uint8)
            change = np.abs(synthesize(infocus, moved, recipe).astype(np.int16) - here).max(axis=2)
            seen &= ~inside | (change > noise)
            tried |= inside
        found[seen & tried & (found == UNSEEN)] = step
    return Difficulty(found, valid)
