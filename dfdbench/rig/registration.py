"""Find how the LIDAR is turned relative to the camera, and read and write that as a file."""

from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass
from itertools import product
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import FiniteFloat, ValidationError

from dfdbench.errors import DfdbenchError, Problem, SourceError, reason_of
from dfdbench.rig import sighting as sights
from dfdbench.rig.geometry import CaptureRig, Pose
from dfdbench.rig.lidar import Beams, Floats
from dfdbench.system.files import read_text, write_whole
from dfdbench.system.parallel import OnDone, one_by_one
from dfdbench.system.strict import Record, problems_of
from dfdbench.system.text import parse_toml

_MOVED = 5.0  # pixels by which scenes may differ when fitted alone and still be of one rig
_GIVEN_UP = 0.01  # how much of its own agreement a scene may lose under the rig's pose
_SLIDE = np.arange(0, 20.1, 0.25)  # pixels
#: Sideways, down, and rotated about the image's middle, in all combinations.
_MOVES = tuple(move for move in product((-1, 0, 1), repeat=3) if any(move))
_MORE_WRONG = 2  # rays


@dataclass(frozen=True)
class Registration:
    """The transform from the LIDAR's depth map to the cropped image.

    Parameters
    ----------
    matrix : ndarray of float, shape (3, 3)
        Projective, from (x, y) in the depth image to (x, y) in the image, in pixels.
    pose : Pose
        The LIDAR's rotation.
    agreement : float or None
        Share of the rays near the board's outline that fall on the correct side of it; None if the
        image shows too little of the board.
    known_to : float
        How far the depth map can be moved and turned before more rays disagree, in pixels at the
        corner of the image that moves most.
    boards : int
        How many boards determined the pose.
    """

    matrix: Floats
    pose: Pose
    agreement: float | None
    known_to: float
    boards: int


def sight(
    image: NDArray[np.uint8], ranges: Floats, beams: Beams, rig: CaptureRig
) -> sights.Sighting:
    """Find a board in a scan and its sides in a frame.

    Parameters
    ----------
    image : ndarray of uint8, shape (y, x, 3)
        A sharp frame, not cropped.
    ranges : ndarray of float, shape (beam, column)
        Averaged, in millimetres.
    beams : Beams
        The beams' directions.
    rig : CaptureRig
        Focal length, sizes and baseline.

    Raises
    ------
    SourceError
        If the LIDAR sees no board.
    """
    rays = sights.board_rays(ranges, beams)
    places = rig.project(Pose().to_camera(rays.points, rig))
    expected = sights.expected_sides(places, rays.hit)
    found = sights.find_sides(image, expected, places[rays.hit].mean(axis=0))
    return sights.Sighting(rays, [lines for lines in found if lines])


def register(
    sightings: Mapping[str, sights.Sighting], rig: CaptureRig, on_scene: OnDone | None = None
) -> tuple[dict[str, Registration], dict[str, tuple[Problem, ...]]]:
    """Estimate the transforms from the LIDAR's depth images to the images, for scenes of one rig.

    The LIDAR's rotation is the same in all scenes. If a board's sides run along the beams, its
    height is uncertain by a part of the beams' spacing; boards at a slant or at another distance
    remove this uncertainty. A scene that contradicts the others is registered alone; one that shows
    fewer than three sides gets the others' pose.

    Parameters
    ----------
    sightings : mapping of str to Sighting
        By the scene's name; one is enough.
    rig : CaptureRig
        Focal length, sizes and baseline.
    on_scene : callable, optional
        Called with (scenes fitted alone, total scenes).

    Returns
    -------
    registrations : dict of str to Registration
        For the scenes with a registration.
    problems : dict of str to tuple of Problem
        For the others: sides that are not found, or that do not agree with the rays.
    """
    fitted: dict[str, sights.Fitted] = {}
    problems: dict[str, tuple[Problem, ...]] = {}
    for name, sighting in one_by_one(sightings.items(), on_scene):
        try:
            fitted[name] = sights.fit_board(sighting, rig)
        except DfdbenchError as error:
            problems[name] = error.problems
    members = _of_one_rig(fitted, rig)
    boards = list(members.values())
    together = _known_to(boards, rig)
    found = {}
    for name, sighting in sightings.items():
        if name in fitted and name not in members:
            one = fitted[name]
            found[name] = _registration(one, _known_to([one], rig), 1, rig)
        elif boards:
            one = members.get(name) or sights.under_pose(boards[0].pose, sighting, rig)
            if name in members or not one.outline.size or one.agreement >= sights.AGREED:
                problems.pop(name, None)
                found[name] = _registration(one, together, len(boards), rig)
    return found, problems


def _registration(
    one: sights.Fitted, known_to: float, boards: int, rig: CaptureRig
) -> Registration:
    matrix = one.sighting.rays.matrix(one.pose, rig)
    agreement = one.agreement if one.outline.size else None
    return Registration(matrix, one.pose, agreement, known_to, boards)


def _of_one_rig(fitted: Mapping[str, sights.Fitted], rig: CaptureRig) -> dict[str, sights.Fitted]:
    """Return the boards that agree on one pose, under it; none if no two of several agree."""
    poses = [astuple(board.pose) for board in fitted.values()]
    middle = np.median(poses or [astuple(Pose())], axis=0)
    members = {
        name: board
        for name, board in fitted.items()
        if _apart(board.pose, Pose(*middle), rig) < _known_to([board], rig) + _MOVED
    }
    while len(members) > 1:
        pose = sights.turn_into_place(list(members.values()), middle, sights.SEARCH / 2, rig)
        agreed = {}
        for name, board in members.items():
            under = sights.under_pose(pose, board.sighting, rig, board.outline)
            if under.agreement >= fitted[name].agreement - _GIVEN_UP:
                agreed[name] = under
        same = all((members[name].outline == one.outline).all() for name, one in agreed.items())
        if len(agreed) == len(members) and same:
            return agreed
        members = agreed
    return members if len(fitted) == 1 else {}


def _apart(first: Pose, second: Pose, rig: CaptureRig) -> float:
    """Return the largest distance between two poses' places in the image, in pixels."""
    yaw, pitch, roll = np.abs(np.subtract(astuple(first), astuple(second)))
    turned = np.hypot(yaw, pitch) * rig.focal_length + roll * max(rig.frame_size) / 2
    return float(np.deg2rad(turned))


def _known_to(boards: Sequence[sights.Fitted], rig: CaptureRig) -> float:
    """Return how far all boards can be moved and turned before more rays are wrong, in pixels."""
    wrong = np.zeros((len(_MOVES), _SLIDE.size))
    for board in boards:
        rays = board.sighting.rays
        distance, near = sights.near_outline(rays, board.outline, board.pose, rig)
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


def _displacements(places: Floats, move: tuple[int, ...], rig: CaptureRig) -> Floats:
    """Return places' displacements by a move; the crop corner that moves most moves one pixel."""
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


NAME = "registration.toml"
#: The earlier registration, perhaps corrected by hand.
PREVIOUS = "registration.previous.toml"
_LEAST_PAIRS = 4
_HEAD = """\
# Where the LIDAR's depth map is on the image. Each pair is one point of the scene: its place
# in the depth map, scaled up, and its place in the cropped image, both x, y in pixels from the
# middle of the top left one. Move a point to correct the fit; add more, and all are fitted.
# Instead of pairs there may be: matrix = [[...], [...], [...]], projective, 3 x 3.
"""
_Row = tuple[FiniteFloat, FiniteFloat, FiniteFloat]


class _Pair(Record):
    lidar: tuple[FiniteFloat, FiniteFloat]
    image: tuple[FiniteFloat, FiniteFloat]


class _File(Record):
    matrix: tuple[_Row, _Row, _Row] | None = None
    pairs: tuple[_Pair, ...] = ()


def read_registration(path: Path) -> Floats:
    """Return the projective matrix in a file, given directly or by pairs of points.

    Parameters
    ----------
    path : Path
        TOML with `matrix`, or with four or more `[[pairs]]` of `lidar` and `image`.

    Returns
    -------
    ndarray of float, shape (3, 3)
        From the scaled-up depth map to the cropped image, (x, y) in pixels.

    Raises
    ------
    SourceError
        If the file gives no such matrix.
    """
    where = str(path)
    try:
        content = _File.model_validate(parse_toml(read_text(path)))
    except ValidationError as error:
        raise SourceError.of(problems_of(error, "not a registration", file=path)) from error
    except (OSError, ValueError) as error:
        got = reason_of(error)
        raise SourceError("cannot read the registration", where=where, got=got) from error
    if content.matrix is not None:
        if content.pairs:
            fix = "leave out one"
            raise SourceError("the file has both a matrix and pairs", where=where, fix=fix)
        matrix = np.array(content.matrix, np.float64)
        if not np.linalg.det(matrix):
            raise SourceError("not a projective matrix", where=where, got=str(matrix.tolist()))
        return matrix
    if len(content.pairs) < _LEAST_PAIRS:
        what = f"too few pairs of points: {_LEAST_PAIRS} or more [[pairs]] are needed, or a matrix"
        raise SourceError(what, where=where)
    source, target = np.array([(pair.lidar, pair.image) for pair in content.pairs]).swapaxes(0, 1)
    for key, points in (("lidar", source), ("image", target)):
        if len(np.unique(points, axis=0)) < len(points):
            raise SourceError("two pairs share a point", where=f"{where}: {key}")
    fitted, _ = cv2.findHomography(source, target, 0)
    flat = any(np.linalg.matrix_rank(p - p[0], tol=1e-6) < 2 for p in (source, target))
    if flat or fitted is None or not np.isfinite(fitted).all():
        raise SourceError("the points lie on one line: no surface has them", where=where)
    return np.asarray(fitted, np.float64)


def write_registration(path: Path, matrix: Floats, corners: Floats, note: str) -> None:
    """Write a registration as the pairs of four corners; keep an older file as `PREVIOUS`.

    Parameters
    ----------
    path : Path
        The file to write.
    matrix : ndarray of float, shape (3, 3)
        From the scaled-up depth map to the cropped image.
    corners : ndarray of float, shape (4, 2)
        Places (x, y) in the depth map to record.
    note : str
        How it was found: a comment in the file.

    Raises
    ------
    SourceError
        If the file cannot be written.
    """
    target = cv2.perspectiveTransform(corners[np.newaxis].astype(np.float64), matrix)[0]
    pairs = [
        f"[[pairs]]\nlidar = [{u:.2f}, {v:.2f}]\nimage = [{x:.2f}, {y:.2f}]\n"
        for (u, v), (x, y) in zip(corners, target, strict=True)
    ]
    try:
        if path.exists():
            write_whole(path.with_name(PREVIOUS), path.read_bytes())
        write_whole(path, "\n".join([f"{_HEAD}# {note}\n", *pairs]))
    except OSError as error:
        got = reason_of(error)
        raise SourceError("cannot write the registration", where=str(path), got=got) from error
