"""The verbs for the capture rig: simulate realworld, simulate lens, register."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import typer
from numpy.typing import NDArray

from dfdbench.catalog import find_manifest
from dfdbench.cli.screen import print_table, progress, save_figure, say
from dfdbench.errors import DfdbenchError, InputError, Problem, SourceError, unknown_name
from dfdbench.figures_realworld import overlay_figure
from dfdbench.lidar import depth_image, warp
from dfdbench.manifest import Capture, Manifest
from dfdbench.registration import board_corners, nominal, register
from dfdbench.registration_file import NAME, read_registration, write_registration
from dfdbench.rig import Rig
from dfdbench.sharpness import sharpest
from dfdbench.simulated_captures import Settings, write_captures
from dfdbench.simulated_lens import write_lens_test
from dfdbench.sources.captures import RawScene, find_scene
from dfdbench.tables import Table
from dfdbench.units import parse_length

simulate_app = typer.Typer(help="Make captures as the thesis's rig would write them.")

OVERLAY = "registration.png"


@simulate_app.command("realworld")
def simulate_realworld(
    out: Annotated[Path, typer.Option(help="Folder to write the scenes into.")],
    scenes: Annotated[str, typer.Option(help="Which: k00-k07,k33.")] = "k00-k07",
    steps: Annotated[str, typer.Option(help="Voltage steps: 127-143.")] = "127-143",
    exposures: Annotated[str, typer.Option(help="In ms.")] = "10,20,30,40,50,60,70",
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
    )
    count = len(settings.steps) * len(settings.exposures) * settings.frames
    say(f"{count} frames a scene, about {count * 0.8:.0f} MB")
    with progress("simulating scenes") as step:
        made = write_captures(out, names, capture, settings, workers, step)
    kept = f", {len(names) - len(made)} kept from before" if len(made) < len(names) else ""
    print(f"simulated {len(made)} scenes{kept}")
    print(f"captures     {out}")
    print(f"truth        {out / 'truth'} (never read by build or register)")
    say(f"next         dfdbench register {scenes} --source {out}")


@simulate_app.command("lens")
def simulate_lens(out: Annotated[Path, typer.Option(help="Folder to write into.")]) -> None:
    """Simulate the captures of a lens test: a dot over temperature, and voltage up and down."""
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
    rows, problems = [], []
    for name in _scenes(f"{manifest.scene_names[0]}-{manifest.scene_names[-1]}" if everywhere
                        else scene, manifest):  # fmt: skip
        files = find_scene(source, name, capture)
        if files is None and everywhere:
            continue
        if not isinstance(files, RawScene):
            problems.append(_not_raw(source / name))
            continue
        try:
            rows.append(_register(files, name, rig, fresh))
        except DfdbenchError as error:
            problems += [_at_scene(problem, name) for problem in error.problems]
    if rows:
        columns = ("scene", "", "rays on their side", "moved by (pixels)")
        print_table(Table("registration", columns, tuple(rows), "llrr"))
    if problems:
        raise SourceError(problems)
    if not rows:
        raise SourceError(Problem("no raw scene found", str(source), "folders such as k33/frames"))


def _register(files: RawScene, name: str, rig: Rig, fresh: bool) -> tuple[str, ...]:
    found = files.scan_problems()
    if found:
        raise SourceError(found)
    ranges, beams = files.ranges(), files.beams()
    frame, told = _sharp_frame(files)
    before = nominal(ranges, beams, rig).matrix
    corners = board_corners(ranges, beams)
    agreement = "–"
    kept = files.registration.exists() and not fresh
    if not kept:
        estimate = register(frame, ranges, beams, rig)
        agreement = f"{100 * estimate.agreement:.1f} %"
        note = f"Estimated by dfdbench register from {told}."
        write_registration(files.registration, estimate.matrix, corners, note)
    after = read_registration(files.registration)
    moved = [cv2.perspectiveTransform(corners[np.newaxis], m)[0] for m in (before, after)]
    levels, valid = depth_image(ranges, beams)
    # The whole frame is drawn, not its crop: the board's sides are what tells.
    y, x = rig.crop_offset
    to_frame = np.array([[1.0, 0, x], [0, 1, y], [0, 0, 1]])
    named = {"before: LIDAR taken as parallel to the camera": before, "after: " + NAME: after}
    depths = {
        title: warp(levels, valid, to_frame @ matrix, rig.frame_size)
        for title, matrix in named.items()
    }
    figure = overlay_figure(frame, depths, f"{name}, {told}, whole frame")
    save_figure(figure, files.folder / OVERLAY)
    shift = float(np.linalg.norm(moved[1] - moved[0], axis=-1).max())
    return name, "kept" if kept else "estimated", agreement, f"{shift:.1f}"


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
