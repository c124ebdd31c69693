"""How far two depth levels must lie apart before a pixel's blur can tell them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.recipe import LEVELS, BlurRecipe
from dfdbench.blur.synthesis import synthesize
from dfdbench.errors import InputError

#: The steps tried, in depth levels.
STEPS = (1, 2, 4, 8, 16, 32, 64, 128)
#: Given where no step tried is seen.
UNSEEN = LEVELS
#: What it means that a step is seen; in every text the same words.
SEEN = (
    "a step is seen where the defocus pixel, as stored in whole grey levels, differs in some "
    "channel by more than {noise} grey levels at the level that much nearer and at the level that "
    "much farther"
)


@dataclass(frozen=True)
class Difficulty:
    """What a pair's blur shows of its depth.

    Parameters
    ----------
    step : ndarray of int64, shape (y, x)
        The smallest of `STEPS` that is seen, nearer and farther; `UNSEEN` where none is.
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


def median_step(parts: Sequence[Difficulty]) -> int | None:
    """Return the median step over the known pixels of some pairs.

    It is one of `STEPS`, or `UNSEEN` where for most pixels no step is seen; None without a known
    pixel.
    """
    steps = np.concatenate([part.step[part.valid] for part in parts])
    return int(np.percentile(steps, 50, method="inverted_cdf")) if steps.size else None


def smallest_step(
    infocus: NDArray[np.uint8],
    depth: NDArray[np.uint8],
    valid: NDArray[np.bool_],
    recipe: BlurRecipe,
    noise: int = 0,
) -> Difficulty:
    """Find the smallest level step that each pixel's blur shows.

    The in-focus image is blurred at each pixel's own level and at levels a step nearer and
    farther. A step is seen where the defocus pixel, as stored in whole grey levels, differs in
    some channel by more than the noise at the level that much nearer and at the level that much
    farther. At the ends of the scale only one of the two exists and decides.

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
    noise : int
        Grey levels that a difference must exceed, beside the rounding that is in the stored
        pixels: by default none, so that any difference counts.

    Raises
    ------
    InputError
        For images that do not fit, or noise that is no whole number from 0 up.

    Notes
    -----
    In a synthetic pair each defocus pixel is made from the in-focus image and its own depth
    alone (Eq. 3.1 to 3.4). So what is not seen here is in no pixel of the pair: a method can
    only guess it from the depth around. Both sides must differ, for a level that looks like one
    of its neighbours cannot be told from it.

    Examples
    --------
    >>> from dfdbench.blur import RECIPES
    >>> flat = np.full((30, 30, 3), 90, np.uint8)
    >>> depth = np.full((30, 30), 120, np.uint8)
    >>> smallest_step(flat, depth, depth > 0, RECIPES["published"]).share_above(1)
    1.0
    """
    if not (isinstance(noise, int | np.integer) and noise >= 0):
        raise InputError(
            "wrong noise", where="noise", expected="whole grey levels, 0 or more", got=str(noise)
        )
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
