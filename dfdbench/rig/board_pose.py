"""Turn the LIDAR until a board's rays fall on their side of its outline in the image."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from dfdbench.errors import SourceError
from dfdbench.rig.board_outline import SEARCH
from dfdbench.rig.board_rays import Mask, Rays
from dfdbench.rig.geometry import Pose, Rig

Floats = NDArray[np.float64]

_LEAST_SIDES = 3
_BY_HAND = "register it with others of its rig, or by hand: see docs/realworld.md"
AGREED = 0.99  # share of rays on their side from which an outline is taken for the board's
_DOUBTFUL = 0.95
_SOFTNESS = (2.0, 0.5)  # pixels: first to find the place, then to settle in it


@dataclass(frozen=True)
class Sighting:
    """A board as the LIDAR and the camera saw it.

    Parameters
    ----------
    rays : Rays
        The LIDAR's.
    sides : list of list of ndarray, shape (3,)
        Lines in the frame that may be the board's sides, best first, for each side that is seen.
    """

    rays: Rays
    sides: list[list[Floats]]


@dataclass(frozen=True)
class Fitted:
    """A sighting, which of its lines are taken for the board's, and how the LIDAR is turned."""

    sighting: Sighting
    outline: Floats
    pose: Pose
    agreement: float


def fit_board(sighting: Sighting, rig: Rig) -> Fitted:
    """Return a board by itself: the lines that are its sides, and the pose that they tell.

    Raises
    ------
    SourceError
        Where too few sides are seen, or they do not agree with the rays.
    """
    sides = sighting.sides
    if len(sides) < _LEAST_SIDES:
        raise SourceError(
            "the board's sides are not found in the image",
            where="image",
            expected=f"{_LEAST_SIDES} sides at least",
            got=str(len(sides)),
            fix=_BY_HAND,
        )
    best = _turned(sighting, np.array([lines[0] for lines in sides]), rig)
    for number, lines in enumerate(sides):
        # A texture may have a line that is clearer than a side; then the rays do not agree.
        for other in lines[1:] if best.agreement < AGREED else ():
            outline = best.outline.copy()
            outline[number] = other
            best = max(best, _turned(sighting, outline, rig), key=lambda one: one.agreement)
    if best.agreement < _DOUBTFUL:
        raise SourceError(
            "the board in the image and the board of the LIDAR do not agree",
            where="image",
            expected=f"{100 * _DOUBTFUL:.0f} % of the rays on their side of the outline",
            got=f"{100 * best.agreement:.1f} %",
            fix=_BY_HAND,
        )
    return best


def _turned(sighting: Sighting, outline: Floats, rig: Rig) -> Fitted:
    start = Fitted(sighting, outline, Pose(), 0.0)
    pose = turn_into_place([start], np.zeros(3), 2 * SEARCH, rig)
    return Fitted(sighting, outline, pose, _agreement(sighting.rays, outline, pose, rig))


def under_pose(pose: Pose, sighting: Sighting, rig: Rig, outline: Floats | None = None) -> Fitted:
    """Return a sighting under a pose that is known, with the lines that agree best with it."""
    rays = sighting.rays
    if outline is not None and (agreed := _agreement(rays, outline, pose, rig)) >= AGREED:
        return Fitted(sighting, outline, pose, agreed)
    if len(sighting.sides) < _LEAST_SIDES:
        return Fitted(sighting, np.zeros((0, 3)), pose, 0.0)
    outlines = [np.array(lines) for lines in product(*sighting.sides)]
    agreements = [_agreement(rays, lines, pose, rig) for lines in outlines]
    best = int(np.argmax(agreements))
    return Fitted(sighting, outlines[best], pose, agreements[best])


def _agreement(rays: Rays, outline: Floats, pose: Pose, rig: Rig) -> float:
    distance, near = near_outline(rays, outline, pose, rig)
    return float(((distance > 0) == rays.hit)[near].mean()) if near.any() else 0.0


def near_outline(rays: Rays, outline: Floats, pose: Pose, rig: Rig) -> tuple[Floats, Mask]:
    """Return how far within the outline each ray falls, in pixels, and which are near it."""
    distance = _inside(rig.project(pose.to_camera(rays.points, rig)), outline)
    return distance, (np.abs(distance) < SEARCH) & (rays.hit | rays.passed)


def _inside(places: Floats, outline: Floats) -> Floats:
    distances = places @ outline[:, :2].T + outline[:, 2]
    return np.asarray(distances.min(axis=-1))


def turn_into_place(boards: Sequence[Fitted], start: Floats, reach: float, rig: Rig) -> Pose:
    """Return the pose under which the boards' rays fall on their sides of the outlines.

    Parameters
    ----------
    boards : sequence of Fitted
        Their outlines hold; their poses are not used.
    start : ndarray of float, shape (3,)
        Angles to start from, in degrees.
    reach : float
        Rays farther from the outline than this at the start, in pixels, are left out.
    rig : Rig
        Focal length, sizes and baseline.
    """
    # What is farther than `reach` pixels from the outline stays on its side: the start is near.
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
        angles = optimize.minimize(
            cost,
            angles,
            args=(softness,),
            method="Nelder-Mead",
            options={"initial_simplex": simplex, "xatol": 1e-4, "fatol": 1e-3, "maxiter": 600},
        ).x
        size = 0.2
    return Pose(*(float(angle) for angle in angles))
