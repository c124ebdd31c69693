"""What every depth level costs at every pixel under a blur law: kernels of any shape, and noise.

As in `dfdbench.methods.data_cost` few kernels stand for all. Here they need not be Gaussians, the
images may be of linear light, and a level's residual is held against the noise that it has to
show: what the defocus image has of its own, and what is left of the in-focus image's after the
level's blur. Where the law is linear, residuals are of light: there the noise of a dark pixel is
as large to either side, which the sRGB curve makes it not.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.law import ROUNDING_VARIANCE, BlurLaw
from dfdbench.blur.recipe import LAST_LEVEL, BlurRecipe
from dfdbench.methods.blurred import Blurred, all_blurred, blurred_by
from dfdbench.methods.data_cost import data_cost
from dfdbench.methods.fitted import Array, Blur, Image
from dfdbench.system.compiled import compiled

#: Integer cost of one nat, a factor e of probability.
UNIT = 4
#: What an image of a stack says at most against a level. Of 2, 3, 5, 8 and 15 about the least error
#: on the demo set's training stacks.
MOST_NATS = 5


def level_costs(
    blurs: Sequence[Blur], infocus: Image, images: Sequence[Image], limit: float
) -> NDArray[np.uint16]:
    """Return a capture's cost volume: minus the logarithm of each level's probability, cut off.

    A level costs the squared difference between the defocus image and the in-focus image blurred
    at it, summed over the channels, over twice its variance: of a recipe, that of rounding; of a
    law, that of the noise it was measured with. Unlike the data cost of `graph-cuts` it compares
    RGB, which is not rounded a second time.

    Parameters
    ----------
    blurs : sequence of BlurRecipe or BlurLaw
        How each defocus image was made; of several, laws.
    infocus : ndarray of uint8, shape (y, x, channel) or (y, x)
        What they are blurred from.
    images : sequence of ndarray of uint8, of that shape
        The defocus images, whose costs are summed.
    limit : float
        Nats above a pixel's least cost at which costs are cut off. An image of a stack says no
        more than 5 against any level: where surfaces end, many of them explain nothing.

    Returns
    -------
    ndarray of uint16, shape (y, x, label)
        `UNIT` a nat; of a single image each pixel's least is 0. The blur's
        ``depth_of_level`` gives a label's depth.

    Examples
    --------
    >>> from dfdbench.blur.recipe import RECIPES
    >>> flat = np.full((2, 3), 90, np.uint8)
    >>> costs = level_costs([RECIPES["published"]], flat, [flat], 20)
    >>> costs.shape, int(costs.max())
    ((2, 3, 256), 0)
    """
    return level_costs_by_rows(blurs, infocus, images, limit)(rows=slice(None))


def level_costs_by_rows(
    blurs: Sequence[Blur], infocus: Image, images: Sequence[Image], limit: float
) -> Callable[..., NDArray[np.uint16]]:
    """Return what gives the `level_costs` of some ``rows``, a slice without a step.

    Of a pair no more is held than its two images.
    """
    most = max(round(UNIT * (limit if len(images) == 1 else min(limit, MOST_NATS))), 1)
    if isinstance(blurs[0], BlurRecipe):
        # Of a recipe's residuals nothing is known but that images are rounded.
        weight = UNIT / (2 * ROUNDING_VARIANCE)
        sharp, blurred = np.atleast_3d(infocus), np.atleast_3d(images[0])
        size = blurs[0].kernel_size
        cost = partial(data_cost, sharp, blurred, blurs[0].sigmas, weight, most, size)
        return lambda rows: cost(rows=rows)[0]
    if len(images) == 1:
        pair = next(all_blurred(blurs, infocus, images))
        return lambda rows: law_cost(pair.part(rows), UNIT, most)[0]
    costs: NDArray[np.uint16] | None = None
    for one in all_blurred(blurs, infocus, images):
        costs = law_cost(one, UNIT, most, costs, add=costs is not None, ceiling=most)[0]
        del one  # Before the next is made: they are large.
    assert costs is not None
    # Twice all of it would be too much: whoever asks for all rows asks once.
    return lambda rows: costs if rows == slice(None) else costs[rows].copy()


# Levels whose squares are worked out, and held, at once.
_AT_ONCE = 16
# Every so many levels, and the side of the corner, that tell how well a law explains a pair.
_COARSE, _CORNER = 8, 256
# Misfits are stored as whole multiples of 1 / STEPS grey levels: see `rounded_cost`.
MISFIT_STEPS = 256


def squares_of(blurred: Blurred) -> Iterator[NDArray[np.float32]]:
    """Yield what each level costs at every pixel, two a nat: float32, shape (y, x).

    The squares that it leaves, of its own variance and summed over channels, and the logarithm
    of that variance: of two levels that leave as much, the one that has to show more of it.
    """
    inverse = 1 / blurred.noise
    for level in range(0, len(blurred.spread), _AT_ONCE):
        some = slice(level, level + _AT_ONCE)
        factors = np.ascontiguousarray(blurred.factors[:, some])
        weights = (1 / blurred.spread[some]).astype(np.float32)
        entries = (blurred.aim.shape[2] * np.log(blurred.spread[some])).astype(np.float32)
        yield from _squares(blurred.nodes, blurred.aim, factors, inverse, weights, entries)


def law_cost(
    blurred: Blurred,
    unit: float,
    limit: int,
    out: NDArray[np.uint16] | None = None,
    add: bool = False,
    ceiling: float = math.inf,
) -> tuple[NDArray[np.uint16], int]:
    """Compute what every level costs at every pixel, for Gaussian noise.

    ``cost = unit * (sum over channels of residual^2 / (2 s n^2) + channels / 2 log s)`` with the
    noise n of the pixel and the spread s of the level.

    Parameters
    ----------
    blurred : Blurred
        The pair.
    unit : float
        Integer cost of one nat, a factor e of probability.
    limit : int
        Costs this far above a pixel's least are stored as `limit`, 1 to 65535.
    out : (y, x, level) uint16, optional
        Memory to write the costs into.
    add : bool
        Add them to what `out` holds, up to 65535.
    ceiling : float
        What no cost exceeds, however badly the least level explains the pixel.

    Returns
    -------
    unary : (y, x, level) uint16
        Costs relative to the least of the pixel.
    offset : int
        Sum of the least costs of all pixels.
    """
    unary = _room(blurred, out)
    channels = blurred.aim.shape[2]
    entry = channels / 2 * np.log(blurred.spread)
    offset = _fill(
        blurred.nodes,
        blurred.aim,
        blurred.factors,
        1 / blurred.noise,
        (unit / (2 * blurred.spread)).astype(np.float32),
        (unit * entry).astype(np.float32),
        np.float32(ceiling),
        limit,
        add,
        unary,
    )
    return unary, int(offset)


def add_energy(unary: NDArray[np.uint16], energy: NDArray[np.float64], limit: int) -> int:
    """Add to each pixel's costs what a level costs everywhere; return the sum of the least.

    Parameters
    ----------
    unary : ndarray of uint16, shape (y, x, level)
        Written over; costs relative to a pixel's least, at most `limit` above it.
    energy : ndarray of float64, shape (level,)
        In integer costs, before rounding.
    limit : int
        As for `law_cost`.
    """
    most = np.iinfo(np.uint16).max
    return int(_add(unary, np.minimum(np.rint(energy), most).astype(np.uint16), limit))


def misfit(law: BlurLaw, infocus: Array, defocus: Array) -> float:
    """Return how badly a law explains a pair, whatever its depth: 1 if by its noise alone.

    The root of the median over a corner's pixels of what the best of some levels leaves, squared,
    in units of the law's noise. It is below 1, as the best level is chosen.
    """
    some = np.arange(0, LAST_LEVEL + 1, _COARSE)
    corner = blurred_by(law, infocus, defocus, some).part(slice(_CORNER), slice(_CORNER))
    least = np.full(corner.aim.shape[:2], np.inf)
    for place, spread in enumerate(corner.spread):
        left = (corner.nodes @ corner.factors[:, place] - corner.aim) / corner.noise
        squares = np.square(left).mean(axis=2)
        least = np.minimum(least, squares / spread)
    return float(np.sqrt(np.median(least)))


def law_misfits(blurred: Blurred, before: NDArray[np.uint16] | None = None) -> NDArray[np.uint16]:
    """Return by how much each level leaves the interval of its noise, as `rounded_cost` has it.

    The interval is that of the even distribution whose variance is the level's: half a grey level
    where there is nothing but rounding. Whole multiples of 1 / 256 of the images' unit, rounded up.

    Parameters
    ----------
    blurred : Blurred
        The pair, from `blurred_by`.
    before : ndarray of uint16, shape (y, x, level), optional
        The misfits of other images, to whose squares those of this one are added; written over.

    Returns
    -------
    ndarray of uint16, shape (y, x, level)
    """
    unary = np.zeros_like(_room(blurred, None)) if before is None else before
    bounds = np.sqrt(3 * blurred.spread).astype(np.float32)
    _leave(blurred.nodes, blurred.aim, blurred.factors, blurred.noise, bounds, unary)
    return unary


def _room(blurred: Blurred, out: NDArray[np.uint16] | None) -> NDArray[np.uint16]:
    shape = (*blurred.aim.shape[:2], blurred.factors.shape[1])
    return np.empty(shape, np.uint16) if out is None else out


# Put into what calls it: a call for each pixel and channel takes as long as what it does.
@compiled(fastmath={"contract"}, inline="always")
def _levels(nodes: Array, factors: Array, out: Array) -> None:
    """Write one pixel's value in one channel, blurred at every level."""
    count, levels = factors.shape
    out[:] = 0
    for node in range(0, count - 1, 2):
        first, second = nodes[node], nodes[node + 1]
        for level in range(levels):
            out[level] += factors[node, level] * first + factors[node + 1, level] * second
    if count % 2:
        for level in range(levels):
            out[level] += factors[count - 1, level] * nodes[count - 1]


@compiled(fastmath={"contract"}, inline="always")
def _leaves(
    nodes: Array, aim: Array, factors: Array, inverse: Array, grey: Array, squares: Array
) -> None:
    """Write what every level leaves of a pixel, in noise, squared and summed over channels."""
    squares[:] = 0
    for channel in range(len(aim)):
        _levels(nodes[channel], factors, grey)
        for level in range(len(grey)):
            residual = (aim[channel] - grey[level]) * inverse[channel]
            squares[level] += residual * residual


@compiled(fastmath={"contract"})
def _squares(
    nodes: Array, aim: Array, factors: Array, inverse: Array, weights: Array, entries: Array
) -> Array:
    (height, width), levels = aim.shape[:2], len(weights)
    out = np.empty((levels, height, width), np.float32)
    grey, squares = np.empty(levels, np.float32), np.empty(levels, np.float32)
    for y in range(height):
        for x in range(width):
            _leaves(nodes[y, x], aim[y, x], factors, inverse[y, x], grey, squares)
            for level in range(levels):
                out[level, y, x] = weights[level] * squares[level] + entries[level]
    return out


@compiled(fastmath={"contract"})
def _fill(
    nodes: Array,
    aim: Array,
    factors: Array,
    inverse: Array,
    weights: Array,
    entries: Array,
    most: Any,
    limit: int,
    add: bool,
    unary: Array,
) -> int:
    height, width = aim.shape[:2]
    levels = factors.shape[1]
    grey, squares = np.empty(levels, np.float32), np.empty(levels, np.float32)
    offset = np.int64(0)
    for y in range(height):
        for x in range(width):
            _leaves(nodes[y, x], aim[y, x], factors, inverse[y, x], grey, squares)
            least = np.float32(np.inf)
            for level in range(levels):
                cost = min(weights[level] * squares[level] + entries[level], most)
                squares[level] = np.rint(cost)
                least = min(least, squares[level])
            offset += np.int64(least)
            for level in range(levels):
                cost = min(squares[level] - least, np.float32(limit))
                if add:
                    cost = min(np.float32(unary[y, x, level]) + cost, np.float32(65535))
                unary[y, x, level] = np.uint16(cost)
    return offset  # type: ignore[return-value]  # compiled, it is a number of the machine


@compiled()
def _add(unary: Array, energy: Array, limit: int) -> int:
    height, width, levels = unary.shape
    offset = np.int64(0)
    for y in range(height):
        for x in range(width):
            row = unary[y, x]
            least = np.int64(2**31)
            for level in range(levels):
                least = min(least, np.int64(row[level]) + np.int64(energy[level]))
            offset += least
            for level in range(levels):
                cost = np.int64(row[level]) + np.int64(energy[level]) - least
                row[level] = np.uint16(min(cost, np.int64(limit)))
    return offset  # type: ignore[return-value]  # compiled, it is a number of the machine


@compiled(fastmath={"contract"})
def _leave(
    nodes: Array, aim: Array, factors: Array, noise: Array, bounds: Array, unary: Array
) -> None:
    height, width, channels = aim.shape
    levels = factors.shape[1]
    grey = np.empty(levels, np.float32)
    squares = np.empty(levels, np.float32)
    for y in range(height):
        for x in range(width):
            squares[:] = 0
            for channel in range(channels):
                _levels(nodes[y, x, channel], factors, grey)
                for level in range(levels):
                    bound = bounds[level] * noise[y, x, channel]
                    excess = max(abs(aim[y, x, channel] - grey[level]) - bound, 0.0)
                    squares[level] += np.float32(excess * excess)
            for level in range(levels):
                before = np.float32(unary[y, x, level]) / np.float32(MISFIT_STEPS)
                steps = math.ceil(MISFIT_STEPS * math.sqrt(squares[level] + before * before))
                unary[y, x, level] = np.uint16(min(steps, 65535))
