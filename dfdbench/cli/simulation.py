"""The verbs that make captures as the rig would: simulate realworld, simulate lens."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from dfdbench.cli.answer import writing
from dfdbench.cli.captures import capture_of, chosen_numbers, chosen_scenes
from dfdbench.cli.screen import progress, say
from dfdbench.datasets.catalog import find_manifest
from dfdbench.errors import InputError
from dfdbench.results.output_place import output_place
from dfdbench.rig.geometry import Pose
from dfdbench.simulation.board_scene import MOUNTED
from dfdbench.simulation.capture_files import CaptureSettings, write_captures, write_lens_test
from dfdbench.tables.wording import counted

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
