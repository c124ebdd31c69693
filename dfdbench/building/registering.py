"""Register captured scenes: align each one's LIDAR depth with its camera's image."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from dfdbench.building.sources.realworld import PublishedScene, RawScene, find_captured_scene
from dfdbench.datasets.manifest import Recording
from dfdbench.errors import DfdbenchError, Problem, SourceError
from dfdbench.optics.sharpness import sharpest
from dfdbench.rig import geometry, lidar, registration
from dfdbench.rig.sighting import Sighting, board_rays
from dfdbench.system.parallel import Shown, one_by_one

_T = TypeVar("_T")


@dataclass(frozen=True)
class _Seen:
    """A scene as read; it has no sighting if its registration is kept."""

    files: RawScene
    ranges: NDArray[np.float64]
    beams: lidar.Beams
    frame: NDArray[np.uint8]
    frame_name: str
    sighting: Sighting | None


@dataclass(frozen=True)
class Registered(_Seen):
    """A scene whose LIDAR depth map is aligned with the image.

    Parameters
    ----------
    files, ranges, beams, frame, frame_name, sighting
        The scene as read, and its sharp frame.
    rig : CaptureRig
        The rig of camera and LIDAR.
    found : Registration or None
        The estimate; None if an earlier registration was kept.
    before, after : ndarray of float, shape (3, 3)
        From the depth map to the image: with the LIDAR parallel to the camera, and as registered.
    """

    rig: geometry.CaptureRig
    found: registration.Registration | None
    before: NDArray[np.float64]
    after: NDArray[np.float64]

    @property
    def moved(self) -> float:
        """How far the corner of the depth map that moves most is moved, in pixels."""
        corners = board_rays(self.ranges, self.beams).corners()[np.newaxis]
        places = [cv2.perspectiveTransform(corners, m)[0] for m in (self.before, self.after)]
        return float(np.linalg.norm(places[1] - places[0], axis=-1).max())

    def depths(self) -> dict[str, tuple[NDArray[np.uint8], NDArray[np.bool_]]]:
        """Return the depth map on the whole frame, before and after, with its mask."""
        y, x = self.rig.crop_offset
        to_frame = np.array([[1.0, 0, x], [0, 1, y], [0, 0, 1]])
        named = {
            "before: LIDAR taken as parallel to the camera": self.before,
            "after: " + registration.NAME: self.after,
        }
        levels, valid = lidar.depth_image(self.ranges, self.beams)
        return {
            title: lidar.warp(levels, valid, to_frame @ matrix, self.rig.frame_size)
            for title, matrix in named.items()
        }


def register_scenes(
    source: Path,
    capture: Recording,
    names: Sequence[str],
    rig: geometry.CaptureRig,
    only_there: bool,
    fresh: bool,
    shown: Shown,
) -> tuple[dict[str, Registered], list[Problem]]:
    """Register scenes, and write each one's registration beside its captures.

    Parameters
    ----------
    source : Path
        The folder with raw captures.
    capture : Recording
        How they were captured.
    names : sequence of str
        The scenes to register.
    rig : CaptureRig
        Focal length, sizes and baseline.
    only_there : bool
        Leave out scenes without files.
    fresh : bool
        Estimate again what is already registered.
    shown : callable
        As in `dfdbench.build`.

    Returns
    -------
    dict of str to Registered
        The scenes that have a registration now.
    list of Problem
        What is wrong with others, which does not stop the rest.
    """
    there = {name: find_captured_scene(source, name, capture) for name in names}
    there = {name: files for name, files in there.items() if files or not only_there}
    problems: dict[str, tuple[Problem, ...]] = {}

    def each(what: str, names: Sequence[str], work: Callable[[str], _T]) -> dict[str, _T]:
        done = {}
        with shown(what) as step:
            for name in one_by_one(names, step):
                try:
                    done[name] = work(name)
                except DfdbenchError as error:
                    problems[name] = error.problems
        return done

    seen = each(
        "looking at scenes", list(there), lambda name: _look(there[name], source / name, rig, fresh)
    )
    sightings = {name: one.sighting for name, one in seen.items() if one.sighting}
    with shown("registering scenes") as step:
        found, unregistered = registration.register(sightings, rig, step)
    problems |= unregistered
    to_place = [name for name, one in seen.items() if name in found or not one.sighting]
    placed = each(
        "placing depth maps", to_place, lambda name: _placed(seen[name], found.get(name), rig)
    )
    said = (_at_scene(p, source, name) for name in there for p in problems.get(name, ()))
    return placed, list(dict.fromkeys(said))


def _look(
    files: RawScene | PublishedScene | None, place: Path, rig: geometry.CaptureRig, fresh: bool
) -> _Seen:
    if not isinstance(files, RawScene):
        found = "images that are registered already" if place.is_dir() else "no such folder"
        what = f"no raw captures, {place.name}/frames and {place.name}/lidar: {found}"
        raise SourceError(what, where=str(place))
    SourceError.raise_if(files.scan_problems())
    ranges, beams = files.ranges(), files.beams()
    frame, frame_name = _sharp_frame(files)
    kept = files.registration.exists() and not fresh
    sighting = None if kept else registration.sight(frame, ranges, beams, rig)
    return _Seen(files, ranges, beams, frame, frame_name, sighting)


def _sharp_frame(files: RawScene) -> tuple[NDArray[np.uint8], str]:
    exposures = files.exposures()
    if not exposures:
        raise SourceError("scene has no frames", where=str(files.folder / "frames"))
    exposure = exposures[len(exposures) // 2]
    steps = files.steps(exposure)
    SourceError.raise_if(
        [problem for step in steps for problem in files.image_problems(exposure, step)]
    )
    if not steps:
        raise SourceError("exposure has no frames", where=f"{files.folder}, {exposure} ms")
    frames = [files.frame(exposure, step) for step in steps]
    chosen = sharpest(frames)
    return frames[chosen], f"step {steps[chosen]}, {exposure} ms"


def _placed(
    one: _Seen, found: registration.Registration | None, rig: geometry.CaptureRig
) -> Registered:
    rays, file = board_rays(one.ranges, one.beams), one.files.registration
    if found:
        others = f" and {found.boards - 1} other scenes" if found.boards > 1 else ""
        note = f"Estimated by dfdbench rig register from {one.frame_name}{others}."
        registration.write_registration(file, found.matrix, rays.corners(), note)
    after = registration.read_registration(file)
    depth = lidar.depth_image(one.ranges, one.beams)
    if not lidar.warp(*depth, after, (rig.crop_size,) * 2)[1].any():
        fix = "correct it by hand, or estimate it anew with --fresh"
        raise SourceError("no LIDAR return falls on the image", where=str(file), fix=fix)
    before = rays.matrix(geometry.Pose(), rig)
    return Registered(**vars(one), rig=rig, found=found, before=before, after=after)


def _at_scene(problem: Problem, source: Path, name: str) -> Problem:
    # The problem's path names the scene, or the problem is one that scenes share.
    named = problem.where.startswith(str(source))
    where = problem.where if named else f"{name}: {problem.where}".removesuffix(": ")
    return replace(problem, where=where)
