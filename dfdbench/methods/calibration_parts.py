"""What `calibration.py` looks at: parts of training pairs, and the pixels of them that count."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.point_spread import point_spread_functions
from dfdbench.blur.recipe import LAST_LEVEL, LEVELS
from dfdbench.methods.alignment import Alignment, find_alignment
from dfdbench.methods.fit import TrainingPair
from dfdbench.methods.law_cost import blur
from dfdbench.methods.light import aim_of, light_of, smooth_grey
from dfdbench.methods.width_curve import LADDER

#: Side of the kernels that are tried, in pixels.
KERNEL_SIZE = 27
_GAUSSIAN = 2.0
# Pairs that are looked at, evenly among all, and the side of the part of each: a minute's work.
_PAIRS = 16
_SIDE = 320
# A pixel counts where the depth around it, a window of so many pixels, spans so many levels only.
_WINDOW = 11
_SPAN = 10
# The defocus image may be cut off above.
_BRIGHT = 253
# Texture is what blurs of two widths, in pixels, differ by, so many grey levels or more.
_NARROW, _WIDE = 1.0, 3.0
_LEAST_TEXTURE = 1.0
# A level with less texture, as a part of its pixels, does not count; few pixels mislead nobody.
_TEXTURED = 0.1
_MANY_PIXELS = 200


@dataclass(frozen=True)
class Way:
    """How defocus images may come about, but for the widths."""

    exponent: float = _GAUSSIAN
    linear: bool = False
    registered: bool = True
    even: bool = True
    gain: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class Part:
    """Part of a pair, (y, x, 1), the depth levels there, and which pixels count."""

    infocus: NDArray[np.uint8]
    defocus: NDArray[np.uint8]
    depth: NDArray[np.int64]
    counts: NDArray[np.bool_]

    def found(self, linear: bool) -> Alignment:
        """Return how the defocus image lies to the in-focus image."""
        images = light_of(self.infocus, linear), light_of(self.defocus, linear)
        return find_alignment(*images, LAST_LEVEL)

    def sample(self, way: Way, turned: bool = False) -> Sample:
        """Return what counts of it; `turned` moves the defocus image the wrong way."""
        how = Alignment(0.0, 0.0, way.gain)
        if not (way.registered and way.even):
            found = self.found(way.linear)
            sign = 0 if way.registered else -1 if turned else 1
            gain = way.gain if way.even else found.gain
            how = Alignment(sign * found.down, sign * found.right, gain)
        light = light_of(self.infocus, way.linear)
        aim = aim_of(self.defocus, way.linear, how, way.offset)
        return Sample(
            light,
            aim[self.counts][:, 0].astype(np.float64),
            smooth_grey(aim, way.linear)[self.counts][:, 0],
            self.depth[self.counts],
            self.counts,
        )


@dataclass(frozen=True)
class Sample:
    """What counts of a part: light (y, x, 1) to blur; of the pixels what there is to explain.

    That is their light, the grey level about them by which their noise is looked up, their depth.
    """

    light: NDArray[np.float32]
    aim: NDArray[np.float64]
    grey: NDArray[np.float64]
    depth: NDArray[np.int64]
    counts: NDArray[np.bool_]

    def trials(self, way: Way) -> Iterator[NDArray[np.float64]]:
        """Yield the light that each width of the ladder would give: float64, shape (pixel,)."""
        for kernel in point_spread_functions(LADDER, KERNEL_SIZE, way.exponent):
            yield blur(self.light, kernel)[self.counts][:, 0].astype(np.float64)


def parts_of(pairs: Sequence[TrainingPair]) -> list[Part]:
    """Return a part of each of some pairs, evenly among all; the same ones each time.

    Of a depth level that is seen on bare surfaces alone no pixel counts: how grey levels happen to
    be rounded there looks like a width, the same one in every pixel.

    Parameters
    ----------
    pairs : sequence of TrainingPair
        One or more.
    """
    places = np.unique(np.linspace(0, len(pairs) - 1, min(_PAIRS, len(pairs))).round().astype(int))
    parts = [_part(pairs[int(place)], number) for number, place in enumerate(places)]
    bare = _bare_levels(parts)
    return [replace(part, counts=part.counts & ~bare[part.depth]) for part in parts]


def _bare_levels(parts: Sequence[Part]) -> NDArray[np.bool_]:
    """Return of which depth levels many pixels are seen, and hardly one with texture: (level,)."""
    pixels, textured = np.zeros(LEVELS), np.zeros(LEVELS)
    for part in parts:
        grey = part.infocus[..., 0].astype(np.float32)
        narrow, wide = (cv2.GaussianBlur(grey, (0, 0), sigma) for sigma in (_NARROW, _WIDE))
        texture = np.abs(narrow - wide) >= _LEAST_TEXTURE
        pixels += np.bincount(part.depth[part.counts], minlength=LEVELS)
        textured += np.bincount(part.depth[part.counts & texture], minlength=LEVELS)
    return np.asarray((pixels >= _MANY_PIXELS) & (textured < _TEXTURED * pixels))


def _part(pair: TrainingPair, number: int) -> Part:
    # Of a large image one part, another of each pair: left, middle, right, and so on.
    where = []
    for size, turn in zip(pair.depth.shape, (number // 3, number), strict=True):
        start = (size - min(size, _SIDE)) * (turn % 3) // 2
        where.append(slice(start, start + _SIDE))
    rows, columns = where
    infocus, defocus = pair.infocus[rows, columns], pair.defocus[rows, columns]
    depth, valid = pair.depth[rows, columns], pair.valid[rows, columns]
    # One channel, the least noisy of a camera, tells as much of the blur as three.
    middle = slice(infocus.shape[2] // 2, infocus.shape[2] // 2 + 1)
    defocus = defocus[..., middle]
    counts = _flat(depth, valid) & (defocus[..., 0] <= _BRIGHT)
    return Part(infocus[..., middle], defocus, depth.astype(np.int64), counts)


def _flat(depth: NDArray[np.uint8], valid: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return where the depth about a pixel is known and spans few levels, away from the border."""
    window = np.ones((_WINDOW, _WINDOW), np.uint8)
    low = cv2.erode(np.where(valid, depth, 0).astype(np.uint8), window).astype(int)
    high = cv2.dilate(np.where(valid, depth, 255).astype(np.uint8), window).astype(int)
    flat = high - low <= _SPAN
    margin = KERNEL_SIZE // 2
    flat[:margin], flat[-margin:], flat[:, :margin], flat[:, -margin:] = False, False, False, False
    return np.asarray(flat)
