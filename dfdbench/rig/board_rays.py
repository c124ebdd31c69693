"""Where a LIDAR's rays meet a board's plane: which of them hit the board, which passed it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from dfdbench.errors import SourceError
from dfdbench.rig.depth_map import in_range
from dfdbench.rig.geometry import Pose, Rig, beam_directions, depth_image_places
from dfdbench.rig.lidar import Beams, align_columns, crop_columns

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

_LEAST_RAYS = 100
_OFF_PLANE = 0.06  # metres: range noise and a board that is not quite flat
_BEHIND = 0.15  # metres behind the board: the ray has passed it


@dataclass(frozen=True)
class Rays:
    """Rays against the board's plane.

    Parameters
    ----------
    points : ndarray of float, shape (row, column, 3)
        Where each ray meets the plane, in metres, in the LIDAR's space.
    hit, passed : ndarray of bool, shape (row, column)
        Whether it came back from the board; whether it came back from behind it.
    """

    points: Floats
    hit: Mask
    passed: Mask

    def matrix(self, pose: Pose, rig: Rig) -> Floats:
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
    """Return the rays that look ahead, against the plane of the largest thing in range.

    Parameters
    ----------
    ranges : ndarray of float, shape (beam, column)
        Averaged, in millimetres.
    beams : Beams
        Where the beams point.

    Raises
    ------
    SourceError
        Where nothing in range is large enough to be a board.
    """
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
            "the LIDAR sees no board",
            where="ranges",
            expected=f"{_LEAST_RAYS} neighbouring returns from less than 2.55 m ahead",
            got=f"{sizes.max(initial=0)}",
        )
    board = labels == sizes.argmax()
    normal, offset = _fit_plane(points[board])
    on_plane = offset / (directions @ normal)
    met = directions * on_plane[..., np.newaxis]
    gap = (metres - on_plane) * (metres > 0)
    hit = board & (np.abs(gap) < 2 * _OFF_PLANE)
    return Rays(met, hit, (gap > _BEHIND) & (on_plane > 0) & (met[..., 2] > 0))


def expected_sides(places: Floats, hit: Mask) -> list[tuple[Floats, Floats]]:
    """Return where in the frame the rays tell the board's sides to be: top, right, bottom, left.

    Parameters
    ----------
    places : ndarray of float, shape (row, column, 2)
        Where each ray appears in the frame, in pixels (x, y).
    hit : ndarray of bool, shape (row, column)
        Whether it hit the board.

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
    lines = [cv2.fitLine(b.astype(np.float32), cv2.DIST_HUBER, 0, 0.01, 0.01) for b in borders]
    through = [(line[2:, 0].astype(np.float64), line[:2, 0].astype(np.float64)) for line in lines]
    corners = [_crossing(through[side - 1], through[side]) for side in range(4)]
    return [(corners[side], corners[(side + 1) % 4]) for side in range(4)]


def _fit_plane(points: Floats) -> tuple[Floats, float]:
    chosen = points
    for _ in range(5):
        middle = chosen.mean(axis=0)
        normal = np.linalg.svd(chosen - middle, full_matrices=False)[2][2]
        chosen = points[np.abs((points - middle) @ normal) < _OFF_PLANE]
    return normal, float(middle @ normal)


def _crossing(first: tuple[Floats, Floats], second: tuple[Floats, Floats]) -> Floats:
    (p, u), (q, v) = first, second
    along = np.linalg.lstsq(np.stack([u, -v], axis=1), q - p, rcond=None)[0]
    return np.asarray(p + along[0] * u)
