"""Find how the LIDAR's depth map lies on the camera's image: a board's edges against range edges.

The thesis did it by hand with an interactive tool (3.2.5, step 6). Here a plane is fitted to the
board's returns, the board's four sides are found in the image, and the LIDAR is turned until rays
that hit the board project inside its outline and rays that passed it project outside.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, optimize

from dfdbench.board_outline import SEARCH, find_sides
from dfdbench.errors import Problem, SourceError
from dfdbench.lidar import Beams, align_columns, crop_columns, in_range
from dfdbench.rig import Pose, Rig, beam_directions, depth_image_places

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

_LEAST_RAYS = 100
_LEAST_SIDES = 3
_BY_HAND = "write the transform by hand: see docs/realworld.md"
_OFF_PLANE = 0.06  # metres: range noise and a board that is not quite flat
_BEHIND = 0.15  # metres behind the board: the ray has passed it
_AGREED = 0.97  # share of rays on their side from which an outline is taken for the board's
_DOUBTFUL = 0.95
_SOFTNESS = (2.0, 0.5)  # pixels: first to find the place, then to settle in it


@dataclass(frozen=True)
class Registration:
    """How the LIDAR's depth map lies on the cropped image.

    Parameters
    ----------
    matrix : ndarray of float, shape (3, 3)
        Projective, from a place (x, y) of the depth image to one of the image, in pixels.
    agreement : float
        Share of the rays near the outline that fall on their side of it.
    pose : Pose
        How the LIDAR is turned, as far as one scene tells.
    """

    matrix: Floats
    agreement: float
    pose: Pose


@dataclass(frozen=True)
class _Rays:
    """Where rays meet the board's plane, whether they hit the board, whether they passed it."""

    points: Floats
    hit: Mask
    passed: Mask


def register(image: NDArray[np.uint8], ranges: Floats, beams: Beams, rig: Rig) -> Registration:
    """Estimate the transform from the LIDAR's depth image to the camera's image.

    Parameters
    ----------
    image : ndarray of uint8, shape (y, x, 3)
        A sharp frame, not cropped.
    ranges : ndarray of float, shape (beam, column)
        Averaged, in millimetres.
    beams : Beams
        Where the beams point.
    rig : Rig
        Focal length, sizes and baseline.

    Raises
    ------
    SourceError
        Where the LIDAR sees no board, the image shows less than three of its sides, or the two
        do not agree.
    """
    rays = _board_rays(ranges, beams)
    sides = _image_sides(image, rays, rig)
    pose, agreement = _fit(rays, [lines[0] for lines in sides], rig)
    for number, lines in enumerate(sides):
        # A texture may have a line that is clearer than a side; then the rays do not agree.
        for other in lines[1:] if agreement < _AGREED else ():
            trial = [*(chosen[0] for chosen in sides[:number]), other,
                     *(chosen[0] for chosen in sides[number + 1 :])]  # fmt: skip
            turned, agreed = _fit(rays, trial, rig)
            if agreed > agreement:
                pose, agreement, sides[number] = turned, agreed, [other]
    if agreement < _DOUBTFUL:
        raise SourceError(
            Problem(
                "the board in the image and the board of the LIDAR do not agree", "image",
                f"{100 * _DOUBTFUL:.0f} % of the rays on their side of the outline",
                f"{100 * agreement:.1f} %", _BY_HAND,
            )
        )  # fmt: skip
    return Registration(_matrix_of(rays, pose, rig), agreement, pose)


def nominal(ranges: Floats, beams: Beams, rig: Rig) -> Registration:
    """Return the transform of a LIDAR that is mounted without any turn: where estimation starts."""
    rays = _board_rays(ranges, beams)
    return Registration(_matrix_of(rays, Pose(), rig), 0.0, Pose())


def matrix_for(ranges: Floats, beams: Beams, rig: Rig, pose: Pose) -> Floats:
    """Return the projective matrix of the board's plane for a pose that is known."""
    return _matrix_of(_board_rays(ranges, beams), pose, rig)


def board_corners(ranges: Floats, beams: Beams) -> Floats:
    """Return four places (x, y) around the board in the depth image, to write a transform by."""
    hit = _board_rays(ranges, beams).hit
    places = depth_image_places(*hit.shape)[hit]
    (left, top), (right, bottom) = places.min(axis=0), places.max(axis=0)
    return np.array([[left, top], [right, top], [right, bottom], [left, bottom]])


def _board_rays(ranges: Floats, beams: Beams) -> _Rays:
    columns = np.arange(ranges.shape[1])
    directions = np.stack(
        [
            crop_columns(align_columns(part, beams))
            for part in np.moveaxis(beam_directions(beams, columns, len(columns)), -1, 0)
        ],
        axis=-1,
    )
    metres = crop_columns(align_columns(ranges, beams)) / 1000
    points = directions * metres[..., np.newaxis]
    labels, _ = ndimage.label(in_range(points[..., 2] * 1000))
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    if sizes.max(initial=0) < _LEAST_RAYS:
        raise SourceError(
            Problem(
                "the LIDAR sees no board", "ranges", f"{_LEAST_RAYS} neighbouring returns from "
                "less than 2.55 m ahead", f"{sizes.max(initial=0)}",
            )
        )  # fmt: skip
    board = labels == sizes.argmax()
    normal, offset = _fit_plane(points[board])
    on_plane = offset / (directions @ normal)
    met = directions * on_plane[..., np.newaxis]
    gap = (metres - on_plane) * (metres > 0)
    hit = board & (np.abs(gap) < 2 * _OFF_PLANE)
    return _Rays(met, hit, (gap > _BEHIND) & (on_plane > 0) & (met[..., 2] > 0))


def _fit_plane(points: Floats) -> tuple[Floats, float]:
    chosen = points
    for _ in range(5):
        middle = chosen.mean(axis=0)
        normal = np.linalg.svd(chosen - middle, full_matrices=False)[2][2]
        chosen = points[np.abs((points - middle) @ normal) < _OFF_PLANE]
    return normal, float(middle @ normal)


def _image_sides(image: NDArray[np.uint8], rays: _Rays, rig: Rig) -> list[list[Floats]]:
    places = rig.project(Pose().to_camera(rays.points, rig))
    expected = _expected_sides(places, rays.hit)
    found = find_sides(image, expected, places[rays.hit].mean(axis=0))
    sides = [lines for lines in found if lines]
    if len(sides) < _LEAST_SIDES:
        raise SourceError(
            Problem(
                "the board's sides are not found in the image", "image",
                f"{_LEAST_SIDES} sides at least", str(len(sides)), _BY_HAND,
            )
        )  # fmt: skip
    return sides


def _fit(rays: _Rays, lines: list[Floats], rig: Rig) -> tuple[Pose, float]:
    """Return the pose for an outline, and the share of rays near it that fall on their side."""
    outline = np.array(lines)
    pose = _turn_into_place(rays, outline, rig)
    distance = _inside(rig.project(pose.to_camera(rays.points, rig)), outline)
    near = (np.abs(distance) < SEARCH) & (rays.hit | rays.passed)
    return pose, float(((distance > 0) == rays.hit)[near].mean()) if near.any() else 0.0


def _expected_sides(places: Floats, hit: Mask) -> list[tuple[Floats, Floats]]:
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
    lines = [cv2.fitLine(b.astype(np.float32), cv2.DIST_HUBER, 0, 0.01, 0.01) for b in borders]
    through = [(line[2:, 0].astype(np.float64), line[:2, 0].astype(np.float64)) for line in lines]
    corners = [_crossing(through[side - 1], through[side]) for side in range(4)]
    return [(corners[side], corners[(side + 1) % 4]) for side in range(4)]


def _crossing(first: tuple[Floats, Floats], second: tuple[Floats, Floats]) -> Floats:
    (p, u), (q, v) = first, second
    along = np.linalg.lstsq(np.stack([u, -v], axis=1), q - p, rcond=None)[0]
    return np.asarray(p + along[0] * u)


def _inside(places: Floats, outline: Floats) -> Floats:
    distances = places @ outline[:, :2].T + outline[:, 2]
    return np.asarray(distances.min(axis=-1))


def _turn_into_place(rays: _Rays, outline: Floats, rig: Rig) -> Pose:
    used = rays.hit | rays.passed
    points, side = rays.points[used], np.where(rays.hit[used], 1.0, -1.0)

    def cost(angles: Floats, softness: float) -> float:
        places = rig.project(Pose(*angles).to_camera(points, rig))
        margin = side * _inside(places, outline) / softness
        return float(np.logaddexp(0, -margin).sum())

    angles, size = np.zeros(3), 1.0
    for softness in _SOFTNESS:
        simplex = angles + size * np.vstack([np.zeros(3), np.eye(3)])
        angles = optimize.minimize(
            cost, angles, args=(softness,), method="Nelder-Mead",
            options={"initial_simplex": simplex, "xatol": 1e-4, "fatol": 1e-3, "maxiter": 600},
        ).x  # fmt: skip
        size = 0.2
    return Pose(*(float(angle) for angle in angles))


def _matrix_of(rays: _Rays, pose: Pose, rig: Rig) -> Floats:
    y, x = rig.crop_offset
    source = depth_image_places(*rays.hit.shape)[rays.hit]
    target = rig.project(pose.to_camera(rays.points[rays.hit], rig)) - np.array([x, y])
    matrix, _ = cv2.findHomography(source, target, 0)
    return np.asarray(matrix, np.float64)
