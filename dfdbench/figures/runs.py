"""Figures out of a run: panels of pairs, scores by scene, by what parts them, depths, times."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import StrMethodFormatter
from numpy.typing import NDArray

from dfdbench.blur.recipe import LAST_LEVEL, LEVELS
from dfdbench.datasets.store import Store
from dfdbench.figures.groups import group_figures
from dfdbench.figures.pairs import HEADS, draw_pair
from dfdbench.figures.style import COLOURS, MARKERS, legend_below, plain_text, write_forms
from dfdbench.metrics.protocol import metrics_of, title_of
from dfdbench.results.folder import read_prediction
from dfdbench.results.record import PairResult, Result
from dfdbench.results.summary import RunSummary
from dfdbench.results.wording import score_text

_PANELS = 3


def draw_run(
    store: Store, summary: RunSummary, folder: Path, also: Sequence[str] = ()
) -> list[Path]:
    """Draw a run's figures as PNG files into ``folder/figures``; return their paths.

    Parameters
    ----------
    store : Store
        The data set that was run on.
    summary : RunSummary
        The run under a protocol, by which pairs are ranked and scored.
    folder : Path
        The run's folder, with its predictions.
    also : sequence of str
        Further forms of each figure, "pdf" or "svg", beside the PNG file.
    """
    target = folder / "figures"
    target.mkdir(parents=True, exist_ok=True)
    result, protocol, order = summary.result, summary.protocol, summary.ranked
    figures: dict[str, Figure | None] = {
        "scores": score_figure(result, protocol),
        "best": panel_figure(store, result, folder, order[:_PANELS], protocol, "best"),
        "worst": panel_figure(store, result, folder, order[::-1][:_PANELS], protocol, "worst"),
        "depths": depth_figure(store, result, folder),
        "time_by_pixels": pixel_time_figure(store, result),
    }
    runs = {result.method.title: result}
    for what, parted in group_figures(runs, protocol, store.manifest.scenes).items():
        figures[f"by_{what}"] = parted
    return [
        path
        for name, figure in figures.items()
        if figure is not None
        for path in write_forms(figure, target, name, ("png", *also))
    ]


def panel_figure(
    store: Store,
    result: Result,
    folder: Path,
    pairs: tuple[PairResult, ...],
    protocol: str,
    kind: str,
) -> Figure | None:
    """Draw in-focus, defocus, truth, prediction and error, a row a pair; None without pairs."""
    rows = []
    for record in pairs:
        pair = record.pair
        prediction = read_prediction(folder, pair, store.shape_of(pair.scene))
        if prediction is not None:
            rows.append((record, store.read(pair), prediction))
    if not rows:
        return None
    figure = Figure(figsize=(15, 2.55 * len(rows) + 0.9), layout="constrained")
    grid = figure.subplots(len(rows), 5, squeeze=False)
    figure.suptitle(
        f"{plain_text(result.method.title)}: {kind} pairs of {result.dataset.label}, "
        f"split {result.dataset.split}, protocol {title_of(protocol)}"
    )
    for axis, head in zip(grid[0], HEADS, strict=True):
        axis.set_title(head, fontsize=10)
    for axes, (record, images, prediction) in zip(grid, rows, strict=True):
        draw_pair(figure, axes, images, prediction)
        axes[0].set_ylabel(record.id.replace("/", "\n"), fontsize=8)
        scores = (
            f"{metric.title} {score_text(record.score(protocol, name), 'undefined')}"
            for name, metric in metrics_of(protocol).items()
        )
        axes[4].set_xlabel("  ".join(scores), fontsize=8)
    figure.supxlabel("grey: depth unknown", fontsize=8)
    return figure


def score_figure(result: Result, protocol: str) -> Figure | None:
    """Draw each metric by scene and lighting, as the thesis's Figs 5.11 to 5.13."""
    pairs = [pair for pair in result.pairs if pair.status == "ok"]
    if not pairs:
        return None
    blocks, rows = result.dataset.blocks, result.dataset.rows
    columns = sorted({pair.coordinates[rows] for pair in pairs}) if rows else [None]
    levels = sorted({pair.coordinates[blocks] for pair in pairs})
    scenes = list(dict.fromkeys(pair.scene for pair in pairs))
    width = max(4.0, 0.35 * len(scenes) + 2.0)
    # Title and legend are of one width, however few scenes there are.
    whole = max(width * len(columns), 8.0)
    metrics = metrics_of(protocol)
    figure = Figure(figsize=(whole, 0.8 + 2.4 * len(metrics)), layout="constrained")
    grid = figure.subplots(len(metrics), len(columns), squeeze=False, sharey="row", sharex=True)
    figure.suptitle(
        f"{plain_text(result.method.title)} on {result.dataset.label}, "
        f"split {result.dataset.split}, protocol {title_of(protocol)}"
    )
    for line, metric in zip(grid, metrics.values(), strict=True):
        line[0].set_ylabel(metric.axis_label)
        for axis, value in zip(line, columns, strict=True):
            chosen = [pair for pair in pairs if rows is None or pair.coordinates[rows] == value]
            for number, level in enumerate(levels):
                offset = (number - (len(levels) - 1) / 2) * 0.5 / len(levels)
                of_level = [pair for pair in chosen if pair.coordinates[blocks] == level]
                found = _marks(of_level, scenes, offset, protocol, metric.name)
                _draw_marks(axis, found, number, f"{blocks} {level}")
            axis.set_xticks(range(len(scenes)), scenes, rotation=60, ha="right")
            axis.grid(alpha=0.3)
    for axis, value in zip(grid[0], columns, strict=True):
        axis.set_title(f"{rows} {value}" if rows else "")
    for axis in grid[-1]:
        axis.set_xlabel("scene; one mark a view" if "view" in result.dataset.axes else "scene")
    handles, labels = grid[0][0].get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="outside lower center", ncols=min(len(levels), int(whole / 2))
    )
    return figure


def _marks(
    pairs: Sequence[PairResult], scenes: Sequence[str], offset: float, protocol: str, metric: str
) -> list[tuple[float, float]]:
    return [
        (scenes.index(pair.scene) + offset, score)
        for pair in pairs
        if (score := pair.score(protocol, metric)) is not None
    ]


def _draw_marks(axis: Axes, found: Sequence[tuple[float, float]], number: int, label: str) -> None:
    axis.plot(
        [at for at, _ in found],
        [score for _, score in found],
        linestyle="none",
        marker=MARKERS[number % len(MARKERS)],
        markersize=5,
        color=COLOURS[number % len(COLOURS)],
        label=label,
    )


def depth_figure(store: Store, result: Result, folder: Path) -> Figure | None:
    """Draw the histogram of ground truth and prediction over all evaluated pairs."""
    truth, found = _depth_counts(store, result, folder)
    if not truth.any():
        return None
    figure = Figure(figsize=(9, 4), layout="constrained")
    axis = figure.subplots()
    levels = np.arange(LEVELS)
    axis.fill_between(
        levels,
        100 * truth / truth.sum(),
        step="mid",
        color=COLOURS[4],
        alpha=0.6,
        label="ground truth",
    )
    axis.step(
        levels,
        100 * found / found.sum(),
        where="mid",
        color=COLOURS[5],
        linewidth=1,
        label=f"prediction of {plain_text(result.method.title)}",
    )
    axis.set(
        xlabel="depth level",
        ylabel="known pixels (%)",
        xlim=(0, LAST_LEVEL),
        title=f"depths of {result.dataset.label}, split {result.dataset.split}",
    )
    axis.grid(alpha=0.3)
    legend_below(figure, axis)
    return figure


def _depth_counts(
    store: Store, result: Result, folder: Path
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    truth, found = np.zeros(LEVELS), np.zeros(LEVELS)
    for record in result.pairs:
        pair = record.pair
        if record.status != "ok":
            continue
        depth, valid = store.read_depth(pair)
        prediction = read_prediction(folder, pair, depth.shape)
        if prediction is None:
            continue
        truth += np.bincount(depth[valid], minlength=LEVELS)
        found += np.bincount(np.rint(prediction[valid]).astype(np.int64), minlength=LEVELS)
    return truth, found


def pixel_time_figure(store: Store, result: Result) -> Figure | None:
    """Draw seconds by number of pixels, as Fig. 4.4; None where all pairs are of one size.

    Times that were not taken alone are left out.
    """
    times = _times_by_pixels(store, result)
    if len(times) < 2:
        return None
    pixels = np.array([size for size, taken in times.items() for _ in taken])
    seconds = np.array([one for taken in times.values() for one in taken])
    sizes = np.array(sorted(times))
    # A line with an intercept would say nothing where sizes are much alike, as Middlebury's.
    rate = seconds.sum() / pixels.sum()
    figure = Figure(figsize=(9, 5), layout="constrained")
    axis = figure.subplots()
    axis.plot(pixels, seconds, ".", color=COLOURS[0], alpha=0.4, label="a pair")
    axis.plot(
        sizes,
        [np.mean(times[size]) for size in sizes],
        "D",
        color=COLOURS[5],
        fillstyle="none",
        label="mean of the pairs of a size",
    )
    axis.plot(
        sizes,
        rate * sizes,
        color="black",
        linewidth=1,
        label=f"in proportion: {1e5 * rate:.3g} s for 100,000 pixels",
    )
    axis.set(
        xlabel="pixels of an image",
        ylabel="seconds per pair",
        ylim=(0, None),
        title=f"time of {plain_text(result.method.title)} on {result.dataset.label}, "
        f"split {result.dataset.split}",
    )
    axis.xaxis.set_major_formatter(StrMethodFormatter("{x:,.0f}"))
    axis.grid(alpha=0.3)
    legend_below(figure, axis)
    return figure


def _times_by_pixels(store: Store, result: Result) -> dict[int, list[float]]:
    times: dict[int, list[float]] = {}
    for pair in result.pairs:
        if pair.status == "ok" and pair.timed_alone and pair.seconds is not None:
            rows, columns = store.shape_of(pair.scene)
            times.setdefault(rows * columns, []).append(pair.seconds)
    return times
