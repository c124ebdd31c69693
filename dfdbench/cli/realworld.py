"""The verbs for the capture rig: simulate realworld, simulate lens, register."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import typer
from numpy.typing import NDArray

from dfdbench.board_rays import board_rays
from dfdbench.catalog import find_manifest
from dfdbench.cli.answer import writing
from dfdbench.cli.screen import print_table, progress, save_figure, say
from dfdbench.errors import DfdbenchError, InputError, Problem, SourceError, unknown_name
from dfdbench.figures_realworld import overlay_figure
from dfdbench.lidar import Beams, depth_image, warp
from dfdbench.manifest import Capture, Manifest
from dfdbench.registration import Registration, Sighting, register, sight
from dfdbench.registration_file import NAME, read_registration, write_registration
from dfdbench.rig import Pose, Rig
from dfdbench.sharpness import sharpest
from dfdbench.simulated_captures import Settings, write_captures
from dfdbench.simulated_lens import write_lens_test
from dfdbench.simulator import MOUNTED
from dfdbench.sources.captures import PublishedScene, RawScene, find_scene
from dfdbench.tables import Table
from dfdbench.units import parse_length

simulate_app = typer.Typer(help="Make captures as the thesis's rig would write them.")

OVERLAY = "registration.png"
_KNOWN_WELL = 3.0  # pixels
_LARGEST_TURN = 10.0  # degrees


@simulate_app.command("realworld")
def simulate_realworld(
    out: Annotated[Path, typer.Option(help="Folder to write the scenes into.")],
    scenes: Annotated[str, typer.Option(help="Which: k00-k07,k33.")] = "k00-k07",
    steps: Annotated[str, typer.Option(help="Voltage steps: 127-143.")] = "127-143",
    exposures: Annotated[str, typer.Option(help="In ms.")] = "10,20,30,40,50,60,70",
    turn: Annotated[
        str, typer.Option(help="Of the LIDAR against the camera: yaw,pitch,roll in degrees.")
    ] = f"{MOUNTED.yaw},{MOUNTED.pitch},{MOUNTED.roll}",
    workers: Annotated[int, typer.Option(min=1, help="Scenes made at once.")] = os.cpu_count() or 1,
) -> None:
    """Simulate raw captures of the real-world set: frames, LIDAR scans, and the truth beside."""
    manifest = find_manifest("realworld")
    capture = _capture(manifest)
    names = _scenes(scenes, manifest)
    settings = Settings(
        _numbers(steps, "--steps", capture.voltage_step),
        _numbers(exposures, "--exposures", manifest.axes["exposure_ms"]),
        capture.frames,
        capture.lidar_scans,
        _pose(turn),
    )
    count = len(settings.steps) * len(settings.exposures) * settings.frames
    say(f"{count} frames a scene, about {count * 0.8:.0f} MB")
    with writing(out), progress("simulating scenes") as step:
        made = write_captures(out, names, capture, settings, workers, step)
    kept = f", {len(names) - len(made)} kept from before" if len(made) < len(names) else ""
    print(f"simulated {len(made)} scenes{kept}")
    print(f"captures     {out}")
    print(f"truth        {out / 'truth'} (never read by build or register)")
    say(f"next         dfdbench register {scenes} --source {out}")


@simulate_app.command("lens")
def simulate_lens(out: Annotated[Path, typer.Option(help="Folder to write into.")]) -> None:
    """Simulate the captures of a lens test: a dot over temperature, and voltage up and down."""
    with writing(out):
        print(f"simulated {write_lens_test(out)} images")
    print(f"captures     {out}")
    say(f"next         dfdbench optics sharpness {out}")


def register_scenes(
    scene: Annotated[str, typer.Argument(help="Which: k33, k00-k07, or all that are there.")],
    source: Annotated[Path, typer.Option(help="Folder with raw captures.")],
    dataset: Annotated[
        str, typer.Option(help="A data set's name or a manifest's path: scenes and frame sizes.")
    ] = "realworld",
    focal_length: Annotated[str, typer.Option(help="Of the camera.")] = "9.6mm",
    pixel: Annotated[str, typer.Option(help="Size of a pixel.")] = "4.8um",
    baseline: Annotated[str, typer.Option(help="The LIDAR's height above the camera.")] = "93mm",
    fresh: Annotated[
        bool, typer.Option("--fresh", help="Estimate anew where a registration is kept.")
    ] = False,
) -> None:
    """Lay the LIDAR's depth map on the camera's image: a small file and an overlay a scene."""
    manifest = find_manifest(dataset)
    capture = _capture(manifest)
    height, width = capture.frame_size
    rig = Rig(
        parse_length(focal_length, "--focal-length") / parse_length(pixel, "--pixel"),
        (height, width), capture.crop_size, parse_length(baseline, "--baseline"),
    )  # fmt: skip
    everywhere = scene == "all"
    span = f"{manifest.scene_names[0]}-{manifest.scene_names[-1]}"
    names = _scenes(span if everywhere else scene, manifest)
    there = {name: find_scene(source, name, capture) for name in names}
    if everywhere:
        there = {name: files for name, files in there.items() if files}
    seen: dict[str, _Seen] = {}
    problems: dict[str, tuple[Problem, ...]] = {}
    with progress("looking at scenes") as step:
        for number, (name, files) in enumerate(there.items(), start=1):
            try:
                seen[name] = _look(files, source / name, rig, fresh)
            except DfdbenchError as error:
                problems[name] = error.problems
            step(number, len(there))
    sightings = {name: one.sighting for name, one in seen.items() if one.sighting}
    with progress("registering scenes") as step:
        found, untold = register(sightings, rig, step)
    problems |= untold
    for name, registration in found.items():
        _write(seen[name], registration)
    drawn = {name: one for name, one in seen.items() if one.files.registration.exists()}
    rows = []
    with progress("drawing scenes") as step:
        for number, (name, one) in enumerate(drawn.items(), start=1):
            try:
                rows.append(_drawn(name, one, found.get(name), rig))
            except DfdbenchError as error:
                problems[name] = error.problems
            step(number, len(drawn))
    if rows:
        columns = ("scene", "", "rays on their side", "known to (pixels)", "moved by (pixels)")
        print_table(Table("registration", columns, tuple(rows), "llrrr", _notes(found)))
    if problems:
        raise SourceError([_at_scene(p, name) for name in there for p in problems.get(name, ())])
    if not rows:
        raise SourceError(Problem("no raw scene found", str(source), "folders such as k33/frames"))


@dataclass(frozen=True)
class _Seen:
    """A scene as `register` reads it; without a sighting where its registration is kept."""

    files: RawScene
    ranges: NDArray[np.float64]
    beams: Beams
    frame: NDArray[np.uint8]
    told: str
    sighting: Sighting | None


def _look(files: RawScene | PublishedScene | None, place: Path, rig: Rig, fresh: bool) -> _Seen:
    if not isinstance(files, RawScene):
        raise SourceError(_not_raw(place))
    wrong = files.scan_problems()
    if wrong:
        raise SourceError(wrong)
    ranges, beams = files.ranges(), files.beams()
    frame, told = _sharp_frame(files)
    kept = files.registration.exists() and not fresh
    sighting = None if kept else sight(frame, ranges, beams, rig)
    return _Seen(files, ranges, beams, frame, told, sighting)


def _write(one: _Seen, found: Registration) -> None:
    others = f" and {found.boards - 1} other scenes" if found.boards > 1 else ""
    note = f"Estimated by dfdbench register from {one.told}{others}."
    corners = board_rays(one.ranges, one.beams).corners()
    write_registration(one.files.registration, found.matrix, corners, note)


def _drawn(name: str, one: _Seen, found: Registration | None, rig: Rig) -> tuple[str, ...]:
    after = read_registration(one.files.registration)
    rays = board_rays(one.ranges, one.beams)
    before = rays.matrix(Pose(), rig)
    moved = [cv2.perspectiveTransform(rays.corners()[np.newaxis], m)[0] for m in (before, after)]
    levels, valid = depth_image(one.ranges, one.beams)
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
        raise SourceError(Problem("scene has no frames", str(files.folder / "frames")))
    exposure = exposures[len(exposures) // 2]
    steps = files.steps(exposure)
    problems = [problem for step in steps for problem in files.image_problems(exposure, step)]
    if problems or not steps:
        raise SourceError(
            problems or [Problem("exposure has no frames", f"{files.folder}, {exposure} ms")]
        )
    frames = [files.frame(exposure, step) for step in steps]
    chosen = sharpest(frames)
    return frames[chosen], f"step {steps[chosen]}, {exposure} ms"


def _scenes(text: str, manifest: Manifest) -> tuple[str, ...]:
    known = manifest.scene_names
    chosen: set[str] = set()
    for part in text.split(","):
        first, _, last = part.strip().partition("-")
        for name in (first, last or first):
            if name not in known:
                raise unknown_name("scene", name, known)
        if known.index(last or first) < known.index(first):
            raise InputError(
                Problem("no scene in that span", got=part.strip(), fix=f"{last}-{first}")
            )
        chosen.update(known[known.index(first) : known.index(last or first) + 1])
    return tuple(name for name in known if name in chosen)


def _numbers(text: str, option: str, known: list[int]) -> tuple[int, ...]:
    chosen: set[int] = set()
    for part in text.split(","):
        ends = re.fullmatch(r"\s*(\d+)(?:-(\d+))?\s*", part)
        if ends:
            chosen.update(range(int(ends[1]), int(ends[2] or ends[1]) + 1))
        if not ends or not chosen <= set(known):
            expected = f"of {', '.join(map(str, known))}"
            raise InputError(Problem("not a list of values", option, expected, text))
    return tuple(sorted(chosen))


def _pose(text: str) -> Pose:
    try:
        yaw, pitch, roll = map(float, text.split(","))
    except ValueError:
        raise InputError(
            Problem("not a turn", "--turn", "yaw,pitch,roll in degrees, as 0.5,-0.3,1", text)
        ) from None
    if not max(abs(yaw), abs(pitch), abs(roll)) <= _LARGEST_TURN:
        expected = f"angles of {_LARGEST_TURN:g} degrees at most"
        raise InputError(Problem("the LIDAR would miss the board", "--turn", expected, text))
    return Pose(yaw, pitch, roll)


def _capture(manifest: Manifest) -> Capture:
    if manifest.capture is None:
        raise SourceError(Problem("section is missing", f"{manifest.stem}: capture"))
    return manifest.capture


def _not_raw(place: Path) -> Problem:
    return Problem(
        "no raw captures", str(place), f"{place.name}/frames and {place.name}/lidar",
        "images that are registered already" if place.is_dir() else "no such folder",
    )  # fmt: skip


def _at_scene(problem: Problem, name: str) -> Problem:
    where = problem.where if name in problem.where else f"{name}: {problem.where}"
    return Problem(problem.what, where, problem.expected, problem.got, problem.fix)
