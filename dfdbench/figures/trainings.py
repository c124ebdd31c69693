"""Figures of trainings, of experiments, and of an architecture search."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from dfdbench.blur.recipe import LEVELS
from dfdbench.figures import style
from dfdbench.methods.networks.choices import FILTERS, LAYERS
from dfdbench.metrics.metric import METRICS
from dfdbench.tables.table import grouped

if TYPE_CHECKING:
    from dfdbench.methods.networks.weights import Card
    from dfdbench.training.crops import Selections
    from dfdbench.training.search.swarm_search import Iteration
    from dfdbench.training.trainer import Log, Row

_POINTS = 400


def training_figure(log: Log, title: str) -> Figure:
    """Draw loss and learning rate, and each metric on train and test, as in Fig. 5.7."""
    lines = 1 + math.ceil(len(METRICS) / 2)
    figure = Figure(figsize=(11, 3 * lines), layout="constrained")
    figure.suptitle(title)
    axes = figure.subplots(lines, 2, sharex=True)
    _draw_losses(axes[0, 0], axes[0, 1], log.losses)
    drawn = axes.flat[: 2 + len(METRICS)]
    for axis, (metric, shown) in zip(drawn[2:], METRICS.items(), strict=True):
        for name, colour in (("train", style.BLUE), ("test", style.RED)):
            rows = [row for row in log.scores if f"{name}_{metric}" in row]
            steps = [int(row["step"]) for row in rows]
            scores = [float(row[f"{name}_{metric}"]) for row in rows]
            axis.plot(steps, scores, marker=".", color=colour, label=f"{name} pairs")
        axis.set(ylabel=shown.title, xlabel="step")
        axis.xaxis.set_tick_params(labelbottom=True)
        if log.scores:
            style.legend_beside(axis)
    for axis in axes.flat[len(drawn) :]:
        axis.set_axis_off()
    for axis in drawn:
        axis.grid(alpha=0.3)
    return figure


def cameras_figure(log: Log, title: str) -> Figure:
    """Draw loss and learning rate of `volume-net`, and the error for each held-out camera."""
    figure = Figure(figsize=(11, 6 if log.scores else 3), layout="constrained")
    figure.suptitle(title)
    axes = figure.subplots(2 if log.scores else 1, 2, sharex=True, squeeze=False)
    _draw_losses(axes[0, 0], axes[0, 1], log.losses)
    for camera in sorted(log.scores[0].keys() - {"step"}) if log.scores else ():
        rows = [(int(row["step"]), float(row[camera])) for row in log.scores]
        axes[1, 0].plot(*zip(*rows, strict=True), marker=".", label=camera)
    if log.scores:
        axes[1, 0].set(ylabel="NRMSE, cameras held out", xlabel="step")
        style.legend_beside(axes[1, 0])
        axes[1, 1].set_axis_off()
    return figure


def _draw_losses(losses: Axes, rates: Axes, rows: Sequence[Row]) -> None:
    steps = np.array([int(row["step"]) for row in rows])
    values = np.array([float(row["loss"]) for row in rows])
    width = max(1, len(rows) // _POINTS)
    label = f"mean of {width} steps" if width > 1 else "each step"
    losses.plot(_means(steps, width), _means(values, width), color="black", label=label)
    losses.set(ylabel="training loss")
    style.legend_beside(losses)
    rates.plot(steps, [float(row["learning_rate"]) for row in rows], color="black")
    rates.set(ylabel="learning rate", yscale="log")


def levels_figure(rows: Sequence[Row], title: str) -> Figure:
    """Draw how often each level occurs in the training pairs and was trained on, as in Fig. 5.9."""
    figure, axis = style.single_axes(11, 5)
    edges = np.array([*(int(row["level"]) for row in rows), LEVELS]) - 0.5
    for name, label, colour in (
        ("present", "in the training pairs", style.BLUE),
        ("trained", "trained on", style.RED),
    ):
        counts = np.array([int(row[name]) for row in rows], np.float64)
        share, text = 100 * counts / max(counts.sum(), 1), f"{label}: {counts.sum():.4g} pixels"
        axis.stairs(share, edges, color=colour, label=text, fill=name == "present", alpha=0.6)
    axis.set(title=title, xlabel="depth level", ylabel="pixels (%)", xlim=(-1, LEVELS))
    style.legend_below(figure, axis)
    return figure


def patches_figure(drawn: Selections, title: str) -> Figure:
    """Draw how often each pair was drawn from, and each pixel of three of them, as in Fig. 5.8."""
    patches = drawn.patches
    median = int(np.argsort(patches, kind="stable")[len(patches) // 2])
    # If there are fewer than three pairs, the least and the most take precedence.
    names = {median: "median", int(patches.argmax()): "most", int(patches.argmin()): "least"}
    maps = {number: drawn.uses(number) for number in sorted(names, key=lambda n: patches[n])}
    figure = Figure(figsize=(13, 8), layout="constrained")
    figure.suptitle(f"{title}: {patches.sum():,} patches of {drawn.size} x {drawn.size}")
    top, bottom = figure.subfigures(2, 1, squeeze=False)[:, 0]
    axis = top.subplots()
    axis.stairs(patches, np.arange(len(patches) + 1) + 0.5, fill=True, color=style.BLUE)
    axis.axhline(patches.mean(), color=style.RED)
    # A legend would hide bars.
    axis.set_title(f"line: the mean, {patches.mean():,.2f} patches a pair", fontsize=9)
    axis.set(xlabel="training pair, by number", ylabel="patches drawn", xlim=(0, len(patches) + 1))
    axis.xaxis.set_major_locator(MaxNLocator(integer=True))
    axis.yaxis.set_major_formatter("{x:,.0f}")
    axis.grid(axis="y", alpha=0.3)
    axes = bottom.subplots(1, len(maps), squeeze=False)[0]
    highest = max(1, *(int(uses.max()) for uses in maps.values()))
    for axis, (number, uses) in zip(axes, maps.items(), strict=True):
        image = axis.imshow(uses, cmap="viridis", vmin=0, vmax=highest, interpolation="nearest")
        count = f"pair {number + 1}, {patches[number]:,} patches"
        axis.set_title(f"{names[number]}: {count}\n{drawn.pairs[number]}", fontsize=9)
        axis.set(xticks=[], yticks=[])
    bottom.colorbar(image, ax=axes, label="patches that a pixel lay in", fraction=0.05)
    return figure


def experiment_figure(
    title: str, cards: Sequence[tuple[str, Card]], baseline: str = "", varies: str = "value"
) -> Figure:
    """Draw the scores of trainings by value, as in Figs 5.18 and 5.21 to 5.23.

    A value trained several times gets the mean with bars of two standard deviations, minimum and
    maximum. A single value gets every training and the mean. The band is two standard deviations
    about the baseline's mean, if that was trained several times.

    Parameters
    ----------
    title : str
        The figure's title.
    cards : sequence of (str, Card)
        Value and card of each training.
    baseline : str
        The value that gets the band.
    varies : str
        What the values are.
    """
    by_value = grouped(cards)
    figure = Figure(figsize=(12, 4), layout="constrained")
    figure.suptitle(f"{title}, protocol thesis")
    for axis, metric in zip(figure.subplots(1, len(METRICS)), METRICS, strict=True):
        scores = {
            value: np.array([card.scores[metric] for card in group if metric in card.scores])
            for value, group in by_value.items()
        }
        _draw_band(axis, scores.get(baseline, np.array([])), baseline)
        if list(scores) == [""]:
            axis.plot(np.arange(1, len(scores[""]) + 1), scores[""], "o", color="black")
            axis.set_xlabel("training")
        else:
            _draw_values(axis, scores)
            axis.set_xlabel(varies.replace("_", " "))
        axis.set(ylabel=METRICS[metric].axis_label)
        axis.grid(alpha=0.3)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
    return figure


def _draw_band(axis: Axes, scores: NDArray[np.float64], baseline: str) -> None:
    if len(scores) < 2:
        return
    mean, deviation = scores.mean(), scores.std(ddof=1)
    whose = f" of {baseline}" if baseline else ""
    ends = mean - 2 * deviation, mean + 2 * deviation
    axis.axhspan(*ends, color=style.BLUE, alpha=0.15, label=f"mean{whose} ± 2 σ")
    axis.axhline(mean, color=style.BLUE, linestyle="--", label=f"mean{whose}")


def _draw_values(axis: Axes, scores: Mapping[str, NDArray[np.float64]]) -> None:
    several = [place for place, found in enumerate(scores.values()) if len(found) > 1]
    groups = list(scores.values())
    if several:
        means = [groups[place].mean() for place in several]
        bars = [2 * groups[place].std(ddof=1) for place in several]
        axis.errorbar(several, means, bars, fmt="o", color=style.RED, capsize=4, label="mean ± 2 σ")
        ends = [groups[place].min() for place in several]
        ends += [groups[place].max() for place in several]
        axis.plot(several * 2, ends, "o", color=style.GREEN, label="minimum, maximum")
    single = [place for place, found in enumerate(groups) if len(found) == 1]
    axis.plot(single, [groups[place][0] for place in single], "o", color="black")
    axis.set_xticks(range(len(groups)), list(scores))
    axis.set_xlim(-0.5, len(groups) - 0.5)
    if max(len(value) for value in scores) > 4:
        axis.tick_params(axis="x", rotation=45)


def _means(values: NDArray[np.float64], width: int) -> NDArray[np.float64]:
    whole = len(values) // width * width
    means: NDArray[np.float64] = values[:whole].reshape(-1, width).mean(axis=1)
    return means


def _by_iteration(title: str) -> tuple[Figure, Axes]:
    figure, axis = style.single_axes(9, 5)
    axis.set(title=style.plain_text(title), xlabel="iteration")
    axis.xaxis.set_major_locator(MaxNLocator(integer=True))
    return figure, axis


def objective_figure(course: Sequence[Iteration], title: str) -> Figure:
    """Draw the best objective so far, and the minimum and the mean of each iteration."""
    figure, axis = _by_iteration(title)
    numbers = [item.number for item in course]
    best = [item.best for item in course]
    axis.step(numbers, best, where="post", color=style.BLUE, label="best so far")
    for name, marker, line in (("mean", "s", "-"), ("least", "o", "")):
        values = [getattr(item, name) for item in course]
        axis.plot(numbers, values, marker=marker, linestyle=line, color=style.RED, label=name)
    axis.set(ylabel="objective, Eq. 6.1")
    style.legend_beside(axis)
    return figure


def convergence_figure(course: Sequence[Iteration], title: str) -> Figure:
    """Draw the share of all components that equal the best position's, and its marks."""
    from dfdbench.training.search.swarm_search import MARKS

    figure, axis = _by_iteration(title)
    shares = [100 * item.alike for item in course]
    axis.plot([item.number for item in course], shares, marker="o", color=style.BLUE, label="equal")
    for mark in MARKS:
        axis.axhline(100 * mark, color=style.GREEN, linestyle="--", linewidth=1)
        axis.annotate(f"{100 * mark:.0f} %", (course[0].number, 100 * mark), va="bottom")
    axis.set(ylabel="components equal to the best's (%)", ylim=(0, 104))
    style.legend_beside(axis)
    return figure


def widths_figure(filters: Sequence[int], title: str) -> Figure:
    """Draw the widths found beside the baseline's, as in Fig. 6.2."""
    figure, axis = style.single_axes(11, 5, axis="y")
    places = np.arange(len(LAYERS))
    for shift, label, colour, widths in (
        (-0.2, "DfD-Net", style.RED, FILTERS["original"]),
        (0.2, "found", style.BLUE, filters),
    ):
        axis.bar(places + shift, widths, 0.4, color=colour, label=label)
    axis.set_xticks(places, [str(layer) for layer in LAYERS])
    axis.set(title=style.plain_text(title), xlabel="layer, input to output", ylabel="filters")
    style.legend_below(figure, axis)
    return figure
