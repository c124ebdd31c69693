"""The verbs for captures of the rig: register, simulate."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, TypeVar

from typer import Argument, Option

from dfdbench.building.registering import Registered, register_scenes
from dfdbench.cli.options import LARGEST_PIXEL, Facts, Printed, parse_length
from dfdbench.cli.screen import progress, save_figure, say, show, writing
from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.manifest import Manifest, Recording
from dfdbench.errors import InputError, SourceError, UnknownNameError, unknown_name
from dfdbench.figures.camera import overlay_figure
from dfdbench.results.output_place import output_place
from dfdbench.rig import geometry, registration
from dfdbench.simulation import board_scene
from dfdbench.tables.table import Format, Table, counted

OVERLAY = "registration.png"
_T = TypeVar("_T")
_KNOWN_WELL = 3.0  # pixels


def register(
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
    format: Printed = Format.table,
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
    found, problems = register_scenes(source, capture, names, rig, scene == "all", fresh, progress)
    for name, one in found.items():
        title = f"{name}, {one.frame_name}, whole frame"
        save_figure(overlay_figure(one.frame, one.depths(), title), one.files.folder / OVERLAY)
    if found:
        columns = ("scene", "", "rays on their side", "known to (pixels)", "moved by (pixels)")
        rows = tuple(_row(name, one) for name, one in found.items())
        records = tuple(map(_record, found, found.values()))
        show(
            format, [Table("registration", columns, rows, "llrrr", _notes(found), records=records)]
        )
    SourceError.raise_if(problems)
    if not found:
        raise SourceError("no raw scene, such as k33/frames", where=str(source))


def _row(name: str, one: Registered) -> tuple[str, ...]:
    moved = f"{one.moved:.1f}"
    if (found := one.found) is None:
        return name, "kept", "–", "–", moved
    how = "by itself" if found.boards == 1 else f"with {found.boards} boards"
    agreed = "–" if found.agreement is None else f"{100 * found.agreement:.1f} %"
    return name, f"estimated {how}", agreed, f"± {found.known_to:.1f}", moved


def _record(name: str, one: Registered) -> dict[str, object]:
    found = {key: getattr(one.found, key, None) for key in ("agreement", "known_to", "boards")}
    overlay = one.files.folder / OVERLAY
    return {"scene": name, "kept": one.found is None, **found, "moved": one.moved, "file": overlay}


def _notes(scenes: Mapping[str, Registered]) -> tuple[str, ...]:
    found = {name: one.found for name, one in scenes.items() if one.found}
    loose = [name for name, one in found.items() if one.known_to > _KNOWN_WELL]
    unseen = [name for name, one in found.items() if one.agreement is None]
    said = {
        "the beams leave open where the board lies; register it with others of its rig": loose,
        "the image shows too little of the board; it lies where the others tell": unseen,
    }
    return tuple(f"{', '.join(names)}: {what}" for what, names in said.items() if names)


_LARGEST_TURN = 10.0  # degrees


def simulate_realworld(
    out: Annotated[Path, Option(help="Folder to write the scenes into.")],
    scenes: Annotated[str, Option(help="Which: k00-k07,k33.")] = "k00-k07",
    steps: Annotated[str, Option(help="Voltage steps: 127-143.")] = "127-143",
    exposures: Annotated[str, Option(help="Exposure times in ms.")] = "10,20,30,40,50,60,70",
    turn: Annotated[
        str, Option(help="The LIDAR's rotation: yaw,pitch,roll in degrees.")
    ] = f"{board_scene.MOUNTED.yaw},{board_scene.MOUNTED.pitch},{board_scene.MOUNTED.roll}",
    workers: Annotated[int, Option(min=1, max=1024, help="Scenes made at once.")] = os.cpu_count()
    or 1,
    format: Facts = "table",
) -> None:
    """Simulate raw captures of the real-world set: frames, LIDAR scans, and the truth beside."""
    output_place(out)
    manifest = find_manifest("realworld")
    capture = capture_of(manifest)
    names = chosen(scenes, "--scenes", manifest.scene_names)
    settings = board_scene.CaptureSettings(
        chosen(steps, "--steps", capture.voltage_step),
        chosen(exposures, "--exposures", manifest.axes["exposure_ms"]),
        capture.frames,
        capture.lidar_scans,
        _pose(turn),
    )
    count = len(settings.steps) * len(settings.exposures) * settings.frames
    say(f"{count} frames a scene, about {count * 0.8:.0f} MB")
    with writing(out), progress("simulating scenes") as step:
        made = board_scene.write_captures(out, names, capture, settings, workers, step)
    kept = f", {len(names) - len(made)} kept from before" if len(made) < len(names) else ""
    truth = out / "truth"
    text = f"simulated {counted(len(made), 'scene')}{kept}\ncaptures     {out}\n"
    text += f"truth        {truth} (never read by build or register)"
    show(format, text=text, scenes=names, simulated=made, captures=out, truth=truth)
    say(f"next         dfdbench rig register {scenes} --source {out}")


def simulate_lens(
    out: Annotated[Path, Option(help="Folder to write into.")], format: Facts = "table"
) -> None:
    """Simulate the captures of a lens test: a dot over temperature, and voltage up and down."""
    output_place(out)
    with writing(out):
        count = board_scene.write_lens_test(out)
    show(format, text=f"simulated {count} images\ncaptures     {out}", images=count, captures=out)
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
