"""The verbs for captures of the rig: register, simulate."""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray
from typer import Argument, Option

from dfdbench.building.sources.realworld import PublishedScene, RawScene, find_captured_scene
from dfdbench.cli.options import LARGEST_PIXEL, parse_length
from dfdbench.cli.screen import print_table, progress, save_figure, say, writing
from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.manifest import Manifest, Recording
from dfdbench.errors import (
    DfdbenchError,
    InputError,
    Problem,
    SourceError,
    UnknownNameError,
    unknown_name,
)
from dfdbench.figures.camera import overlay_figure
from dfdbench.optics.sharpness import sharpest
from dfdbench.results.output_place import output_place
from dfdbench.rig import geometry, lidar, registration
from dfdbench.rig.sighting import Sighting, board_rays
from dfdbench.simulation.board_scene import (
    MOUNTED,
    CaptureSettings,
    write_captures,
    write_lens_test,
)
from dfdbench.tables.table import Table, counted

OVERLAY = "registration.png"
_T = TypeVar("_T")
_Problems = dict[str, tuple[Problem, ...]]
_KNOWN_WELL = 3.0  # pixels


def register_scenes(
    scene: Annotated[str, Argument(help="Scenes: k33, k00-k07, or all that are there.")],
    source: Annotated[Path, Option(help="Folder with raw captures.")],
    dataset: Annotated[
        str, Option(help="A data set's name or a manifest's path: scenes and frame sizes.")
    ] = "realworld",
    focal_length: Annotated[str, Option(help="Focal length of the camera.")] = "9.6mm",
    pixel: Annotated[str, Option(help="Size of a pixel.")] = "4.8um",
    baseline: Annotated[str, Option(help="The LIDAR's height above the camera.")] = "93mm",
    fresh: Annotated[
        bool,
        Option("--fresh", help=f"Estimate again, and keep the old as {registration.PREVIOUS}."),
    ] = False,
) -> None:
    """Lay the LIDAR's depth map on the camera's image: a small file and an overlay per scene."""
    manifest = find_manifest(dataset)
    capture = capture_of(manifest)
    if not source.is_dir():
        raise SourceError(f"{source} is no folder of captures", where="--source")
    height, width = capture.frame_size
    size = parse_length(pixel, "--pixel", at_most=LARGEST_PIXEL)
    focal_pixels = parse_length(focal_length, "--focal-length") / size
    above = parse_length(baseline, "--baseline")
    rig = geometry.CaptureRig(focal_pixels, (height, width), capture.crop_size, above)
    names = manifest.scene_names if scene == "all" else chosen(scene, "", manifest.scene_names)
    there = {name: find_captured_scene(source, name, capture) for name in names}
    there = {name: files for name, files in there.items() if files or scene != "all"}
    problems: _Problems = {}
    seen = _each(
        "looking at scenes",
        list(there),
        lambda name: _look(there[name], source / name, rig, fresh),
        problems,
    )
    sightings = {name: one.sighting for name, one in seen.items() if one.sighting}
    with progress("registering scenes") as step:
        found, unregistered = registration.register(sightings, rig, step)
    problems |= unregistered

    def draw(name: str) -> tuple[str, ...]:
        if name in found:
            _write(seen[name], found[name])
        return _drawn(name, seen[name], found.get(name), rig)

    to_draw = [name for name, one in seen.items() if name in found or not one.sighting]
    rows = _each("drawing scenes", to_draw, draw, problems)
    if rows:
        columns = ("scene", "", "rays on their side", "known to (pixels)", "moved by (pixels)")
        notes = _notes({name: found[name] for name in rows if name in found})
        print_table(Table("registration", columns, tuple(rows.values()), "llrrr", notes))
    if problems:
        said = (_at_scene(p, source, name) for name in there for p in problems.get(name, ()))
        raise SourceError.of(dict.fromkeys(said))
    if not rows:
        raise SourceError("no raw scene, such as k33/frames", where=str(source))


@dataclass(frozen=True)
class _Seen:
    """A scene as `register` reads it; without a sighting where its registration is kept."""

    files: RawScene
    ranges: NDArray[np.float64]
    beams: lidar.Beams
    frame: NDArray[np.uint8]
    frame_name: str
    sighting: Sighting | None


def _each(
    what: str, names: Sequence[str], work: Callable[[str], _T], problems: _Problems
) -> dict[str, _T]:
    """Do the work of each scene and show how far it is; what is wrong with one stops no other."""
    done = {}
    with progress(what) as step:
        for number, name in enumerate(names, start=1):
            try:
                done[name] = work(name)
            except DfdbenchError as error:
                problems[name] = error.problems
            step(number, len(names))
    return done


def _look(
    files: RawScene | PublishedScene | None, place: Path, rig: geometry.CaptureRig, fresh: bool
) -> _Seen:
    if not isinstance(files, RawScene):
        raise SourceError.of(_not_raw(place))
    wrong = files.scan_problems()
    SourceError.raise_if(wrong)
    ranges, beams = files.ranges(), files.beams()
    frame, frame_name = _sharp_frame(files)
    kept = files.registration.exists() and not fresh
    sighting = None if kept else registration.sight(frame, ranges, beams, rig)
    return _Seen(files, ranges, beams, frame, frame_name, sighting)


def _write(one: _Seen, found: registration.Registration) -> None:
    others = f" and {found.boards - 1} other scenes" if found.boards > 1 else ""
    note = f"Estimated by dfdbench rig register from {one.frame_name}{others}."
    corners = board_rays(one.ranges, one.beams).corners()
    registration.write_registration(one.files.registration, found.matrix, corners, note)


def _drawn(
    name: str, one: _Seen, found: registration.Registration | None, rig: geometry.CaptureRig
) -> tuple[str, ...]:
    after = registration.read_registration(one.files.registration)
    rays = board_rays(one.ranges, one.beams)
    levels, valid = lidar.depth_image(one.ranges, one.beams)
    before = rays.matrix(geometry.Pose(), rig)
    if not lidar.warp(levels, valid, after, (rig.crop_size,) * 2)[1].any():
        fix = "correct it by hand, or estimate it anew with --fresh"
        where = str(one.files.registration)
        raise SourceError("no LIDAR return falls on the image", where=where, fix=fix)
    moved = [cv2.perspectiveTransform(rays.corners()[np.newaxis], m)[0] for m in (before, after)]
    # The whole frame is drawn, not its crop: the board's sides are what tells.
    y, x = rig.crop_offset
    to_frame = np.array([[1.0, 0, x], [0, 1, y], [0, 0, 1]])
    named = {
        "before: LIDAR taken as parallel to the camera": before,
        "after: " + registration.NAME: after,
    }
    depths = {
        title: lidar.warp(levels, valid, to_frame @ matrix, rig.frame_size)
        for title, matrix in named.items()
    }
    figure = overlay_figure(one.frame, depths, f"{name}, {one.frame_name}, whole frame")
    save_figure(figure, one.files.folder / OVERLAY)
    shift = f"{float(np.linalg.norm(moved[1] - moved[0], axis=-1).max()):.1f}"
    if found is None:
        return name, "kept", "–", "–", shift
    how = "by itself" if found.boards == 1 else f"with {found.boards} boards"
    agreed = "–" if found.agreement is None else f"{100 * found.agreement:.1f} %"
    return name, f"estimated {how}", agreed, f"± {found.known_to:.1f}", shift


def _notes(found: Mapping[str, registration.Registration]) -> tuple[str, ...]:
    loose = [name for name, one in found.items() if one.known_to > _KNOWN_WELL]
    unseen = [name for name, one in found.items() if one.agreement is None]
    said = {
        "the beams leave open where the board lies; register it with others of its rig": loose,
        "the image shows too little of the board; it lies where the others tell": unseen,
    }
    return tuple(f"{', '.join(names)}: {what}" for what, names in said.items() if names)


def _sharp_frame(files: RawScene) -> tuple[NDArray[np.uint8], str]:
    exposures = files.exposures()
    if not exposures:
        raise SourceError("scene has no frames", where=str(files.folder / "frames"))
    exposure = exposures[len(exposures) // 2]
    steps = files.steps(exposure)
    problems = [problem for step in steps for problem in files.image_problems(exposure, step)]
    if problems or not steps:
        raise SourceError.of(
            problems or [Problem("exposure has no frames", where=f"{files.folder}, {exposure} ms")]
        )
    frames = [files.frame(exposure, step) for step in steps]
    chosen = sharpest(frames)
    return frames[chosen], f"step {steps[chosen]}, {exposure} ms"


def _not_raw(place: Path) -> Problem:
    found = "images that are registered already" if place.is_dir() else "no such folder"
    what = f"no raw captures, {place.name}/frames and {place.name}/lidar: {found}"
    return Problem(what, where=str(place))


def _at_scene(problem: Problem, source: Path, name: str) -> Problem:
    # A path names the scene, or that scenes share what is wrong.
    named = problem.where.startswith(str(source))
    return problem if named else replace(problem, where=f"{name}: {problem.where}")


_LARGEST_TURN = 10.0  # degrees


def simulate_realworld(
    out: Annotated[Path, Option(help="Folder to write the scenes into.")],
    scenes: Annotated[str, Option(help="Which: k00-k07,k33.")] = "k00-k07",
    steps: Annotated[str, Option(help="Voltage steps: 127-143.")] = "127-143",
    exposures: Annotated[str, Option(help="Exposure times in ms.")] = "10,20,30,40,50,60,70",
    turn: Annotated[
        str, Option(help="The LIDAR's rotation: yaw,pitch,roll in degrees.")
    ] = f"{MOUNTED.yaw},{MOUNTED.pitch},{MOUNTED.roll}",
    workers: Annotated[int, Option(min=1, max=1024, help="Scenes made at once.")] = os.cpu_count()
    or 1,
) -> None:
    """Simulate raw captures of the real-world set: frames, LIDAR scans, and the truth beside."""
    output_place(out)
    manifest = find_manifest("realworld")
    capture = capture_of(manifest)
    names = chosen(scenes, "--scenes", manifest.scene_names)
    settings = CaptureSettings(
        chosen(steps, "--steps", capture.voltage_step),
        chosen(exposures, "--exposures", manifest.axes["exposure_ms"]),
        capture.frames,
        capture.lidar_scans,
        _pose(turn),
    )
    count = len(settings.steps) * len(settings.exposures) * settings.frames
    say(f"{count} frames a scene, about {count * 0.8:.0f} MB")
    with writing(out), progress("simulating scenes") as step:
        made = write_captures(out, names, capture, settings, workers, step)
    kept = f", {len(names) - len(made)} kept from before" if len(made) < len(names) else ""
    print(f"simulated {counted(len(made), 'scene')}{kept}")
    print(f"captures     {out}")
    print(f"truth        {out / 'truth'} (never read by build or register)")
    say(f"next         dfdbench rig register {scenes} --source {out}")


def simulate_lens(out: Annotated[Path, Option(help="Folder to write into.")]) -> None:
    """Simulate the captures of a lens test: a dot over temperature, and voltage up and down."""
    output_place(out)
    with writing(out):
        print(f"simulated {write_lens_test(out)} images")
    print(f"captures     {out}")
    say(f"next         dfdbench rig optics sharpness {out}")


def _pose(text: str) -> geometry.Pose:
    try:
        yaw, pitch, roll = map(float, text.split(","))
    except ValueError:
        what = f"not yaw,pitch,roll in degrees, as 0.5,-0.3,1: {text}"
        raise InputError(what, where="--turn") from None
    if not all(abs(angle) <= _LARGEST_TURN for angle in (yaw, pitch, roll)):
        what = f"the LIDAR would miss the board: {_LARGEST_TURN:g} degrees at most, not {text}"
        raise InputError(what, where="--turn")
    return geometry.Pose(yaw, pitch, roll)


def capture_of(manifest: Manifest) -> Recording:
    """Return how a data set was captured.

    Raises
    ------
    InputError
        Where it was not captured by the rig.
    """
    if manifest.capture is None:
        raise InputError(f"{manifest.short} was not captured by the rig", where="--dataset")
    return manifest.capture


def chosen(text: str, where: str, known: Sequence[_T]) -> tuple[_T, ...]:
    """Return what a list names, as ``k00-k07,k33`` or ``127-131,141``, in the order of `known`.

    Raises
    ------
    UnknownNameError
        If it names what is not known.
    InputError
        If a span goes backwards.

    Examples
    --------
    >>> chosen("40, 10-20", "--exposures", (10, 15, 20, 40))
    (10, 15, 20, 40)
    """
    names = [str(each) for each in known]
    places: set[int] = set()
    for part in text.split(","):
        ends = part.strip().split("-", 1)
        for name in ends:
            if name not in names:
                what = f"unknown value {name!r}, not of {names[0]} to {names[-1]}"
                near = unknown_name("value", name, names).problems[0].fix
                raise UnknownNameError(what, where=where, fix=near)
        begin, end = names.index(ends[0]), names.index(ends[-1])
        if end < begin:
            what, fix = f"nothing in the span {part.strip()}", f"{ends[-1]}-{ends[0]}"
            raise InputError(what, where=where, fix=fix)
        places.update(range(begin, end + 1))
    return tuple(known[place] for place in sorted(places))
