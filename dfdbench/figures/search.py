"""Figures of an architecture search: its objective, its convergence, the widths it found."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from dfdbench.figures.style import COLOURS, legend_below, legend_beside, plain_text
from dfdbench.methods.networks.choices import FILTERS, LAYERS
from dfdbench.training.search.course import MARKS, Iteration

_BEST, _MEAN, _MARK = COLOURS[0], COLOURS[5], COLOURS[2]


def objective_figure(course: Sequence[Iteration], title: str) -> Figure:
    """Draw the best objective so far, and the least and the mean of each iteration."""
    figure = Figure(figsize=(9, 5), layout="constrained")
    axis = figure.subplots()
    numbers = [item.number for item in course]
    axis.step(
        numbers, [item.best for item in course], where="post", color=_BEST, label="best so far"
    )
    for name, marker, line in (("mean", "s", "-"), ("least", "o", "")):
        values = [getattr(item, name) for item in course]
        axis.plot(numbers, values, marker=marker, linestyle=line, color=_MEAN, label=name)
    axis.set(title=plain_text(title), xlabel="iteration", ylabel="objective, Eq. 6.1")
    _finish(axis)
    return figure


def _finish(axis: Axes) -> None:
    axis.xaxis.set_major_locator(MaxNLocator(integer=True))
    axis.grid(alpha=0.3)
    legend_beside(axis)


def convergence_figure(course: Sequence[Iteration], title: str) -> Figure:
    """Draw the share of all components that are equal to the best position's, and its marks."""
    figure = Figure(figsize=(9, 5), layout="constrained")
    axis = figure.subplots()
    shares = [100 * item.alike for item in course]
    axis.plot([item.number for item in course], shares, marker="o", color=_BEST, label="equal")
    for mark in MARKS:
        axis.axhline(100 * mark, color=_MARK, linestyle="--", linewidth=1)
        axis.annotate(f"{100 * mark:.0f} %", (course[0].number, 100 * mark), va="bottom")
    axis.set(
        title=plain_text(title),
        xlabel="iteration",
        ylabel="components equal to the best's (%)",
        ylim=(0, 104),
    )
    _finish(axis)
    return figure


def widths_figure(filters: Sequence[int], title: str) -> Figure:
    """Draw the widths found beside the baseline's, as Fig. 6.2 tells them."""
    figure = Figure(figsize=(11, 5), layout="constrained")
    axis = figure.subplots()
    places = np.arange(len(LAYERS))
    for shift, label, colour, widths in (
        (-0.2, "DfD-Net", _MEAN, FILTERS["original"]),
        (0.2, "found", _BEST, filters),
    ):
        axis.bar(places + shift, widths, 0.4, color=colour, label=label)
    axis.set_xticks(places, [str(layer) for layer in LAYERS])
    axis.set(title=plain_text(title), xlabel="layer, input to output", ylabel="filters")
    axis.grid(axis="y", alpha=0.3)
    legend_below(figure, axis)
    return figure
