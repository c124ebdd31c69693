"""A cost volume smoothed by the guided filter: every level by itself, then the winner."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dfdbench.errors import MethodError
from dfdbench.methods.fitted import Blur, Image, Solver, channels_of, fit_problems, number_within
from dfdbench.methods.law_cost import UNIT, level_costs
from dfdbench.methods.posterior import Posterior
from dfdbench.methods.readout import read_out
from dfdbench.methods.shape_from_focus import guided_lines


class Guided(Solver):
    """Depth by the least cost, each level's costs smoothed but for the in-focus image's edges.

    What a level costs a pixel is the squared difference between the defocus image and the
    in-focus image blurred at it (`level_costs`). Within each window a level's costs are taken for
    a line over the in-focus image's grey value; a pixel's cost is the mean of the lines of all
    windows it is in. A pixel takes the level of least cost, and the minimum of a parabola.

    Parameters
    ----------
    recipe : BlurRecipe or BlurLaw, optional
        How the defocus images were made; without it the law is fitted.
    window : int, optional
        Side of the square window in pixels, odd. By default 7, or where the law is fitted what the
        fit chooses.
    flatness : float
        Variance in squared grey levels below which a window counts as flat, and its costs are
        but averaged; epsilon of the paper.
    limit : float
        Nats above a pixel's least at which costs are cut off, so that one pixel that no level
        explains cannot outvote a window.
    prior : bool
        Where the law is fitted: weigh depths by how often training shows them, if that helps there.
    sure : bool
        Also say how sure it is: see `dfdbench.methods.fitted.Solver`.

    Raises
    ------
    MethodError
        For a parameter out of range, all of them named; at a call without recipe or fit, or
        with an image smaller than the window.

    Notes
    -----
    He, Sun and Tang 2013, with a grey guide, by box filters; for cost volumes: Hosni et al., Fast
    cost-volume filtering for visual correspondence and beyond, PAMI 2013.

    Examples
    --------
    >>> from dfdbench.blur import RECIPES, synthesize
    >>> image = np.random.default_rng(0).integers(0, 256, (40, 40, 3)).astype(np.uint8)
    >>> defocus = synthesize(image, np.full((40, 40), 120, np.uint8), RECIPES["published"])
    >>> found = Guided(RECIPES["published"])(image, defocus)
    >>> bool(np.abs(found - 120).max() < 2)
    True
    """

    paper = "He, Sun and Tang, Guided image filtering, PAMI 2013"

    def __init__(
        self,
        recipe: Blur | None = None,
        window: int | None = None,
        flatness: float = 100.0,
        limit: float = 15.0,
        prior: bool = True,
        sure: bool = False,
    ) -> None:
        problems = fit_problems(prior, window)
        problems += number_within("flatness", flatness, 1e6)
        problems += number_within("limit", limit, 10000)
        MethodError.raise_if(problems)
        super().__init__(recipe, window, prior, sure)
        self._limit = limit
        self._flatness = np.float32(flatness)

    def _solve(
        self, infocus: Image, images: Sequence[Image], posterior: Posterior | None = None
    ) -> NDArray[np.float32]:
        window = self.window_in(infocus)
        costs = level_costs(self.blurs, infocus, images, self._limit)
        guide = channels_of(infocus).mean(2)
        planes = (costs[:, :, label].astype(np.float32) for label in range(costs.shape[2]))
        smooth = np.empty((costs.shape[2], *costs.shape[:2]), np.float32)
        lines = guided_lines(guide, planes, window, self._flatness)
        for filtered, (slope, start) in zip(smooth, lines, strict=True):
            filtered[:] = slope * guide + start
        if posterior is not None:
            depths = self.blur.depth_of_level(np.arange(self.levels))
            posterior.add_all(depths, np.moveaxis(costs, 2, 0), UNIT)
        if self.chosen.weight:
            smooth += (UNIT * self.chosen.energy[:, np.newaxis, np.newaxis]).astype(np.float32)
        found = read_out(smooth, self.chosen.sharpness / UNIT)
        return np.asarray(self.blur.depth_of_level(found), np.float32)
