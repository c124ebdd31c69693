"""Figures of cameras: a blur law, a lens's blur, a lens test, a depth map over its image."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from dfdbench.figures import style
from dfdbench.optics.lens_table import LensTable, StepPair
from dfdbench.optics.sharpness import Measurement
from dfdbench.optics.thin_lens import ThinLens

if TYPE_CHECKING:
    from dfdbench.methods.measured_law import Calibration

Depth = tuple[NDArray[np.uint8], NDArray[np.bool_]]
_SHARPNESS = "discrete cosine sharpness measure"


def law_figure(calibration: Calibration) -> Figure:
    """Draw a law's widths over the depth levels, the measurements, and the residual below.

    A level's dot grows with its number of pixels.
    """
    law = calibration.law
    levels = np.arange(law.levels)
    change = calibration.change
    figure = Figure(figsize=(9, 6 + 2 * bool(law.falloff)), layout="constrained")
    ratios = (2, 1, 1) if law.falloff else (2, 1)
    widths, left, *corners = figure.subplots(len(ratios), 1, height_ratios=ratios)
    left.sharex(widths)
    most = max(int(calibration.pixels.max()), 1)
    sizes = 4 + 60 * calibration.pixels[: law.levels] / most
    label = "each level by itself"
    widths.scatter(levels, calibration.measured, sizes, color=style.ORANGE, label=label)
    widths.plot(levels, law.sigmas, color=style.BLUE, label="the law")
    images = "linear light" if law.linear else "grey levels"
    place = "registered" if law.registered else "moved, each pair its own way"
    gain = f"gain {law.gain:.3f}" if law.even else "a gain a pair"
    kernels = f"kernels exp(-(r / c)^p), p = {law.exponent:g}; {images}; {place}; {gain}"
    title = f"{kernels}\nthe defocus image: {change.words()}"
    # A level without visible blur may be off by pixels, so the law sets the scale.
    widths.set(ylabel="standard deviation (pixels)", title=title, ylim=(0, 1.3 * max(law.sigmas)))
    style.legend_beside(widths)
    left.plot(levels, calibration.residual, ".", color=style.BLUE)
    left.set(xlabel="depth level", ylabel="residual (grey levels, rms)", xlim=(0, law.levels - 1))
    left.set_ylim(bottom=0)
    for axis in corners:
        colours = ("#c33", "#383", "#36c") if len(law.falloff) == 3 else ("#555",)
        for curve, colour in zip(law.falloff, colours, strict=True):
            axis.plot(np.sqrt(np.linspace(0, 1, len(curve))), curve, "o-", color=colour)
        axis.set(xlabel="distance from the middle (1: corner)", ylabel="light, defocus / in-focus")
        axis.set_xlim(0, 1)
    for axis in figure.axes:
        axis.grid(alpha=0.3)
    return figure


def overlay_figure(image: NDArray[np.uint8], depths: Mapping[str, Depth], title: str) -> Figure:
    """Draw depth maps (levels, valid) over an RGB image, one panel each, with their outlines."""
    # Dark exposures are drawn brighter: otherwise there would be nothing to compare with.
    shown = np.clip(image / max(float(np.percentile(image, 99)), 1.0), 0, 1)
    all_known = np.concatenate([levels[valid] for levels, valid in depths.values()])
    low, high = style.depth_span(all_known.astype(np.float64)) if all_known.size else (0.0, 255.0)
    figure = Figure(figsize=(5.2 * len(depths) + 1.2, 5.4), layout="constrained")
    grid = figure.subplots(1, len(depths), squeeze=False)[0]
    for axis, (name, (levels, valid)) in zip(grid, depths.items(), strict=True):
        axis.imshow(shown)
        known = np.where(valid, levels, np.nan).astype(np.float64)
        drawn = axis.imshow(known, cmap="viridis", alpha=0.4, vmin=low, vmax=high)
        if valid.any() and not valid.all():
            axis.contour(valid, levels=[0.5], colors=style.ORANGE, linewidths=1.2)
        axis.set(xticks=[], yticks=[], title=name)
    figure.colorbar(drawn, ax=grid[-1], label="depth level (cm)", fraction=0.046)
    figure.suptitle(title)
    return figure


def temperature_figure(measured: Sequence[Measurement]) -> Figure:
    """Draw sharpness over the camera's temperature, as in the thesis's Fig. 7.11."""
    figure, axis = style.single_axes(7, 4.5)
    degrees = [item.temperature for item in measured]
    sharpness, background = zip(*((m.sharpness, m.background) for m in measured), strict=True)
    axis.plot(degrees, sharpness, marker="o", color=style.BLUE, label="image")
    axis.plot(degrees, background, marker="s", color=style.ORANGE, label="background: noise alone")
    title = f"sharpness over temperature, voltage step {measured[0].step}"
    axis.set(xlabel="camera temperature (°C)", ylabel=_SHARPNESS, title=title)
    style.legend_below(figure, axis)
    return figure


def voltage_figure(up: Sequence[Measurement], down: Sequence[Measurement]) -> Figure:
    """Draw sharpness over the voltage step, one line per direction, as in thesis Fig. 7.12."""
    figure, axis = style.single_axes(7, 4.5)
    for measured, marker, colour in ((up, "o", style.BLUE), (down, "s", style.ORANGE)):
        if measured:
            steps = [item.step for item in measured]
            ends = (steps[0], steps[-1]) if measured is up else (steps[-1], steps[0])
            sharpness = [item.sharpness for item in measured]
            label = f"{ends[0]} → {ends[1]}"
            axis.plot(steps, sharpness, marker=marker, color=colour, label=label)
    title = "sharpness over the voltage step: hysteresis"
    axis.set(xlabel="voltage step", ylabel=_SHARPNESS, title=title)
    style.legend_below(figure, axis)
    return figure


def blur_figure(lens: ThinLens, near: float, far: float) -> Figure:
    """Draw blur, quantised blur and its limit over a range in metres, as in thesis Fig. 2.5."""
    distance = np.linspace(near, far, 4001)
    figure, axis = style.single_axes(9, 5)
    limit = lens.max_blur_radius() / lens.pixel_size
    radius = lens.blur_radius(distance) / lens.pixel_size
    whole = lens.quantised_blur_radius(distance)
    axis.plot(distance, radius, color=style.BLUE, label="blur width")
    axis.plot(distance, whole, color=style.BLACK, linewidth=1, label="quantised to whole pixels")
    axis.axhline(limit, color=style.GREEN, linestyle="--", label=f"at infinity: {limit:.2f} pixels")
    axis.axvline(lens.focus_distance, color="0.6", linestyle=":", label="focus")
    focused = f"focused at {lens.focus_distance:g} m, pixels of {lens.pixel_size * 1e6:g} µm"
    axis.set_title(f"f/{lens.f_number:g}, {lens.focal_length * 1e3:g} mm, {focused}")
    axis.set(xlabel="distance from the camera (m)", ylabel="blur width (pixels)")
    axis.set(xlim=(near, far), ylim=(0, limit * 1.25 + 1))
    style.legend_below(figure, axis)
    return figure


def pair_figure(table: LensTable, pairs: Sequence[StepPair]) -> Figure:
    """Draw two steps' radii and their difference for each pair, as in the thesis's Fig. 7.15."""
    figure = Figure(figsize=(4.5 * len(pairs), 4), layout="constrained")
    grid = figure.subplots(1, len(pairs), squeeze=False, sharey=True)[0]
    for axis, pair in zip(grid, pairs, strict=True):
        first, second = (
            table.radius_at(step, table.distances) for step in (pair.first, pair.second)
        )
        axis.axvspan(pair.distances[0], pair.distances[-1], color="0.9", label="working range")
        for radius, colour, line, label in (
            (first, style.BLUE, "-", f"step {pair.first}"),
            (second, style.ORANGE, "-", f"step {pair.second}"),
            (np.abs(first - second), style.BLACK, "--", "difference"),
        ):
            axis.step(
                table.distances, radius, where="mid", color=colour, linestyle=line, label=label
            )
        axis.set(xlabel="distance from the camera (m)", title=pair.name)
        axis.grid(alpha=0.3)
        style.legend_beside(axis)
    grid[0].set_ylabel("blur width (pixels)")
    return figure
