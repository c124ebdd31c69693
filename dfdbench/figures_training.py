"""Figures of a training: loss, learning rate and scores by step; the levels trained on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from dfdbench.protocol import METRICS
from dfdbench.training.checkpoint import Log, Row

# Okabe and Ito's colours, which the colour-blind can tell apart.
_TRAIN, _TEST = "#0072B2", "#D55E00"
_POINTS = 400


def training_figure(log: Log, title: str) -> Figure:
    """Draw loss and learning rate, and each metric on train and test, as Fig. 5.7 does."""
    figure = Figure(figsize=(11, 9), layout="constrained")
    figure.suptitle(title)
    axes = figure.subplots(3, 2, sharex=True)
    _draw_losses(axes[0, 0], axes[0, 1], log.losses)
    for axis, metric in zip(axes.flat[2:], METRICS, strict=False):
        for name, colour in (("train", _TRAIN), ("test", _TEST)):
            rows = [row for row in log.scores if row.get(f"{name}_{metric}")]
            axis.plot(
                [int(row["step"]) for row in rows],
                [float(row[f"{name}_{metric}"]) for row in rows],
                marker=".", color=colour, label=f"{name} pairs",
            )  # fmt: skip
        axis.set(ylabel=metric.upper(), xlabel="step")
        axis.xaxis.set_tick_params(labelbottom=True)
        if log.scores:
            axis.legend()
    axes[2, 1].set_axis_off()
    for axis in axes.flat[:5]:
        axis.grid(alpha=0.3)
    return figure


def _draw_losses(losses: Axes, rates: Axes, rows: Sequence[Row]) -> None:
    steps = np.array([int(row["step"]) for row in rows])
    values = np.array([float(row["loss"]) for row in rows])
    width = max(1, len(rows) // _POINTS)
    losses.plot(
        _means(steps, width), _means(values, width), color="black",
        label=f"mean of {width} steps" if width > 1 else "each step",
    )  # fmt: skip
    losses.set(ylabel="training loss")
    losses.legend()
    rates.plot(steps, [float(row["learning_rate"]) for row in rows], color="black")
    rates.set(ylabel="learning rate", yscale="log")


def levels_figure(rows: Sequence[Row], title: str) -> Figure:
    """Draw how often each level occurs in the training pairs and was trained on, as Fig. 5.9."""
    figure = Figure(figsize=(11, 5), layout="constrained")
    axis = figure.subplots()
    levels = np.array([int(row["level"]) for row in rows])
    for name, label, colour in (
        ("present", "in the training pairs", _TRAIN),
        ("trained", "trained on", _TEST),
    ):
        counts = np.array([int(row[name]) for row in rows], np.float64)
        axis.stairs(
            100 * counts / max(counts.sum(), 1), np.append(levels, 256) - 0.5, color=colour,
            label=f"{label}: {counts.sum():.4g} pixels", fill=name == "present", alpha=0.6,
        )  # fmt: skip
    axis.set(title=title, xlabel="depth level", ylabel="pixels (%)", xlim=(-1, 256))
    axis.grid(alpha=0.3)
    axis.legend()
    return figure


def _means(values: NDArray[np.float64], width: int) -> NDArray[np.float64]:
    whole = len(values) // width * width
    means: NDArray[np.float64] = values[:whole].reshape(-1, width).mean(axis=1)
    return means
