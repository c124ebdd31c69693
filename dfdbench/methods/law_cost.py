"""The cost of every depth level at every pixel under a blur law: kernels of any shape, and noise.

As in `dfdbench.methods.data_cost`, few kernels represent all. Here they need not be Gaussians, the
images may be in linear light, and a level's residual is compared with the noise expected there:
the defocus image's own, and what remains of the in-focus image's after the level's blur. If the
law is linear, residuals are computed in linear light, where a dark pixel's noise is symmetric;
after the sRGB curve it is not.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial, reduce
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
#: The most nats that one image of a stack counts against a level. Among 2, 3, 5, 8 and 15 this had
#: about the least error on the demo set's training stacks.
MOST_NATS = 5


def level_costs(
    blurs: Sequence[Blur], infocus: Image, images: Sequence[Image], limit: float
) -> NDArray[np.uint16]:
    """Return a capture's cost volume: minus the log probability of each level, cut off.

    A level's cost is the squared difference between the defocus image and the in-focus image
    blurred for that level, summed over channels and divided by twice its variance: for a recipe
    that of rounding, for a law that of the noise measured with it. Unlike the data cost of
    `graph-cuts`, it compares RGB, which is not rounded a second time.

    Parameters
    ----------
    blurs : sequence of BlurRecipe or BlurLaw
        How each defocus image was made; if there are several, they must be laws.
    infocus : ndarray of uint8, shape (y, x, channel) or (y, x)
        The image that they are blurred from.
    images : sequence of ndarray of uint8, of that shape
        The defocus images, whose costs are summed.
    limit : float
        Nats above a pixel's least cost at which costs are cut off. One image of a stack counts at
        most 5 against any level: where surfaces end, many images explain nothing.

    Returns
    -------
    ndarray of uint16, shape (y, x, label)
        Costs, `UNIT` per nat. For a single image each pixel's least cost is 0. The blur's
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
    """Return a function that gives the `level_costs` of some ``rows``, a slice without a step.

    For a pair it holds nothing but the two images.
    """
    most = max(round(UNIT * (limit if len(images) == 1 else min(limit, MOST_NATS))), 1)
    if isinstance(blurs[0], BlurRecipe):
        # All we know about a recipe's residuals is that images are rounded.
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
        del one  # before the next is made, as they are large
    assert costs is not None
    # Do not copy the whole volume, which would double the memory; it is requested only once.
    return lambda rows: costs if rows == slice(None) else costs[rows].copy()


# The number of levels whose squares are computed and held at once.
_AT_ONCE = 16
# The step between levels, and the side of the corner, for judging how well a law explains a pair.
_COARSE, _CORNER = 8, 256
# Misfits are stored as whole multiples of 1 / STEPS grey levels: see `rounded_cost`.
MISFIT_STEPS = 256


def squares_of(blurred: Blurred) -> Iterator[NDArray[np.float32]]:
    """Yield each level's cost at every pixel, two per nat: float32, shape (y, x).

    It is the squared residual over the level's variance, summed over channels, plus the logarithm
    of that variance. So of two levels with equal normalised residuals, the one that expects less
    variance costs less.
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
    """Compute the cost of every level at every pixel, for Gaussian noise.

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
        Add the costs to those in `out`, up to 65535.
    ceiling : float
        The largest cost, however badly the best level explains the pixel.

    Returns
    -------
    unary : (y, x, level) uint16
        Costs relative to the pixel's least.
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
    """Add a cost per level to every pixel's costs, and return the sum of the least costs.

    Parameters
    ----------
    unary : ndarray of uint16, shape (y, x, level)
        Costs relative to a pixel's least, at most `limit` above it; overwritten.
    energy : ndarray of float64, shape (level,)
        In integer costs, before rounding.
    limit : int
        As for `law_cost`.
    """
    most = np.iinfo(np.uint16).max
    return int(_add(unary, np.minimum(np.rint(energy), most).astype(np.uint16), limit))


def misfit(law: BlurLaw, infocus: Array, defocus: Array) -> float:
    """Return how badly a law explains a pair, whatever its depth, in units of the law's noise.

    It takes the squared residual of the best of some levels at each pixel of a corner, and returns
    the root of the median. Since the best level is chosen, pure noise gives less than 1.
    """
    some = np.arange(0, LAST_LEVEL + 1, _COARSE)
    corner = blurred_by(law, infocus, defocus, some).part(slice(_CORNER), slice(_CORNER))
    channels = corner.aim.shape[2]
    entries = channels * np.log(corner.spread)
    squares = (cost - entry for cost, entry in zip(squares_of(corner), entries, strict=True))
    return float(np.sqrt(np.median(reduce(np.minimum, squares)) / channels))


def law_misfits(blurred: Blurred, before: NDArray[np.uint16] | None = None) -> NDArray[np.uint16]:
    """Return how far each level's residual is outside the interval of its noise.

    The interval is that of the uniform distribution with the level's variance: half a grey level
    if there is only rounding. Misfits are whole multiples of 1 / 256 of the images' unit, rounded
    up, as in `rounded_cost`.

    Parameters
    ----------
    blurred : Blurred
        The pair, from `blurred_by`.
    before : ndarray of uint16, shape (y, x, level), optional
        The misfits of other images; the squares of this one's are added to theirs. Overwritten.

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


# Inlined, because a call for each pixel and channel takes as long as the work itself.
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
    """Write every level's squared residual at a pixel, in units of noise, summed over channels."""
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
