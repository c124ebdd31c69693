"""Measure a blur law from training pairs: width, shape, brightness and noise.

The methods that use the law inherit `dfdbench.methods.fitted.Calibrated`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize, nnls

from dfdbench.blur.law import GREYS, BlurLaw, noise_at
from dfdbench.blur.point_spread import point_spread_functions
from dfdbench.blur.recipe import LAST_LEVEL, LEVELS
from dfdbench.methods import alignment, width_curve
from dfdbench.methods.blurred import blur
from dfdbench.methods.fitted import Array, part_of
from dfdbench.methods.measured_law import Calibration
from dfdbench.methods.method import TrainingPair
from dfdbench.methods.stacks import require_alike, sharp_and_blurred, view_and_blurred
from dfdbench.methods.view_change import Images, ViewChange, find_change
from dfdbench.system.compiled import in_threads

#: Side of the kernels that are tried, in pixels.
KERNEL_SIZE = 27
_GAUSSIAN = 2.0
# How many pairs to use, evenly among all, and the side of the part of each: a minute's work.
_PAIRS = 16
# How many whole images to use for what the camera changes besides the blur.
_VIEWS = 8
_SIDE = 320
# A pixel counts if the depth within a window of this side around it spans at most this many levels.
_WINDOW = 11
_SPAN = 10
# Above this the defocus image may be clipped.
_BRIGHT = 253
# A pixel has texture if blurs of these two widths, in pixels, differ by this many grey levels.
_NARROW, _WIDE = 1.0, 3.0
_LEAST_TEXTURE = 1.0
# A level of which a smaller share of pixels has texture does not count; few pixels do no harm.
_TEXTURED = 0.1
_MANY_PIXELS = 200


@dataclass(frozen=True)
class Way:
    """How defocus images may come about, apart from the widths."""

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

    def found(self, linear: bool) -> alignment.Alignment:
        """Return the shift and gain of the defocus image against the in-focus image."""
        images = alignment.light_of(self.infocus, linear), alignment.light_of(self.defocus, linear)
        return alignment.find_alignment(*images)

    def sample(self, way: Way, turned: bool = False) -> Sample:
        """Return the pixels that count; `turned` shifts the defocus image the wrong way."""
        how = alignment.Alignment(0.0, 0.0, way.gain)
        if not (way.registered and way.even):
            found = self.found(way.linear)
            sign = 0 if way.registered else -1 if turned else 1
            gain = way.gain if way.even else found.gain
            how = alignment.Alignment(sign * found.down, sign * found.right, gain)
        light = alignment.light_of(self.infocus, way.linear)
        aim = alignment.aim_of(self.defocus, way.linear, how, way.offset)
        grey = alignment.smooth_grey(aim, way.linear)[self.counts][:, 0]
        shown = aim[self.counts][:, 0].astype(np.float64)
        return Sample(light, shown, grey, self.depth[self.counts], self.counts)


@dataclass(frozen=True)
class Sample:
    """The light (y, x, 1) of a part to blur, and for each pixel that counts what to explain.

    That is its light in the defocus image, the grey level around it, which gives its noise, and its
    depth.
    """

    light: NDArray[np.float32]
    aim: NDArray[np.float64]
    grey: NDArray[np.float64]
    depth: NDArray[np.int64]
    counts: NDArray[np.bool_]

    def trials(self, kernels: Array) -> Iterator[NDArray[np.float64]]:
        """Yield the light expected after the blur by each kernel: float64, shape (pixel,)."""
        for kernel in kernels:
            yield blur(self.light, kernel)[self.counts][:, 0].astype(np.float64)


def parts_of(
    captures: Sequence[TrainingPair], changes: Sequence[ViewChange] = (ViewChange(),)
) -> list[list[Part]]:
    """Return the parts of each defocus image, with its `changes` undone.

    They are spread evenly over all captures and are the same each time. If a depth level occurs
    only on bare surfaces, none of its pixels count. There, rounding is the only difference between
    the two images, and looks like a blur width, the same one in every pixel.
    """
    parts: list[list[Part]] = []
    for number, place in enumerate(_places(len(captures))):
        capture = captures[place]
        region = part_of(capture.levels.shape, number, _SIDE)
        known = capture.levels[region], capture.valid[region]
        infocus, images = sharp_and_blurred(capture.stack, changes)
        # The changes are about the middle of the whole image.
        images = [c.undone(image)[region] for c, image in zip(changes, images, strict=True)]
        parts.append([_part(infocus[region], image, *known) for image in images])
    return [_without_bare(each) for each in zip(*parts, strict=True)]


def _changes(captures: Sequence[TrainingPair]) -> list[ViewChange]:
    """Return what the camera changes in each defocus image besides the blur."""
    seen: list[list[Images]] = []
    for place in _places(len(captures), _VIEWS):
        infocus, images = view_and_blurred(captures[place].stack)
        seen.append([Images.small(infocus, image) for image in images])
    return [find_change(each) for each in zip(*seen, strict=True)]


def _places(count: int, most: int = _PAIRS) -> list[int]:
    even = np.linspace(0, count - 1, min(most, count)).round()
    return sorted(set(even.astype(int).tolist()))


def _without_bare(parts: Sequence[Part]) -> list[Part]:
    """Leave out depth levels that have many pixels, but hardly any with texture."""
    pixels, textured = np.zeros(LEVELS), np.zeros(LEVELS)
    for part in parts:
        grey = part.infocus[..., 0].astype(np.float32)
        narrow, wide = (cv2.GaussianBlur(grey, (0, 0), sigma) for sigma in (_NARROW, _WIDE))
        texture = np.abs(narrow - wide) >= _LEAST_TEXTURE
        pixels += np.bincount(part.depth[part.counts], minlength=LEVELS)
        textured += np.bincount(part.depth[part.counts & texture], minlength=LEVELS)
    bare = (pixels >= _MANY_PIXELS) & (textured < _TEXTURED * pixels)
    return [replace(part, counts=part.counts & ~bare[part.depth]) for part in parts]


def _part(infocus: Array, defocus: Array, depth: Array, valid: Array) -> Part:
    # Green, a camera's least noisy channel, says as much about the blur as all three.
    middle = slice(infocus.shape[2] // 2, infocus.shape[2] // 2 + 1)
    defocus = defocus[..., middle]
    counts = _flat(depth, valid) & (defocus[..., 0] <= _BRIGHT)
    return Part(infocus[..., middle], defocus, depth.astype(np.int64), counts)


def _flat(depth: NDArray[np.uint8], valid: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return where the depth around a pixel is known and spans few levels, away from the border."""
    window = np.ones((_WINDOW, _WINDOW), np.uint8)
    low = cv2.erode(np.where(valid, depth, 0).astype(np.uint8), window).astype(int)
    high = cv2.dilate(np.where(valid, depth, 255).astype(np.uint8), window).astype(int)
    flat = high - low <= _SPAN
    margin = KERNEL_SIZE // 2
    flat[:margin], flat[-margin:], flat[:, :margin], flat[:, -margin:] = False, False, False, False
    return np.asarray(flat)


# About how many of the parts are used to choose the shape.
_FEW = 4
# The exponents p of the kernels to try.
_EXPONENTS = (2.0, 3.0, 4.0, 6.0, 8.0, 16.0, 32.0)
# A more complex model has to leave less than this share of the squared differences.
_BETTER = 0.97
_MUCH_BETTER = 0.8
_ROUNDS = 3
# In grey levels; a smaller offset counts as none.
_LEAST_OFFSET = 0.5
# Fewer pixels are not enough to measure the noise at a grey level.
_FEW_PIXELS = 200


def calibrate(pairs: Sequence[TrainingPair]) -> Calibration:
    """Measure the blur law of training pairs.

    Parameters
    ----------
    pairs : sequence of TrainingPair
        Some of them are used, the same ones each time.

    Raises
    ------
    MethodError
        If no pixel of known depth shows any blur, or if the pairs differ in aperture.

    Notes
    -----
    The in-focus image is blurred at a ladder of widths. For each depth level, the squared
    difference from the defocus image is summed over pixels around which the depth is nearly
    constant. As a function of the width, its minimum gives the level's width. The noise of the
    in-focus image, which blur reduces, is subtracted. The widths of all levels are smoothed by a
    curve of least bending (Whittaker), each weighted by the sharpness of its minimum, so levels
    that training lacks follow their neighbours. Beyond all levels that training shows, the curve
    does not turn back to the widths of other levels (`held_at_ends`), and an end that turns back
    nonetheless continues straight (`grown_from_focus`). The kernel shape, and blur in grey levels
    or in linear light, are chosen by the least difference.
    """
    return calibrate_images(pairs)[0]


def calibrate_images(captures: Sequence[TrainingPair]) -> list[Calibration]:
    """Measure the blur law of each defocus image of training captures: pairs, or stacks.

    If there is no image in focus everywhere, the stack's sharpest pixels replace it.

    Raises
    ------
    MethodError
        As for `calibrate`, and if captures are focused at different depths.
    """
    require_alike(captures)
    changes = _changes(captures)
    parts = parts_of(captures, changes)
    return [_calibrated(each, change) for each, change in zip(parts, changes, strict=True)]


def _calibrated(parts: Sequence[Part], change: ViewChange) -> Calibration:
    few = parts[:: max(1, len(parts) // _FEW)]
    way = _way(few)
    # Choose the shape first: gain and offset would compensate for a wrong one.
    way = replace(way, exponent=_exponent(few, way))
    if way.even and not way.linear:
        gain, offset = _line([part.sample(way) for part in few], way)
        if abs(offset) > _LEAST_OFFSET:
            way = replace(way, gain=way.gain * gain, offset=way.offset + way.gain * offset)
            way = replace(way, exponent=_exponent(few, way))
    samples = [part.sample(way) for part in parts]
    sums, pixels = _sums(samples[:: len(parts) // len(few)], way)
    rough = width_curve.width_curve(sums, pixels)
    _, noise = _residuals(samples[:: len(parts) // len(few)], way, rough)
    sums, pixels = _sums(samples, way, noise)
    sigmas, infocus_noise = _cleared_curve(sums, pixels, way)
    sigmas = width_curve.grown_from_focus(width_curve.held_at_ends(sigmas, pixels), pixels)
    residual, noise = _residuals(samples, way, sigmas)
    # The residual includes the in-focus image's noise: see `BlurLaw.noise`.
    shares = np.interp(sigmas, width_curve.LADDER, _shares(way))
    both = float(np.average(1 + infocus_noise**2 * shares, weights=pixels))
    law = BlurLaw(
        sigmas=tuple(sigmas.tolist()),
        kernel_size=KERNEL_SIZE,
        noise=tuple((noise / math.sqrt(both)).tolist()),
        infocus_noise=infocus_noise,
        similarity=change.similarity,
        falloff=change.falloff,
        **asdict(way),
    )
    widths = np.where(pixels > 0, width_curve.best_widths(sums)[0], np.nan)
    return Calibration(law, widths, pixels, residual, change.uneven)


def _way(few: Sequence[Part]) -> Way:
    """Choose what fits better: grey levels or light, pairs as they are or aligned."""
    best, least = Way(), _misfit(few, Way())
    gains = {
        linear: float(np.median([part.found(linear).gain for part in few]))
        for linear in (False, True)
    }

    def with_offset() -> Way:
        start = Way(gain=gains[False])
        gain, offset = _line([part.sample(start) for part in few], start)
        return replace(start, gain=start.gain * gain, offset=start.gain * offset)

    changes: tuple[Callable[[Way], Way], ...] = (
        lambda way: replace(way, linear=True),
        lambda way: replace(way, gain=gains[way.linear]),
        lambda way: replace(way, gain=gains[way.linear], even=False),
        # Before the gain was known, grey levels may have fitted better.
        lambda way: Way(linear=True, gain=gains[True]),
        lambda way: Way(linear=True, gain=gains[True], even=False),
        # Where scenes differ in brightness, an offset looks like a gain of each pair.
        lambda way: way if way.even else with_offset(),
    )
    tried = {best}
    for change in changes:
        way = change(best)
        if way in tried:
            continue
        tried.add(way)
        misfit = _misfit(few, way)
        if misfit < _BETTER * least:
            best, least = way, misfit
    # Shifting an image smooths it a little, so compare with an equal shift the wrong way.
    way = replace(best, registered=False)
    return way if _misfit(few, way) < _MUCH_BETTER * _misfit(few, way, turned=True) else best


def _exponent(few: Sequence[Part], way: Way) -> float:
    return min(_EXPONENTS, key=lambda exponent: _misfit(few, replace(way, exponent=exponent)))


def _misfit(few: Sequence[Part], way: Way, turned: bool = False) -> float:
    samples = [part.sample(way, turned) for part in few]
    return float(width_curve.best_widths(_sums(samples, way)[0])[2].sum())


def _kernels(way: Way) -> NDArray[np.float64]:
    """Return the kernel of each width of the ladder, shape (width, y, x)."""
    return point_spread_functions(width_curve.LADDER, KERNEL_SIZE, way.exponent)


def _shares(way: Way) -> NDArray[np.float64]:
    """Return the share of the in-focus image's noise variance that is left at each width."""
    return np.asarray(np.square(_kernels(way)).sum(axis=(1, 2)))


def _sums(
    samples: Sequence[Sample], way: Way, noise: Array | None = None
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return squared differences by depth level and width, and the number of pixels.

    They are in units of the noise or, without it, in grey levels, so that ways can be compared.
    """
    kernels = _kernels(way)

    def squares(sample: Sample) -> Array:
        own = 1.0 if noise is None else noise_at(noise, sample.grey)
        aim = sample.aim if noise is not None else alignment.grey_of(sample.aim, way.linear)
        found = np.empty((LEVELS, len(kernels)))
        for number, trial in enumerate(sample.trials(kernels)):
            shown = trial if noise is not None else alignment.grey_of(trial, way.linear)
            left = np.square((shown - aim) / own)
            found[:, number] = np.bincount(sample.depth, left, LEVELS)
        return found

    sums = np.zeros((LEVELS, width_curve.LADDER.size))
    pixels = np.zeros(LEVELS, np.int64)
    for sample, found in zip(samples, in_threads(squares, samples), strict=True):
        pixels += np.bincount(sample.depth, minlength=LEVELS)
        sums += found
    return sums, pixels


def _line(samples: Sequence[Sample], way: Way) -> tuple[float, float]:
    """Return the best gain and offset of the defocus images, with each level at its width.

    Lower contrast looks like more blur, so gain and widths have to be found together.
    """
    trials = np.zeros((3, LEVELS, width_curve.LADDER.size))
    aims = np.zeros((3, LEVELS, 1))
    kernels = _kernels(way)
    for sample in samples:
        depth, aim = sample.depth, sample.aim.astype(np.float64)
        for total, values in zip(aims, (np.ones(aim.size), aim, aim**2), strict=True):
            total[:, 0] += np.bincount(depth, values, LEVELS)
        for number, trial in enumerate(sample.trials(kernels)):
            for total, values in zip(trials, (trial, trial**2, trial * aim), strict=True):
                total[:, number] += np.bincount(depth, values, LEVELS)
    (count, aim_sum, aim_square), (trial_sum, trial_square, both) = aims, trials

    def left(line: NDArray[np.float64]) -> float:
        gain, offset = line
        squares = aim_square - 2 * gain * both - 2 * offset * aim_sum
        squares = squares + gain**2 * trial_square + 2 * gain * offset * trial_sum
        return float(width_curve.best_widths(squares + offset**2 * count)[2].sum())

    start = np.array([[1.0, 0.0], [0.95, 0.0], [1.0, 4.0]])
    options = {"initial_simplex": start, "xatol": 1e-3, "fatol": 1e-4, "maxfev": 120}
    gain, offset = minimize(left, start[0], method="Nelder-Mead", options=options).x
    return float(gain), float(offset)


def _residuals(
    samples: Sequence[Sample], way: Way, sigmas: Array
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the root mean square residual at some widths.

    It is given by depth level, in grey levels, and by grey level, in the unit of a law's noise.
    """
    by_level, by_grey = np.zeros((2, LEVELS)), np.zeros((2, GREYS))
    place = np.interp(sigmas, width_curve.LADDER, np.arange(width_curve.LADDER.size))
    first = np.clip(place.astype(int), 0, width_curve.LADDER.size - 2)
    part = place - first
    kernels = _kernels(way)
    for sample in samples:
        steps, weights = first[sample.depth], part[sample.depth]
        # Between two widths of the ladder, linear interpolation of blurred images is close enough.
        fit = np.zeros(sample.aim.shape)
        for number, trial in enumerate(sample.trials(kernels)):
            fit += np.where(steps == number, (1 - weights) * trial, 0)
            fit += np.where(steps + 1 == number, weights * trial, 0)
        left = alignment.grey_of(fit, way.linear) - alignment.grey_of(sample.aim, way.linear)
        tones = np.rint(sample.grey * (GREYS - 1) / LAST_LEVEL).astype(int)
        for sums, where, squares in (
            (by_level, sample.depth, np.square(left)),
            (by_grey, tones, np.square(fit - sample.aim)),
        ):
            sums[0] += np.bincount(where, squares, sums.shape[1])
            sums[1] += np.bincount(where, minlength=sums.shape[1])
    level, tone = (
        np.where(sums[1] > 0, np.sqrt(sums[0] / np.maximum(sums[1], 1)), np.nan)
        for sums in (by_level, by_grey)
    )
    known = np.flatnonzero(by_grey[1] >= _FEW_PIXELS)
    tone = np.interp(np.arange(GREYS), known, tone[known]) if known.size else np.ones(GREYS)
    greys = np.linspace(0, LAST_LEVEL, GREYS)
    return level, np.maximum(tone, alignment.rounding_at(greys, way.linear))


def _cleared_curve(sums: Array, pixels: Array, way: Way) -> tuple[NDArray[np.float64], float]:
    """Return the widths by depth level, and the in-focus image's noise relative to the other's."""
    shares = _shares(way)
    infocus_noise = 0.0
    for _ in range(_ROUNDS):
        cleared = sums - infocus_noise**2 * pixels[:, np.newaxis] * shares
        sigmas = width_curve.width_curve(cleared, pixels)
        left = width_curve.left_at(sums, sigmas) / np.maximum(pixels, 1)
        root = np.sqrt(pixels)
        terms = np.stack([root, root * np.interp(sigmas, width_curve.LADDER, shares)], axis=1)
        own, blurred = nnls(terms, root * left)[0]
        infocus_noise = min(math.sqrt(blurred / own), 1.0) if own else 1.0
    return sigmas, infocus_noise
