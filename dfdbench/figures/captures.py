"""Figures of captures: a depth map laid over its image, sharpness over temperature and voltage."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from dfdbench.figures.style import depth_span, legend_below
from dfdbench.optics.white_dot import Measurement

_BLUE, _ORANGE = "#0072B2", "#E69F00"

Depth = tuple[NDArray[np.uint8], NDArray[np.bool_]]


def overlay_figure(image: NDArray[np.uint8], depths: Mapping[str, Depth], title: str) -> Figure:
    """Draw depth maps over an image, each in a panel, with the outline of what is known.

    Parameters
    ----------
    image : ndarray of uint8, shape (y, x, 3)
        RGB.
    depths : mapping of str to (levels, valid)
        What each panel shows.
    title : str
        Over all panels.
    """
    # Dark exposures are drawn brighter, or there would be nothing to compare with.
    shown = np.clip(image / max(float(np.percentile(image, 99)), 1.0), 0, 1)
    known = np.concatenate([levels[valid] for levels, valid in depths.values()])
    low, high = depth_span(known.astype(np.float64)) if known.size else (0.0, 255.0)
    figure = Figure(figsize=(5.2 * len(depths) + 1.2, 5.4), layout="constrained")
    grid = figure.subplots(1, len(depths), squeeze=False)[0]
    for axis, (name, (levels, valid)) in zip(grid, depths.items(), strict=True):
        axis.imshow(shown)
        drawn = axis.imshow(
            np.where(valid, levels, np.nan).astype(np.float64),
            cmap="viridis",
            alpha=0.4,
            vmin=low,
            vmax=high,
        )
        if valid.any() and not valid.all():
            axis.contour(valid, levels=[0.5], colors="#E69F00", linewidths=1.2)
        axis.set(xticks=[], yticks=[], title=name)
    figure.colorbar(drawn, ax=grid[-1], label="depth level (cm)", fraction=0.046)
    figure.suptitle(title)
    return figure


def temperature_figure(measured: Sequence[Measurement]) -> Figure:
    """Draw sharpness over the camera's temperature, as the thesis's Fig. 7.11."""
    figure = Figure(figsize=(7, 4.5), layout="constrained")
    axis = figure.subplots()
    degrees = [item.temperature for item in measured]
    axis.plot(
        degrees, [item.sharpness for item in measured], marker="o", color=_BLUE, label="image"
    )
    axis.plot(
        degrees,
        [item.background for item in measured],
        marker="s",
        color=_ORANGE,
        label="background: noise alone",
    )
    axis.set(
        xlabel="camera temperature (°C)",
        ylabel="discrete cosine sharpness measure",
        title=f"sharpness over temperature, voltage step {measured[0].step}",
    )
    axis.grid(alpha=0.3)
    legend_below(figure, axis)
    return figure


def voltage_figure(up: Sequence[Measurement], down: Sequence[Measurement]) -> Figure:
    """Draw sharpness over the voltage step, one line a direction, as the thesis's Fig. 7.12."""
    figure = Figure(figsize=(7, 4.5), layout="constrained")
    axis = figure.subplots()
    ways = ((up, "o", _BLUE), (down, "s", _ORANGE))
    for measured, marker, colour in ways:
        if measured:
            steps = [item.step for item in measured]
            ends = (steps[0], steps[-1]) if measured is up else (steps[-1], steps[0])
            axis.plot(
                steps,
                [item.sharpness for item in measured],
                marker=marker,
                color=colour,
                label=f"{ends[0]} → {ends[1]}",
            )
    axis.set(
        xlabel="voltage step",
        ylabel="discrete cosine sharpness measure",
        title="sharpness over the voltage step: hysteresis",
    )
    axis.grid(alpha=0.3)
    legend_below(figure, axis)
    return figure
