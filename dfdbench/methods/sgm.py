"""Semi-global matching over the cost of each depth level."""

import copy
import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfdbench.errors import MethodError, Problem
from dfdbench.methods.fitted import Blur, Image, Solver, number_within
from dfdbench.methods.law_cost import UNIT, level_costs_by_rows
from dfdbench.methods.posterior import Posterior
from dfdbench.methods.readout import read_out
from dfdbench.system.compiled import compiled

#: Of the paths.
DIRECTIONS = 8
#: Largest cost and step together: the sums over all paths are kept in 16 bits.
MOST = 65535 // DIRECTIONS

# What costs take at most that are not worked out in bands: those of 480 x 640 pixels do.
_MOST_BYTES = 160_000_000

# Above any cost of a path, and still in 16 bits with a step added.
_FAR = np.uint16(2**15)
# The directions that a sweep from the upper left comes from, as rows and columns, those of four
# paths first; a sweep from the lower right comes from the opposite ones.
_FROM = np.array([[0, -1], [-1, 0], [-1, -1], [-1, 1]])

Array = NDArray[Any]


def path_costs(
    costs: NDArray[np.uint16], small: int, large: int, directions: int = 8
) -> NDArray[np.uint16]:
    """Return the sum over directions of the least cost of a path to each pixel and label.

    Parameters
    ----------
    costs : ndarray of uint16, shape (y, x, label)
        At most `MOST` less `large`.
    small, large : int
        What a path pays for a step of one label, and for a step of more.
    directions : {8, 4}
        Four are along rows and columns, the other four along diagonals.

    Notes
    -----
    ``L_r(p, d) = C(p, d) + min(L_r(p - r, d), L_r(p - r, d - 1) + P1, L_r(p - r, d + 1) + P1,
    min_i L_r(p - r, i) + P2) - min_i L_r(p - r, i)``: Hirschmüller, PAMI 2008, Eq. 13.

    Examples
    --------
    >>> path_costs(np.array([[[0, 2], [3, 0]]], np.uint16), 1, 1).tolist()
    [[[1, 16], [24, 1]]]
    """
    whole = path_costs_by_bands(
        lambda rows: costs, costs.shape, small, large, directions, max(len(costs), 1)
    )
    return next(whole)[1]


def path_costs_by_bands(
    costs_of: Callable[[slice], NDArray[np.uint16]],
    shape: tuple[int, ...],
    small: int,
    large: int,
    directions: int = 8,
    rows: int | None = None,
) -> Iterator[tuple[slice, NDArray[np.uint16]]]:
    """Yield bands of rows and their path costs, the last one first: never is all in memory.

    Parameters
    ----------
    costs_of : callable
        Gives the costs of some rows; it is called twice for each band but the last.
    shape : tuple of int
        Of all costs, (y, x, label).
    small, large, directions
        As for `path_costs`.
    rows : int, optional
        How many a band has; default: all of a small image, of a larger as many as need the least
        memory.

    Examples
    --------
    >>> costs = np.array([[[0, 2]], [[3, 0]]], np.uint16)
    >>> bands = path_costs_by_bands(lambda rows: costs[rows], costs.shape, 1, 1, rows=1)
    >>> [(rows.start, sums.tolist()) for rows, sums in bands]
    [(1, [[[24, 1]]]), (0, [[[1, 16]]])]
    """
    height = shape[0]
    if rows is None:
        # A band's costs and sums take as much as the ends of the paths, kept for each band.
        whole = 2 * math.prod(shape) <= _MOST_BYTES
        rows = height if whole else math.isqrt(height * directions // 2)
    bands = [slice(top, min(top + rows, height)) for top in range(0, height, rows)]
    # Paths from above are followed twice: to know where each band begins, then with those from
    # below, which come up band by band.
    down = [_Sweep(shape, small, large, directions)]
    for band in bands[:-1]:
        down.append(down[-1].copy())
        down[-1].add(costs_of(band), None)
    up = _Sweep(shape, small, large, directions, backwards=True)
    while bands:
        costs = costs_of(bands[-1])
        sums = np.zeros(costs.shape, np.uint16)
        down.pop().add(costs, sums)
        up.add(costs, sums)
        yield bands.pop(), sums


class _Sweep:
    """Half of the paths, from the upper left or from the lower right, as far as they have come."""

    def __init__(
        self,
        shape: tuple[int, ...],
        small: int,
        large: int,
        directions: int,
        backwards: bool = False,
    ) -> None:
        _, width, labels = shape
        self._sources = _FROM[: directions // 2]
        self._steps, self._backwards = (np.uint16(small), np.uint16(large)), backwards
        # Two rows of path costs a direction, one spare label at either end.
        self._paths = np.full((2, len(self._sources), width, labels + 2), _FAR, np.uint16)
        self._least = np.zeros((2, len(self._sources), width), np.uint16)
        self._rows = 0

    def copy(self) -> "_Sweep":
        other = copy.copy(self)
        other._paths, other._least = self._paths.copy(), self._least.copy()
        return other

    def add(self, costs: NDArray[np.uint16], sums: NDArray[np.uint16] | None) -> None:
        """Go on over the next rows, and add the path costs to sums."""
        _sweep(
            costs,
            *self._steps,
            self._sources,
            self._backwards,
            self._rows,
            self._paths,
            self._least,
            np.empty_like(costs[:1]) if sums is None else sums,
        )
        self._rows += len(costs)


@compiled()
def _sweep(
    costs: Array,
    small: Any,
    large: Any,
    sources: Array,
    backwards: bool,
    rows: int,
    paths: Array,
    least: Array,
    sums: Array,
) -> None:
    height, width, labels = costs.shape
    start = np.zeros(labels + 2, np.uint16)
    for row in range(height):
        y = height - 1 - row if backwards else row
        now, before = (rows + row) % 2, (rows + row + 1) % 2
        # Where sums are not asked for there is one row for all.
        into = y % len(sums)
        for column in range(width):
            x = width - 1 - column if backwards else column
            for direction in range(len(sources)):
                there = column + sources[direction, 1]
                level = now if sources[direction, 0] == 0 else before
                begins = there < 0 or there >= width or (level == before and rows + row == 0)
                least[now, direction, column] = _step(
                    costs[y, x],
                    start if begins else paths[level, direction, there],
                    np.uint16(0) if begins else least[level, direction, there],
                    small,
                    large,
                    paths[now, direction, column],
                    sums[into, x],
                )


# Put into what calls it: a call for each pixel and direction takes as long as what it does.
@compiled(inline="always")
def _step(
    cost: Array, before: Array, least: Any, small: Any, large: Any, now: Array, total: Array
) -> Any:
    """Write the path costs of one pixel and direction, add them to the sums, return their least."""
    # Numba makes every sum of 16-bit numbers one of 64 bits, which holds a quarter as many in a
    # processor's register: each is turned back at once.
    best, jump = _FAR, np.uint16(least + large)
    for label in range(cost.size):
        way = min(np.uint16(min(before[label], before[label + 2]) + small), before[label + 1])
        value = np.uint16(np.uint16(cost[label] + min(way, jump)) - least)
        now[label + 1] = value
        total[label] = np.uint16(total[label] + value)
        best = min(best, value)
    return best


class SemiGlobal(Solver):
    """Depth by the sum of eight paths' least costs: smoothness along lines, not over the image.

    What a level costs a pixel is the squared difference between the defocus image and the
    in-focus image blurred at it. Along each of eight directions the least cost of a path that ends
    at a pixel with a level is found by dynamic programming; a step of one level costs `small_step`,
    a larger one `large_step`. A pixel takes the level of the least sum over the eight, and the
    minimum of a parabola.

    Parameters
    ----------
    recipe : BlurRecipe or BlurLaw, optional
        How the defocus images were made; without it the law is fitted.
    small_step, large_step : float
        P1 and P2 of the paper, in nats (factors e of probability); the second not below the
        first.
    limit : float
        Nats above a pixel's least at which costs are cut off.
    prior : bool
        Where the law is fitted: weigh depths by how often training shows them, if that helps there.
    sure : bool
        Also say how sure it is: see `dfdbench.methods.fitted.Solver`.

    Raises
    ------
    MethodError
        For a parameter out of range, all of them named; at a call without recipe or fit.

    Notes
    -----
    Hirschmüller 2008, Eq. 13 and 14, with a constant P2.

    Examples
    --------
    >>> from dfdbench.blur import RECIPES, synthesize
    >>> image = np.random.default_rng(0).integers(0, 256, (40, 40, 3)).astype(np.uint8)
    >>> defocus = synthesize(image, np.full((40, 40), 120, np.uint8), RECIPES["published"])
    >>> found = SemiGlobal(RECIPES["published"])(image, defocus)
    >>> bool(np.abs(found - 120).mean() < 1)
    True
    """

    paper = (
        "Hirschmüller, Stereo processing by semiglobal matching and mutual information, PAMI 2008"
    )

    def __init__(
        self,
        recipe: Blur | None = None,
        small_step: float = 0.5,
        large_step: float = 15.0,
        limit: float = 100.0,
        prior: bool = True,
        sure: bool = False,
    ) -> None:
        most = MOST // (2 * UNIT)
        problems = number_within("small_step", small_step, most)
        problems += number_within("large_step", large_step, most)
        if not problems and large_step < small_step:
            problems.append(
                Problem(
                    f"small_step {small_step:g} is above large_step {large_step:g}",
                    where="small_step",
                )
            )
        problems += number_within("limit", limit, most)
        MethodError.raise_if(problems)
        super().__init__(recipe, prior=prior, sure=sure)
        self._limit = limit
        self._steps = round(UNIT * small_step), round(UNIT * large_step)

    def _solve(
        self, infocus: Image, images: Sequence[Image], posterior: Posterior | None = None
    ) -> NDArray[np.float32]:
        # As many images as there are, as often a cost is counted.
        small, large = (
            min(step * len(images) * self.chosen.smoothing, MOST // 2) for step in self._steps
        )
        by_images = level_costs_by_rows(self.blurs, infocus, images, self._limit)

        def costs_of(rows: slice) -> NDArray[np.uint16]:
            costs = by_images(rows)
            if self.chosen.weight:
                costs += np.rint(UNIT * self.chosen.energy).astype(np.uint16)
            return np.minimum(costs, MOST - large, out=costs)

        parts: Callable[[slice], NDArray[np.uint16]] = costs_of
        if posterior is not None:
            # It takes costs level by level.
            held = costs_of(slice(None))
            parts = held.__getitem__
            # Costs along paths are as low where neighbours agree on what is wrong.
            depths = self.blur.depth_of_level(np.arange(self.levels))
            posterior.add_all(depths, np.moveaxis(held, 2, 0), UNIT)
        label = np.empty(infocus.shape[:2])
        shape = (*infocus.shape[:2], self.levels)
        for rows, sums in path_costs_by_bands(parts, shape, small, large):
            levels = np.moveaxis(sums, 2, 0)
            label[rows] = read_out(levels, self.chosen.sharpness / (UNIT * DIRECTIONS))
        return np.asarray(self.blur.depth_of_level(label), np.float32)
