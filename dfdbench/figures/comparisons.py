"""Figures over several runs: scores by scene and lighting, times, changes, scores on tracks."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage

from dfdbench.blur.tracks import CLEAN
from dfdbench.figures import style
from dfdbench.figures.runs import draw_by_scene, draw_pair, scene_grid
from dfdbench.metrics.metric import find_metric
from dfdbench.metrics.protocol import metrics_of, ranked_by, title_of
from dfdbench.results.differences import PairChange
from dfdbench.results.record import PairResult
from dfdbench.results.saved_run import SavedRun
from dfdbench.results.summary import median_seconds

_COLUMNS = 4
_WIDTH, _HEIGHT = 2.7, 2.4
# Used when there are more methods than colours.
_LINES = ("-", "--", ":")
#: The meaning of the colours of a transfer's matrix.
OVER_OWN = "over that of its own fit"


def lighting_figures(runs: Sequence[SavedRun], protocol: str) -> dict[str, Figure]:
    """Draw each metric of comparable runs by scene and exposure, one figure per illumination.

    As in the thesis's Figs 4.5, 4.7, 4.8, 5.11 to 5.13 and, with several methods, 5.15 to 5.17. The
    key says what a figure shows. Without illuminations there is only one figure; for a single scene
    there is one with the lightings side by side.
    """
    dataset = runs[0].result.dataset
    pairs = [pair for run in runs for pair in run.result.evaluated]
    if not pairs:
        return {}
    if dataset.rows is None:
        return {"scores by scene": _scene_figure(runs, pairs, protocol, None)}
    if len({pair.scene for pair in pairs}) == 1:
        return {f"scores by {dataset.rows}": _one_scene_figure(runs, protocol)}
    values = sorted({pair.coordinates[dataset.rows] for pair in pairs})
    return {
        f"{dataset.rows} {value}": _scene_figure(runs, pairs, protocol, value) for value in values
    }


def time_figure(runs: Sequence[SavedRun]) -> Figure | None:
    """Draw the seconds per pair of each method as boxes on a logarithmic axis."""
    times = [
        (run.label, [p.seconds for p in run.result.evaluated if p.seconds and p.timed_alone])
        for run in runs
    ]
    timed = [(label, seconds) for label, seconds in times if seconds]
    if not timed:
        return None
    figure, axis = style.single_axes(9, 1.4 + 0.45 * len(timed), axis="x")
    seconds, box = [each for _, each in timed], {"facecolor": style.SKY, "alpha": 0.7}
    look: dict[str, Any] = {"patch_artist": True, "widths": 0.6, "whis": (0, 100)}
    axis.boxplot(seconds, orientation="horizontal", boxprops=box, **look)
    names = [style.wrapped(style.plain_text(label), 40) for label, _ in timed]
    axis.set_yticks(range(1, len(timed) + 1), names)
    axis.invert_yaxis()
    axis.set(xscale="log", xlabel="seconds per pair: quartiles and extremes")
    return figure


def accuracy_figure(runs: Sequence[SavedRun], protocol: str) -> Figure | None:
    """Draw the ranking metric against the seconds per pair, one mark per method, both logarithmic.

    Runs that are incomplete or whose seconds are not comparable are left out; None if all are.
    """
    name = ranked_by(protocol)[0]
    found = [
        (run.label, seconds, score)
        for run in runs
        if (score := run.result.mean(protocol, name)) and (seconds := median_seconds([run.result]))
    ]
    if not found:
        return None
    figure, axis = style.single_axes(7, 4.2, which="both")
    for number, (label, seconds, score) in enumerate(found):
        marker = style.MARKERS[(number + number // len(style.COLOURS)) % len(style.MARKERS)]
        look = {**style.marks(number), "marker": marker, "markersize": 9}
        axis.plot(seconds, score, label=style.plain_text(label), **look)
    axis.set(xscale="log", xlabel="seconds per pair, median")
    axis.set(yscale="log", ylabel=find_metric(name).heading)
    for side in (axis.xaxis, axis.yaxis):
        side.set_major_formatter("{x:g}")
    axis.yaxis.set_minor_formatter("{x:g}")
    axis.set_title(f"{runs[0].result.dataset.name}, protocol {title_of(protocol)}", fontsize=11)
    style.legend_below(figure, axis)
    return figure


def change_figure(
    first: SavedRun, second: SavedRun, found: Sequence[PairChange], metric: str
) -> Figure | None:
    """Draw truth, both predictions and both errors, one row per pair; None without depth maps."""
    rows = []
    for change in found:
        before, after = first.images(change.first), second.images(change.second)
        if before is not None and after is not None:
            rows.append((change, before[0], before[1], after[1]))
    if not rows:
        return None
    heads = ("in-focus", "ground truth", "A", "B", "A − truth", "B − truth")
    figure, grid = style.rows_of_images([change.first.id for change, *_ in rows], heads, 1.9)
    names = [style.plain_text(run.label) for run in (first, second)]
    figure.suptitle(f"A: {names[0]}    B: {names[1]}    changed much, scene by scene")
    for axes, (change, images, *predictions) in zip(grid, rows, strict=True):
        draw_pair(figure, axes, images, *predictions)
        axes[5].set_xlabel(f"{find_metric(metric).title} {change.difference:+.4f}", fontsize=9)
    figure.supxlabel("grey: depth unknown", fontsize=8)
    return figure


def _scene_figure(
    runs: Sequence[SavedRun], pairs: Sequence[PairResult], protocol: str, value: int | None
) -> Figure:
    dataset = runs[0].result.dataset
    levels = sorted({pair.coordinates[dataset.blocks] for pair in pairs})
    scenes = list(dict.fromkeys(pair.scene for pair in pairs))
    lighting = {dataset.rows: value} if dataset.rows and value is not None else {}
    panels = {
        f"{dataset.blocks} {level}": {
            style.plain_text(run.label): _pairs_at(run, {dataset.blocks: level, **lighting})
            for run in runs
        }
        for level in levels
    }
    size = max(3.2, 0.3 * len(scenes) + 1.5), 2.5 * len(metrics_of(protocol))
    figure, grid = scene_grid(panels, scenes, protocol, size, 0.6, len(style.COLOURS) - 1)
    style.legend_below(figure, grid[0][0])
    return figure


def _one_scene_figure(runs: Sequence[SavedRun], protocol: str) -> Figure:
    dataset, metrics = runs[0].result.dataset, metrics_of(protocol)
    figure = Figure(figsize=(4.0 * len(metrics), 4.2), layout="constrained")
    axes = figure.subplots(1, len(metrics), squeeze=False)[0]
    series = {style.plain_text(run.label): _by_lighting(run) for run in runs}
    places = sorted({pair.scene for pairs in series.values() for pair in pairs})
    for axis, metric in zip(axes, metrics.values(), strict=True):
        draw_by_scene(axis, series, places, protocol, metric.name, 0.6, len(style.COLOURS) - 1)
        axis.set_ylabel(metric.axis_label)
        axis.set_xlabel(f"{dataset.blocks}, {dataset.rows}")
    style.legend_below(figure, axes[0])
    return figure


def _by_lighting(run: SavedRun) -> list[PairResult]:
    """Return a run's pairs, named by their lighting instead of their scene."""
    dataset = run.result.dataset
    named = []
    for pair in _pairs_at(run, {}):
        place = (pair.coordinates[axis] for axis in (dataset.blocks, dataset.rows) if axis)
        named.append(pair.model_copy(update={"scene": ", ".join(map(str, place))}))
    return named


def _pairs_at(run: SavedRun, place: dict[str, int]) -> list[PairResult]:
    return [pair for pair in run.result.evaluated if place.items() <= pair.coordinates.items()]


def tracks_figure(scores: Mapping[str, pd.DataFrame], metric: str, title: str) -> Figure:
    """Draw a metric against severity, one panel per track, one line per method.

    Parameters
    ----------
    scores : mapping of str to DataFrame
        By method: a row per track, a column per severity, 0 for clean images; see
        `dfdbench.results.frame.track_means`.
    metric : str
        The metric's name.
    title : str
        The title above all panels.
    """
    tracks = list(dict.fromkeys(track for means in scores.values() for track in means.index))
    rows = -(-len(tracks) // _COLUMNS)
    columns = min(_COLUMNS, len(tracks))
    # A single panel is wide enough for the title.
    width = max(_WIDTH * columns, 5.0)
    figure = Figure((width, _HEIGHT * rows + 0.7), layout="constrained")
    axes = figure.subplots(rows, columns, sharey=True, squeeze=False)
    for axis in axes.flat[len(tracks) :]:
        axis.set_axis_off()
    for track, axis in zip(tracks, axes.flat, strict=False):
        longest = 0
        for number, (method, means) in enumerate(scores.items()):
            values = means.loc[track].tolist() if track in means.index else []
            longest = max(longest, len(values))
            line = _LINES[number // len(style.COLOURS) % len(_LINES)]
            look = {**style.marks(number), "linestyle": line, "markersize": None}
            axis.plot(range(len(values)), values, label=style.plain_text(method), **look)
        axis.set_title(track, fontsize=10)
        axis.set_xlabel("severity")
        axis.set_xticks(range(longest), [CLEAN, *map(str, range(1, longest))])
        axis.grid(alpha=0.3)
    for axis in axes[:, 0]:
        axis.set_ylabel(find_metric(metric).heading)
    # The height of the shared axis is only known now; a line along its upper edge is hardly seen.
    axes.flat[0].set_ylim(0, 1.05 * axes.flat[0].get_ylim()[1])
    figure.suptitle(style.wrapped(style.plain_text(title), int(12 * width)), fontsize=10)
    if len(scores) > 1:
        handles, labels = axes.flat[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return figure


def transfer_figure(means: pd.DataFrame, title: str) -> Figure:
    """Draw the scores of foreign fits beside a set's own, as a matrix.

    A column's colours show its score over that of its own fit, which is on the diagonal.

    Parameters
    ----------
    means : DataFrame
        See `dfdbench.report.objects.Transfer.table`.
    title : str
        The title above the matrix.
    """
    side = 2.2 + 0.8 * len(means)
    figure = Figure((side + 2.4, side), layout="constrained")
    image = draw_transfer(figure.subplots(), means)
    figure.colorbar(image, label=OVER_OWN, shrink=0.8)
    figure.suptitle(style.wrapped(style.plain_text(title), 60), fontsize=10)
    return figure


def draw_transfer(axis: Axes, means: pd.DataFrame, most: float | None = None) -> AxesImage:
    """Draw the matrix of `transfer_figure`; the last colour is `most` times the own score."""
    shares = means.to_numpy() / np.diag(means)
    most = most or float(np.nanmax(shares))
    image = axis.imshow(shares, vmin=1, vmax=most, cmap="cividis_r")
    for (row, column), score in np.ndenumerate(means.to_numpy()):
        colour = "white" if shares[row, column] > (1 + most) / 2 else "black"
        axis.text(column, row, f"{score:.3f}", ha="center", va="center", color=colour, fontsize=9)
    names = [style.plain_text(str(name)) for name in means.columns]
    axis.set_xticks(range(len(names)), names, rotation=45, ha="right")
    axis.set_yticks(range(len(names)), names)
    axis.set(xlabel="tested on", ylabel="fitted on")
    return image
