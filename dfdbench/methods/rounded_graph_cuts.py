"""Graph cuts for a defocus image that is nothing but a rounded blur of the in-focus image."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.law import BlurLaw
from dfdbench.blur.recipe import RECIPES, BlurRecipe
from dfdbench.errors import MethodError
from dfdbench.methods import mrf
from dfdbench.methods.calibrated import Calibrated
from dfdbench.methods.law_cost import blurred_by, law_misfits
from dfdbench.methods.path_costs import MOST, path_costs
from dfdbench.methods.rounded_cost import costs_of_misfits, rounded_cost

Image = NDArray[np.uint8]

# Integer costs of one nat (a factor e of probability), and of a level's difference between
# neighbours.
_UNIT = 4

# Of blocks of 2 x 2, then of pixels: what reaches the energy of a sweep of expansions, in a quarter
# of its time.
REPAIRS = ((-16, 128, 64, 32, 16, 8), (0, 16, 8, 0))


def best_paths(blocks: mrf.Energy) -> NDArray[np.int64]:
    """Give blocks of 2 x 2 pixels the labels that are best along rows and columns."""
    # Two edges between blocks.
    small, large = 2 * int(blocks.smoothness[1]), 2 * int(blocks.smoothness.max())
    costs = np.minimum(blocks.unary, MOST - large).astype(np.uint16)
    return np.asarray(path_costs(costs, small, large, directions=4).argmin(axis=2))


class RoundedGraphCuts(Calibrated):
    """Depth by the interval that rounding leaves: labels within half a grey level are free.

    A synthetic defocus image has no noise: it is the blurred image rounded to whole grey levels.
    So the true label's residual is at most half a level in every channel, and every label that
    keeps within that explains a pixel equally well (`rounded_cost`). Of the depth maps that obey,
    the smoothest is taken: neighbours pay for each level they differ, up to `truncation`, beyond
    which they belong to different surfaces. Where images have other errors too, the constraint
    softens by itself.

    Parameters
    ----------
    recipe : BlurRecipe, BlurLaw or None
        How the defocus images were made; in a run, the data set's recipe. Where that is not told,
        the method is fitted: see `dfdbench.methods.calibration`. The interval of a law is as wide
        as its noise, and no level is proposed beyond those whose blur training showed.
    truncation : int
        Difference in levels from which neighbours count as different surfaces.

    Raises
    ------
    MethodError
        For a truncation that is not positive or too large for 16-bit costs.

    Notes
    -----
    It lives on exact knowledge of the blur and on the absence of noise, and says little about
    photographs: docs/graph_cuts.md. Minimised on blocks of 2 x 2 pixels first
    (`mrf.coarse_to_fine`), from the best labels along rows and columns (`path_costs`); where some
    pixel has no free label, by a sweep of alpha-expansion, since lines through noise lead astray.

    Examples
    --------
    >>> from dfdbench.blur import synthesize
    >>> infocus = np.random.default_rng(1).integers(0, 256, (12, 30, 3)).astype(np.uint8)
    >>> depth = np.full((12, 30), 90, np.uint8)
    >>> depth[:, 15:] = 200
    >>> defocus = synthesize(infocus, depth, RECIPES["published"])
    >>> bool(np.all(RoundedGraphCuts()(infocus, defocus) == depth))
    True
    """

    def __init__(
        self, recipe: BlurRecipe | BlurLaw | None = RECIPES["published"], truncation: int = 8
    ) -> None:
        most = (65535 - 1) // (4 * _UNIT)
        if not isinstance(truncation, int) or not 1 <= truncation <= most:
            raise MethodError(
                "wrong parameter", where="truncation", expected=f"1 to {most}", got=str(truncation)
            )
        super().__init__(recipe)
        self._smoothness = mrf.truncated_absolute(self.levels, truncation, _UNIT)

    def warm_up(self, infocus: Image, defocus: Image) -> None:
        """Compile what the first call would compile."""
        self(infocus[:32, :32].copy(), defocus[:32, :32].copy())

    def __call__(self, infocus: Image, defocus: Image) -> NDArray[np.float32]:
        """Return depth levels, shape (y, x), for two images of uint8, (y, x, 3) or (y, x)."""
        if infocus.ndim == 2:
            infocus, defocus = infocus[..., np.newaxis], defocus[..., np.newaxis]
        # Four neighbours cannot pay for more than this: such a cost is a prohibition.
        limit = 4 * int(self._smoothness.max()) + 1
        blur = self.blur
        if isinstance(blur, BlurLaw):
            unary = law_misfits(blurred_by(blur, infocus, defocus))
            # Beyond the levels shown, a fitted curve has the widths of its ends: free for the same
            # pixels as the end itself, those levels would win wherever that is smoother.
            shown = self._shown()
            unary[..., : shown.start] = unary[..., shown.stop :] = np.iinfo(np.uint16).max
            offset = costs_of_misfits(unary, infocus.shape[2], _UNIT, limit)
        else:
            unary, offset = rounded_cost(infocus, defocus, blur.kernels(), _UNIT, limit)
        energy = mrf.Energy(unary, self._smoothness, offset=offset)
        if offset > 0:
            labels = mrf.expansion(energy, unary.argmin(axis=2), max_sweeps=1).labels
        else:
            labels = mrf.coarse_to_fine(energy, best_paths, REPAIRS).labels
        return np.asarray(blur.depth_of_level(labels.astype(np.int64)), np.float32)

    def _shown(self) -> slice:
        """Levels from the first to the last that was measured; all of a law that was told."""
        if self.calibration is None:
            return slice(0, self.levels)
        measured = np.flatnonzero(self.calibration.pixels)
        return slice(int(measured[0]), int(measured[-1]) + 1)
