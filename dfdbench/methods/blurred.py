"""A pair under a blur law: the in-focus image blurred by few kernels, which combine to every blur.

Blurring is linear, so each level's blurred image is a weighted sum of these few. They take much
memory, so large images are processed in parts.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.law import BlurLaw
from dfdbench.methods.alignment import Alignment, Array, aim_of, find_alignment, light_of, noise_of
from dfdbench.methods.view_change import ViewChange

# Largest sum of absolute differences between a level's kernel and the sum that replaces it: at
# most 0.05 grey levels where black meets white.
KERNEL_TOLERANCE = 2e-4
# The most memory for a band's images, blurred by the few kernels: enough for half a megapixel.
_MOST_BYTES = 80_000_000
# The number of levels at which a pixel's information is computed.
_LOOKED_AT = 8


@dataclass(frozen=True)
class Blurred:
    """A pair under a law: its images, and each level's weights for the few kernels.

    Parameters
    ----------
    law : BlurLaw
        How the defocus image came about.
    infocus : ndarray of uint8, shape (y, x, channel)
        The in-focus image; for a part, with the margin that its blur reaches.
    inside : tuple of slice
        Where the part is within it.
    aim : ndarray of float32, shape (y, x, channel)
        The defocus image, aligned to the in-focus image and of its brightness: in grey levels or,
        if the law is linear, in 255ths of light.
    factors : ndarray of float32, shape (node, level)
        The weight of each kernel's image in a level's blurred image.
    noise : ndarray of float32, shape (y, x, channel)
        Standard deviation of the defocus image's noise, in the same unit.
    spread : ndarray of float64, shape (level,)
        The factor by which the in-focus image's noise increases a residual's variance, by level.
    """

    law: BlurLaw
    infocus: Array
    inside: tuple[slice, slice]
    aim: NDArray[np.float32]
    factors: NDArray[np.float32]
    noise: NDArray[np.float32]
    spread: NDArray[np.float64]

    @cached_property
    def nodes(self) -> NDArray[np.float32]:
        """The in-focus image blurred by each kernel, shape (y, x, channel, node); it is large."""
        kernels = _few(self.law)[0]
        light = light_of(self.infocus, self.law.linear)
        nodes = np.empty((*self.aim.shape, len(kernels)), np.float32)
        for number, kernel in enumerate(kernels):
            nodes[..., number] = blur(light, kernel)[self.inside]
        return nodes

    def part(self, rows: slice = slice(None), columns: slice = slice(None)) -> Blurred:
        """Return the same for a part of the whole image."""
        height, width = self.aim.shape[:2]
        (top, bottom, _), (left, right, _) = rows.indices(height), columns.indices(width)
        if (bottom - top, right - left) == (height, width):
            return self
        reach = self.law.kernel_size // 2
        above, before = max(top - reach, 0), max(left - reach, 0)
        return replace(
            self,
            infocus=self.infocus[above : bottom + reach, before : right + reach],
            inside=(slice(top - above, bottom - above), slice(left - before, right - before)),
            aim=np.ascontiguousarray(self.aim[rows, columns]),
            noise=np.ascontiguousarray(self.noise[rows, columns]),
        )

    def bands(self) -> Iterator[Blurred]:
        """Yield it in bands of rows small enough for their `nodes`, or whole if it is small."""
        height, width, channels = self.aim.shape
        rows = max(_MOST_BYTES // (4 * width * channels * len(self.factors)), 1)
        for top in range(0, height, rows):
            yield self.part(slice(top, top + rows))


def all_blurred(
    blurs: Sequence[Any],
    infocus: Array,
    images: Sequence[Array],
    levels: NDArray[np.intp] | None = None,
) -> Iterator[Blurred]:
    """Yield `blurred_by` of each defocus image and its law, one at a time as they are large."""
    for law, image in zip(blurs, images, strict=True):
        yield blurred_by(law, np.atleast_3d(infocus), np.atleast_3d(image), levels)


def blurred_by(
    law: BlurLaw, infocus: Array, defocus: Array, levels: NDArray[np.intp] | None = None
) -> Blurred:
    """Blur an in-focus image by a law's few kernels, and align the defocus image to it.

    Parameters
    ----------
    law : BlurLaw
        How the defocus image came about.
    infocus, defocus : ndarray of uint8, shape (y, x, channel)
        The pair.
    levels : ndarray of int, optional
        The depth levels to cover; by default all.
    """
    _, factors, shares = _few(law)
    chosen = slice(None) if levels is None else levels
    spread = 1 + law.infocus_noise**2 * shares[chosen]
    factors = np.ascontiguousarray(factors[:, chosen])
    aim = aligned(law, light_of(infocus, law.linear), defocus)
    everywhere = (slice(None), slice(None))
    return Blurred(law, infocus, everywhere, aim, factors, noise_of(law, aim), spread)


def aligned(law: BlurLaw, light: NDArray[np.float32], defocus: Array) -> NDArray[np.float32]:
    """Return a defocus image aligned to the in-focus image, in the same unit."""
    defocus = ViewChange.of(law).undone(defocus)
    how = Alignment(0.0, 0.0, law.gain)
    if not (law.registered and law.even):
        seen = light_of(defocus, law.linear)
        found = find_alignment(light, seen, law.offset)
        how = Alignment(
            0.0 if law.registered else found.down,
            0.0 if law.registered else found.right,
            law.gain if law.even else found.gain,
        )
    return aim_of(defocus, law.linear, how, law.offset)


def blur(image: NDArray[np.float32], kernel: Array) -> NDArray[np.float32]:
    """Correlate an image (y, x, channel) with a 2-D kernel, repeating its edge outside."""
    rings = np.flatnonzero(np.abs(kernel).max(axis=0) > 1e-7)
    start = int(rings[0]) if rings.size else 0
    inner = kernel[start : kernel.shape[0] - start, start : kernel.shape[1] - start]
    blurred = cv2.filter2D(image, cv2.CV_32F, inner, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(blurred, np.float32).reshape(image.shape)


@lru_cache(maxsize=4)
def _few(law: BlurLaw) -> tuple[Array, NDArray[np.float32], NDArray[np.float64]]:
    kernels = law.kernels()
    radius = law.kernel_size // 2
    # In sums over the kernel, a tap off an axis also counts for its mirror images.
    times = np.where(np.arange(radius + 1) > 0, 2.0, 1.0)
    quadrants = kernels[:, radius:, radius:] * times[:, np.newaxis] * times
    chosen, factors = few_kernels(quadrants.reshape(len(kernels), -1), KERNEL_TOLERANCE)
    shares = np.square(kernels).sum(axis=(1, 2))
    return kernels[chosen], factors.astype(np.float32), shares


def few_kernels(planes: Array, tolerance: float) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Choose few kernels, and weights with which they sum to all kernels.

    Blurring is linear: images blurred with the few kernels sum to images blurred with any, by the
    same weights.

    Parameters
    ----------
    planes : ndarray of float64, shape (label, tap)
        The kernels; a tap that also counts for its mirror images is multiplied by their number.
    tolerance : float
        Largest sum of absolute differences between a kernel and the sum that replaces it.

    Returns
    -------
    chosen : ndarray of int
        Rows of the chosen kernels.
    factors : ndarray of float64, shape (chosen, label)
        The weight of each in the sum for a label.
    """
    rest, chosen = planes.copy(), list[int]()
    while len(chosen) < min(planes.shape):
        # Choose the worst approximated kernel, and remove its direction from all kernels.
        chosen.append(int(np.argmax(np.square(rest).sum(1))))
        along = rest[chosen[-1]] / np.linalg.norm(rest[chosen[-1]])
        rest -= np.outer(rest @ along, along)
        if np.abs(rest).sum(1).max() <= tolerance:
            break
    factors = np.linalg.lstsq(planes[chosen].T, planes.T, rcond=None)[0]
    return np.array(chosen), np.ascontiguousarray(factors)


def information(blurred: Blurred, levels: NDArray[np.intp]) -> float:
    """Return a pixel's Fisher information about its depth level, in levels^-2.

    It is the mean, over pixels and some levels, of the squared change from one level to the next,
    in units of the noise. Its root is one over the error of a level estimated from one pixel.

    Parameters
    ----------
    blurred : Blurred
        The pair.
    levels : ndarray of int
        The depth levels that `blurred` holds, ascending.
    """
    last = len(levels) - 1
    middles = np.linspace(0, last, min(_LOOKED_AT, last + 1)).astype(int)
    sums = np.zeros(len(middles))
    for band in blurred.bands():
        for place, middle in enumerate(middles):
            low, high = max(middle - 1, 0), min(middle + 1, last)
            change = blurred.factors[:, high] - blurred.factors[:, low]
            slope = band.nodes @ change / np.float32(levels[high] - levels[low])
            sums[place] += np.square(slope / band.noise).sum(axis=2).sum(dtype=np.float64)
    found = sums / math.prod(blurred.aim.shape[:2]) / blurred.spread[middles]
    return math.fsum(found) / len(found)


def information_at(blurred: Blurred, levels: NDArray[Any]) -> NDArray[np.float64]:
    """Return each pixel's Fisher information about its own depth level, shape (y, x).

    Its inverse root is the least standard deviation, in levels, of an unbiased estimate from this
    pixel alone (Cramér and Rao). With normal noise whose mean m and variance v depend on the level,
    a channel contributes ``m'^2 / v + (v' / v)^2 / 2``.

    Parameters
    ----------
    blurred : Blurred
        The pair, at all levels of its law.
    levels : ndarray of int, shape (y, x)
        The depth level of each pixel.
    """
    # Slopes are central differences, one-sided at the ends of the scale.
    slopes = np.gradient(blurred.factors, axis=1)
    # Blur does not change bare surfaces, but the few kernels do slightly, which would add up over
    # wide windows.
    slopes -= slopes.mean(axis=0)
    change = np.zeros(blurred.aim.shape, np.float32)
    for node, slope in enumerate(slopes.astype(np.float32)):
        change += blurred.nodes[..., node] * slope[levels][..., np.newaxis]
    told = np.square(change / blurred.noise).sum(axis=2, dtype=np.float64)
    wider = np.square(np.gradient(np.log(blurred.spread))) * blurred.aim.shape[2] / 2
    return np.asarray(told / blurred.spread[levels] + wider[levels])
