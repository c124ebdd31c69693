"""The baselines: what any method has to beat."""

import math
from collections.abc import Iterator, Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.law import ROUNDING_VARIANCE, BlurLaw
from dfdbench.blur.recipe import RECIPES, BlurRecipe
from dfdbench.errors import MethodError
from dfdbench.methods.fitted import Blur, Image, Solver, learned_array, nothing_to_fit
from dfdbench.methods.method import Learned, TrainingPair
from dfdbench.methods.posterior import Posterior
from dfdbench.methods.readout import read_out

Cost = NDArray[np.float32]

#: Rows and columns of what `PositionalPrior` learns.
_CELLS = (24, 32)


class Constant:
    """The same depth everywhere, without a look at the images.

    Parameters
    ----------
    training_mean : float
        The depth level; in a run, the mean over the known pixels of the training split.

    Examples
    --------
    >>> image = np.zeros((1, 2, 3), np.uint8)
    >>> Constant(training_mean=90.5)(image, image).tolist()
    [[90.5, 90.5]]
    """

    def __init__(self, training_mean: float) -> None:
        if not 0 <= training_mean <= 255:
            what = f"training_mean must be 0 to 255, not {training_mean}"
            raise MethodError(what, where="training_mean")
        self._level = training_mean

    def __call__(self, infocus: Image, defocus: Image) -> NDArray[np.float32]:
        """Return the level for each pixel of `infocus`, shape (y, x)."""
        return np.full(infocus.shape[:2], self._level, np.float32)


class ConstantMedian(Constant):
    """The same depth everywhere: `training_median`, in a run that of the training split.

    Examples
    --------
    >>> image = np.zeros((1, 2, 3), np.uint8)
    >>> ConstantMedian(training_median=90)(image, image).tolist()
    [[90.0, 90.0]]
    """

    def __init__(self, training_median: float) -> None:
        super().__init__(training_median)


class PositionalPrior:
    """The depth that training captures have at the same place, without a look at the images.

    The median over the captures in each of 24 x 32 cells. A method that is no better has learned
    where floors and walls are, not what blur says.

    Examples
    --------
    >>> from dfdbench.datasets.captures import Capture
    >>> from dfdbench.datasets.manifest import Pair
    >>> depth = np.full((48, 64), 40, np.uint8)
    >>> depth[24:] = 200
    >>> image = np.zeros((48, 64, 3), np.uint8)
    >>> prior = PositionalPrior()
    >>> capture = Capture(Pair("room", ()), np.stack([image, image]), depth.astype(np.float32))
    >>> prior.restore(prior.fit([capture]))
    >>> prior(image, image)[[0, -1], 0].tolist()
    [40.0, 200.0]
    """

    def __init__(self) -> None:
        self._depth: NDArray[Any] | None = None

    def fit(self, pairs: Sequence[TrainingPair]) -> Learned:
        """Learn ``depth``, the median level of each cell."""
        seen = np.reshape([_cells(pair.levels, pair.valid) for pair in pairs], (len(pairs), -1))
        if np.isnan(seen).all():
            raise nothing_to_fit("positional-prior", "training captures with known depth", "none")
        # What no capture shows is as deep as all of them.
        seen[:, np.isnan(seen).all(axis=0)] = np.nanmedian(seen)
        return {"depth": np.nanmedian(seen, axis=0).reshape(_CELLS)}

    def restore(self, learned: Learned) -> None:
        """Take over what `fit` learned."""
        self._depth = learned_array(learned, "depth", "positional-prior", 2)

    def __call__(self, infocus: Image, defocus: Image) -> NDArray[np.float32]:
        """Return the level for each pixel of `infocus`, shape (y, x)."""
        if self._depth is None:
            what = "the method has seen no training captures yet"
            raise MethodError(what, where="positional-prior", fix="call fit(captures) first")
        size = infocus.shape[1::-1]
        return np.asarray(cv2.resize(self._depth, size, interpolation=cv2.INTER_LINEAR), np.float32)


class Local(Solver):
    """Depth from a small window: the blur level that explains the defocus image best.

    The in-focus image is blurred at every level; the squared difference to the defocus image,
    summed over the channels, is averaged over a window; each pixel takes the level of the
    least. No smoothness beyond the window.

    Parameters
    ----------
    recipe : BlurRecipe, BlurLaw or None
        How the defocus images were made; in a run, the data set's recipe. Without one the
        method is fitted: see `dfdbench.methods.calibration`.
    window : int, optional
        Side of the square window in pixels, odd. By default 7, or where the law is fitted what the
        fit chooses.
    prior : bool
        Where the law is fitted: weigh depths by how often training shows them, if that helps there.
    sure : bool
        Also say how sure it is: see `dfdbench.methods.fitted.Solver`.

    Examples
    --------
    >>> from dfdbench.blur import synthesize
    >>> image = np.random.default_rng(0).integers(0, 256, (40, 40, 3)).astype(np.uint8)
    >>> depth = np.full((40, 40), 120, np.uint8)
    >>> defocus = synthesize(image, depth, RECIPES["published"])
    >>> float(np.median(Local()(image, defocus)))
    120.0
    """

    def __init__(
        self,
        recipe: Blur | None = RECIPES["published"],
        window: int | None = None,
        prior: bool = True,
        sure: bool = False,
    ) -> None:
        super().__init__(recipe, window, prior, sure)

    def _solve(
        self, infocus: Image, images: Sequence[Image], posterior: Posterior | None = None
    ) -> NDArray[np.float32]:
        # They compile; a constant needs none.
        from dfdbench.methods.blurred import all_blurred
        from dfdbench.methods.law_cost import UNIT, level_costs, squares_of

        blur, window = self.blur, self.window_in(infocus)
        best = np.full(infocus.shape[:2], np.inf, np.float32)
        level = np.zeros(infocus.shape[:2], np.int64)
        squares: Iterator[Cost]
        # Squares over the noise's variance: two a nat.
        nat = UNIT if len(images) > 1 else 2
        if len(images) > 1:
            # A stack's costs in one volume: its images, each blurred by few kernels, take more.
            costs = level_costs(self.blurs, infocus, images, np.inf)
            squares = (costs[..., n].astype(np.float32) for n in range(costs.shape[2]))
        elif isinstance(blur, BlurLaw):
            (pair,) = all_blurred([blur], infocus, images)
            squares = squares_of(pair)
        else:
            squares = _by_recipe(blur, infocus, images[0])
        # Of a recipe's residuals nothing is known but that images are rounded.
        told = 2 * ROUNDING_VARIANCE if isinstance(blur, BlurRecipe) else nat
        energy, sharpness = nat * self.chosen.energy, self.chosen.sharpness / nat
        volume = []
        for candidate, single in enumerate(squares):
            if posterior is not None:
                posterior.add(float(blur.depth_of_level(candidate)), single / np.float32(told))
            cost = cv2.boxFilter(single, cv2.CV_32F, window, borderType=cv2.BORDER_REPLICATE)
            if self.chosen.weight:
                cost = cost + np.float32(energy[candidate])
            if sharpness:
                volume.append(cost)
                continue
            better = cost < best
            best[better] = cost[better]
            level[better] = candidate
        found = read_out(np.stack(volume), sharpness) if sharpness else level
        return np.asarray(blur.depth_of_level(found), np.float32)


def _cells(levels: Image, valid: NDArray[np.bool_]) -> NDArray[np.float64]:
    known = np.where(valid, levels, np.nan)
    rows = np.array_split(known, _CELLS[0])
    cells = [cell for row in rows for cell in np.array_split(row, _CELLS[1], axis=1)]
    medians = [np.nan if np.isnan(cell).all() else np.nanmedian(cell) for cell in cells]
    return np.reshape(medians, _CELLS)


def _by_recipe(recipe: BlurRecipe, infocus: Image, defocus: Image) -> Iterator[Cost]:
    sharp, blurred = infocus.astype(np.float32), defocus.astype(np.float32)
    channel_sum = np.ones((1, infocus.shape[2]), np.float32)
    for candidate, kernel in enumerate(recipe.kernels()):
        trial = _separable(sharp, kernel, recipe.sigmas[candidate])
        residual = cv2.subtract(trial, blurred)
        yield np.asarray(cv2.transform(cv2.multiply(residual, residual), channel_sum))


def _separable(image: NDArray[np.float32], kernel: NDArray[np.float64], sigma: float) -> Image:
    # Beyond six sigma a weight is below float32's resolution of the sum.
    radius = min(kernel.size // 2, math.ceil(6 * sigma))
    middle = kernel.size // 2
    short = kernel[middle - radius : middle + radius + 1]
    return np.asarray(
        cv2.sepFilter2D(image, cv2.CV_32F, short, short, borderType=cv2.BORDER_REPLICATE)
    )
