"""Find how the LIDAR's depth map lies on the camera's image: a board's edges against range edges.

The thesis did it by hand with an interactive tool (3.2.5, step 6). Here a plane is fitted to the
board's returns, the board's four sides are found in the image, and the LIDAR is turned until rays
that hit the board project inside its outline and rays that passed it project outside. What one
board leaves open, others that the same rig saw settle.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from dfdbench.errors import DfdbenchError, Problem, SourceError
from dfdbench.rig.board_outline import SEARCH, find_sides
from dfdbench.rig.board_rays import Mask, Rays, board_rays, expected_sides
from dfdbench.rig.geometry import Pose, Rig
from dfdbench.rig.lidar import Beams

Floats = NDArray[np.float64]

_LEAST_SIDES = 3
_BY_HAND = "register it with others of its rig, or by hand: see docs/realworld.md"
_AGREED = 0.99  # share of rays on their side from which an outline is taken for the board's
_DOUBTFUL = 0.95
_MOVED = 5.0  # pixels that scenes may differ by themselves and still be of one rig
_GIVEN_UP = 0.01  # how much of its own agreement a scene may give up for the rig's pose
_SOFTNESS = (2.0, 0.5)  # pixels: first to find the place, then to settle in it
_SLIDE = np.arange(0, 20.1, 0.25)  # pixels
#: To the side, down, and turned about the image's middle, in all combinations.
_MOVES = tuple(move for move in product((-1, 0, 1), repeat=3) if any(move))
_MORE_WRONG = 2  # rays


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
class Registration:
    """How the LIDAR's depth map lies on the cropped image.

    Parameters
    ----------
    matrix : ndarray of float, shape (3, 3)
        Projective, from a place (x, y) of the depth image to one of the image, in pixels.
    pose : Pose
        How the LIDAR is turned.
    agreement : float or None
        Share of the rays near the board's outline that fall on their side of it; None where the
        image shows too little of the board to tell.
    known_to : float
        How far the depth map can be moved and turned until more rays disagree: pixels at the
        corner of the image that goes farthest.
    boards : int
        How many boards told the pose.
    """

    matrix: Floats
    pose: Pose
    agreement: float | None
    known_to: float
    boards: int


@dataclass(frozen=True)
class _Fitted:
    """A sighting, which of its lines are taken for the board's, and how the LIDAR is turned."""

    sighting: Sighting
    outline: Floats
    pose: Pose
    agreement: float


def sight(image: NDArray[np.uint8], ranges: Floats, beams: Beams, rig: Rig) -> Sighting:
    """Find a board in a scan and its sides in a frame.

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
        Where the LIDAR sees no board.
    """
    rays = board_rays(ranges, beams)
    places = rig.project(Pose().to_camera(rays.points, rig))
    expected = expected_sides(places, rays.hit)
    found = find_sides(image, expected, places[rays.hit].mean(axis=0))
    return Sighting(rays, [lines for lines in found if lines])


def register(
    sightings: Mapping[str, Sighting], rig: Rig, on_scene: Callable[[int, int], None] | None = None
) -> tuple[dict[str, Registration], dict[str, tuple[Problem, ...]]]:
    """Estimate the transforms from the LIDAR's depth images to the images of scenes of one rig.

    The LIDAR is turned the same in all of them. A board whose sides run along the beams leaves
    its height open by a part of their distance; boards aslant or at another distance do not. A
    scene that contradicts the others is registered by itself; one that shows less than three
    sides is given what the others tell.

    Parameters
    ----------
    sightings : mapping of str to Sighting
        By the scene's name; one is enough.
    rig : Rig
        Focal length, sizes and baseline.
    on_scene : callable, optional
        Called with (scenes fitted by themselves, scenes in all).

    Returns
    -------
    registrations : dict of str to Registration
        Of the scenes where it was found.
    problems : dict of str to tuple of Problem
        Of the others: sides that are not seen, or that do not agree with the rays.
    """
    fitted: dict[str, _Fitted] = {}
    problems: dict[str, tuple[Problem, ...]] = {}
    for number, (name, sighting) in enumerate(sightings.items(), start=1):
        try:
            fitted[name] = _fit(sighting, rig)
        except DfdbenchError as error:
            problems[name] = error.problems
        if on_scene:
            on_scene(number, len(sightings))
    members = _of_one_rig(fitted, rig)
    boards = list(members.values())
    together = _known_to(boards, rig)
    found = {}
    for name, sighting in sightings.items():
        if name in fitted and name not in members:
            one = fitted[name]
            found[name] = _registration(one, _known_to([one], rig), 1, rig)
        elif boards:
            one = members.get(name) or _under(boards[0].pose, sighting, rig)
            if name in members or not one.outline.size or one.agreement >= _AGREED:
                problems.pop(name, None)
                found[name] = _registration(one, together, len(boards), rig)
    return found, problems


def _registration(one: _Fitted, known_to: float, boards: int, rig: Rig) -> Registration:
    matrix = one.sighting.rays.matrix(one.pose, rig)
    agreement = one.agreement if one.outline.size else None
    return Registration(matrix, one.pose, agreement, known_to, boards)


def _fit(sighting: Sighting, rig: Rig) -> _Fitted:
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
        for other in lines[1:] if best.agreement < _AGREED else ():
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


def _of_one_rig(fitted: Mapping[str, _Fitted], rig: Rig) -> dict[str, _Fitted]:
    """Return the boards that agree on one pose, under it; none where no two of several do."""
    poses = [astuple(board.pose) for board in fitted.values()]
    middle = np.median(poses or [astuple(Pose())], axis=0)
    members = {
        name: board
        for name, board in fitted.items()
        if _apart(board.pose, Pose(*middle), rig) < _known_to([board], rig) + _MOVED
    }
    while len(members) > 1:
        pose = _turn_into_place(list(members.values()), middle, SEARCH / 2, rig)
        agreed = {}
        for name, board in members.items():
            under = _under(pose, board.sighting, rig, board.outline)
            if under.agreement >= fitted[name].agreement - _GIVEN_UP:
                agreed[name] = under
        same = all((members[name].outline == one.outline).all() for name, one in agreed.items())
        if len(agreed) == len(members) and same:
            return agreed
        members = agreed
    return members if len(fitted) == 1 else {}


def _apart(first: Pose, second: Pose, rig: Rig) -> float:
    """Return how far apart two poses put what lies within the image, in pixels, at most."""
    yaw, pitch, roll = np.abs(np.subtract(astuple(first), astuple(second)))
    turned = np.hypot(yaw, pitch) * rig.focal_length + roll * max(rig.frame_size) / 2
    return float(np.deg2rad(turned))


def _turned(sighting: Sighting, outline: Floats, rig: Rig) -> _Fitted:
    start = _Fitted(sighting, outline, Pose(), 0.0)
    pose = _turn_into_place([start], np.zeros(3), 2 * SEARCH, rig)
    return _Fitted(sighting, outline, pose, _agreement(sighting.rays, outline, pose, rig))


def _under(pose: Pose, sighting: Sighting, rig: Rig, outline: Floats | None = None) -> _Fitted:
    """Return a sighting under a pose that is known, with the lines that agree best with it."""
    rays = sighting.rays
    if outline is not None and (agreed := _agreement(rays, outline, pose, rig)) >= _AGREED:
        return _Fitted(sighting, outline, pose, agreed)
    if len(sighting.sides) < _LEAST_SIDES:
        return _Fitted(sighting, np.zeros((0, 3)), pose, 0.0)
    outlines = [np.array(lines) for lines in product(*sighting.sides)]
    agreements = [_agreement(rays, lines, pose, rig) for lines in outlines]
    best = int(np.argmax(agreements))
    return _Fitted(sighting, outlines[best], pose, agreements[best])


def _agreement(rays: Rays, outline: Floats, pose: Pose, rig: Rig) -> float:
    distance, near = _near(rays, outline, pose, rig)
    return float(((distance > 0) == rays.hit)[near].mean()) if near.any() else 0.0


def _near(rays: Rays, outline: Floats, pose: Pose, rig: Rig) -> tuple[Floats, Mask]:
    distance = _inside(rig.project(pose.to_camera(rays.points, rig)), outline)
    return distance, (np.abs(distance) < SEARCH) & (rays.hit | rays.passed)


def _known_to(boards: Sequence[_Fitted], rig: Rig) -> float:
    """Return how far all boards can be moved and turned until more rays are wrong, in pixels."""
    wrong = np.zeros((len(_MOVES), _SLIDE.size))
    for board in boards:
        rays = board.sighting.rays
        distance, near = _near(rays, board.outline, board.pose, rig)
        near &= np.abs(distance) <= _SLIDE[-1]
        places = rig.project(board.pose.to_camera(rays.points[near], rig))
        distances = places @ board.outline[:, :2].T + board.outline[:, 2]
        for number, move in enumerate(_MOVES):
            along = _displacements(places, move, rig) @ board.outline[:, :2].T
            moved = (distances[..., np.newaxis] + along[..., np.newaxis] * _SLIDE).min(axis=1)
            wrong[number] += ((moved > 0) != rays.hit[near][:, np.newaxis]).sum(axis=0)
    free = np.logical_and.accumulate(wrong <= wrong[:, :1] + _MORE_WRONG, axis=1)
    first_too_far = np.minimum(free.sum(axis=1), _SLIDE.size - 1)
    return float(_SLIDE[first_too_far].max())


def _displacements(places: Floats, move: tuple[int, ...], rig: Rig) -> Floats:
    """Return where a move takes places; the corner of the crop that goes farthest goes a pixel."""
    height, width = rig.frame_size
    half = rig.crop_size / 2
    across, down, turn = move
    middle = np.array([(width - 1) / 2, (height - 1) / 2])

    def moved(offsets: Floats) -> Floats:
        turned = np.stack([-offsets[..., 1], offsets[..., 0]], axis=-1)
        return np.asarray([across, down] + turn * turned / (half * np.sqrt(2)))

    corners = half * np.array([[-1.0, -1], [1, -1], [-1, 1], [1, 1]])
    farthest = np.linalg.norm(moved(corners), axis=-1).max()
    return np.asarray(moved(places - middle) / farthest)


def _inside(places: Floats, outline: Floats) -> Floats:
    distances = places @ outline[:, :2].T + outline[:, 2]
    return np.asarray(distances.min(axis=-1))


def _turn_into_place(boards: Sequence[_Fitted], start: Floats, reach: float, rig: Rig) -> Pose:
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
