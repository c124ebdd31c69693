"""Find a board in a scan and in an image, and turn the LIDAR until both agree.

The LIDAR's rays show where the board's sides must be, and the image has candidates for each side
near there. The LIDAR is turned until rays that hit the board are inside the outline and others
outside.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, optimize

from dfdbench.errors import SourceError
from dfdbench.optics.sharpness import to_grey
from dfdbench.rig.geometry import CaptureRig, Pose, beam_directions, depth_image_places
from dfdbench.rig.lidar import Beams, Floats, Mask, align_columns, crop_columns, in_range

_LEAST_RAYS = 100
_OFF_PLANE = 0.06  # metres: range noise and a board that is not quite flat
_BEHIND = 0.15  # metres behind the board: the ray has passed it

#: How far from its expected place to look for a side, in pixels.
SEARCH = 70
_TILT = 30  # pixels by which a side's two ends may deviate from each other
_SMOOTHING = 1.5
_BRIGHT = 200.0  # the image is scaled to this level
_WEAK_EDGE = 3.0  # levels per pixel: an edge of this strength counts half
_BAND = 8  # pixels beyond a side that should be plain: the background is not textured
_LEAST_SUPPORT = 0.2
_SAMPLES = 160
_CANDIDATES = 6
_APART = 7  # pixels between two candidates, at their middle or at their ends

_LEAST_SIDES = 3
_BY_HAND = "register it with others of its rig, or by hand: see docs/realworld.md"
AGREED = 0.99  # an outline with this share of rays on their side counts as the board's
_DOUBTFUL = 0.95
_SOFTNESS = (2.0, 0.5)  # pixels: first to find the place, then to settle in it


@dataclass(frozen=True)
class Rays:
    """Rays relative to the board's plane.

    Parameters
    ----------
    points : ndarray of float, shape (row, column, 3)
        Where each ray meets the plane, in metres, in the LIDAR's space.
    hit, passed : ndarray of bool, shape (row, column)
        Whether the ray came back from the board, and whether it came back from behind it.
    """

    points: Floats
    hit: Mask
    passed: Mask

    def matrix(self, pose: Pose, rig: CaptureRig) -> Floats:
        """Return the projective matrix from the depth image to the cropped image for a pose."""
        y, x = rig.crop_offset
        source = depth_image_places(*self.hit.shape)[self.hit]
        target = rig.project(pose.to_camera(self.points[self.hit], rig)) - np.array([x, y])
        matrix, _ = cv2.findHomography(source, target, 0)
        return np.asarray(matrix, np.float64)

    def corners(self) -> Floats:
        """Return four places (x, y) around the board in the depth image."""
        places = depth_image_places(*self.hit.shape)[self.hit]
        (left, top), (right, bottom) = places.min(axis=0), places.max(axis=0)
        return np.array([[left, top], [right, top], [right, bottom], [left, bottom]])


def board_rays(ranges: Floats, beams: Beams) -> Rays:
    """Return the rays that look ahead, relative to the plane of the largest object in range.

    Parameters
    ----------
    ranges : ndarray of float, shape (beam, column)
        Averaged, in millimetres.
    beams : Beams
        The beams' directions.

    Raises
    ------
    SourceError
        If nothing in range is large enough to be a board.
    """
    columns = np.arange(ranges.shape[1])
    directions = beam_directions(beams, columns, len(columns))
    directions = crop_columns(align_columns(directions, beams))
    metres = crop_columns(align_columns(ranges, beams)) / 1000
    points = directions * metres[..., np.newaxis]
    labels, _ = ndimage.label(in_range(points[..., 2] * 1000))
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    if sizes.max(initial=0) < _LEAST_RAYS:
        wanted = f"{_LEAST_RAYS} neighbouring returns from less than 2.55 m ahead"
        raise SourceError("the LIDAR sees no board", expected=wanted, got=str(sizes.max(initial=0)))
    board = labels == sizes.argmax()
    normal, offset = _fit_plane(points[board])
    on_plane = offset / (directions @ normal)
    met = directions * on_plane[..., np.newaxis]
    gap = (metres - on_plane) * (metres > 0)
    hit = board & (np.abs(gap) < 2 * _OFF_PLANE)
    return Rays(met, hit, (gap > _BEHIND) & (on_plane > 0) & (met[..., 2] > 0))


def expected_sides(places: Floats, hit: Mask) -> list[tuple[Floats, Floats]]:
    """Return the board's sides in the frame as the rays see them: top, right, bottom, left.

    Parameters
    ----------
    places : ndarray of float, shape (row, column, 2)
        Where each ray appears in the frame, in pixels (x, y).
    hit : ndarray of bool, shape (row, column)
        Whether the ray hit the board.

    Returns
    -------
    list of (start, end)
        Each side's ends (x, y), clockwise.
    """
    rows = np.flatnonzero(hit.any(axis=1))
    columns = np.flatnonzero(hit.any(axis=0))
    first, last = hit.argmax(axis=1), hit.shape[1] - 1 - hit[:, ::-1].argmax(axis=1)
    top, bottom = hit.argmax(axis=0), hit.shape[0] - 1 - hit[::-1].argmax(axis=0)
    borders = (
        places[top[columns], columns],
        places[rows, last[rows]],
        places[bottom[columns], columns],
        places[rows, first[rows]],
    )
    through = [_line_through(border) for border in borders]
    corners = [_crossing(through[side - 1], through[side]) for side in range(4)]
    return [(corners[side], corners[(side + 1) % 4]) for side in range(4)]


def _fit_plane(points: Floats) -> tuple[Floats, float]:
    chosen = points
    for _ in range(5):
        middle = chosen.mean(axis=0)
        normal = np.linalg.svd(chosen - middle, full_matrices=False)[2][2]
        chosen = points[np.abs((points - middle) @ normal) < _OFF_PLANE]
    return normal, float(middle @ normal)


def _line_through(points: Floats) -> tuple[Floats, Floats]:
    """Return a point on the line through most of some points, and the line's direction."""
    line = cv2.fitLine(points.astype(np.float32), cv2.DIST_HUBER, 0, 0.01, 0.01)[:, 0]
    return line[2:].astype(np.float64), line[:2].astype(np.float64)


def _crossing(first: tuple[Floats, Floats], second: tuple[Floats, Floats]) -> Floats:
    (p, u), (q, v) = first, second
    along = np.linalg.lstsq(np.stack([u, -v], axis=1), q - p, rcond=None)[0]
    return np.asarray(p + along[0] * u)


def find_sides(
    image: NDArray[np.uint8], expected: list[tuple[Floats, Floats]], middle: Floats
) -> list[list[Floats]]:
    """Return the candidate lines for each expected side.

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
        Lines (a, b, c) with ``a x + b y + c`` the distance inwards in pixels; none for a side that
        is not visible.
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
    """Return the row in which each line of an offset and a tilt crosses each sample."""
    offsets, tilts = np.arange(-SEARCH, SEARCH + 1), np.arange(-_TILT, _TILT + 1)
    row = offsets[:, np.newaxis, np.newaxis] + tilts[np.newaxis, :, np.newaxis] * (share - 0.5)
    return np.rint(row).astype(np.int64) + SEARCH + _TILT


def _support(strength: Floats, seen: NDArray[np.bool_], index: NDArray[np.int64]) -> Floats:
    """Return the share of each line that is an edge with a plain area beyond it."""
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
    place, along = _line_through(edge)
    inward = np.array([-along[1], along[0]])
    inward *= np.sign(inward @ (middle - place))
    return np.array([*inward, -inward @ place])


@dataclass(frozen=True)
class Sighting:
    """A board as seen by the LIDAR and the camera.

    Parameters
    ----------
    rays : Rays
        The LIDAR's rays.
    sides : list of list of ndarray, shape (3,)
        Candidate lines in the frame for each visible side, best first.
    """

    rays: Rays
    sides: list[list[Floats]]


@dataclass(frozen=True)
class Fitted:
    """A sighting, the lines chosen as the board's sides, and the LIDAR's rotation."""

    sighting: Sighting
    outline: Floats
    pose: Pose
    agreement: float


def fit_board(sighting: Sighting, rig: CaptureRig) -> Fitted:
    """Fit a board alone: find the lines that are its sides, and the resulting pose.

    Raises
    ------
    SourceError
        If too few sides are visible, or they do not agree with the rays.
    """
    sides = sighting.sides
    if len(sides) < _LEAST_SIDES:
        what = f"only {len(sides)} of the board's sides are found in the image"
        raise SourceError(what, expected=f"at least {_LEAST_SIDES}", fix=_BY_HAND)
    best = _turned(sighting, np.array([lines[0] for lines in sides]), rig)
    for number, lines in enumerate(sides):
        # A texture may have a clearer line than a side, but the rays do not agree with it.
        for other in lines[1:] if best.agreement < AGREED else ():
            outline = best.outline.copy()
            outline[number] = other
            best = max(best, _turned(sighting, outline, rig), key=lambda one: one.agreement)
    if best.agreement < _DOUBTFUL:
        share, least = 100 * best.agreement, 100 * _DOUBTFUL
        what = f"only {share:.1f} % of the rays agree with the board's outline, not {least:.0f} %"
        raise SourceError(what, fix=f"check the lens and the rig's measures; or {_BY_HAND}")
    return best


def _turned(sighting: Sighting, outline: Floats, rig: CaptureRig) -> Fitted:
    start = Fitted(sighting, outline, Pose(), 0.0)
    pose = turn_into_place([start], np.zeros(3), 2 * SEARCH, rig)
    return Fitted(sighting, outline, pose, _agreement(sighting.rays, outline, pose, rig))


def under_pose(
    pose: Pose, sighting: Sighting, rig: CaptureRig, outline: Floats | None = None
) -> Fitted:
    """Return a sighting under a known pose, with the lines that agree best with it."""
    rays = sighting.rays
    if outline is not None and (agreed := _agreement(rays, outline, pose, rig)) >= AGREED:
        return Fitted(sighting, outline, pose, agreed)
    if len(sighting.sides) < _LEAST_SIDES:
        return Fitted(sighting, np.zeros((0, 3)), pose, 0.0)
    outlines = [np.array(lines) for lines in product(*sighting.sides)]
    agreements = [_agreement(rays, lines, pose, rig) for lines in outlines]
    best = int(np.argmax(agreements))
    return Fitted(sighting, outlines[best], pose, agreements[best])


def _agreement(rays: Rays, outline: Floats, pose: Pose, rig: CaptureRig) -> float:
    distance, near = near_outline(rays, outline, pose, rig)
    return float(((distance > 0) == rays.hit)[near].mean()) if near.any() else 0.0


def near_outline(rays: Rays, outline: Floats, pose: Pose, rig: CaptureRig) -> tuple[Floats, Mask]:
    """Return how far inside the outline each ray is, in pixels, and which rays are near it."""
    distance = _inside(rig.project(pose.to_camera(rays.points, rig)), outline)
    return distance, (np.abs(distance) < SEARCH) & (rays.hit | rays.passed)


def _inside(places: Floats, outline: Floats) -> Floats:
    distances = places @ outline[:, :2].T + outline[:, 2]
    return np.asarray(distances.min(axis=-1))


def turn_into_place(boards: Sequence[Fitted], start: Floats, reach: float, rig: CaptureRig) -> Pose:
    """Return the pose that puts the boards' rays on the correct sides of the outlines.

    Parameters
    ----------
    boards : sequence of Fitted
        Only their outlines are used, not their poses.
    start : ndarray of float, shape (3,)
        Angles to start from, in degrees.
    reach : float
        Ignore rays farther from the outline than this at the start, in pixels.
    rig : CaptureRig
        Focal length, sizes and baseline.
    """
    # Rays farther than `reach` pixels from the outline stay on their side, since the start is
    # close.
    known = []
    for board in boards:
        rays = board.sighting.rays
        distance = _inside(rig.project(Pose(*start).to_camera(rays.points, rig)), board.outline)
        used = (rays.hit | rays.passed) & (np.abs(distance) < reach)
        known.append((rays.points[used], np.where(rays.hit[used], 1.0, -1.0), board.outline))

    def cost(angles: Floats, softness: float) -> float:
        total = 0.0
        for points, side, outline in known:
            places = rig.project(Pose(*angles).to_camera(points, rig))
            margin = side * _inside(places, outline) / softness
            total += float(np.logaddexp(0, -margin).sum())
        return total

    angles, size = start, 1.0
    for softness in _SOFTNESS:
        simplex = angles + size * np.vstack([np.zeros(3), np.eye(3)])
        options = {"initial_simplex": simplex, "xatol": 1e-4, "fatol": 1e-3, "maxiter": 600}
        angles = optimize.minimize(cost, angles, (softness,), "Nelder-Mead", options=options).x
        size = 0.2
    return Pose(*(float(angle) for angle in angles))
