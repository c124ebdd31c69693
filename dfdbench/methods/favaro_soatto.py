"""Favaro and Soatto's operators: which pairs of patches a depth makes possible, by training."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from dfdbench.errors import MethodError
from dfdbench.methods import fitted
from dfdbench.methods.method import Learned, TrainingPair
from dfdbench.methods.readout import Chosen, read_out
from dfdbench.methods.stacks import sharp_and_blurred
from dfdbench.system.compiled import compiled

if TYPE_CHECKING:
    from xarray import DataArray

_NAME = "favaro-soatto"
_LEVELS = 256
# Of a training pair and a group of levels. With 64 pairs the sums of the integer products stay
# below 2^53: exact in float64, whatever order they are added in.
_PATCHES = 500
# What weights are rounded to: as fine as it has to be, since images have whole grey levels.
_STEP = 2.0**-14

Array = NDArray[Any]


class FavaroSoatto(fitted.Choosing):
    """Depth by the operators of training patches: no point-spread function is known or estimated.

    A sharp patch and the blurred patches at its middle, one of each defocus image, stacked to one
    vector, lie in a subspace
    that belongs to the depth, since the one determines the others. Of each group of depth levels
    the training pairs' vectors give, by a singular value decomposition, the orthogonal
    complement of that subspace. A pixel takes the group whose complement has the least part of
    its own vector, summed over a window, and the minimum of a parabola through that and its
    neighbours.

    Parameters
    ----------
    sharp_patch, blurred_patch : int
        Sides of the two patches in pixels, odd, the blurred one the smaller. The sharp patch
        should reach as far as the blur does.
    groups : int
        How many groups the 256 levels are divided into, 2 to 128.
    window : int, optional
        Side of the window that residuals are summed over, in pixels, odd; by default what the fit
        chooses, 7 if no other is better.
    prior : bool
        Weigh depths by how often training shows them, if that helps there.

    Raises
    ------
    MethodError
        For a parameter out of range, all of them named; at a call before a fit, or with an image
        smaller than the window.

    Notes
    -----
    Favaro and Soatto 2005, sections 3 and 4. There both images are blurred and patches of one
    size; here one is sharp, so that it may be taken larger, and the complement has as many
    dimensions as the blurred patches have pixels: that many numbers follow from the sharp patch.
    Of a focal stack without an image in focus all over the sharp patch is of its sharpest pixels.
    The time grows with the square of the number of images.
    The mean of the sharp patch is taken from both. Groups of which the training pairs show
    hardly a patch are never answered.

    Examples
    --------
    >>> from dfdbench.blur import RECIPES, synthesize
    >>> image = np.random.default_rng(0).integers(0, 256, (64, 120, 3)).astype(np.uint8)
    >>> depth = np.repeat(np.array([[40, 120, 200]], np.uint8), 64, 0).repeat(40, 1)
    >>> defocus = synthesize(image, depth, RECIPES["published"])
    >>> from dfdbench.datasets.captures import Capture
    >>> from dfdbench.datasets.manifest import Pair
    >>> pair = Capture(Pair("room", ()), np.stack([image, defocus]), depth.astype(np.float32))
    >>> method = FavaroSoatto()
    >>> method.restore(method.fit([pair]))
    >>> bool(np.abs(method(image, defocus)[32, 20::40] - [40, 120, 200]).max() < 5)
    True
    """

    paper = "Favaro and Soatto, A geometric approach to shape from defocus, PAMI 2005"

    def __init__(
        self,
        sharp_patch: int = 13,
        blurred_patch: int = 3,
        groups: int = 64,
        window: int | None = None,
        prior: bool = True,
    ) -> None:
        problems = fitted.odd_window("sharp_patch", sharp_patch, most=21)
        problems += fitted.odd_window("blurred_patch", blurred_patch, most=21)
        if not problems and not 1 < blurred_patch < sharp_patch:
            expected = f"above 1, smaller than sharp_patch, {sharp_patch}"
            problems.append(fitted.wrong("blurred_patch", expected, blurred_patch))
        if not isinstance(groups, int) or not 2 <= groups <= _LEVELS // 2:
            problems.append(fitted.wrong("groups", f"2 to {_LEVELS // 2}", groups))
        problems += fitted.fit_problems(prior, window)
        MethodError.raise_if(problems)
        super().__init__(window, prior)
        self._sides, self._groups = (sharp_patch, blurred_patch), groups
        self._operators: NDArray[np.float32] | None = None
        self._images = 1

    def fit(self, pairs: Sequence[TrainingPair]) -> Learned:
        """Learn the operators: ``operators``, (group, dimension, pixel), and each one's ``depth``.

        Raises
        ------
        MethodError
            Where no group of levels has patches enough.
        """
        learned = self._learned(pairs)
        trial = copy.copy(self)
        trial.restore(learned)
        # A stack leaves less to choose, and its fit takes long enough.
        return learned if trial._images > 1 else trial._with_choices(learned, pairs)

    def _learned(self, pairs: Sequence[TrainingPair]) -> Learned:
        sharp, blurred = self._sides
        size, moments = 0, np.zeros((self._groups, 0, 0))
        counts, depths = np.zeros(self._groups, np.int64), np.zeros(self._groups, np.int64)
        for index in fitted.evenly_spread(len(pairs)):
            pair = pairs[index]
            infocus, images = sharp_and_blurred(pair.stack)
            vectors = [_patches(infocus, sharp), *(_patches(image, blurred) for image in images)]
            if not size:
                size = sharp**2 + len(images) * blurred**2
                moments = np.zeros((self._groups, size, size))
            if size != sharp**2 + len(images) * blurred**2:
                what = "the training captures have different numbers of defocus images"
                raise MethodError(what, where=_NAME)
            groups = pair.levels.astype(np.int64) * self._groups // _LEVELS
            known, inside = np.zeros_like(pair.valid), (slice(sharp // 2, -(sharp // 2)),) * 2
            # Patches that lie within the image.
            known[inside] = pair.valid[inside]
            for group in np.unique(groups[known]):
                rows, columns = np.nonzero(known & (groups == group))
                taken = fitted.evenly_spread(rows.size, _PATCHES)
                rows, columns = rows[taken], columns[taken]
                stacked = _stacked([patches[rows, columns] for patches in vectors])
                moments[group] += stacked.T @ stacked
                counts[group] += rows.size
                depths[group] += pair.levels[rows, columns].sum(dtype=np.int64)
        size = size or sharp**2 + blurred**2
        enough = np.flatnonzero(counts >= 2 * size)
        if not enough.size:
            wanted = f"a group of levels with {2 * size} patches of known depth"
            raise fitted.nothing_to_fit(_NAME, wanted, f"at most {counts.max()}")
        dimensions = size - sharp**2 - 1
        operators = [_complement(moments[group], sharp, dimensions) for group in enough]
        return {
            "operators": np.array(operators, np.float32),
            "depth": depths[enough] / counts[enough],
        }

    def restore(self, learned: Learned) -> None:
        """Take over what `fit` learned."""
        self.chosen = Chosen.taken_from(dict(learned))
        operators = fitted.learned_array(learned, "operators", _NAME, 3).astype(np.float32)
        self._depths = fitted.learned_array(learned, "depth", _NAME, 1)
        sharp, blurred = self._sides
        self._images = max((operators.shape[1] + 1) // blurred**2, 1)
        pixels = self._images * blurred**2
        if operators.shape != (self._depths.size, pixels - 1, sharp**2 + pixels):
            what, got = "operators of other patches", f"shape {operators.shape}"
            raise MethodError(what, where=_NAME, got=got, fix=fitted.REFIT)
        # Up to a multiple of four with zeros, as the loops want it.
        spare = -operators.shape[2] % 4
        self._operators = np.pad(operators, ((0, 0), (0, 0), (0, spare)))

    def warm_up(self, infocus: fitted.Image, defocus: fitted.Image) -> None:
        """Compile what the first call would compile."""
        extent = max(32, self._given_window or 0)
        part = [defocus[:extent, :extent].copy()] * self._images
        self._solve(infocus[:extent, :extent].copy(), part)

    def __call__(self, infocus: fitted.Image, defocus: fitted.Image) -> NDArray[np.float32]:
        """Return depth levels for two images of uint8, shape (y, x, 3) or, grey, (y, x)."""
        return self._solve(infocus, [defocus])

    def from_stack(self, stack: DataArray) -> NDArray[np.float32]:
        """Return depth levels, shape (y, x)."""
        return self._solve(*sharp_and_blurred(stack))

    def _solve(self, infocus: fitted.Image, images: Sequence[fitted.Image]) -> NDArray[np.float32]:
        if self._operators is None:
            raise fitted.not_fitted(_NAME)
        if len(images) != self._images:
            what = f"{len(images)} defocus images, but {self._images} were fitted"
            raise MethodError(what, where=_NAME, fix=fitted.REFIT)
        window = self.window_in(infocus)
        side, small = self._sides
        sharp, *blurred = (
            np.pad(_grey(image), width // 2, mode="edge").astype(np.float32)
            for image, width in ((infocus, side), *((image, small) for image in images))
        )
        shape = infocus.shape[:2]
        costs = np.empty((len(self._operators), *shape), np.float32)
        _residuals(sharp, np.stack(blurred), side, small, self._operators, costs)
        for cost in costs:
            cv2.boxFilter(cost, cv2.CV_32F, window, cost, borderType=cv2.BORDER_REPLICATE)
        self.chosen.weigh_in(costs, np.rint(self._depths).astype(np.int64))
        best = read_out(costs, self.chosen.sharpness)
        # Between two groups, but not out into depths that no training pair has shown.
        own, width = self._depths[np.rint(best).astype(np.int64)], _LEVELS / self._groups
        depth = np.interp(best, np.arange(self._depths.size), self._depths)
        return np.clip(depth, own - width, own + width).astype(np.float32)


def _stacked(patches: Sequence[Array]) -> Array:
    """Return patches as rows, the first ones' mean taken away; whole, times its pixels."""
    stacked = np.concatenate([each.reshape(len(each), -1) for each in patches], axis=1)
    pixels = patches[0][0].size if len(patches[0]) else 1
    return np.asarray(pixels * stacked - stacked[:, :pixels].sum(1, keepdims=True))


def _patches(image: fitted.Image, side: int) -> NDArray[np.float64]:
    return sliding_window_view(np.pad(_grey(image), side // 2, mode="edge"), (side, side))


def _grey(image: fitted.Image) -> NDArray[np.float64]:
    # A sum, not a mean: whole numbers. A grey image counts as three equal channels.
    channels = np.atleast_3d(image).astype(np.float64)
    return np.asarray(channels.sum(2) * (3 // channels.shape[2]))


def _complement(moment: Array, side: int, dimensions: int) -> Array:
    """Return the directions in which the vectors have least, as rows for images with their mean."""
    sharp = side**2
    # Without its mean a sharp patch has nothing along its ones: no property of the depth.
    ones = np.zeros(len(moment))
    ones[:sharp] = 1 / math.sqrt(sharp)
    lifted = moment + np.trace(moment) * np.outer(ones, ones)
    rows = np.linalg.eigh(lifted)[1][:, :dimensions].T
    # A vector's mean is taken away by these weights themselves, so that raw patches will do.
    rows[:, :sharp] -= rows.sum(1, keepdims=True) / sharp
    # Any rotation of the rows spans the same. This one is unique, where that of a decomposition
    # depends on how many threads its library has; what is left of that the rounding takes.
    turn, triangle = np.linalg.qr(rows[:, sharp : sharp + dimensions])
    rows = np.sign(np.diag(triangle))[:, np.newaxis] * (turn.T @ rows)
    rounded = np.rint(rows / _STEP) * _STEP
    rounded[:, sharp // 2] -= rounded.sum(1)
    # No minus zeros, whose bytes differ.
    return np.asarray(rounded + 0.0)


@compiled(fastmath={"contract"})
def _residuals(
    sharp: Array, blurred: Array, side: int, small: int, operators: Array, out: Array
) -> None:
    # One image row is in work at a time: of all its vectors a pixel is a row of memory.
    groups, height, width = out.shape
    dimensions, size = operators.shape[1:]
    vectors = np.zeros((size, width), np.float32)
    along = np.empty(width, np.float32)
    for y in range(height):
        for pixel in range(side * side):
            row, column = pixel // side, pixel % side
            vectors[pixel] = sharp[y + row, column : column + width]
        for image in range(len(blurred)):
            start = side * side + image * small * small
            for pixel in range(small * small):
                row, column = pixel // small, pixel % small
                vectors[start + pixel] = blurred[image, y + row, column : column + width]
        for group in range(groups):
            total = out[group, y]
            total[:] = 0
            for dimension in range(dimensions):
                weights = operators[group, dimension]
                along[:] = 0
                # Four pixels at a time quarter the trips to `along`.
                for pixel in range(0, size, 4):
                    first, second = vectors[pixel], vectors[pixel + 1]
                    third, fourth = vectors[pixel + 2], vectors[pixel + 3]
                    for x in range(width):
                        along[x] += (
                            weights[pixel] * first[x]
                            + weights[pixel + 1] * second[x]
                            + weights[pixel + 2] * third[x]
                            + weights[pixel + 3] * fourth[x]
                        )
                for x in range(width):
                    total[x] += along[x] * along[x]
