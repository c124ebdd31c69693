"""Blur realistically at depth jumps: composite layers from back to front."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.light import Floats
from dfdbench.blur.synthesis import Ints, reaches, require_kernels
from dfdbench.system.compiled import compiled
from dfdbench.system.vectors import LANES, all_of, load, plus, store, times, where_below

#: The depth level of each pixel.
Levels = NDArray[np.int16]
#: A kernel ends where it falls below this share of its peak: for a Gaussian at 3.7 sigma, which
#: cuts off a thousandth of its light.
TAIL = 1e-3
#: Where depths meet, those further apart than this are different surfaces; closer ones are one
#: slanted surface.
GAP = 8

# How many pixels of a level spread their light together, and how far apart in a row they may be.
_TOGETHER, _APART = 4, LANES
# Colours spread at once, beside the layer's cover: all of them fit in a processor's registers.
_COLOURS = 3


def without_tails(kernels: Floats) -> Floats:
    """Drop kernel weights below `TAIL` of the peak, and scale the rest to sum to 1.

    Examples
    --------
    >>> row = np.array([1e-4, 0.1, 1, 0.1, 1e-4])
    >>> without_tails(np.outer(row, row)[np.newaxis])[0, 2].round(3).tolist()
    [0.0, 0.069, 0.694, 0.069, 0.0]
    """
    peaks = kernels.max(axis=(1, 2), keepdims=True)
    cut = np.where(kernels < TAIL * peaks, 0, kernels)
    return np.asarray(cut / cut.sum(axis=(1, 2), keepdims=True), dtype=np.float64)


def composite_layers(image: Floats, depth: NDArray[np.integer], kernels: Floats) -> Floats:
    """Blur each depth level as a layer, and lay surfaces over one another, the nearest last.

    Parameters
    ----------
    image : ndarray of float64, shape (y, x, channel) or (y, x)
        The in-focus image, in any unit. Image and depth repeat their edge pixels past the border.
    depth : ndarray of int, shape (y, x)
        The layer of each pixel; larger is nearer.
    kernels : ndarray of float64, shape (level, size, size)
        One per depth level, of odd size, symmetric in both axes and their diagonal.

    Returns
    -------
    ndarray of float64
        Same shape as the image, not rounded.

    Raises
    ------
    InputError
        If shapes do not match, a depth has no kernel, or a kernel is not symmetric.

    Notes
    -----
    Let m_d be the mask of the pixels at depth d, K_d that depth's kernel and * a convolution. A
    layer covers a_d = K_d * m_d of a pixel and shows the colour c_d = K_d * (m_d I). At each pixel
    the depths with a_d > 0, from the farthest to the nearest, are cut into surfaces S wherever two
    successive ones lie more than `GAP` apart. From the farthest surface to the nearest, with f and
    n the farthest and the nearest depth of S::

        seen   =   sum of a_d over S
        share  =   seen / (seen + K_n * m_{d < f})
        C     <-   (1 - share) C + share (sum of c_d) / seen

    So a surface's share is how much of it is seen among everything that nearer surfaces leave
    visible. The farthest surface has share 1: we assume that it continues behind the others. At a
    straight edge both sides weigh 1/2, as in a lens.

    If we composited level by level, without surfaces, a slanted plane would occlude itself: many
    thin layers reach a pixel, and the nearer ones would weigh up to e times as much as the farther
    ones.

    For each row, the pixels within reach spread their light layer by layer, a few at a time, so the
    work grows with the kernels' area and not with the number of levels. The order of the sums is
    fixed, so the last bit is the same on any machine.

    Examples
    --------
    >>> image, depth = np.zeros((5, 9)), np.zeros((5, 9), int)
    >>> image[:, 4:], depth[:, 4:] = 90, 50  # bright and near, in focus, beside dark and far
    >>> kernels = np.zeros((51, 3, 3))
    >>> kernels[0], kernels[50, 1, 1] = 1 / 9, 1
    >>> composite_layers(image, depth, kernels)[2].round().tolist()
    [0.0, 0.0, 0.0, 0.0, 90.0, 90.0, 90.0, 90.0, 90.0]
    """
    require_kernels(image, depth, kernels)
    channels = image if image.ndim == 3 else image[:, :, np.newaxis]
    colours = channels.shape[2]
    if colours > _COLOURS:
        parts = np.split(channels, range(_COLOURS, colours, _COLOURS), axis=2)
        return np.concatenate([composite_layers(part, depth, kernels) for part in parts], axis=2)
    present = np.flatnonzero(np.bincount(depth.ravel(), minlength=len(kernels)))
    radius = int(reaches(kernels[present]).max())
    # A vector may start at the last column.
    around = ((radius, radius), (radius, radius + LANES))
    levels = np.pad(depth, around, mode="edge").astype(np.int16)
    # A layer's cover and its colours are stored alike, as two or four planes.
    light = np.zeros((*levels.shape, 2 if colours == 1 else 1 + _COLOURS), np.float64)
    light[..., 0] = 1
    light[..., 1 : 1 + colours] = np.pad(channels, (*around, (0, 0)), mode="edge")
    centre = kernels.shape[1] // 2
    quadrants = kernels[:, centre : centre + radius + 1, centre : centre + radius + 1]
    quadrants = np.ascontiguousarray(quadrants, dtype=np.float64)
    covered = _composite(light, levels, present, quadrants, channels.shape[:2])
    return np.asarray(covered[..., 1 : 1 + colours], dtype=np.float64).reshape(image.shape)


@compiled()
def _composite(
    light: Floats, depth: Levels, present: Ints, quadrants: Floats, shape: tuple[int, int]
) -> Floats:
    height, width = shape
    planes, radius = light.shape[2], quadrants.shape[1] - 1
    starts, places, lights = _groups(depth, light, len(quadrants), radius)
    halves, weights = _rows_of(quadrants, present)
    # One row each, plane after plane, with room for a vector that starts in the last column.
    room = width + 2 * LANES
    layer = np.zeros((planes, room), np.float64)
    surface = np.zeros((planes, room), np.float64)
    total = np.zeros((planes, room), np.float64)
    # The farthest and the nearest depth of each pixel's surface so far.
    ends = np.zeros((2, room), np.int64)
    seen = np.zeros(2 * radius + 1 + LANES, np.float64)
    out = np.empty((height, width, planes), np.float64)
    for y in range(height):
        centre = (y + radius) * depth.shape[1] + radius
        for level in present:
            reach = halves[level, 0]
            groups = starts[level, y + radius - reach], starts[level, y + radius + reach + 1]
            first, last = _spread(places, lights, groups, y, level, halves, weights, width, layer)
            for x in range(first, min(last, width)):
                if layer[0, x] != 0.0:
                    if surface[0, x] == 0.0:
                        ends[0, x] = level
                    elif level - ends[1, x] > GAP:
                        behind = 0.0
                        if total[0, x] != 0.0:
                            behind = _behind(
                                depth, centre + x, ends[0, x], ends[1, x], halves, weights, seen
                            )
                        _lay_over(surface, total, x, behind)
                        ends[0, x] = level
                    ends[1, x] = level
            for plane in range(planes):
                for i in range(plane * room + first, plane * room + last, LANES):
                    store(surface, i, plus(load(surface, i), load(layer, i)))
                    store(layer, i, all_of(0.0))
        for x in range(width):
            behind = 0.0
            if total[0, x] != 0.0:
                behind = _behind(depth, centre + x, ends[0, x], ends[1, x], halves, weights, seen)
            _lay_over(surface, total, x, behind)
            for plane in range(planes):
                out[y, x, plane], total[plane, x] = total[plane, x], 0.0
    return out


@compiled()
def _groups(depth: Levels, light: Floats, levels: int, radius: int) -> tuple[Ints, Ints, Floats]:
    """Group pixels of one level that are close together in a row, by level and then by row.

    Returns where each level and row's groups start; the columns of each group's pixels and their
    row; and their light by plane, 0 where a group is not full.
    """
    height, width, planes = light.shape
    starts = np.zeros((levels, height + 1), np.int64)
    number = np.zeros(levels, np.int64)
    places = np.empty((0, _TOGETHER + 1), np.int64)
    lights = np.empty((0, planes, _TOGETHER), np.float64)
    # Count in the first pass, fill in the second.
    for fills in range(2):
        following = starts.copy()
        for y in range(height):
            begun = np.full(levels, -_APART, np.int64)
            for x in range(width):
                level = depth[y, x]
                if x - begun[level] >= _APART or number[level] == _TOGETHER:
                    begun[level], number[level] = x, 0
                    following[level, y] += 1
                if fills:
                    group = following[level, y] - 1
                    for i in range(number[level], _TOGETHER):
                        places[group, i] = x - radius
                    places[group, _TOGETHER] = y - radius
                    for plane in range(planes):
                        lights[group, plane, number[level]] = light[y, x, plane]
                number[level] += 1
        if not fills:
            count = 0
            for level in range(levels):
                for y in range(height + 1):
                    starts[level, y] = count
                    count += following[level, y]
            places = np.empty((count, _TOGETHER + 1), np.int64)
            lights = np.zeros((count, planes, _TOGETHER), np.float64)
    return starts, places, lights


@compiled()
def _rows_of(quadrants: Floats, present: Ints) -> tuple[Ints, Floats]:
    """Return half of each row's width, and the rows from the middle on, padded with zeros."""
    size = quadrants.shape[1]
    centre = size - 1 + _APART + LANES
    halves = np.zeros((len(quadrants), size), np.int64)
    weights = np.zeros((len(quadrants), size, 2 * centre + 1), np.float64)
    for level in present:
        for j in range(size):
            for i in range(size):
                if quadrants[level, j, i] != 0.0:
                    halves[level, j] = i
                    weights[level, j, centre - i] = quadrants[level, j, i]
                    weights[level, j, centre + i] = quadrants[level, j, i]
    return halves, weights


@compiled()
def _spread(
    places: Ints,
    lights: Floats,
    groups: tuple[int, int],
    y: int,
    level: int,
    halves: Ints,
    weights: Floats,
    width: int,
    layer: Floats,
) -> tuple[int, int]:
    """Add groups' light, and the pixels themselves, to a row; return which columns they reach."""
    # Index whole arrays: compiled code counts references for every slice.
    size, stride = weights.shape[1:]
    planes, room = layer.shape
    begin, end = width, 0
    for group in range(groups[0], groups[1]):
        away = abs(places[group, _TOGETHER] - y)
        first = max(0, places[group, 0] - halves[level, away])
        last = min(width, places[group, _TOGETHER - 1] + halves[level, away] + 1)
        if first >= last:
            continue
        begin, end = min(begin, first), max(end, last)
        middle = (level * size + away) * stride + stride // 2
        x0, x1 = middle - places[group, 0], middle - places[group, 1]
        x2, x3 = middle - places[group, 2], middle - places[group, 3]
        a, b = _four(lights, group, 0), _four(lights, group, 1)
        c, d = _four(lights, group, planes - 2), _four(lights, group, planes - 1)
        for x in range(first, last, LANES):
            w0, w1 = load(weights, x0 + x), load(weights, x1 + x)
            row = w0, w1, load(weights, x2 + x), load(weights, x3 + x)
            _add(layer, x, row, a)
            _add(layer, room + x, row, b)
            if planes > 2:
                _add(layer, 2 * room + x, row, c)
                _add(layer, 3 * room + x, row, d)
    return begin, end


@compiled()
def _four(lights: Floats, group: int, plane: int) -> Any:
    first, second = all_of(lights[group, plane, 0]), all_of(lights[group, plane, 1])
    return first, second, all_of(lights[group, plane, 2]), all_of(lights[group, plane, 3])


@compiled()
def _add(layer: Floats, at: int, row: Any, light: Any) -> None:
    sums = load(layer, at)
    for one in range(_TOGETHER):
        sums = plus(sums, times(row[one], light[one]))
    store(layer, at, sums)


@compiled()
def _lay_over(surface: Floats, total: Floats, x: int, behind: float) -> None:
    """Put a pixel's surface over what is behind it, and clear it for the next."""
    own = surface[0, x]
    share = own / (own + behind)
    for plane in range(len(surface)):
        total[plane, x] = (1.0 - share) * total[plane, x] + share / own * surface[plane, x]
        surface[plane, x] = 0.0


@compiled()
def _behind(
    depth: Levels, centre: int, far: int, near: int, halves: Ints, weights: Floats, seen: Floats
) -> float:
    """Return how much of the near level's kernel around a pixel falls on levels below `far`."""
    size, stride = weights.shape[1:]
    reach, middle = halves[near, 0], near * size * stride + stride // 2
    for i in range(-reach, reach + 1, LANES):
        sums = all_of(0.0)
        for j in range(-reach, reach + 1):
            row = load(weights, middle + abs(j) * stride + i)
            sums = plus(sums, where_below(depth, centre + j * depth.shape[1] + i, far, row))
        store(seen, i + reach, sums)
    total = 0.0
    for i in range(2 * reach + 1):
        total += seen[i]
    return total
