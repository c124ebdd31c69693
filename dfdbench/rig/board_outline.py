"""Find a board's sides in an image, near where they are expected: candidates, best first."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from dfdbench.optics.sharpness import to_grey

Floats = NDArray[np.float64]

#: How far from its expected place a side is looked for, in pixels.
SEARCH = 70
_TILT = 30  # pixels by which its ends may be off against each other
_SMOOTHING = 1.5
_BRIGHT = 200.0  # levels that the image is scaled to
_WEAK_EDGE = 3.0  # levels a pixel: an edge of this strength counts half
_BAND = 8  # pixels beyond a side that should be plain: what lies behind the board is not textured
_LEAST_SUPPORT = 0.2
_SAMPLES = 160
_CANDIDATES = 6
_APART = 7  # pixels between two candidates, in their middle or between their ends


def find_sides(
    image: NDArray[np.uint8], expected: list[tuple[Floats, Floats]], middle: Floats
) -> list[list[Floats]]:
    """Return for each expected side the lines that may be it.

    Parameters
    ----------
    image : ndarray of uint8, shape (y, x, 3)
        RGB.
    expected : list of (start, end)
        Each side's ends (x, y), in pixels.
    middle : ndarray of float, shape (2,)
        A place (x, y) on the board.

    Returns
    -------
    list of list of ndarray, shape (3,)
        Lines (a, b, c) with ``a x + b y + c`` the distance inwards in pixels; none for a side
        that is not seen.
    """
    grey = to_grey(image).astype(np.float64)
    # A dark exposure has the same edges as a bright one, only fainter.
    grey *= _BRIGHT / max(float(np.percentile(grey, 99)), 1.0)
    slopes = [ndimage.gaussian_filter(grey, _SMOOTHING, order=order) for order in ((0, 1), (1, 0))]
    return [_candidates(slopes, start, end, middle) for start, end in expected]


def _candidates(slopes: list[Floats], start: Floats, end: Floats, middle: Floats) -> list[Floats]:
    along = (end - start) / np.linalg.norm(end - start)
    outward = np.array([along[1], -along[0]])
    outward *= np.sign(outward @ ((start + end) / 2 - middle))
    share = np.linspace(0.03, 0.97, _SAMPLES)
    away = np.arange(-SEARCH - _TILT, SEARCH + _TILT + _BAND + 1)
    base = start + share[:, np.newaxis] * (end - start)
    places = base[np.newaxis] + away[:, np.newaxis, np.newaxis] * outward
    height, width = slopes[0].shape
    seen = ((places >= 4) & (places <= np.array([width - 5, height - 5]))).all(axis=-1)
    at = [places[..., 1], places[..., 0]]
    parts = [ndimage.map_coordinates(part, at, order=1, mode="nearest") for part in slopes]
    slope = np.abs(parts[0] * outward[0] + parts[1] * outward[1]) * seen
    strength = slope / (slope + _WEAK_EDGE)
    index = _lines_through(share)
    support = _support(strength, seen, index)
    lines = []
    for _ in range(_CANDIDATES):
        best = np.unravel_index(support.argmax(), support.shape)
        if support[best] < _LEAST_SUPPORT:
            break
        chosen = index[best]
        edge = base + (away[chosen] + _peak_near(slope, chosen))[:, np.newaxis] * outward
        clear = strength[chosen, np.arange(_SAMPLES)] > _LEAST_SUPPORT
        if clear.sum() > _SAMPLES / 10:
            lines.append(_fitted(edge[clear], middle))
        near = [slice(max(place - _APART, 0), place + _APART + 1) for place in best]
        support[tuple(near)] = 0
    return lines


def _lines_through(share: Floats) -> NDArray[np.int64]:
    """Return at which row each line of an offset and a tilt crosses each sample."""
    offsets, tilts = np.arange(-SEARCH, SEARCH + 1), np.arange(-_TILT, _TILT + 1)
    row = offsets[:, np.newaxis, np.newaxis] + tilts[np.newaxis, :, np.newaxis] * (share - 0.5)
    return np.rint(row).astype(np.int64) + SEARCH + _TILT


def _support(strength: Floats, seen: NDArray[np.bool_], index: NDArray[np.int64]) -> Floats:
    """Return how much of each line is an edge with something plain beyond it."""
    sample = np.arange(_SAMPLES)
    visible = seen[index, sample].sum(axis=-1)
    beyond = ndimage.uniform_filter1d(strength, _BAND, axis=0)
    contrast = strength[index, sample] - beyond[index + _BAND, sample]
    support = contrast.sum(axis=-1) / np.maximum(visible, 1)
    support[visible < _SAMPLES / 5] = 0
    return np.asarray(support)


def _peak_near(slope: Floats, chosen: NDArray[np.int64]) -> Floats:
    # The centre of the slope within three pixels of the line, for each sample along it.
    reach = np.arange(-3, 4)[:, np.newaxis]
    weight = slope[chosen + reach, np.arange(chosen.size)] ** 2
    return np.asarray((weight * reach).sum(axis=0) / np.maximum(weight.sum(axis=0), 1e-9))


def _fitted(edge: Floats, middle: Floats) -> Floats:
    line = cv2.fitLine(edge.astype(np.float32), cv2.DIST_HUBER, 0, 0.01, 0.01)[:, 0]
    inward = np.array([-line[1], line[0]], np.float64)
    inward *= np.sign(inward @ (middle - line[2:]))
    return np.array([inward[0], inward[1], -inward @ line[2:]])
