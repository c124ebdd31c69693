"""Figures of a lens: blur over distance, and pairs of voltage steps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from dfdbench.figures.style import legend_below, legend_beside
from dfdbench.optics.lens_table import LensTable, StepPair
from dfdbench.optics.thin_lens import ThinLens

_BLUE, _ORANGE, _GREEN, _BLACK = "#0072B2", "#E69F00", "#009E73", "#000000"


def blur_figure(lens: ThinLens, near: float, far: float) -> Figure:
    """Draw blur, quantised blur and its limit over distance, as the thesis's Fig. 2.5.

    Parameters
    ----------
    lens : ThinLens
        The lens.
    near, far : float
        The distances drawn, in metres.
    """
    distance = np.linspace(near, far, 4001)
    figure = Figure(figsize=(9, 5), layout="constrained")
    axis = figure.subplots()
    limit = lens.max_blur_radius() / lens.pixel_size
    axis.plot(
        distance, lens.blur_radius(distance) / lens.pixel_size, color=_BLUE, label="blur radius"
    )
    axis.plot(
        distance,
        lens.quantised_blur_radius(distance),
        color=_BLACK,
        linewidth=1,
        label="quantised to whole pixels",
    )
    axis.axhline(limit, color=_GREEN, linestyle="--", label=f"at infinity: {limit:.2f} pixels")
    axis.axvline(lens.focus_distance, color="0.6", linestyle=":", label="focus")
    axis.set(
        xlabel="distance from the camera (m)",
        ylabel="blur radius (pixels)",
        xlim=(near, far),
        ylim=(0, limit * 1.25 + 1),
        title=f"f/{lens.f_number:g}, {lens.focal_length * 1e3:g} mm, focused at "
        f"{lens.focus_distance:g} m, pixels of {lens.pixel_size * 1e6:g} µm",
    )
    axis.grid(alpha=0.3)
    legend_below(figure, axis)
    return figure


def pair_figure(table: LensTable, pairs: Sequence[StepPair]) -> Figure:
    """Draw two steps' radii and their difference for each pair, as the thesis's Fig. 7.15."""
    figure = Figure(figsize=(4.5 * len(pairs), 4), layout="constrained")
    grid = figure.subplots(1, len(pairs), squeeze=False, sharey=True)[0]
    for axis, pair in zip(grid, pairs, strict=True):
        first, second = (
            table.radius_at(step, table.distances) for step in (pair.first, pair.second)
        )
        axis.axvspan(pair.distances[0], pair.distances[-1], color="0.9", label="working range")
        axis.step(table.distances, first, where="mid", color=_BLUE, label=f"step {pair.first}")
        axis.step(table.distances, second, where="mid", color=_ORANGE, label=f"step {pair.second}")
        axis.step(
            table.distances,
            np.abs(first - second),
            where="mid",
            color=_BLACK,
            linestyle="--",
            label="difference",
        )
        axis.set(xlabel="distance from the camera (m)", title=pair.name)
        axis.grid(alpha=0.3)
        legend_beside(axis)
    grid[0].set_ylabel("blur radius (pixels)")
    return figure
