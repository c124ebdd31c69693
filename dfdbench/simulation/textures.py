"""Draw numbers from a seed, and textures from them: plaster, wood, tiles, cloth and print."""

from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

from dfdbench.blur.formation import uniform_numbers
from dfdbench.blur.light import LINEAR, Floats

#: Photographs that may hang on a wall or cover an object.
PHOTOGRAPHS = (
    "astronaut", "brick", "camera", "cell", "chelsea", "coffee", "coins", "grass", "gravel",
    "ihc", "moon", "motorcycle_left", "page", "text",
)  # fmt: skip
_SIDE = 384  # texels of a pattern
_BLOCK = 1024

Item = TypeVar("Item")


class Draws:
    """A stream of random numbers for a key; another key gives another stream.

    Parameters
    ----------
    *key : str or int
        What the numbers are for.

    Examples
    --------
    >>> draws = Draws("room", 7, 0)
    >>> draws.between(1.0, 2.0) == Draws("room", 7, 0).between(1.0, 2.0)
    True
    """

    def __init__(self, *key: str | int) -> None:
        self.key = key
        self._taken = 0
        self._block: list[float] = []

    def share(self) -> float:
        """Return a number between 0 and 1."""
        block, place = divmod(self._taken, _BLOCK)
        if place == 0:
            self._block = uniform_numbers(_BLOCK, *self.key, "block", block).tolist()
        self._taken += 1
        return self._block[place]

    def between(self, low: float, high: float) -> float:
        """Return a number between two others, uniformly distributed."""
        return low + (high - low) * self.share()

    def whole(self, low: int, high: int) -> int:
        """Return a whole number from `low` to `high`, both included."""
        return low + int((high - low + 1) * self.share())

    def chance(self, share: float) -> bool:
        """Return True in this share of calls."""
        return self.share() < share

    def one_of(self, items: Sequence[Item]) -> Item:
        """Return one of the items, with equal probability."""
        return items[self.whole(0, len(items) - 1)]


def pattern(kind: str, draws: Draws) -> Floats:
    """Return a pattern as linear reflectance, shape (y, x, 3).

    Parameters
    ----------
    kind : str
        One of `PATTERNS`.
    draws : Draws
        Draws its colours, sizes and grain.
    """
    grey = PATTERNS[kind](draws)
    # Round to whole grey levels, so that the last bits of a machine's arithmetic change nothing.
    return np.asarray(LINEAR[np.clip(np.rint(grey), 0, 255).astype(np.int64)])


def clouds(draws: Draws, size: float, rough: float = 0.5, stretch: float = 1.0) -> Floats:
    """Return smooth noise between 0 and 1, shape (y, x).

    Parameters
    ----------
    draws : Draws
        Draws the noise.
    size : float
        Size of the largest blots, in texels.
    rough : float
        The weight of each finer octave relative to the previous one.
    stretch : float
        The ratio of the blots' length to their width.
    """
    total, weight, sum_of_weights = np.zeros((_SIDE, _SIDE)), 1.0, 0.0
    while size >= 2:
        rows, columns = (int(_SIDE / step) + 2 for step in (size * stretch, size))
        name = draws.whole(0, 2**30)
        grid = uniform_numbers(rows * columns, "clouds", name).reshape(rows, columns)
        total += weight * _between(_between(grid, size * stretch).T, size).T
        sum_of_weights += weight
        weight, size = weight * rough, size / 2
    return total / sum_of_weights


def _between(grid: Floats, step: float) -> Floats:
    place = np.arange(_SIDE) / step
    first = np.minimum(place.astype(np.int64), len(grid) - 2)
    share = np.minimum(place - first, 1.0)
    share = (share * share * (3 - 2 * share))[:, np.newaxis]
    return np.asarray(grid[first] * (1 - share) + grid[first + 1] * share)


def colour(draws: Draws, low: float = 60, high: float = 225, vivid: float = 45) -> Floats:
    """Return a colour as three grey levels: a grey, warmed or cooled and tinted by up to `vivid`.

    Most things in a room are warmer than grey; few are pink or violet.
    """
    grey, warm = draws.between(low, high), draws.between(-0.5, 1) * vivid
    green = draws.between(-0.3, 0.4) * vivid
    return np.array([grey + warm, grey + green, grey - warm])


def _mix(share: Floats, first: Floats, second: Floats) -> Floats:
    return np.asarray(first * (1 - share[..., np.newaxis]) + second * share[..., np.newaxis])


def _plain(draws: Draws) -> Floats:
    grey = np.broadcast_to(colour(draws, 90, 235, 25), (_SIDE, _SIDE, 3))
    return grey + draws.between(0, 4) * (clouds(draws, 200)[..., np.newaxis] - 0.5)


def _plaster(draws: Draws) -> Floats:
    grain = clouds(draws, draws.between(4, 60), 0.8)[..., np.newaxis] - 0.5
    return colour(draws, 100, 220, 35) + draws.between(40, 160) * grain


def _marble(draws: Draws) -> Floats:
    field = clouds(draws, draws.between(80, 200), 0.6)
    veins = np.abs(field * draws.between(4, 9) % 1 - 0.5) * 2
    return _mix(veins ** draws.between(0.4, 2.0), colour(draws), colour(draws))


def _speckle(draws: Draws) -> Floats:
    grain = clouds(draws, draws.between(3, 16), 0.6)
    share = np.clip((grain - draws.between(0.4, 0.6)) * 12 + 0.5, 0, 1)
    return _mix(share, colour(draws), colour(draws))


def _wood(draws: Draws) -> Floats:
    width = draws.between(30, 90)
    grain = clouds(draws, draws.between(5, 12), 0.7, stretch=12)
    plank = np.floor(np.arange(_SIDE) / width).astype(np.int64)
    tones = uniform_numbers(int(plank.max()) + 1, "planks", draws.whole(0, 2**30))[plank]
    joint = (np.arange(_SIDE) % width) < draws.between(1, 3)
    base = np.array([150.0, 105.0, 65.0]) * draws.between(0.5, 1.4) + draws.between(-15, 25)
    grey = base + (90 * (grain - 0.5) + 50 * (tones - 0.5))[..., np.newaxis]
    grey[:, joint] *= 0.55
    return grey


def _blocks(draws: Draws, height: float, width: float, shift: float, joint: float) -> Floats:
    y, x = np.arange(_SIDE)[:, np.newaxis], np.arange(_SIDE)[np.newaxis, :]
    row = np.floor(y / height).astype(np.int64)
    moved = x + row * shift * width
    column = np.floor(moved / width).astype(np.int64)
    tones = uniform_numbers(4096, "blocks", draws.whole(0, 2**30))
    tone = tones[(row * 131 + column) % 4096]
    gap = (y % height < joint) | (moved % width < joint)
    face, mortar = colour(draws), colour(draws, 60, 220, 20)
    contrast = draws.one_of((0.0, 20.0, 70.0))
    grey = face + (contrast * (tone - 0.5) + 35 * (clouds(draws, 12, 0.8) - 0.5))[..., np.newaxis]
    return np.where(gap[..., np.newaxis], mortar, grey)


def _tiles(draws: Draws) -> Floats:
    side = draws.between(20, 90)
    return _blocks(draws, side, side * draws.one_of((1.0, 1.0, 2.0)), 0.0, draws.between(1, 4))


def _bricks(draws: Draws) -> Floats:
    height = draws.between(14, 36)
    return _blocks(draws, height, height * draws.between(2, 3.5), 0.5, draws.between(1.5, 4))


def _bands(draws: Draws) -> Floats:
    # A repeating period of bands in a few colours.
    period = draws.whole(16, 96)
    colours = [colour(draws, 40, 230, 60) for _ in range(draws.whole(2, 4))]
    edges = np.sort([draws.whole(0, period) for _ in range(draws.whole(2, 6))])
    which = np.searchsorted(edges, np.arange(_SIDE) % period, side="right") % len(colours)
    return np.array(colours)[which]


def _stripes(draws: Draws) -> Floats:
    grey = np.broadcast_to(_bands(draws)[np.newaxis], (_SIDE, _SIDE, 3))
    return grey + 20 * (clouds(draws, 8)[..., np.newaxis] - 0.5)


def _plaid(draws: Draws) -> Floats:
    weave = (np.add.outer(np.arange(_SIDE), np.arange(_SIDE)) // 2 % 2)[..., np.newaxis]
    return np.where(weave, _bands(draws)[:, np.newaxis], _bands(draws)[np.newaxis])


def _motif(draws: Draws) -> Floats:
    # Wallpaper: one small symmetric figure, repeated on a grid.
    side = draws.whole(6, 12)
    dots = uniform_numbers(side * side, "motif", draws.whole(0, 2**30)).reshape(side, side)
    figure = np.where(dots > draws.between(0.5, 0.75), 1.0, 0.0)
    figure = np.maximum(figure, figure[:, ::-1])
    gap = draws.whole(2, 8)
    figure = np.pad(figure, ((gap, gap), (gap, gap)))
    figure = np.kron(figure, np.ones((draws.whole(2, 4),) * 2))
    count = _SIDE // min(figure.shape) + 2
    sheet = np.tile(figure, (count, count))[:_SIDE, :_SIDE]
    paper = _mix(sheet, colour(draws), colour(draws))
    return paper + 12 * (clouds(draws, 6)[..., np.newaxis] - 0.5)


def _print(draws: Draws) -> Floats:
    # A printed page: lines of words made of strokes, with an occasional gap.
    ink = np.zeros((_SIDE, _SIDE))
    line, name = draws.whole(9, 16), draws.whole(0, 2**30)
    noise = uniform_numbers(_SIDE * _SIDE, "print", name).reshape(_SIDE, _SIDE)
    for number, top in enumerate(range(line, _SIDE - line, line)):
        if noise[number, 0] < 0.12:
            continue
        words = np.repeat(noise[number, : _SIDE // 6] < 0.8, 6)[:_SIDE]
        high = line - 4
        strokes = np.repeat(np.repeat(noise[top : top + high // 2, : _SIDE // 2], 2, 0), 2, 1)
        ink[top : top + len(strokes)] = (strokes < 0.55) * np.pad(words, (0, _SIDE - len(words)))
    ink[:, :14] = ink[:, -14:] = 0
    return _mix(ink, colour(draws, 200, 245, 12), colour(draws, 10, 60, 20))


PATTERNS: dict[str, Callable[[Draws], Floats]] = {
    "plain": _plain, "plaster": _plaster, "marble": _marble, "speckle": _speckle, "wood": _wood,
    "tiles": _tiles, "bricks": _bricks, "stripes": _stripes, "plaid": _plaid, "motif": _motif,
    "print": _print,
}  # fmt: skip
