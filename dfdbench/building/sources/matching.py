"""Align a captured pair, match its brightness, and measure whether this is needed."""

import cmath
import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.light import decode
from dfdbench.datasets.captured_files import Align
from dfdbench.errors import InputError
from dfdbench.methods.view_change import Images, ViewChange, find_change, resampled

Image = NDArray[np.uint8]
Mask = NDArray[np.bool_]
Motion = Literal["translation", "euclidean", "similarity"]

_MOTIONS = {
    "translation": cv2.MOTION_TRANSLATION,
    "euclidean": cv2.MOTION_EUCLIDEAN,
    "similarity": cv2.MOTION_AFFINE,
}
# Both images are smoothed by a Gaussian of this sigma before they are compared, so that a
# difference in blur weighs less than one in place.
_SMOOTHING = 2.0
# The surroundings of a pixel: a Gaussian of this sigma, wider than blur and narrower than fall-off.
_AROUND = 20.0
_RIM = 6
# From coarse to fine: each size starts from the result of the previous one.
_SCALES = (8, 4, 2, 1)
_LEAST_SIDE = 40
_STEPS, _PRECISION = 200, 1e-6
# Two views with a lower correlation coefficient do not match.
_LEAST_CORRELATION = 0.8
# How far a pair may be moved, as a share of the image's longer side, and how much may it grow.
_FARTHEST = 0.1
_PLACES, _ANGLE_PLACES, _SIZE_PLACES = 2, 4, 5
# Pixels above or below these levels may have been clipped.
_BRIGHT, _DARK = 245, 5
_LARGEST_GAIN = 4.0


@dataclass(frozen=True)
class Placement:
    """How the moved image of a pair must be moved to align with the other.

    Parameters
    ----------
    right, down : float
        The shift of the image's centre, in pixels.
    degrees : float
        How far it is turned about its centre, clockwise as seen.
    correlation : float
        The coefficient of both images, smoothed and aligned, that was maximised.
    magnification : float
        How many times larger it shows things than the other image; it is scaled down by this.
    """

    right: float
    down: float
    degrees: float
    correlation: float
    magnification: float = 1.0

    def rounded(self) -> Self:
        """Return it rounded, so that the last bits of a platform's arithmetic change no image."""
        right, down = (round(part, _PLACES) + 0.0 for part in (self.right, self.down))
        degrees = round(self.degrees, _ANGLE_PLACES) + 0.0
        size = round(self.magnification, _SIZE_PLACES)
        return replace(self, right=right, down=down, degrees=degrees, magnification=size)

    def at_corners(self, shape: tuple[int, ...]) -> float:
        """Return the largest displacement of a corner of an image of this shape, in pixels.

        Examples
        --------
        >>> round(Placement(0, 0, 0, 1, magnification=1.006).at_corners((370, 427)), 2)
        1.69
        """
        half = complex(shape[1] - 1, shape[0] - 1) / 2
        turn = self.magnification * cmath.exp(-1j * math.radians(self.degrees)) - 1
        corners = (half, -half, half.conjugate(), -half.conjugate())
        return max(abs(turn * corner - complex(self.right, self.down)) for corner in corners)


def find_placement(fixed: Image, moved: Image, motion: Motion = "similarity") -> Placement:
    """Find how to align an image with another (ECC, Evangelidis and Psarakis 2008).

    Gain and offset of the images do not matter: neither changes the coefficient.

    Parameters
    ----------
    fixed, moved : ndarray of uint8, shape (y, x, 3)
        Two images of one scene, of one size.
    motion : {"translation", "euclidean", "similarity"}
        Whether the image may also be turned, and also be scaled.

    Raises
    ------
    InputError
        If no placement is found: the search does not converge, or ends far off.

    Examples
    --------
    >>> image = np.random.default_rng(0).uniform(0, 255, (80, 90, 3))
    >>> image = cv2.GaussianBlur(image, (0, 0), 3).astype(np.uint8)
    >>> found = find_placement(image[4:-4, 4:-4], image[3:-5, 6:-2], "translation").rounded()
    >>> found.right, found.down
    (2.0, -1.0)

    Notes
    -----
    For a similarity, ECC finds an affine transform, and the nearest similarity is returned. The
    last step compares grey levels divided by those around them. Otherwise, on bare walls, a
    different fall-off of light towards the corners passes for a movement of up to three pixels.
    """
    images = [_smooth_grey(image) for image in (fixed, moved)]
    matrix = np.eye(2, 3, dtype=np.float32)
    correlation = 0.0
    for scale in _SCALES:
        if scale > 1 and min(fixed.shape[:2]) < scale * _LEAST_SIDE:
            continue
        small = [image[scale // 2 :: scale, scale // 2 :: scale].copy() for image in images]
        matrix[:, 2] /= scale
        matrix, correlation = _refined(small, matrix, motion)
        matrix[:, 2] *= scale
    if motion == "similarity":
        around = [cv2.GaussianBlur(image, (0, 0), _AROUND) for image in images]
        ratios = [image / (wide + 1) for image, wide in zip(images, around, strict=True)]
        matrix = _refined(ratios, matrix, motion)[0]
    shape = images[0].shape
    # OpenCV's matrix maps places in the fixed image to those in the moved one.
    centre = np.array([(shape[1] - 1) / 2, (shape[0] - 1) / 2])
    linear = matrix[:, :2].astype(np.float64)
    way = linear @ centre + matrix[:, 2] - centre
    if not np.isfinite(way).all() or correlation < _LEAST_CORRELATION:
        raise _not_aligned(f"a correlation of {correlation:.2f} at best")
    if np.abs(way).max() > _FARTHEST * max(shape):
        raise _not_aligned(f"a move by {way[0]:.0f} and {way[1]:.0f} pixels")
    turn = complex(linear[0, 0] + linear[1, 1], linear[1, 0] - linear[0, 1]) / 2
    right, down = (-way).tolist()
    degrees = -math.degrees(cmath.phase(turn))
    if abs(abs(turn) - 1) > _FARTHEST:
        raise _not_aligned(f"a magnification of {abs(turn):.2f}")
    return Placement(right, down, degrees, round(correlation, 4), abs(turn))


def _refined(
    images: list[NDArray[np.float32]], matrix: NDArray[np.float32], motion: str
) -> tuple[NDArray[np.float32], float]:
    everywhere = np.ones(images[1].shape, np.uint8)
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, _STEPS, _PRECISION)
    try:
        correlation, found = cv2.findTransformECC(
            images[0], images[1], matrix, _MOTIONS[motion], criteria, everywhere, 1
        )
    except cv2.error:
        raise _not_aligned("the search does not converge") from None
    return np.asarray(found, np.float32), float(correlation)


def _smooth_grey(image: Image) -> NDArray[np.float32]:
    grey = image.mean(axis=2, dtype=np.float32)
    smooth = cv2.GaussianBlur(grey, (0, 0), _SMOOTHING)
    # At the border the filter saw made-up pixels; both images lose the same rows.
    rim = min(_RIM, min(grey.shape) // 4)
    return np.asarray(smooth[rim : grey.shape[0] - rim, rim : grey.shape[1] - rim], np.float32)


def _not_aligned(got: str) -> InputError:
    what = f"no alignment of the pair's images was found: {got}, not a correlation of "
    what += f"{_LEAST_CORRELATION} and a move or change of size below {_FARTHEST:.0%} of the image"
    return InputError(what, fix='leave the scene out, or set align = "none" for an aligned set')


def place(image: NDArray[np.float64], at: Placement) -> tuple[NDArray[np.float64], Mask]:
    """Return an image moved to its place, and which pixels it covers there.

    Parameters
    ----------
    image : ndarray of float64, shape (y, x, channel)
        Interpolated by cubic splines, which keep more of its detail than linear interpolation.
    at : Placement
        Where it belongs.

    Returns
    -------
    ndarray of float64, shape (y, x, channel)
        Beyond the image's edge, its edge pixels repeat.
    ndarray of bool, shape (y, x)
        False where the image does not reach.
    """
    if not (at.right or at.down or at.degrees) and at.magnification == 1:
        return image, np.ones(image.shape[:2], bool)
    angle = math.radians(at.degrees)
    cosine, sine = math.cos(angle), math.sin(angle)
    # Map (y, x) in the result to (y, x) in the image: turn back about the centre, and scale.
    back = at.magnification * np.array([[cosine, -sine], [sine, cosine]])
    centre = (np.array(image.shape[:2]) - 1) / 2
    offset = centre - back @ centre - np.array([at.down, at.right])
    y, x = np.indices(image.shape[:2], dtype=np.float64)
    rows = back[0, 0] * y + back[0, 1] * x + offset[0]
    columns = back[1, 0] * y + back[1, 1] * x + offset[1]
    covered = (rows >= 0) & (rows <= image.shape[0] - 1)
    covered &= (columns >= 0) & (columns <= image.shape[1] - 1)
    return resampled(image, back, offset), covered


def find_gain(infocus: NDArray[np.float64], defocus: NDArray[np.float64], where: Mask) -> float:
    """Return the factor that makes the defocus image as bright as the in-focus one.

    It is the ratio of sums, which blur hardly changes, over pixels that are black or white in
    neither image.

    Parameters
    ----------
    infocus, defocus : ndarray of float64, shape (y, x, channel)
        Grey levels, 0 to 255.
    where : ndarray of bool, shape (y, x)
        Which pixels both images cover.

    Raises
    ------
    InputError
        If there is no such pixel, or one image is more than four times as bright.
    """
    seen = _seen(infocus, defocus, where)
    sums = [float(image[seen].sum()) for image in (infocus, defocus)]
    gain = round(sums[0] / sums[1], 4) if sums[1] else 0.0
    if not 1 / _LARGEST_GAIN <= gain <= _LARGEST_GAIN:
        got = (
            f"{gain:g} times, not at most {_LARGEST_GAIN:g}" if seen.any() else "all black or white"
        )
        what = f"the images of the pair differ too much in brightness: {got}"
        raise InputError(what, fix="leave the scene out, or set match_gain = false")
    return gain


def _seen(infocus: NDArray[np.float64], defocus: NDArray[np.float64], where: Mask) -> Mask:
    seen = where.copy()
    for image in (infocus, defocus):
        smooth = cv2.GaussianBlur(image, (0, 0), _SMOOTHING)
        seen &= ((smooth > _DARK) & (smooth < _BRIGHT)).all(axis=2)
    return seen


def _unlike_in_brightness(infocus: NDArray[np.float64], defocus: NDArray[np.float64]) -> float:
    """Return by what share a pair differs in brightness: of grey levels or, if less, of light.

    Blur keeps the sum of what it mixes: of light in a camera, of grey levels in some simulations.
    """
    everywhere = np.ones(infocus.shape[:2], bool)
    gain = find_gain(infocus, defocus, everywhere)
    seen = _seen(infocus, defocus, everywhere)
    sharp, blurred = (float(decode(image[seen]).sum()) for image in (infocus, defocus))
    return min(abs(gain - 1), abs(sharp / blurred - 1))


# Corner movements (pixels) and gains below these need no correction. If Middlebury's scenes are
# blurred but aligned, all but the barest are measured with errors below 0.4 pixels, the barest with
# 0.48, because of noise, JPEG and unequal fall-off of light.
_STILL, _UNGAINED = 0.5, 0.01
# A movement has to be this many times its error.
_CLEARLY = 2.0


@dataclass(frozen=True)
class Matching:
    """How pairs of photographs differ in place and brightness.

    Parameters
    ----------
    align, match_gain : str, bool
        The fields to write into a manifest.
    flat_field : tuple of tuple of float
        Likewise; empty if the light falls off alike.
    found, open : tuple of str
        In words: what was found, and what a person has to decide.
    measured : int
        How many pairs could be compared.
    """

    align: Align = "none"
    match_gain: bool = False
    flat_field: tuple[tuple[float, ...], ...] = ()
    found: tuple[str, ...] = ()
    open: tuple[str, ...] = ()
    measured: int = 0


def matching_of(pairs: Iterable[tuple[str, Image, Image]]) -> Matching:
    """Measure how some pairs differ.

    Parameters
    ----------
    pairs : iterable of (str, ndarray of uint8, ndarray of uint8)
        Each scene's name, its in-focus and its defocus image, shape (y, x, 3).
    """
    moves: dict[str, tuple[Placement, tuple[int, ...]]] = {}
    gains, unlike, tried = [0.0], 0, list(pairs)
    alike = [each for each in tried if each[1].shape == each[2].shape]
    unequal = [name for name, sharp, blurred in tried if sharp.shape != blurred.shape]
    problems = [f"photographs of {name} differ in size" for name in unequal]
    seen = [Images.small(sharp, blurred) for _, sharp, blurred in alike]
    light = replace(find_change(seen), similarity=ViewChange.similarity)
    for name, sharp, blurred in alike:
        level = np.clip(np.rint(light.undone(blurred)), 0, 255)
        try:
            moves[name] = find_placement(sharp, level.astype(np.uint8)), sharp.shape
            gains.append(_unlike_in_brightness(sharp.astype(float), level.astype(float)))
        except InputError:
            unlike += 1
    if unlike:
        problems.append(f"{unlike} of {len(tried)} pairs tried cannot be aligned")
    gain = max(gains)
    align, moved = _proposed([*moves.values()])
    if align == "none":
        problems, moved = [*problems, *moved], []
    far = {name: move.at_corners(shape) for name, (move, shape) in moves.items()}
    count = sum(corner > _STILL for corner in far.values())
    if align == "none" and 0 < count < len(far):
        name = max(far, key=far.__getitem__)
        problems.append(
            f"whether {count} of {len(far)} pairs moved, as the others did not: {name} by "
            f"{far[name]:.1f} pixels?"
        )
    found = moved
    if gain > _UNGAINED:
        found.append(f"photographs differ in brightness by up to {100 * gain:.1f} %")
    if light.changes or light.has_shadow:
        found.append(f"the defocus images are {light.words()}")
    measured = len(moves)
    return Matching(align, gain > _UNGAINED, light.falloff, tuple(found), tuple(problems), measured)


def _proposed(moves: list[tuple[Placement, tuple[int, ...]]]) -> tuple[Align, list[str]]:
    """Return the alignment to propose, and what was measured or is in doubt."""

    def most(**without: float) -> float:
        return max(replace(move, **without).at_corners(shape) for move, shape in moves)

    # In few pixels, strong blur passes for a movement: one pair does not speak for the set, and
    # where one pair grows and another shrinks, that much is error.
    grown = [(move.magnification - 1) * math.hypot(*shape[:2]) / 2 for move, shape in moves]
    error = max(min(max(grown), -min(grown)), 0.0) if moves else 0.0
    median = np.median([move.at_corners(shape) for move, shape in moves]) if moves else 0.0
    if median <= _STILL:
        return "none", []
    if median <= _CLEARLY * error:
        what = f"whether the photographs moved: by {median:.1f} pixels at the corners, but"
        return "none", [f"{what} some pairs grew and others shrank by {error:.1f} or more"]
    shift, turn = most(degrees=0, magnification=1), most(right=0, down=0, magnification=1)
    rigid, magnified = most(magnification=1), most(right=0, down=0, degrees=0)
    degrees = max(abs(move.degrees) for move, _ in moves)
    percent = max(100 * abs(move.magnification - 1) for move, _ in moves)
    moved = (
        f"photographs moved by up to {most():.2f} pixels at the corners: shifted "
        f"by {shift:.2f} pixels, turned by {degrees:.3f} degrees, magnified by {percent:.2f} %"
    )
    align: Align = "none"
    if magnified > _STILL:
        align = "similarity"
    elif rigid > _STILL:
        align = "euclidean" if turn > _STILL else "translation"
    # Do not report what needs no correction.
    return align, [moved] if align != "none" else []
