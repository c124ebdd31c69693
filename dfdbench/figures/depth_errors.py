"""The figure of errors by depth: how far runs are off, and what they answer, at each true depth."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from dfdbench.audit.depth_errors import DepthErrors
from dfdbench.audit.run_errors import LevelErrors
from dfdbench.blur.recipe import LEVELS
from dfdbench.datasets.depth_scale import DepthScale
from dfdbench.figures.style import COLOURS, legend_beside, plain_text

# Levels that are drawn as one: single ones are of few scenes.
_TOGETHER = 4
_METRES = (0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 10.0, 20.0, 50.0)
_LEAST_APART = 0.03  # of the axis: marks in metres that would overlap are left out


def depth_error_figure(
    title: str, found: Sequence[DepthErrors], scale: DepthScale | None
) -> Figure:
    """Draw the mean absolute error over true depth, and below it each run's answers.

    Parameters
    ----------
    title : str
        Above the figure.
    found : sequence of DepthErrors
        The runs, all of the same pairs.
    scale : DepthScale or None
        How levels become metres: then an axis on top has them.
    """
    figure = Figure(figsize=(max(9.0, 3.6 * len(found)), 8), layout="constrained")
    figure.suptitle(plain_text(title))
    grid = figure.add_gridspec(2, len(found), height_ratios=(1.1, 1))
    there = np.flatnonzero(found[0].levels.pixels)
    span = (float(there[0]) - 2, float(there[-1]) + 2)
    top = figure.add_subplot(grid[0, :])
    for number, one in enumerate(found):
        levels, means = _curve(one.levels)
        colour = COLOURS[number % len(COLOURS)]
        top.plot(levels, means, color=colour, label=plain_text(one.name))
    top.set(xlabel="true depth level", ylabel="mean absolute error (levels)", xlim=span)
    top.set_ylim(bottom=0)
    top.grid(alpha=0.3)
    legend_beside(top)
    if scale is not None:
        _metres_on_top(top, scale, span)
    for number, one in enumerate(found):
        axis = figure.add_subplot(grid[1, number])
        _draw_answers(axis, one, span)
        axis.set_title(plain_text(one.name), fontsize=10)
        if number == 0:
            axis.set_ylabel("predicted level")
    return figure


def _curve(errors: LevelErrors) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    pixels, absolute = (
        values.reshape(-1, _TOGETHER).sum(axis=1) for values in (errors.pixels, errors.absolute)
    )
    middle = np.arange(0, LEVELS, _TOGETHER) + (_TOGETHER - 1) / 2
    mean = np.divide(absolute, pixels, out=np.full(len(pixels), np.nan), where=pixels > 0)
    return np.asarray(middle, np.float64), np.asarray(mean, np.float64)


def _draw_answers(axis: Axes, one: DepthErrors, span: tuple[float, float]) -> None:
    # Of each true depth by itself: otherwise common depths would hide what happens at rare ones.
    side = LEVELS // _TOGETHER
    answers = one.answers.reshape(side, _TOGETHER, side, _TOGETHER).sum(axis=(1, 3))
    known = answers.sum(axis=1, keepdims=True)
    share = np.divide(answers, known, out=np.zeros(answers.shape), where=known > 0)
    ends = (-0.5, LEVELS - 0.5)
    axis.imshow(
        np.sqrt(share).T,
        origin="lower",
        extent=(*ends, *ends),
        cmap="gray_r",
        vmin=0,
        vmax=1,
        interpolation="nearest",
        aspect="auto",
    )
    axis.plot(span, span, color=COLOURS[5], linewidth=1)
    axis.set(xlabel="true level", xlim=span, ylim=span)


def _metres_on_top(axis: Axes, scale: DepthScale, span: tuple[float, float]) -> None:
    inside = [metres for metres in _METRES if scale.near <= metres <= scale.far]
    places = scale.to_exact_levels(np.array(inside))
    shown: list[tuple[float, float]] = []
    for place, metres in sorted(zip(places.tolist(), inside, strict=True)):
        apart = place - shown[-1][0] if shown else np.inf
        if span[0] <= place <= span[1] and apart >= _LEAST_APART * (span[1] - span[0]):
            shown.append((place, metres))
    above = axis.secondary_xaxis("top")
    above.set_xticks([place for place, _ in shown], [f"{metres:g}" for _, metres in shown])
    above.set_xlabel("metres")
