"""What ``volume-net`` is given: what depths cost under a camera's blur, and a guide."""

import math
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.law import BlurLaw
from dfdbench.blur.recipe import LAST_LEVEL
from dfdbench.methods.blurred import all_blurred
from dfdbench.methods.fitted import Image, channels_of
from dfdbench.methods.law_cost import MOST_NATS, law_cost
from dfdbench.methods.networks.volume import MOST
from dfdbench.methods.sgm import DIRECTIONS, path_costs
from dfdbench.system.compiled import compiled

Array = NDArray[Any]

#: Integer cost of a nat: over a window hundredths of one add up.
UNIT = 64
# What costs are at most.
_MOST_KEPT = np.iinfo(np.uint16).max
# Rows that are blurred at once: their blurred images stay in a processor's cache.
_ROWS = 128
# Integer cost of a nat along paths, and of a step of one level and of more: of some, those that
# erred least on five cameras of the training.
_PATH_UNIT, _SMALL_STEP, _LARGE_STEP = 16, 40, 800
# Side of the window that the guide's contrast is made even over, and grey levels of no contrast.
_WINDOW, _BARE = 15, 8.0


def levels_of(count: int) -> NDArray[np.intp]:
    """Return the depth levels that a volume of so many has: the middles of even parts.

    Examples
    --------
    >>> levels_of(32)[[0, 1, 31]].tolist()
    [4, 12, 252]
    """
    step = (LAST_LEVEL + 1) // count
    return np.arange(step // 2, LAST_LEVEL + 1, step)


def finer_levels(count: int) -> NDArray[np.intp]:
    """Return twice as many levels: every second one is of `levels_of`.

    Examples
    --------
    >>> finer_levels(32)[[0, 1, 2, 61, 62, 63]].tolist()
    [4, 8, 12, 248, 252, 255]
    """
    step = (LAST_LEVEL + 1) // (2 * count)
    return np.append(np.arange(step, LAST_LEVEL + 1, step), LAST_LEVEL)


def halved_costs(
    laws: Sequence[BlurLaw], infocus: Image, images: Sequence[Image], count: int, multiple: int = 2
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return what each of some levels costs, and what can be told, at half the resolution.

    Parameters
    ----------
    laws : sequence of BlurLaw
        How each defocus image came about.
    infocus : ndarray of uint8, shape (y, x, channel) or (y, x)
        What they are blurred from.
    images : sequence of ndarray of uint8, of that shape
        The defocus images.
    count : int
        How many levels.
    multiple : int
        Rows and columns are made so many times a whole number, the last repeated.

    Returns
    -------
    volume : ndarray of float32, shape (level, y / 2, x / 2)
        Nats above a pixel's least, at most `MOST`: the mean of two by two pixels.
    told : ndarray of float32, shape (y / 2, x / 2)
        By how much the least and the largest level differ there, squared, in units of the noise.
    """
    return halved(*all_costs(laws, infocus, images, levels_of(count)), multiple)


def all_costs(
    laws: Sequence[BlurLaw],
    infocus: Image,
    images: Sequence[Image],
    levels: NDArray[np.intp],
    step: int = 1,
) -> tuple[NDArray[np.uint16], NDArray[np.float32]]:
    """Return what levels cost, `UNIT` a nat, and what every so manieth of them can tell."""
    shape, one = infocus.shape[:2], len(images) == 1
    most, ceiling = (_MOST_KEPT, math.inf) if one else (UNIT * MOST_NATS, UNIT * MOST_NATS)
    costs, told = np.zeros((*shape, len(levels)), np.uint16), np.zeros(shape, np.float32)
    for blurred in all_blurred(laws, infocus, images, levels):
        for top in range(0, shape[0], _ROWS):
            rows = slice(top, top + _ROWS)
            band = blurred.part(rows)
            law_cost(band, UNIT, most, costs[rows], not one, ceiling)
            factors = band.factors[:, ::step]
            ends = band.nodes @ (factors[:, -1] - factors[:, 0])
            told[rows] += sum(np.moveaxis(np.square(ends / band.noise), 2, 0))
    return costs, told


def along_paths(volume: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return costs summed along the paths of semi-global matching, as `SemiGlobal` has them.

    Parameters
    ----------
    volume : ndarray of float32, shape (level, y, x)
        Costs in nats.

    Returns
    -------
    ndarray of float32, shape (level, y, x)
        The mean over eight directions, in nats above a pixel's least, at most `MOST`.

    Examples
    --------
    >>> along_paths(np.array([[[0, 2]], [[3, 0]]], np.float32)).ravel().tolist()
    [0.0, 1.6875, 2.75, 0.0]
    """
    costs = np.moveaxis(np.rint(_PATH_UNIT * volume), 0, 2).astype(np.uint16)
    sums = np.moveaxis(path_costs(np.ascontiguousarray(costs), _SMALL_STEP, _LARGE_STEP), 2, 0)
    nats = (sums - sums.min(axis=0)) / np.float32(_PATH_UNIT * DIRECTIONS)
    return np.asarray(np.minimum(nats, np.float32(MOST), out=nats))


def guide_of(infocus: Image) -> NDArray[np.float32]:
    """Return an image's grey, its contrast about the same everywhere: shape (y, x).

    Examples
    --------
    >>> float(np.abs(guide_of(np.full((20, 20, 3), 90, np.uint8))).max())
    0.0
    """
    grey = channels_of(infocus).mean(axis=2)
    mean = cv2.blur(grey, (_WINDOW, _WINDOW))
    variance = cv2.blur(grey * grey, (_WINDOW, _WINDOW)) - mean * mean
    return np.asarray((grey - mean) / (np.sqrt(np.maximum(variance, 0)) + _BARE), np.float32)


def padded(image: Array, multiple: int) -> Array:
    """Repeat an image's last row and column, so that their numbers are multiples."""
    return np.pad(image, [(0, -side % multiple) for side in image.shape], mode="edge")


def halved(
    costs: Array, told: Array, multiple: int, step: int = 1
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return every so manieth level's costs in nats, and what can be told, over two by two."""
    whole = padded(told, multiple)
    rows, columns = (side // 2 for side in whole.shape)
    volume = np.empty((rows, columns, (costs.shape[2] + step - 1) // step), np.float32)
    _halve(costs, step, int(UNIT * MOST), volume)
    blocks = whole.reshape(rows, 2, columns, 2)
    return np.moveaxis(volume, 2, 0), blocks.mean(axis=(1, 3), dtype=np.float32)


@compiled()
def _halve(costs: Array, step: int, most: int, volume: Array) -> None:
    (height, width, _), (rows, columns, count) = costs.shape, volume.shape
    some, sums = np.empty(count, np.int32), np.empty(count, np.int32)
    for y in range(rows):
        for x in range(columns):
            sums[:] = 0
            for down in range(2):
                for right in range(2):
                    # The last row and column stand for those beyond.
                    pixel = costs[min(2 * y + down, height - 1), min(2 * x + right, width - 1)]
                    for level in range(count):
                        some[level] = pixel[level * step]
                    least = some.min()
                    for level in range(count):
                        sums[level] += min(some[level] - least, most)
            least = sums.min()
            for level in range(count):
                nats = (sums[level] - least) / np.float32(4 * UNIT)
                volume[y, x, level] = min(nats, np.float32(MOST))
