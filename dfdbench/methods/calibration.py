"""A blur law measured from training pairs: how wide, of which shape, how bright, how noisy."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import nnls

from dfdbench.blur.formation import decode, encode
from dfdbench.blur.law import BlurLaw
from dfdbench.blur.point_spread import point_spread_functions
from dfdbench.blur.recipe import LEVELS
from dfdbench.errors import MethodError
from dfdbench.methods.alignment import Alignment, find_alignment, undo
from dfdbench.methods.fit import Learned, TrainingPair
from dfdbench.methods.law_cost import blur

Array = NDArray[Any]

# Pairs that are looked at, evenly among all, and the side of the part of each: a minute's work.
_PAIRS = 12
_SIDE = 320
# Of them, those from which the shape is chosen.
_SHAPE_PAIRS = 4
_KERNEL_SIZE = 27
# Widths that are tried; between them the residual is a smooth curve.
_LADDER = np.geomspace(0.22, 6.4, 33)
_FINE = np.geomspace(_LADDER[0], _LADDER[-1], 16 * (_LADDER.size - 1) + 1)
# p of the kernels that are tried.
_EXPONENTS = (2.0, 3.0, 4.0, 6.0, 8.0, 16.0, 32.0)
# A pixel counts where the depth around it, a window of so many pixels, spans so many levels only.
_WINDOW = 11
_SPAN = 10
# The defocus image may be cut off above.
_BRIGHT = 253
_MOVED = 0.08
_BRIGHTER = 0.004
_ROUNDS = 3


@dataclass(frozen=True)
class Calibration:
    """A blur law, and what it was measured from.

    Parameters
    ----------
    law : BlurLaw
        The law.
    measured : ndarray of float64, shape (level,)
        The width that fits each depth level best by itself; NaN where no pixel counted.
    pixels : ndarray of int64, shape (level,)
        How many pixels counted.
    residual : ndarray of float64, shape (level,)
        Root mean square in grey levels of what the law leaves unexplained; NaN without pixels.
    """

    law: BlurLaw
    measured: NDArray[np.float64]
    pixels: NDArray[np.int64]
    residual: NDArray[np.float64]

    def as_learned(self) -> Learned:
        """Return it as a method's fit returns it."""
        law = self.law.as_dict()
        return {
            **{name: np.array(value) for name, value in law.items()},
            "measured": self.measured,
            "pixels": self.pixels,
            "residual": self.residual,
        }

    @classmethod
    def of(cls, learned: Learned) -> Calibration:
        """Return what `as_learned` gave."""
        fields = dict(learned)
        measured, pixels, residual = (
            np.asarray(fields.pop(name)) for name in ("measured", "pixels", "residual")
        )
        sigmas = tuple(np.asarray(fields.pop("sigmas")).tolist())
        return cls(BlurLaw(sigmas=sigmas, **fields), measured, pixels, residual)  # type: ignore[arg-type]


def calibrate(pairs: Sequence[TrainingPair]) -> Calibration:
    """Measure the blur law of training pairs.

    Parameters
    ----------
    pairs : sequence of TrainingPair
        Of them some are looked at, the same ones each time.

    Raises
    ------
    MethodError
        Where no pixel of known depth shows any blur.

    Notes
    -----
    The in-focus image is blurred at a ladder of widths. For each depth level the squared
    difference to the defocus image, summed over the pixels around which the depth is about the
    same, is a curve over the width, and its least value tells the width. What noise of the
    in-focus image adds, which blur lessens, is taken off. The widths of all levels are smoothed by
    a curve of least bending (Whittaker), each weighted by how sharp its minimum is, so that levels
    that training lacks lie on the curve through their neighbours. Of the shapes, and of blur in
    grey levels or in linear light, that with the least difference is taken.
    """
    if not len(pairs):
        raise MethodError("no pair to calibrate with", expected="one training pair or more")
    parts = [_part(pair, number) for number, pair in _chosen(pairs)]
    registered, even, gain = _alignments(parts)
    parts = [_aligned(part, registered, even, gain) for part in parts]
    few = parts[:: max(1, len(parts) // _SHAPE_PAIRS)]
    ways = [(exponent, linear) for linear in (False, True) for exponent in _EXPONENTS]
    exponent, linear = min(ways, key=lambda way: _misfit(few, *way))
    sums, pixels = _sums(parts, exponent, linear, _LADDER)
    shares = np.square(point_spread_functions(_LADDER, _KERNEL_SIZE, exponent)).sum(axis=(1, 2))
    channels = parts[0].defocus.shape[2]
    infocus_noise = 0.0
    for _ in range(_ROUNDS):
        noisy = channels * infocus_noise**2 * pixels[:, np.newaxis] * shares
        widths, sharpness, least = _widths(sums - noisy, pixels)
        if not sharpness.any():
            raise MethodError(
                "the training pairs do not show how their blur depends on depth",
                expected="texture at known depth, away from jumps in depth and from the border",
                got=f"{int(pixels.sum())} pixels that count",
            )
        variance = np.maximum(least / np.maximum(channels * pixels, 1), 1 / 12)
        sigmas = np.clip(_smooth(widths, sharpness / (2 * variance)), _LADDER[0], _LADDER[-1])
        rows = CubicSpline(np.log(_LADDER), sums, axis=1)
        left = np.array([rows(np.log(sigma))[level] for level, sigma in enumerate(sigmas)])
        left = np.maximum(left, 0) / np.maximum(channels * pixels, 1)
        left_of_noise = np.interp(sigmas, _LADDER, shares)
        root = np.sqrt(pixels)
        terms = np.stack([root, root * left_of_noise], axis=1)
        (own, blurred), _ = nnls(terms, root * left)
        infocus_noise = math.sqrt(blurred)
    law = BlurLaw(
        sigmas=tuple(sigmas.tolist()),
        exponent=exponent,
        kernel_size=_KERNEL_SIZE,
        gain=gain,
        noise=math.sqrt(own),
        infocus_noise=infocus_noise,
        linear=linear,
        registered=registered,
        even=even,
    )
    seen = pixels > 0
    return Calibration(
        law, np.where(seen, widths, np.nan), pixels, np.where(seen, np.sqrt(left), np.nan)
    )


def _chosen(pairs: Sequence[TrainingPair]) -> Iterator[tuple[int, TrainingPair]]:
    places = np.unique(np.linspace(0, len(pairs) - 1, min(_PAIRS, len(pairs))).round().astype(int))
    for number, place in enumerate(places):
        yield number, pairs[int(place)]


@dataclass(frozen=True)
class _Part:
    infocus: NDArray[np.float32]
    defocus: NDArray[np.float32]
    depth: NDArray[np.int64]
    counts: NDArray[np.bool_]


def _part(pair: TrainingPair, number: int) -> _Part:
    # Of a large image one part, another of each pair: left, middle, right, and so on.
    where = []
    for size, turn in zip(pair.depth.shape, (number // 3, number), strict=True):
        start = (size - min(size, _SIDE)) * (turn % 3) // 2
        where.append(slice(start, start + _SIDE))
    infocus, defocus, depth, valid = (
        np.asarray(array[tuple(where)])
        for array in (pair.infocus, pair.defocus, pair.depth, pair.valid)
    )
    return _Part(
        infocus.astype(np.float32),
        defocus.astype(np.float32),
        depth.astype(np.int64),
        _flat(depth, valid) & (defocus.max(axis=2) <= _BRIGHT),
    )


def _flat(depth: NDArray[np.uint8], valid: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return where the depth about a pixel is known and spans few levels, away from the border."""
    window = np.ones((_WINDOW, _WINDOW), np.uint8)
    low = cv2.erode(np.where(valid, depth, 0).astype(np.uint8), window).astype(int)
    high = cv2.dilate(np.where(valid, depth, 255).astype(np.uint8), window).astype(int)
    flat = high - low <= _SPAN
    margin = _KERNEL_SIZE // 2
    flat[:margin], flat[-margin:], flat[:, :margin], flat[:, -margin:] = False, False, False, False
    return np.asarray(flat)


def _alignments(parts: Sequence[_Part]) -> tuple[bool, bool, float]:
    """Return whether pairs are registered, whether their gain is the same, and its mean."""
    found = [find_alignment(part.infocus, part.defocus) for part in parts]
    away = float(np.median([math.hypot(each.down, each.right) for each in found]))
    gains = np.array([each.gain for each in found])
    even = float(np.median(np.abs(gains - np.median(gains)))) < _BRIGHTER
    gain = float(np.median(gains))
    return away < _MOVED, even, gain if abs(gain - 1) >= _BRIGHTER or not even else 1.0


def _aligned(part: _Part, registered: bool, even: bool, gain: float) -> _Part:
    found = find_alignment(part.infocus, part.defocus)
    place = (0.0, 0.0) if registered else (found.down, found.right)
    return replace(
        part, defocus=undo(Alignment(*place, gain if even else found.gain), part.defocus)
    )


def _light(part: _Part, linear: bool) -> NDArray[np.float32]:
    return decode(part.infocus).astype(np.float32) if linear else part.infocus


def _sums(
    parts: Sequence[_Part], exponent: float, linear: bool, ladder: Array
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the squared differences by depth level and width, and the pixels by depth level."""
    kernels = point_spread_functions(ladder, _KERNEL_SIZE, exponent)
    sums = np.zeros((LEVELS, ladder.size))
    pixels = np.zeros(LEVELS, np.int64)
    for part in parts:
        light = _light(part, linear)
        depth = part.depth[part.counts]
        aim = part.defocus[part.counts]
        pixels += np.bincount(depth, minlength=LEVELS)
        for number, kernel in enumerate(kernels):
            trial = blur(light, kernel)[part.counts]
            if linear:
                trial = encode(trial)
            squares = np.square(trial - aim).sum(axis=1)
            sums[:, number] += np.bincount(depth, squares, LEVELS)
    return sums, pixels


def _misfit(parts: Sequence[_Part], exponent: float, linear: bool) -> float:
    ladder = _LADDER[::2]
    sums, pixels = _sums(parts, exponent, linear, ladder)
    fine = np.geomspace(ladder[0], ladder[-1], 8 * (ladder.size - 1) + 1)
    curves = CubicSpline(np.log(ladder), sums[pixels > 0], axis=1)(np.log(fine))
    return float(curves.min(axis=1).sum())


def _widths(
    sums: Array, pixels: Array
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the width of least difference by level, how sharp it is, and the difference there."""
    curves = CubicSpline(np.log(_LADDER), sums, axis=1)
    values = curves(np.log(_FINE))
    best = values.argmin(axis=1)
    inner = np.clip(best, 1, _FINE.size - 2)
    rows = np.arange(len(sums))
    before, here, after = (values[rows, inner + step] for step in (-1, 0, 1))
    bend = before - 2 * here + after
    safe = np.where(bend > 0, bend, 1)
    step = np.where(bend > 0, np.clip(0.5 * (before - after) / safe, -1, 1), 0)
    widths = np.exp(np.interp(inner + step, np.arange(_FINE.size), np.log(_FINE)))
    spacing = _FINE[inner] * math.log(_FINE[1] / _FINE[0])
    sharpness = np.where((pixels > 0) & (bend > 0), bend / spacing**2, 0.0)
    return widths, sharpness, np.maximum(values[rows, best], 0)


def _smooth(values: Array, weights: Array) -> NDArray[np.float64]:
    """Return the curve of least bending through weighted values (Whittaker 1923).

    How much it may bend is chosen by generalised cross validation.
    """
    count = len(values)
    bends = np.diff(np.eye(count), 2, axis=0)
    penalty = bends.T @ bends
    known = weights > 0
    target = np.where(known, values, 0.0)
    best, found = math.inf, target
    for strength in np.geomspace(1e-2, 1e10, 25) * np.median(weights[known]):
        hat = np.linalg.solve(np.diag(weights) + strength * penalty, np.diag(weights))
        curve = hat @ target
        freedom = max(1 - np.trace(hat) / known.sum(), 1e-6)
        score = float((weights * np.square(target - curve)).sum()) / freedom**2
        if score < best:
            best, found = score, curve
    return found
