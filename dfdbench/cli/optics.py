"""The verbs for a lens: optics blur, optics pairs, optics sharpness."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import numpy as np
from matplotlib.ticker import MaxNLocator
from typer import Argument, Option

from dfdbench.cli.options import LARGEST_PIXEL, Printed, parse_length
from dfdbench.cli.screen import save_figure, show
from dfdbench.errors import InputError
from dfdbench.figures.camera import blur_figure, pair_figure, temperature_figure, voltage_figure
from dfdbench.optics.lens_table import StepPair, rank_pairs, read_lens_table
from dfdbench.optics.sharpness import Measurement, read_lens_captures
from dfdbench.optics.thin_lens import ThinLens
from dfdbench.results.output_place import output_place
from dfdbench.tables.table import Format, Table

_ROWS = 20
_DRAWN = 3


def blur(
    f_number: Annotated[float, Option(help="Focal length over aperture.")],
    focal_length: Annotated[str, Option(help="With its unit: 9.6mm.")],
    focus: Annotated[str, Option(help="The distance in focus: 0.5m.")],
    pixel: Annotated[str, Option(help="Size of a pixel: 4.8um.")],
    range: Annotated[
        tuple[str, str], Option(help="Distances shown; metres unless a unit is given.")
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
    # A figure that cannot be kept is refused before anything is printed.
    save_figure(blur_figure(lens, near, far), out)
    show(format, [_blur_table(lens, near, far)], figure=out)


def pairs(
    lens: Annotated[
        Path | None, Option(help="A measured lens as CSV; default: the thesis's.")
    ] = None,
    range: Annotated[
        tuple[str, str], Option(help="The working range; metres unless a unit is given.")
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
    save_figure(pair_figure(table, ranked[:_DRAWN]), out)
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
            (f"{m.temperature:.2f}", *(f"{v:.4f}" for v in (m.sharpness, m.background)))
            for m in warming
        )
        columns = ("temperature (°C)", "image", "background")
        save_figure(temperature_figure(warming), out / "temperature.png")
        title, records = "discrete cosine sharpness over temperature", tuple(map(asdict, warming))
        tables.append(Table(title, columns, rows, "rrr", records=records))
    up, down = found.get("up", ()), found.get("down", ())
    if up or down:
        save_figure(voltage_figure(up, down), out / "voltage.png")
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
        size = {"radius_m": width, "pixels": pixels, "quantised": whole}
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
    columns = ("distance (m)", "blur radius (µm)", "(pixels)", "quantised", "depth resolution (m)")
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
    align = "rl" + "r" * (len(distances) + 3)
    return Table(title, columns, rows, align, notes, records=records)


def _range(given: tuple[str, str]) -> tuple[float, float]:
    near, far = (parse_length(text, "--range", unit="m") for text in given)
    if near >= far:
        what = f"the range is empty: {' '.join(given)}"
        raise InputError(what, where="--range", fix="name the nearer end first")
    return near, far
