"""Figures of a training: loss, learning rate and scores by step; levels and patches trained on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, StrMethodFormatter
from numpy.typing import NDArray

from dfdbench.figures.style import COLOURS
from dfdbench.methods.weights import Card
from dfdbench.protocol import METRICS
from dfdbench.training.checkpoint import Log, Row
from dfdbench.training.selections import Selections

_TRAIN, _TEST = COLOURS[0], COLOURS[5]
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


def patches_figure(drawn: Selections, title: str) -> Figure:
    """Draw how often each pair was drawn from, and each pixel of three of them, as Fig. 5.8."""
    patches = drawn.patches
    median = int(np.argsort(patches, kind="stable")[len(patches) // 2])
    # With less than three pairs, the least and the most are shown.
    names = {median: "median", int(patches.argmax()): "most", int(patches.argmin()): "least"}
    maps = {number: drawn.uses(number) for number in sorted(names, key=lambda n: patches[n])}
    figure = Figure(figsize=(13, 8), layout="constrained")
    figure.suptitle(f"{title}: {patches.sum():,} patches of {drawn.size} x {drawn.size}")
    top, bottom = figure.subfigures(2, 1, squeeze=False)[:, 0]
    axis = top.subplots()
    axis.stairs(patches, np.arange(len(patches) + 1) + 0.5, fill=True, color=_TRAIN)
    axis.axhline(patches.mean(), color=_TEST)
    # A legend would lie on the bars.
    axis.set_title(f"line: the mean, {patches.mean():,.2f} patches a pair", fontsize=9)
    axis.set(xlabel="training pair, by number", ylabel="patches drawn", xlim=(0, len(patches) + 1))
    axis.xaxis.set_major_locator(MaxNLocator(integer=True))
    axis.yaxis.set_major_formatter(StrMethodFormatter("{x:,.0f}"))
    axis.grid(axis="y", alpha=0.3)
    axes = bottom.subplots(1, len(maps), squeeze=False)[0]
    highest = max(1, *(int(uses.max()) for uses in maps.values()))
    for axis, (number, uses) in zip(axes, maps.items(), strict=True):
        image = axis.imshow(uses, cmap="viridis", vmin=0, vmax=highest, interpolation="nearest")
        axis.set_title(
            f"{names[number]}: pair {number + 1}, {patches[number]:,} patches\n"
            f"{drawn.pairs[number]}",
            fontsize=9,
        )
        axis.set_xticks([])
        axis.set_yticks([])
    bottom.colorbar(image, ax=axes, label="patches that a pixel lay in", fraction=0.05)
    return figure


def experiment_figure(title: str, cards: Sequence[tuple[str, Card]]) -> Figure:
    """Draw each training's scores and their mean by value, as Figs 5.18 and 5.21 to 5.23 do."""
    values = list(dict.fromkeys(value for value, _ in cards))
    figure = Figure(figsize=(12, 4), layout="constrained")
    figure.suptitle(title)
    for axis, metric in zip(figure.subplots(1, len(METRICS)), METRICS, strict=True):
        for place, value in enumerate(values):
            scores = [card.scores[metric] for name, card in cards if name == value]
            axis.plot([place] * len(scores), scores, "o", color=_TRAIN, alpha=0.6)
            axis.plot([place - 0.2, place + 0.2], [np.mean(scores)] * 2, color=_TEST)
        axis.set_xticks(range(len(values)), [value or "all seeds" for value in values])
        axis.set(ylabel=metric.upper())
        axis.set_xlim(-0.5, len(values) - 0.5)
        axis.grid(alpha=0.3)
        if max((len(value) for value in values), default=0) > 4:
            axis.tick_params(axis="x", rotation=45)
    return figure


def _means(values: NDArray[np.float64], width: int) -> NDArray[np.float64]:
    whole = len(values) // width * width
    means: NDArray[np.float64] = values[:whole].reshape(-1, width).mean(axis=1)
    return means
