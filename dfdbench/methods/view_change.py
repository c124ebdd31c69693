"""What a camera changes between two images of one view besides the blur: position, size, light.

A lens that changes its focus breathes: the view grows or shrinks about the middle. A wide aperture
darkens the corners more than a small one. Both are measured over training captures and removed
from the defocus image before it is compared.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.law import BlurLaw
from dfdbench.blur.light import decode, encode
from dfdbench.blur.recipe import LAST_LEVEL

Array = NDArray[Any]

# Images are reduced until no side is longer than this, in pixels. Each step's smoothing finds a
# shift of about as many pixels.
_LONGEST = 640
_SMOOTHINGS = (8.0, 4.0, 2.0, 2.0)
# Below the first share of white there is more noise than light; above the second, it is clipped.
_DARK, _BRIGHT = 0.03, 0.94
# Left out at the border, in pixels, because the smoothing reaches past it.
_BORDER = 12
# A smaller change does not count: in pixels at the corners, and as a share of the light.
_STILL = 0.1
_LEVEL = 0.015
# In radians; a smaller rotation is not mentioned.
_TURNED = 2e-4
# A change has to be this many times the captures' median spread.
_CLEARLY = 2.0
# A larger rotation or magnification is not breathing but another view.
_FARTHEST = 0.06
# Rows and columns of the fields whose light is compared; the share of its variance over the image
# that has to go with the radius, as otherwise it is a shadow.
_FIELDS = (12, 16)
_BY_RADIUS = 0.5
# Light that differs further by more than this may be a shadow: a third of the image 10 % darker
# makes 0.04.
_SHADOW = 0.03
# A median's standard deviation over the median distance from it, for one value of a normal
# distribution.
_OF_MEDIANS = 1.858
# Knots of the fall-off's curve. It is not a polynomial of low degree, which could not follow a stop
# in front of the lens that darkens only the corners.
KNOTS = 9
# The weight of a bend in the curve, relative to a field's misfit.
_STIFF = 0.5
_FEW_CAPTURES = 3


class Images(NamedTuple):
    """An in-focus and a defocus image of one capture, reduced: uint8, shape (y, x, channel).

    `times` is the factor of the reduction along each side.
    """

    infocus: Array
    defocus: Array
    times: int = 1

    @classmethod
    def small(cls, infocus: Array, defocus: Array) -> Self:
        """Reduce images of any size to the working size."""
        height, width = infocus.shape[:2]
        times = -(-max(height, width) // _LONGEST)
        if times == 1:
            return cls(infocus, defocus)
        size = (width // times, height // times)
        shape = (size[1], size[0], -1)
        sharp, blurred = (
            cv2.resize(
                image[: size[1] * times, : size[0] * times], size, interpolation=cv2.INTER_AREA
            )
            for image in (infocus, defocus)
        )
        return cls(sharp.reshape(shape), blurred.reshape(shape), times)


@dataclass(frozen=True)
class ViewChange:
    """How a defocus image's view differs from the in-focus image's.

    Parameters
    ----------
    similarity : tuple of float
        How far it is shifted down and right, in pixels; how far it is rotated, in radians from down
        to right, and how much larger it is (0.006 for 0.6 %), both about the middle.
    falloff : tuple of tuple of float
        For each channel, its light as a fraction of the in-focus image's, at even steps of r^2 from
        the middle to the corners, with linear interpolation. Empty if the light is equal.
    uneven : float
        How much the light differs beyond the fall-off; this part is not undone. It is the standard
        deviation over fields of the image, as a share of the light.
    """

    similarity: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    falloff: tuple[tuple[float, ...], ...] = ()
    uneven: float = 0.0

    @classmethod
    def of(cls, law: BlurLaw) -> Self:
        """Return the change that a law contains."""
        return cls(law.similarity, law.falloff)

    @property
    def changes(self) -> bool:
        """Whether there is anything to undo."""
        return bool(self.falloff or any(self.similarity))

    @property
    def has_shadow(self) -> bool:
        """Whether the remaining light differs by more than blur makes it differ in photographs."""
        return self.uneven > _SHADOW

    def light_at(self, shape: Sequence[int]) -> Array:
        """Return the defocus image's light as a fraction of the other's, shape (y, x, channel)."""
        radius = _square_radius(shape)
        steps = [np.linspace(0, 1, len(curve)) for curve in self.falloff]
        curves = zip(steps, self.falloff, strict=True)
        return np.stack([np.interp(radius, *curve) for curve in curves], axis=-1)

    def words(self) -> str:
        """Return it in words.

        Examples
        --------
        >>> ViewChange((0.0, 0.0, 0.0, 0.006), ((1.0, 0.9, 0.8),)).words()
        '0.60 % larger; 20 % darker at the corners than in the middle'
        >>> ViewChange().words()
        'in register, and as bright all over'
        """
        down, right, turn, larger = self.similarity
        words = []
        if any(self.similarity):
            words.append(f"{abs(larger):.2%} {'larger' if larger > 0 else 'smaller'}")
            words[0] = words[0].replace("%", " %")
            if abs(turn) > _TURNED:
                words[0] += f", turned by {np.degrees(turn):.2f} degrees"
            if np.hypot(down, right) > _STILL:
                down, right = (round(way, 1) + 0.0 for way in (down, right))
                words[0] += f", moved by {down} and {right} pixels down and right"
        if self.falloff:
            lost = 1 - float(np.mean([curve[-1] for curve in self.falloff]))
            side = "darker" if lost > 0 else "brighter"
            words.append(f"{100 * abs(lost):.0f} % {side} at the corners than in the middle")
        if self.has_shadow:
            uneven = f"{100 * self.uneven:.0f} %"
            words.append(f"{uneven} lighter and darker from place to place (a shadow? it is left)")
        return "; ".join(words) or "in register, and as bright all over"

    def undone(self, defocus: Array) -> Array:
        """Return a defocus image with the change undone; the same array if there is none.

        Parameters
        ----------
        defocus : ndarray of uint8, shape (y, x, channel)

        Returns
        -------
        ndarray, shape (y, x, channel)
            Grey levels, float32 if something changed.
        """
        image = defocus
        if self.falloff:
            light = decode(image) / self.light_at(image.shape)
            image = encode(light).astype(np.float32)
        if any(self.similarity):
            image = _moved_back(image, self.similarity)
        return image


def without_change(law: BlurLaw) -> BlurLaw:
    """Return the law for images from which the change has been removed."""
    return replace(law, similarity=ViewChange.similarity, falloff=ViewChange.falloff)


def find_change(captures: Sequence[Images]) -> ViewChange:
    """Measure the change that all captures share.

    Parameters
    ----------
    captures : sequence of Images
        Captures of one camera; the median over them is taken.

    Notes
    -----
    Light: each capture is divided into fields, and a field's light in the defocus image is compared
    with that in the in-focus image; blur moves light only between neighbours. A piecewise linear
    curve over r^2 is fitted to the fields' ratios.

    Position and size: the smoothed defocus image is modelled as the smoothed in-focus image, plus
    its first derivatives times the similarity's shift of each pixel, plus its Laplacian, which
    changes its blur. It is fitted by least squares, from coarse to fine (Lucas and Kanade 1981).

    With fewer than three captures nothing is measured, since one scene's shadow or parallax would
    be taken for the camera's.

    Examples
    --------
    >>> image = np.random.default_rng(0).integers(50, 200, (60, 80, 1)).astype(np.uint8)
    >>> find_change([Images(image, image)] * 3).changes
    False
    """
    if len(captures) < _FEW_CAPTURES:
        return ViewChange()
    light = find_falloff(captures)
    found = np.array([_similarity(pair, light) for pair in captures])
    typical = np.median(found, axis=0)
    spread = np.median(np.abs(found - typical), axis=0)
    down, right, angle, growth = typical.tolist()
    change = replace(light, similarity=(down, right, angle, growth))
    turn, larger = np.abs(typical[2:])
    # A mere shift does not count: each capture may have its own, which a law finds anew.
    corner = np.median([np.hypot(*pair.infocus.shape[:2]) / 2 * pair.times for pair in captures])
    size = np.hypot(turn, larger)
    still = size * corner < _STILL or size < _CLEARLY * np.hypot(*spread[2:])
    return light if still or max(turn, larger) > _FARTHEST else change


def _middle(shape: Sequence[int]) -> tuple[Array, Array]:
    """Return how far each pixel is below and to the right of the middle."""
    height, width = shape[:2]
    down = np.arange(height, dtype=np.float32)[:, np.newaxis] - np.float32((height - 1) / 2)
    right = np.arange(width, dtype=np.float32)[np.newaxis] - np.float32((width - 1) / 2)
    return down, right


def _square_radius(shape: Sequence[int]) -> Array:
    down, right = _middle(shape)
    return np.asarray((down**2 + right**2) / max(float(down[0, 0] ** 2 + right[0, 0] ** 2), 1.0))


def find_falloff(captures: Sequence[Images]) -> ViewChange:
    """Measure the light alone; of a single capture, a shadow may pass for a fall-off."""
    ratios, weights = [], []
    for pair in captures:
        known = np.ones(pair.infocus.shape, bool)
        for image in pair[:2]:
            known &= (image > _DARK * LAST_LEVEL) & (image < _BRIGHT * LAST_LEVEL)
        # A capture whose red, green or blue is too dark or too bright all over tells nothing.
        known &= known.any(axis=(0, 1)).all()
        sums = [_by_field(np.where(known, decode(image), 0)) for image in pair[:2]]
        # The light of a whole capture may differ, for example with the exposure time.
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = sums[1] / sums[0]
        ratios.append(ratio / np.nanmedian(ratio, axis=(0, 1)) if known.any() else ratio)
        weights.append(_by_field(known.astype(np.float64)))
    count = np.sum(weights, axis=0)
    if not count.all():
        return ViewChange()
    typical = np.nanmedian(ratios, axis=0)
    channels = np.moveaxis(typical, -1, 0)
    # Blur moves light between fields, so medians over captures vary by chance.
    spread = np.nanmedian(np.abs(np.array(ratios) - typical), axis=0)
    chance = np.square(_OF_MEDIANS * spread).sum() / len(captures)
    terms = np.mean([_knots_by_field(pair.infocus.shape) for pair in captures], axis=0)
    # Hardly any pixel is at the last knot, so penalise bends to let the curve continue straight.
    bends = _STIFF * np.diff(np.eye(KNOTS), 2, axis=0)
    rows, none = np.concatenate([terms, bends]), np.zeros(len(bends))
    fitted = [
        np.linalg.lstsq(rows, np.concatenate([values.ravel(), none]), rcond=None)[0]
        for values in channels
    ]
    curves = np.stack([terms @ curve for curve in fitted])
    left = np.square(channels.reshape(len(channels), -1) - curves).sum()
    all_of_it = np.square(channels - channels.mean(axis=(1, 2), keepdims=True)).sum()
    by_radius = 1 - left / all_of_it if all_of_it else 0.0
    # Light that the whole image lacks is its gain, which is in the law.
    fitted = [curve / curve[0] for curve in fitted]
    ends = np.array([curve[-1] for curve in fitted])
    if by_radius < _BY_RADIUS or np.abs(ends - 1).max() < _LEVEL or ends.min() < _DARK:
        return ViewChange(uneven=float(np.sqrt(max(all_of_it - chance, 0) / channels.size)))
    falloff = tuple(tuple(curve.tolist()) for curve in fitted)
    return ViewChange(falloff=falloff, uneven=float(np.sqrt(max(left - chance, 0) / channels.size)))


def _knots_by_field(shape: Sequence[int]) -> Array:
    """Return the share of each knot of the curve in each field, shape (field, knot)."""
    radius, steps = _square_radius(shape), np.linspace(0, 1, KNOTS)
    shares = [np.interp(radius, steps, knot)[..., np.newaxis] for knot in np.eye(KNOTS)]
    return np.stack([_by_field(share, np.mean).ravel() for share in shares], axis=1)


def _by_field(values: Array, of: Any = np.sum) -> Array:
    rows, columns = (
        np.array_split(np.arange(size), count)
        for size, count in zip(values.shape, _FIELDS, strict=False)
    )
    return np.array(
        [[of(values[np.ix_(row, column)], axis=(0, 1)) for column in columns] for row in rows]
    )


def _similarity(pair: Images, light: ViewChange) -> Array:
    sharp, blurred = (
        image.mean(axis=2, dtype=np.float32) for image in (pair.infocus, light.undone(pair.defocus))
    )
    down, right = _middle(sharp.shape)
    found = np.zeros(4)
    for sigma in _SMOOTHINGS:
        smooth = cv2.GaussianBlur(sharp, (0, 0), sigma)
        here = _moved_back(blurred[..., np.newaxis], found)[..., 0] if found.any() else blurred
        aim = cv2.GaussianBlur(here, (0, 0), sigma)
        by_down, by_right = np.gradient(smooth)
        bright = _BRIGHT * LAST_LEVEL
        edge = round(_BORDER + 2 * sigma)
        inner = (slice(edge, -edge), slice(edge, -edge))
        known = ((smooth < bright) & (aim < bright))[inner]
        if known.sum() < 10 * len(found):
            return np.zeros(4)
        terms = (
            by_down,
            by_right,
            by_right * down - by_down * right,
            by_down * down + by_right * right,
            smooth,
            cv2.Laplacian(smooth, cv2.CV_32F),
            np.ones_like(smooth),
        )
        columns = np.stack([term[inner][known] for term in terms], axis=1)
        square = (columns.T @ columns).astype(np.float64)
        factors = np.linalg.lstsq(square, columns.T @ aim[inner][known], rcond=None)[0]
        if factors[4] <= 0:
            return np.zeros(4)
        found -= factors[:4] / factors[4]
    return found * [pair.times, pair.times, 1, 1]


def _moved_back(image: Array, similarity: Any) -> Array:
    """Undo a similarity: return an image (y, x, channel) sampled where it moved each pixel."""
    down, right, turn, larger = similarity
    matrix = (1 + larger) * np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    middle = (np.array(image.shape[:2]) - 1) / 2
    offset = middle + np.array([down, right]) - matrix @ middle
    return np.asarray(np.clip(resampled(image.astype(np.float32), matrix, offset), 0, LAST_LEVEL))


def resampled(image: Array, matrix: Array, offset: Array) -> Array:
    """Return an image (y, x, channel) sampled by cubic splines where a transform leads.

    The edge pixels are repeated past the image's edge; `matrix` and `offset` are in (y, x) order.
    """
    # Imported here because it takes half a second, and most images are in register.
    from scipy.ndimage import affine_transform

    channels = [
        affine_transform(image[..., channel], matrix, offset, mode="nearest")
        for channel in range(image.shape[2])
    ]
    return np.stack(channels, axis=-1)
