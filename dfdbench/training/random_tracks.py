"""Patches of random tracks: each formed anew by a track at a severity that is drawn for it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.formation import LOBES, form_pair, kernel_size_of, law_of
from dfdbench.blur.recipe import BlurRecipe
from dfdbench.blur.tracks import TRACKS, Degradation


class RandomTracks:
    """Draws a track and a severity for each patch, and forms the patch by it.

    Parameters
    ----------
    recipe : BlurRecipe
        The data set's, from which tracks depart.
    names : sequence of str
        The tracks that are drawn from, each as often; so are their severities, 0 among them, which
        is clean.

    Examples
    --------
    >>> from dfdbench.blur.recipe import RECIPES
    >>> tracks = RandomTracks(RECIPES["published"], ["noise", "psf"])
    >>> tracks.choose(np.random.default_rng(0)).label, tracks.margin
    ('psf-2', 13)
    """

    def __init__(self, recipe: BlurRecipe, names: Sequence[str]) -> None:
        self._recipe = recipe
        self._drawn = tuple(
            Degradation(TRACKS[name], severity)
            for name in names
            for severity in range(len(TRACKS[name].severities) + 1)
        )
        #: Pixels around a patch that it may depend on, whichever track is drawn.
        self.margin = max(map(self.margin_of, self._drawn))

    def margin_of(self, degradation: Degradation) -> int:
        """Return how many pixels around a patch it depends on, on one track."""
        formation = degradation.formation
        radius = kernel_size_of(law_of(self._recipe, formation), formation.layers) // 2
        return radius + (LOBES + math.ceil(formation.shift) if formation.shift else 0)

    def choose(self, random: np.random.Generator) -> Degradation:
        """Draw a track and a severity."""
        return self._drawn[int(random.integers(len(self._drawn)))]

    def form(
        self,
        infocus: NDArray[np.uint8],
        depth: NDArray[np.uint8],
        degradation: Degradation,
        name: str,
    ) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """Return a patch's two images, (y, x, 3); direction, gain and noise follow from its name.

        Names of patches begin with ``training``, which no pair's does: no noise of a data set is
        drawn a second time.
        """
        return form_pair(infocus, depth, self._recipe, degradation, f"training/{name}")
