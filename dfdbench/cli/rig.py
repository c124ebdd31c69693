"""The verbs of `rig`: what a lens does to a point, registration, simulated captures."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, TypeVar

import numpy as np
from matplotlib.ticker import MaxNLocator
from typer import Argument, Option

from dfdbench.building.registering import Registered, register_scenes
from dfdbench.cli.options import LARGEST_PIXEL, Facts, Printed, parse_length
from dfdbench.cli.screen import command, progress, save_figure, say, show
from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.manifest import Manifest, Recording
from dfdbench.errors import InputError, SourceError, UnknownNameError, unknown_name
from dfdbench.figures import camera
from dfdbench.optics.lens_table import StepPair, rank_pairs, read_lens_table
from dfdbench.optics.sharpness import Measurement, read_lens_captures
from dfdbench.optics.thin_lens import ThinLens
from dfdbench.results.output_place import output_place
from dfdbench.rig import geometry, registration
from dfdbench.simulation import board_scene
from dfdbench.tables.table import Format, Table, counted

# Rows of the table of blur, and how many pairs of voltage steps are drawn.
_ROWS, _DRAWN = 20, 3
OVERLAY = "registration.png"
_T = TypeVar("_T")
_KNOWN_WELL = 3.0  # pixels


def blur(
    f_number: Annotated[float, Option(help="Focal length over aperture.")],
    focal_length: Annotated[str, Option(help="With its unit: 9.6mm.")],
    focus: Annotated[str, Option(help="The distance in focus: 0.5m.")],
    pixel: Annotated[str, Option(help="Size of a pixel: 4.8um.")],
    range: Annotated[
        tuple[str, str],
        Option(metavar="NEAR FAR", help="Distances shown; metres unless a unit is given."),
    ] = ("0.3", "4"),
    out: Annotated[Path, Option(help="Where the curve is drawn.")] = Path("blur.png"),
    format: Printed = Format.table,
) -> None:
    """Print a thin lens's blur by distance and draw the curve (thesis, Fig. 2.5)."""
    lens = ThinLens(
        f_number,
        parse_length(focal_length, "--focal-length"),
        parse_length(focus, "--focus"),
        parse_length(pixel, "--pixel", at_most=LARGEST_PIXEL),
    )
    near, far = _range(range)
    if near <= lens.focal_length:
        what = f"no real image within the focal length, {focal_length}: {' '.join(range)}"
        raise InputError(what, where="--range")
    # Refuse a figure that cannot be written before anything is printed.
    save_figure(camera.blur_figure(lens, near, far), out)
    show(format, [_blur_table(lens, near, far)], figure=out)


def pairs(
    lens: Annotated[
        Path | None, Option(help="A measured lens as CSV; default: the thesis's.")
    ] = None,
    range: Annotated[
        tuple[str, str],
        Option(metavar="NEAR FAR", help="The working range; metres unless a unit is given."),
    ] = ("1.5", "2.2"),
    limit: Annotated[int, Option(min=1, help="How many pairs are shown.")] = 20,
    out: Annotated[Path, Option(help="Where the best pairs are drawn.")] = Path("pairs.png"),
    format: Printed = Format.table,
) -> None:
    """Rank pairs of voltage steps by how well their blur tells distances apart (thesis, 7.2.3)."""
    table = read_lens_table(lens)
    near, far = _range(range)
    ranked = rank_pairs(table, near, far)
    if not ranked:
        what = f"no pair has a monotonic difference of blur from {near:g} to {far:g} m"
        raise InputError(what, where="--range", fix="choose a narrower range")
    save_figure(camera.pair_figure(table, ranked[:_DRAWN]), out)
    show(format, [_pair_table(ranked, limit)], usable=len(ranked), figure=out)


def sharpness(
    source: Annotated[Path, Argument(help="Folder with temperature, up and down.")],
    out: Annotated[Path, Option(help="Folder for the figures.")] = Path("sharpness"),
    format: Printed = Format.table,
) -> None:
    """Measure a lens from images of a dot: over temperature, and voltage up and down (7.2.1)."""
    output_place(out, source)
    found = read_lens_captures(source)
    tables = []
    warming = found.get("temperature", ())
    if warming:
        rows = tuple(
            (f"{m.temperature:.2f}", f"{m.sharpness:.4f}", f"{m.background:.4f}") for m in warming
        )
        columns = ("temperature (°C)", "image", "background")
        save_figure(camera.temperature_figure(warming), out / "temperature.png")
        title, records = "discrete cosine sharpness over temperature", tuple(map(asdict, warming))
        tables.append(Table(title, columns, rows, "rrr", records=records))
    up, down = found.get("up", ()), found.get("down", ())
    if up or down:
        save_figure(camera.voltage_figure(up, down), out / "voltage.png")
        tables.append(_hysteresis_table(up, down))
    show(format, tables, figures=out)


def _hysteresis_table(up: tuple[Measurement, ...], down: tuple[Measurement, ...]) -> Table:
    ways = [{m.step: m.sharpness for m in measured} for measured in (up, down)]
    rows = []
    for step in sorted({*ways[0], *ways[1]}):
        values = [way.get(step) for way in ways]
        cells = ["–" if value is None else f"{value:.4f}" for value in values]
        gap = "–" if None in values else f"{ways[0][step] - ways[1][step]:+.4f}"
        rows.append((str(step), *cells, gap))
    columns = ("voltage step", "going up", "going down", "difference")
    records = tuple(
        {"way": way, **asdict(m)} for way, ms in (("up", up), ("down", down)) for m in ms
    )
    title = "discrete cosine sharpness over voltage"
    return Table(title, columns, tuple(rows), "rrrr", records=records)


def _blur_table(lens: ThinLens, near: float, far: float) -> Table:
    ticks = [float(tick) for tick in MaxNLocator(_ROWS).tick_values(near, far)]
    rows = []
    records: list[dict[str, float | None]] = []
    for distance in (tick for tick in ticks if near <= tick <= far):
        width = float(lens.blur_radius(distance))
        pixels, whole = width / lens.pixel_size, int(lens.quantised_blur_radius(distance))
        step = float(lens.depth_resolution(distance)) if distance >= lens.focus_distance else None
        cells = (f"{distance:g}", f"{width * 1e6:.2f}", f"{pixels:.2f}", str(whole))
        rows.append((*cells, _resolution_text(step)))
        size = {"width_m": width, "pixels": pixels, "quantised": whole}
        records.append({"distance_m": distance, **size, "resolution_m": step})
    sharp_near, sharp_far = lens.depth_of_field()
    far_text = "infinity" if np.isinf(sharp_far) else f"{sharp_far:.4f} m"
    depth = "infinite" if np.isinf(sharp_far) else f"{sharp_far - sharp_near:.4f} m"
    limit = lens.max_blur_radius()
    notes = (
        f"at infinity: {limit * 1e6:.2f} µm, {limit / lens.pixel_size:.2f} pixels",
        f"depth of field at one pixel: {sharp_near:.4f} m to {far_text}, {depth}",
        f"hyperfocal distance: {lens.hyperfocal_distance():.3f} m",
        "depth resolution: how much farther a point must lie for one pixel more (Eq. 2.21)",
    )
    columns = ("distance (m)", "blur width (µm)", "(pixels)", "quantised", "depth resolution (m)")
    title = (
        f"f/{lens.f_number:g}, {lens.focal_length * 1e3:g} mm, focused at {lens.focus_distance:g} m"
    )
    return Table(title, columns, tuple(rows), "rrrrr", notes, records=tuple(records))


def _resolution_text(step: float | None) -> str:
    if step is None:
        return "–"
    return "none" if np.isinf(step) else f"{step:.3f}"


def _pair_table(ranked: tuple[StepPair, ...], limit: int) -> Table:
    shown = ranked[:limit]
    distances = tuple(f"{distance:g}" for distance in shown[0].distances)
    numbers = [(*pair.differences, pair.repeats, pair.span, pair.longest_run) for pair in shown]
    rows = tuple(
        (str(place), pair.name, *map(str, found))
        for place, (pair, found) in enumerate(zip(shown, numbers, strict=True), start=1)
    )
    title = "absolute difference of the blur radii in pixels, by distance in metres"
    left = len(ranked) - len(shown)
    notes = (
        "all are monotonic; fewer repeated values first, then the larger span, the shorter run, "
        "the more even growth, the lesser blur",
        *((f"{left} more usable pairs: --limit {len(ranked)}",) if left else ()),
    )
    keys = ("repeats", "span", "longest_run")
    records = tuple(asdict(pair) | {key: getattr(pair, key) for key in keys} for pair in shown)
    columns = ("", "pair", *distances, "repeats", "span", "run")
    return Table(title, columns, rows, "rl", notes, records=records)


def _range(given: tuple[str, str]) -> tuple[float, float]:
    near, far = (parse_length(text, "--range", unit="m") for text in given)
    if near >= far:
        what = f"the range is empty: {' '.join(given)}"
        raise InputError(what, where="--range", fix="name the nearer end first")
    return near, far


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
        overlay = camera.overlay_figure(one.frame, one.depths(), title)
        save_figure(overlay, one.files.folder / OVERLAY)
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
    """Simulate raw captures of the real-world set: frames, LIDAR scans, and the truth."""
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
    with progress("simulating scenes") as step:
        made = board_scene.write_captures(out, names, capture, settings, workers, step)
    kept = f", {len(names) - len(made)} kept from before" if len(made) < len(names) else ""
    truth = out / "truth"
    text = f"simulated {counted(len(made), 'scene')}{kept}\ncaptures     {out}\n"
    text += f"truth        {truth} (never read by build or register)"
    show(format, text=text, scenes=names, simulated=made, captures=out, truth=truth)
    say(f"next         {command('rig', 'register', scenes, source=out)}")


def simulate_lens(
    out: Annotated[Path, Option(help="Folder to write into.")], format: Facts = "table"
) -> None:
    """Simulate the captures of a lens test: a dot over temperature, and voltage up and down."""
    output_place(out)
    count = board_scene.write_lens_test(out)
    show(format, text=f"simulated {count} images\ncaptures     {out}", images=count, captures=out)
    say(f"next         {command('rig', 'optics', 'sharpness', out)}")


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
        If the rig did not capture it.
    """
    if manifest.capture is None:
        raise InputError(f"{manifest.short} was not captured by the rig", where="--dataset")
    return manifest.capture


def chosen(text: str, where: str, known: Sequence[_T]) -> tuple[_T, ...]:
    """Return what a list names, as ``k00-k07,k33`` or ``127-131,141``, in the order of `known`.

    Raises
    ------
    UnknownNameError
        If it names something unknown.
    InputError
        If a span goes backwards.

    Examples
    --------
    >>> chosen("40, 10-20", "--exposures", (10, 15, 20, 40))
    (10, 15, 20, 40)
    >>> chosen("k33,k00-k01", "--scenes", ("k00", "k01", "k02", "k33"))
    ('k00', 'k01', 'k33')
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
