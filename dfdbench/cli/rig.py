"""The verbs for captures of the rig: register, simulate."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import typer
from numpy.typing import NDArray

from dfdbench.building.sources.rig_scenes import PublishedScene, RawScene, find_captured_scene
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
from dfdbench.rig.geometry import CaptureRig, Pose
from dfdbench.rig.lidar import Beams, depth_image, warp
from dfdbench.rig.registration import (
    NAME,
    PREVIOUS,
    Registration,
    read_registration,
    register,
    sight,
    write_registration,
)
from dfdbench.rig.sighting import Sighting, board_rays
from dfdbench.simulation.board_scene import MOUNTED
from dfdbench.simulation.capture_files import CaptureSettings, write_captures, write_lens_test
from dfdbench.tables.table import Table, counted

OVERLAY = "registration.png"


_KNOWN_WELL = 3.0  # pixels


def register_scenes(
    scene: Annotated[str, typer.Argument(help="Scenes: k33, k00-k07, or all that are there.")],
    source: Annotated[Path, typer.Option(help="Folder with raw captures.")],
    dataset: Annotated[
        str, typer.Option(help="A data set's name or a manifest's path: scenes and frame sizes.")
    ] = "realworld",
    focal_length: Annotated[str, typer.Option(help="Focal length of the camera.")] = "9.6mm",
    pixel: Annotated[str, typer.Option(help="Size of a pixel.")] = "4.8um",
    baseline: Annotated[str, typer.Option(help="The LIDAR's height above the camera.")] = "93mm",
    fresh: Annotated[
        bool,
        typer.Option("--fresh", help=f"Estimate again; the earlier answer is kept as {PREVIOUS}."),
    ] = False,
) -> None:
    """Lay the LIDAR's depth map on the camera's image: a small file and an overlay per scene."""
    manifest = find_manifest(dataset)
    capture = capture_of(manifest)
    if not source.is_dir():
        got = "a file" if source.exists() else "no such folder"
        raise SourceError("no folder of captures", where="--source", expected=str(source), got=got)
    height, width = capture.frame_size
    focal_pixels = parse_length(focal_length, "--focal-length") / parse_length(
        pixel, "--pixel", at_most=LARGEST_PIXEL
    )
    above = parse_length(baseline, "--baseline")
    rig = CaptureRig(focal_pixels, (height, width), capture.crop_size, above)
    there = _scenes_there(scene, source, manifest)
    problems: dict[str, tuple[Problem, ...]] = {}
    seen = _look_at_all(there, source, rig, fresh, problems)
    found = _register_all(seen, rig, problems)
    rows = _draw_all(seen, found, rig, problems)
    if rows:
        columns = ("scene", "", "rays on their side", "known to (pixels)", "moved by (pixels)")
        print_table(Table("registration", columns, tuple(rows), "llrrr", _notes(found)))
    if problems:
        told = (_at_scene(p, source, name) for name in there for p in problems.get(name, ()))
        raise SourceError.of(dict.fromkeys(told))
    if not rows:
        raise SourceError(
            "no raw scene found", where=str(source), expected="folders such as k33/frames"
        )


@dataclass(frozen=True)
class _Seen:
    """A scene as `register` reads it; without a sighting where its registration is kept."""

    files: RawScene
    ranges: NDArray[np.float64]
    beams: Beams
    frame: NDArray[np.uint8]
    told: str
    sighting: Sighting | None


def _scenes_there(
    scene: str, source: Path, manifest: Manifest
) -> dict[str, RawScene | PublishedScene | None]:
    everywhere = scene == "all"
    span = f"{manifest.scene_names[0]}-{manifest.scene_names[-1]}"
    names = chosen_scenes(span if everywhere else scene, manifest)
    there = {name: find_captured_scene(source, name, capture_of(manifest)) for name in names}
    return {name: files for name, files in there.items() if files or not everywhere}


def _look_at_all(
    there: Mapping[str, RawScene | PublishedScene | None],
    source: Path,
    rig: CaptureRig,
    fresh: bool,
    problems: dict[str, tuple[Problem, ...]],
) -> dict[str, _Seen]:
    seen: dict[str, _Seen] = {}
    with progress("looking at scenes") as step:
        for number, (name, files) in enumerate(there.items(), start=1):
            try:
                seen[name] = _look(files, source / name, rig, fresh)
            except DfdbenchError as error:
                problems[name] = error.problems
            step(number, len(there))
    return seen


def _register_all(
    seen: Mapping[str, _Seen], rig: CaptureRig, problems: dict[str, tuple[Problem, ...]]
) -> dict[str, Registration]:
    sightings = {name: one.sighting for name, one in seen.items() if one.sighting}
    with progress("registering scenes") as step:
        registered, untold = register(sightings, rig, step)
    problems |= untold
    found: dict[str, Registration] = {}
    for name, registration in registered.items():
        try:
            _write(seen[name], registration)
            found[name] = registration
        except DfdbenchError as error:
            problems[name] = error.problems
    return found


def _draw_all(
    seen: Mapping[str, _Seen],
    found: Mapping[str, Registration],
    rig: CaptureRig,
    problems: dict[str, tuple[Problem, ...]],
) -> list[tuple[str, ...]]:
    drawn = {name: one for name, one in seen.items() if name in found or not one.sighting}
    rows = []
    with progress("drawing scenes") as step:
        for number, (name, one) in enumerate(drawn.items(), start=1):
            try:
                rows.append(_drawn(name, one, found.get(name), rig))
            except DfdbenchError as error:
                problems[name] = error.problems
            step(number, len(drawn))
    return rows


def _look(
    files: RawScene | PublishedScene | None, place: Path, rig: CaptureRig, fresh: bool
) -> _Seen:
    if not isinstance(files, RawScene):
        raise SourceError.of(_not_raw(place))
    wrong = files.scan_problems()
    if wrong:
        raise SourceError.of(wrong)
    ranges, beams = files.ranges(), files.beams()
    frame, told = _sharp_frame(files)
    kept = files.registration.exists() and not fresh
    sighting = None if kept else sight(frame, ranges, beams, rig)
    return _Seen(files, ranges, beams, frame, told, sighting)


def _write(one: _Seen, found: Registration) -> None:
    others = f" and {found.boards - 1} other scenes" if found.boards > 1 else ""
    note = f"Estimated by dfdbench rig register from {one.told}{others}."
    corners = board_rays(one.ranges, one.beams).corners()
    write_registration(one.files.registration, found.matrix, corners, note)


def _drawn(name: str, one: _Seen, found: Registration | None, rig: CaptureRig) -> tuple[str, ...]:
    after = read_registration(one.files.registration)
    rays = board_rays(one.ranges, one.beams)
    levels, valid = depth_image(one.ranges, one.beams)
    before = rays.matrix(Pose(), rig)
    if not warp(levels, valid, after, (rig.crop_size,) * 2)[1].any():
        raise SourceError(
            "no LIDAR return falls on the image",
            where=str(one.files.registration),
            fix="correct it by hand, or estimate it anew with --fresh",
        )
    moved = [cv2.perspectiveTransform(rays.corners()[np.newaxis], m)[0] for m in (before, after)]
    # The whole frame is drawn, not its crop: the board's sides are what tells.
    y, x = rig.crop_offset
    to_frame = np.array([[1.0, 0, x], [0, 1, y], [0, 0, 1]])
    named = {"before: LIDAR taken as parallel to the camera": before, "after: " + NAME: after}
    depths = {
        title: warp(levels, valid, to_frame @ matrix, rig.frame_size)
        for title, matrix in named.items()
    }
    figure = overlay_figure(one.frame, depths, f"{name}, {one.told}, whole frame")
    save_figure(figure, one.files.folder / OVERLAY)
    shift = f"{float(np.linalg.norm(moved[1] - moved[0], axis=-1).max()):.1f}"
    if found is None:
        return name, "kept", "–", "–", shift
    how = "by itself" if found.boards == 1 else f"with {found.boards} boards"
    agreed = "–" if found.agreement is None else f"{100 * found.agreement:.1f} %"
    return name, f"estimated {how}", agreed, f"± {found.known_to:.1f}", shift


def _notes(found: Mapping[str, Registration]) -> tuple[str, ...]:
    loose = [name for name, one in found.items() if one.known_to > _KNOWN_WELL]
    unseen = [name for name, one in found.items() if one.agreement is None]
    told = {
        "the beams leave open where the board lies; register it with others of its rig": loose,
        "the image shows too little of the board; it lies where the others tell": unseen,
    }
    return tuple(f"{', '.join(names)}: {what}" for what, names in told.items() if names)


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
    return Problem(
        "no raw captures",
        where=str(place),
        expected=f"{place.name}/frames and {place.name}/lidar",
        got="images that are registered already" if place.is_dir() else "no such folder",
    )


def _at_scene(problem: Problem, source: Path, name: str) -> Problem:
    # A path tells the scene, or that scenes share what is wrong.
    named = problem.where.startswith(str(source))
    where = problem.where if named else f"{name}: {problem.where}"
    return Problem(
        problem.what, where=where, expected=problem.expected, got=problem.got, fix=problem.fix
    )


app = typer.Typer(
    help="Make captures as the thesis's rig would write them.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
)


_LARGEST_TURN = 10.0  # degrees


@app.command("realworld")
def simulate_realworld(
    out: Annotated[Path, typer.Option(help="Folder to write the scenes into.")],
    scenes: Annotated[str, typer.Option(help="Which: k00-k07,k33.")] = "k00-k07",
    steps: Annotated[str, typer.Option(help="Voltage steps: 127-143.")] = "127-143",
    exposures: Annotated[str, typer.Option(help="Exposure times in ms.")] = "10,20,30,40,50,60,70",
    turn: Annotated[
        str,
        typer.Option(help="Rotation of the LIDAR against the camera: yaw,pitch,roll in degrees."),
    ] = f"{MOUNTED.yaw},{MOUNTED.pitch},{MOUNTED.roll}",
    workers: Annotated[
        int, typer.Option(min=1, max=1024, help="Scenes made at once.")
    ] = os.cpu_count() or 1,
) -> None:
    """Simulate raw captures of the real-world set: frames, LIDAR scans, and the truth beside."""
    output_place(out)
    manifest = find_manifest("realworld")
    capture = capture_of(manifest)
    names = chosen_scenes(scenes, manifest)
    settings = CaptureSettings(
        chosen_numbers(steps, "--steps", capture.voltage_step),
        chosen_numbers(exposures, "--exposures", manifest.axes["exposure_ms"]),
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


@app.command("lens")
def simulate_lens(out: Annotated[Path, typer.Option(help="Folder to write into.")]) -> None:
    """Simulate the captures of a lens test: a dot over temperature, and voltage up and down."""
    output_place(out)
    with writing(out):
        print(f"simulated {write_lens_test(out)} images")
    print(f"captures     {out}")
    say(f"next         dfdbench rig optics sharpness {out}")


def _pose(text: str) -> Pose:
    try:
        yaw, pitch, roll = map(float, text.split(","))
    except ValueError:
        raise InputError(
            "not a turn",
            where="--turn",
            expected="yaw,pitch,roll in degrees, as 0.5,-0.3,1",
            got=text,
        ) from None
    if not all(abs(angle) <= _LARGEST_TURN for angle in (yaw, pitch, roll)):
        expected = f"angles of {_LARGEST_TURN:g} degrees at most"
        raise InputError(
            "the LIDAR would miss the board", where="--turn", expected=expected, got=text
        )
    return Pose(yaw, pitch, roll)


def capture_of(manifest: Manifest) -> Recording:
    """Return how a data set was captured.

    Raises
    ------
    InputError
        Where it was not captured by the rig.
    """
    if manifest.capture is None:
        raise InputError(
            "not captured by the rig", where="--dataset", expected="realworld", got=manifest.short
        )
    return manifest.capture


def chosen_scenes(text: str, manifest: Manifest) -> tuple[str, ...]:
    """Return the scenes that a list names, as ``k00-k07,k33``, in the manifest's order.

    Raises
    ------
    UnknownNameError
        Where it names one that the manifest lacks.
    InputError
        Where a span goes backwards.
    """
    known = manifest.scene_names
    chosen: set[str] = set()
    for part in text.split(","):
        first, _, last = part.strip().partition("-")
        for name in (first, last or first):
            if name not in known:
                near = unknown_name("scene", name, known).problems[0].fix
                raise UnknownNameError(
                    "unknown scene",
                    where="",
                    expected=f"of {known[0]} to {known[-1]}",
                    got=name,
                    fix=near,
                )
        begin, end = known.index(first), known.index(last or first)
        if end < begin:
            raise InputError("no scene in that span", got=part.strip(), fix=f"{last}-{first}")
        chosen.update(known[begin : end + 1])
    return tuple(name for name in known if name in chosen)


def chosen_numbers(text: str, option: str, known: Sequence[int]) -> tuple[int, ...]:
    """Return the numbers that a list names, as ``127-131,141``, ascending.

    Raises
    ------
    InputError
        Where it is no such list, a span goes backwards, or names what is not known.
    """
    expected = ", ".join(map(str, known))
    chosen: set[int] = set()
    for part in text.split(","):
        ends = re.fullmatch(r"\s*(\d+)(?:-(\d+))?\s*", part)
        if not ends:
            raise InputError(
                "not a list of numbers",
                where=option,
                expected=f"as {known[0]} or {known[0]}-{known[-1]}, of {expected}",
                got=text,
            )
        first, last = int(ends[1]), int(ends[2] or ends[1])
        if last < first:
            raise InputError(
                "no number in that span", where=option, got=part.strip(), fix=f"{last}-{first}"
            )
        # A span may pass over what is not known, as 10-70 over 15; its ends may not.
        if not {first, last} <= set(known):
            raise InputError(
                "unknown value", where=option, expected=f"of {expected}", got=part.strip()
            )
        chosen.update(number for number in known if first <= number <= last)
    return tuple(sorted(chosen))
