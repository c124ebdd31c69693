"""Graph cuts for a defocus image that is nothing but a rounded blur of the in-focus image."""

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.law import BlurLaw
from dfdbench.blur.recipe import RECIPES
from dfdbench.errors import MethodError
from dfdbench.methods import mrf
from dfdbench.methods.blurred import all_blurred, few_kernels
from dfdbench.methods.data_cost import part_of_pair, planes_of, require_pair
from dfdbench.methods.fitted import Blur, Image, Solver, wrong
from dfdbench.methods.law_cost import add_energy, law_misfits
from dfdbench.methods.posterior import Posterior
from dfdbench.methods.sgm import MOST, path_costs_by_bands
from dfdbench.system.compiled import compiled

# Taps below this part of a kernel's whole change no value by a hundredth of TOLERANCE.
NEGLIGIBLE = 1e-12

# Largest sum of absolute differences between a label's 2-D kernel and the sum of others that stands
# for it: at most 1.3e-6 grey levels, a sixth of what TOLERANCE leaves beyond float32 rounding.
KERNEL_TOLERANCE = 1e-8

# A value is rounded to float32 before it is rounded to a whole one: by at most 2^-17 below 256,
# plus as much again for float64 sums in another order (far less) and the comparison.
TOLERANCE = 2.0**-16

# Misfits are stored as whole multiples of 1 / STEPS grey levels, rounded up: only 0 means none.
STEPS = 256

Array = NDArray[Any]


def rounded_cost(
    infocus: NDArray[np.uint8],
    defocus: NDArray[np.uint8],
    kernels: NDArray[np.float64],
    unit: float,
    limit: int,
    rows: slice = slice(None),
    columns: slice = slice(None),
) -> tuple[NDArray[np.uint16], int]:
    """Compute what every label costs at every pixel, given that `defocus` was rounded.

    The misfit m of a label is the root of the sum over channels of max(0, abs(residual) - 1/2)^2,
    its cost 0 where m = 0, else unit * (log(1 / f) + m^2 / (2 v)). Here f is the part of the pixels
    where every label has a misfit, and v the mean over those pixels and over the channels of the
    least m^2. Where every pixel has a label without misfit, f is 0, and others cost `limit`.

    Parameters
    ----------
    infocus, defocus : (y, x, channel) uint8
        The two images.
    kernels : (label, 2 * radius + 1) float64
        The 1-D kernel of each label, symmetric, of sum 1: `BlurRecipe.kernels`.
    unit : float
        Integer cost of one nat, a factor e of probability.
    limit : int
        Costs this far above a pixel's least are stored as `limit`, 1 to 65535.
    rows, columns : slice, optional
        The part of the image whose costs are asked for, without a step; f and v are the part's.

    Returns
    -------
    unary : (y, x, label) uint16
        Costs relative to the least of the pixel.
    offset : int
        Sum of the least costs of all pixels.

    Raises
    ------
    InputError
        If an image is not as above, or both differ in size.

    Examples
    --------
    >>> import numpy as np
    >>> from dfdbench.blur import BlurRecipe
    >>> image = np.zeros((1, 5, 1), np.uint8)
    >>> image[0, 2] = 100
    >>> kernels = BlurRecipe(sigma_min=0.1, sigma_step=0.1, levels=4).kernels()
    >>> unary, offset = rounded_cost(image, image, kernels, unit=4, limit=129)
    >>> unary[0, 2].tolist(), offset
    ([0, 0, 129, 129], 0)
    """
    sharp, blurred = np.asarray(infocus), np.asarray(defocus)
    require_pair(sharp, blurred, "uint8")
    radius = kernels.shape[1] // 2
    half = np.ascontiguousarray(kernels[:, radius:])
    padded, blurred = part_of_pair(sharp, blurred, radius, rows, columns)
    unary = np.empty((*blurred.shape[:2], len(half)), np.uint16)
    planes = np.ascontiguousarray(blurred.transpose(2, 0, 1))
    chosen, mixture = _mixture(kernels)
    half = half[chosen]
    lengths = (half > NEGLIGIBLE).sum(1)
    _misfits(padded.astype(np.float64), planes, half, lengths, mixture, unary)
    return unary, costs_of_misfits(unary, sharp.shape[2], unit, limit)


def costs_of_misfits(unary: NDArray[np.uint16], channels: int, unit: float, limit: int) -> int:
    """Turn misfits into costs where they lie, as `rounded_cost` says; return the offset.

    Parameters
    ----------
    unary : (y, x, label) uint16
        Misfits in whole multiples of 1 / `STEPS` grey levels.
    channels : int
        Of the images.
    unit, limit
        As for `rounded_cost`.
    """
    least = unary.min(2).astype(np.float64)
    off = least[least > 0]
    entry, slope = float(limit), 0.0
    if off.size:
        entry = unit * math.log(least.size / off.size)
        slope = unit * channels / (2 * float(np.mean(off**2)))
    return int(_costs(unary, entry, slope, limit))


def _mixture(kernels: Array) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Choose few kernels, and the sums of their 2-D kernels that stand for all.

    Returns the rows of the chosen ones and a (chosen, label) float64 matrix.
    """
    return few_kernels(planes_of(kernels), KERNEL_TOLERANCE)


# Long, as one loop nest is: what it would hand on to shorter ones are arrays and counters by the
# dozen, for every pixel.
@compiled(fastmath={"contract"})
def _misfits(
    padded: Array, defocus: Array, kernels: Array, lengths: Array, mixture: Array, out: Array
) -> None:
    # In float64: an interval of half a level leaves no room for the errors of a faster way. One
    # image row is in work at a time, and no blurred image is stored.
    channels, height, width = defocus.shape
    nodes, labels = mixture.shape
    radius = kernels.shape[1] - 1
    column = np.empty(width + 2 * radius, np.float64)
    # Four pixels share each trip to the mixture; the columns that fill up a last four are unused.
    fours = (width + 3) // 4 * 4
    residuals = np.zeros((channels, fours, (nodes + 3) // 4 * 4), np.float64)
    factors = np.zeros((residuals.shape[2], labels), np.float64)
    # By loops: numba takes seconds to compile what an assignment of arrays says when shapes differ.
    for node in range(nodes):
        for label in range(labels):
            factors[node, label] = mixture[node, label]
    blurred = np.empty(width, np.float64)
    difference = np.zeros((4, labels), np.float64)
    squares = np.empty((4, labels), np.float64)
    bound = 0.5 + TOLERANCE
    for y in range(height):
        for channel in range(channels):
            rows = padded[channel]
            for node in range(nodes):
                kernel = kernels[node]
                for x in range(width + 2 * radius):
                    column[x] = kernel[0] * rows[y + radius, x]
                for tap in range(1, lengths[node]):
                    above, below = rows[y + radius - tap], rows[y + radius + tap]
                    factor = kernel[tap]
                    for x in range(width + 2 * radius):
                        column[x] += factor * (above[x] + below[x])
                for x in range(width):
                    blurred[x] = kernel[0] * column[x + radius]
                for tap in range(1, lengths[node]):
                    left, right = column[radius - tap :], column[radius + tap :]
                    factor = kernel[tap]
                    for x in range(width):
                        blurred[x] += factor * (left[x] + right[x])
                for x in range(width):
                    residuals[channel, x, node] = blurred[x]
        for start in range(0, width, 4):
            many = min(4, width - start)
            squares[:] = 0
            for channel in range(channels):
                for pixel in range(many):
                    difference[pixel] = -np.float64(defocus[channel, y, start + pixel])
                for node in range(0, factors.shape[0], 4):
                    _add_four(
                        factors[node : node + 4],
                        residuals[channel, start : start + 4, node : node + 4],
                        difference,
                    )
                for pixel in range(many):
                    for label in range(labels):
                        excess = max(abs(difference[pixel, label]) - bound, 0.0)
                        squares[pixel, label] += excess * excess
            for pixel in range(many):
                for label in range(labels):
                    steps = np.ceil(STEPS * np.sqrt(squares[pixel, label]))
                    out[y, start + pixel, label] = np.uint16(min(steps, 65535.0))


@compiled(fastmath={"contract"}, inline="always")
def _add_four(factors: Array, at: Array, out: Array) -> None:
    # Add four nodes' parts to what each label makes of four pixels.
    for half in range(0, 4, 2):
        a0, a1, a2, a3 = at[half, 0], at[half, 1], at[half, 2], at[half, 3]
        b0, b1, b2, b3 = at[half + 1, 0], at[half + 1, 1], at[half + 1, 2], at[half + 1, 3]
        for label in range(out.shape[1]):
            f0, f1 = factors[0, label], factors[1, label]
            f2, f3 = factors[2, label], factors[3, label]
            out[half, label] += f0 * a0 + f1 * a1 + f2 * a2 + f3 * a3
            out[half + 1, label] += f0 * b0 + f1 * b1 + f2 * b2 + f3 * b3


@compiled()
def _costs(unary: Array, entry: float, slope: float, limit: int) -> int:
    # Turns misfits into costs in place: the volume is the largest array there is.
    height, width, labels = unary.shape
    most = np.float64(limit)
    offset = 0
    for y in range(height):
        for x in range(width):
            row = unary[y, x]
            misfit = np.float64(row.min())
            least = np.rint(entry + slope * misfit * misfit) if misfit > 0 else 0.0
            offset += int(least)
            for label in range(labels):
                misfit = np.float64(row[label])
                cost = np.rint(entry + slope * misfit * misfit) if misfit > 0 else 0.0
                row[label] = np.uint16(min(cost - least, most))
    return offset


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
    labels = np.empty(blocks.shape, np.int64)
    bands = path_costs_by_bands(
        lambda rows: np.minimum(blocks.unary[rows], MOST - large).astype(np.uint16, copy=False),
        blocks.unary.shape,
        small,
        large,
        directions=4,
    )
    for rows, sums in bands:
        labels[rows] = sums.argmin(axis=2)
    return labels


class RoundedGraphCuts(Solver):
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
    prior : bool
        Where the law is fitted: weigh depths by how often training shows them, if that helps there.
    sure : bool
        Also say how sure it is: see `dfdbench.methods.fitted.Solver`.

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

    reads_out = False
    smooths = False

    def __init__(
        self,
        recipe: Blur | None = RECIPES["published"],
        truncation: int = 8,
        prior: bool = True,
        sure: bool = False,
    ) -> None:
        most = (65535 - 1) // (4 * _UNIT)
        if not isinstance(truncation, int) or not 1 <= truncation <= most:
            raise MethodError.of(wrong("truncation", f"1 to {most}", truncation))
        super().__init__(recipe, prior=prior, sure=sure)
        self._smoothness = mrf.truncated_absolute(self.levels, truncation, _UNIT)

    def _solve(
        self, infocus: Image, images: Sequence[Image], posterior: Posterior | None = None
    ) -> NDArray[np.float32]:
        if infocus.ndim == 2:
            infocus, images = infocus[..., np.newaxis], [image[..., np.newaxis] for image in images]
        # Four neighbours cannot pay for more than this: such a cost is a prohibition.
        limit = 4 * int(self._smoothness.max()) + 1
        blur = self.blur
        if isinstance(blur, BlurLaw):
            unary: Any = None
            for blurred in all_blurred(self.blurs, infocus, images):
                unary = law_misfits(blurred, unary)
                del blurred
            assert unary is not None
            # Beyond the levels shown, a fitted curve has the widths of its ends: free for the same
            # pixels as the end itself, those levels would win wherever that is smoother.
            shown = self._shown()
            unary[..., : shown.start] = unary[..., shown.stop :] = np.iinfo(np.uint16).max
            channels = infocus.shape[2] * len(images)
            offset = costs_of_misfits(unary, channels, _UNIT, limit)
            if self.chosen.weight:
                offset += add_energy(unary, _UNIT * self.chosen.energy, limit)
        else:
            cost = partial(rounded_cost, infocus, images[0], blur.kernels(), _UNIT, limit)
            parts = mrf.Parts(cost, (*infocus.shape[:2], self.levels), limit)
            # Without noise every part has the costs that it has in the whole.
            large = 2 * math.prod(parts.shape) > mrf.MOST_HELD and posterior is None
            unary, offset = (parts, 0) if large and parts.offset() == 0 else cost()
        energy = mrf.Energy(unary, self._smoothness, offset=offset)
        if offset > 0:
            labels = mrf.expansion(energy, unary.argmin(axis=2), max_sweeps=1).labels
        else:
            labels = mrf.coarse_to_fine(energy, best_paths, REPAIRS).labels
        if posterior is not None:
            depths = blur.depth_of_level(np.arange(self.levels))
            posterior.add_all(depths, np.moveaxis(unary, 2, 0), _UNIT)
        return np.asarray(blur.depth_of_level(labels.astype(np.int64)), np.float32)

    def _shown(self) -> slice:
        """Levels from the first to the last that was measured; all of a law that was told."""
        if not self.calibrations:
            return slice(0, self.levels)
        measured = np.flatnonzero(sum(found.pixels for found in self.calibrations))
        return slice(int(measured[0]), int(measured[-1]) + 1)
