"""Figures of a run: pairs, scores by scene and by group, depths, times."""

import io
import math
import textwrap
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from dfdbench.blur.recipe import LAST_LEVEL, LEVELS
from dfdbench.datasets.captures import Capture
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest import Scene
from dfdbench.errors import InputError, ResultError
from dfdbench.figures import style, sureness
from dfdbench.metrics.metric import mean_of
from dfdbench.metrics.protocol import Unit, metrics_of, title_of
from dfdbench.results.record import PairResult, Result
from dfdbench.results.run_folder import read_prediction
from dfdbench.results.saved_run import SavedRun
from dfdbench.results.summary import scene_labels, summarise
from dfdbench.results.wording import titled_scores
from dfdbench.tables.table import grouped

_PANELS = 3


def draw_run(run: SavedRun, protocol: str, forms: Sequence[str] = ("png",)) -> list[Path]:
    """Draw a run's figures into ``figures`` in its folder; return their paths.

    Parameters
    ----------
    run : SavedRun
        The run, with its predictions.
    protocol : str
        The protocol that ranks and scores pairs.
    forms : sequence of str
        The formats of each figure: "png", "pdf", "svg".

    Raises
    ------
    ResultError
        If its images cannot be shown.
    """
    result, store, folder = run.result, run.store, run.path.parent
    if store is None:
        raise ResultError(run.without, where=str(folder))
    target = folder / "figures"
    target.mkdir(parents=True, exist_ok=True)
    order = summarise(result, protocol).ranked
    figures: dict[str, Figure | None] = {
        "scores": score_figure(result, protocol),
        "best": panel_figure(run, order[:_PANELS], protocol, "best"),
        "worst": panel_figure(run, order[::-1][:_PANELS], protocol, "worst"),
        "depths": depth_figure(store, result, folder),
        "time_by_pixels": pixel_time_figure(store, result),
    }
    if sure := sureness.curves_of(run, result.method.title):
        title = f"how sure it is, {result.dataset.heading}"
        figures["sureness"] = sureness.sureness_figure([sure], title)
    groups = group_figures({result.method.title: result}, protocol, store.manifest.scenes)
    figures |= {f"by_{what}": figure for what, figure in groups.items()}
    return [
        path
        for name, figure in figures.items()
        if figure is not None
        for path in style.write_forms(figure, target, name, forms)
    ]


def panel_figure(
    run: SavedRun, pairs: Sequence[PairResult], protocol: str, kind: str
) -> Figure | None:
    """Draw in-focus, defocus, truth, prediction and error, one row per pair; None without pairs."""
    rows = [(record, *found) for record in pairs if (found := run.images(record))]
    if not rows:
        return None
    result = run.result
    figure, grid = style.rows_of_images([record.id for record, *_ in rows], HEADS, 2.55)
    name, under = style.plain_text(result.method.title), f"protocol {title_of(protocol)}"
    figure.suptitle(f"{name}: {kind} pairs of {result.dataset.heading}, {under}")
    for axes, (record, images, prediction) in zip(grid, rows, strict=True):
        draw_pair(figure, axes, images, prediction, both=True)
        scores = map(" ".join, titled_scores(record, protocol, "undefined"))
        # Break lines between scores, not within one.
        whole = "  ".join(score.replace(" ", _NO_BREAK) for score in scores)
        axes[4].set_xlabel(textwrap.fill(whole, _CAPTION), fontsize=8)
    figure.supxlabel("grey: depth unknown", fontsize=8)
    return figure


def score_figure(result: Result, protocol: str) -> Figure | None:
    """Draw each metric by scene and lighting, as in the thesis's Figs 5.11 to 5.13."""
    pairs, first = result.evaluated, next(iter(metrics_of(protocol)))
    if all(pair.score(protocol, first) is None for pair in pairs):
        return None
    blocks, rows = result.dataset.blocks, result.dataset.rows
    columns = sorted({pair.coordinates[rows] for pair in pairs}) if rows else [None]
    levels = sorted({pair.coordinates[blocks] for pair in pairs})
    panels = {}
    for value in columns:
        chosen = [pair for pair in pairs if rows is None or pair.coordinates[rows] == value]
        panels[f"{rows} {value}" if rows else ""] = {
            f"{blocks} {level}": [pair for pair in chosen if pair.coordinates[blocks] == level]
            for level in levels
        }
    scenes = list(dict.fromkeys(pair.scene for pair in pairs))
    size = max(4.0, 0.35 * len(scenes) + 2.0), 0.8 + 2.4 * len(metrics_of(protocol))
    figure, grid = scene_grid(panels, scenes, protocol, size, 0.5)
    name, under = style.plain_text(result.method.title), f"protocol {title_of(protocol)}"
    figure.suptitle(f"{name} on {result.dataset.heading}, {under}")
    for axis in grid[-1]:
        axis.set_xlabel("scene; one mark a view" if "view" in result.dataset.axes else "scene")
    named = grid[0][0].get_legend_handles_labels()
    most = int(figure.get_figwidth() / 2)
    figure.legend(*named, loc="outside lower center", ncols=min(len(levels), most))
    return figure


def scene_grid(
    panels: Mapping[str, Mapping[str, Sequence[PairResult]]],
    scenes: Sequence[str],
    protocol: str,
    size: tuple[float, float],
    spread: float,
    colours: int = len(style.COLOURS),
) -> tuple[Figure, Any]:
    """Draw each metric by scene: one row per metric, one column for the series under each title.

    `size` is a panel's width and the height of all rows.
    """
    metrics = metrics_of(protocol)
    # Title and legend have a fixed width, however few scenes and panels there are.
    whole = max(size[0] * len(panels), 8.0), size[1]
    figure = Figure(figsize=whole, layout="constrained")
    grid = figure.subplots(len(metrics), len(panels), squeeze=False, sharey="row", sharex=True)
    for line, metric in zip(grid, metrics.values(), strict=True):
        line[0].set_ylabel(metric.axis_label)
        for axis, series in zip(line, panels.values(), strict=True):
            draw_by_scene(axis, series, scenes, protocol, metric.name, spread, colours)
    for axis, title in zip(grid[0], panels, strict=True):
        axis.set_title(title)
    return figure, grid


def draw_by_scene(
    axis: Axes,
    series: Mapping[str, Sequence[PairResult]],
    scenes: Sequence[str],
    protocol: str,
    metric: str,
    spread: float,
    colours: int = len(style.COLOURS),
) -> None:
    """Draw a score by scene, one mark per pair; series are side by side, with their labels."""
    for number, (label, pairs) in enumerate(series.items()):
        offset = (number - (len(series) - 1) / 2) * spread / len(series)
        found = [(p.scene, v) for p in pairs if (v := p.score(protocol, metric)) is not None]
        at = [scenes.index(scene) + offset for scene, _ in found]
        look = {**style.marks(number), "color": style.COLOURS[number % colours]}
        axis.plot(at, [value for _, value in found], label=label, **look)
    axis.set_xticks(range(len(scenes)), scenes, rotation=60, ha="right")
    axis.grid(alpha=0.3)


def depth_figure(store: Dataset, result: Result, folder: Path) -> Figure | None:
    """Draw the histogram of ground truth and prediction over all evaluated pairs."""
    truth, found, about = np.zeros(LEVELS), np.zeros(LEVELS), store.manifest.depth
    unit = about.kind
    for pair in [record.pair for record in result.evaluated]:
        depth, valid = store.read_levels(pair)
        if (prediction := read_prediction(folder, pair, depth.shape, "depth", unit)) is not None:
            counts = valid & ~np.isnan(prediction)
            answered = np.rint(about.exact_levels(prediction[counts]))
            truth += np.bincount(depth[counts], minlength=LEVELS)
            found += np.bincount(answered.astype(np.int64), minlength=LEVELS)
    if not truth.any():
        return None
    figure, axis = style.single_axes(9, 4)
    levels = np.arange(LEVELS)
    truth, found = 100 * truth / truth.sum(), 100 * found / found.sum()
    axis.fill_between(levels, truth, step="mid", color=style.SKY, alpha=0.6, label="ground truth")
    label = f"prediction of {style.plain_text(result.method.title)}"
    axis.step(levels, found, where="mid", color=style.RED, linewidth=1, label=label)
    title = f"depths of {result.dataset.heading}"
    axis.set(xlabel=style.DEPTH_LABELS[unit], ylabel="known pixels (%)", title=title)
    axis.set_xlim(0, LAST_LEVEL)
    if unit == "metres" and about.scale:
        ticks = np.linspace(about.scale.far_level, about.scale.near_level, 9)
        axis.set_xticks(ticks, [f"{distance:.3g}" for distance in about.scale.to_metres(ticks)])
    style.legend_below(figure, axis)
    return figure


def pixel_time_figure(store: Dataset, result: Result) -> Figure | None:
    """Draw seconds by number of pixels, as in Fig. 4.4; None if all pairs have the same size.

    Pairs that ran at the same time as others are left out.
    """
    times = grouped(
        (math.prod(store.shape_of(pair.scene)), pair.seconds)
        for pair in result.evaluated
        if pair.timed_alone and pair.seconds is not None
    )
    if len(times) < 2:
        return None
    pixels = np.array([size for size, taken in times.items() for _ in taken])
    seconds = np.array([one for taken in times.values() for one in taken])
    sizes = np.array(sorted(times))
    # An intercept means nothing if sizes are much alike, as Middlebury's are.
    rate = seconds.sum() / pixels.sum()
    figure, axis = style.single_axes(9, 5)
    axis.plot(pixels, seconds, ".", color=style.BLUE, alpha=0.4, label="a pair")
    means = [np.mean(times[size]) for size in sizes]
    label = "mean of the pairs of a size"
    axis.plot(sizes, means, "D", color=style.RED, fillstyle="none", label=label)
    label = f"in proportion: {1e5 * rate:.3g} s for 100,000 pixels"
    axis.plot(sizes, rate * sizes, color="black", linewidth=1, label=label)
    title = f"time of {style.plain_text(result.method.title)} on {result.dataset.heading}"
    axis.set(xlabel="pixels of an image", ylabel="seconds per pair", ylim=(0, None), title=title)
    axis.xaxis.set_major_formatter("{x:,.0f}")
    style.legend_below(figure, axis)
    return figure


def group_figures(
    results: Mapping[str, Result], protocol: str, scenes: Sequence[Scene]
) -> dict[str, Figure]:
    """Draw each metric by exposure, geometry and texture, as in the thesis's Figs 7.2 to 7.17.

    Parameters
    ----------
    results : mapping of str to Result
        Runs on the same data, by name.
    protocol : str
        The protocol.
    scenes : sequence of Scene
        The manifest's scenes; if they have neither geometry nor texture, nothing is drawn.

    Returns
    -------
    dict of str to Figure
        By the property that groups the pairs.
    """
    labels = scene_labels(scenes)
    if not labels or not any(result.evaluated for result in results.values()):
        return {}
    blocks = next(iter(results.values())).dataset.blocks
    figures = {blocks: _group_figure(results, protocol, blocks, None)}
    return figures | {
        what: _group_figure(results, protocol, what, label_of) for what, label_of in labels.items()
    }


def _group_figure(
    results: Mapping[str, Result], protocol: str, what: str, label_of: Mapping[str, str] | None
) -> Figure:
    def label(pair: PairResult) -> str | None:
        return label_of.get(pair.scene) if label_of else str(pair.coordinates[what])

    found = [pair for result in results.values() for pair in result.evaluated]
    labels = [name for name in dict.fromkeys(map(label, found)) if name is not None]
    several = len(results) > 1
    height = 1.3 + max(0.3, 0.16 * len(results)) * len(labels) + 0.3 * several
    metrics = metrics_of(protocol)
    figure = Figure(figsize=(3 * len(metrics), height), layout="constrained")
    grid = figure.subplots(1, len(metrics), sharey=True)
    for axis, metric in zip(grid, metrics.values(), strict=True):
        for number, (name, result) in enumerate(results.items()):
            offset = (number - (len(results) - 1) / 2) * 0.7 / len(results)
            by_label = _by_label(result, protocol, metric.name, label)
            rows = {at + offset: by_label[one] for at, one in enumerate(labels) if one in by_label}
            _draw_run(axis, rows, number, style.plain_text(name))
        axis.set_xlabel(metric.axis_label)
        axis.locator_params(axis="x", nbins=4)
        axis.grid(axis="x", alpha=0.3)
    grid[0].set_yticks(range(len(labels)), labels)
    grid[0].set_ylim(len(labels) - 0.5, -0.5)
    grid[0].set_ylabel(what)
    first = next(iter(results.values()))
    whose = "" if several else f"{style.plain_text(next(iter(results)))} on "
    under = f"protocol {title_of(protocol)}: mean and standard deviation; a dot is a pair"
    figure.suptitle(f"{whose}{first.dataset.heading}, {under}", fontsize=10)
    if several:
        style.legend_below(figure, grid[0])
    return figure


def _by_label(
    result: Result, protocol: str, metric: str, label: Callable[[PairResult], str | None]
) -> dict[str, list[float]]:
    found = ((label(pair), pair.score(protocol, metric)) for pair in result.evaluated)
    return grouped((name, score) for name, score in found if name is not None and score is not None)


def _draw_run(axis: Axes, rows: Mapping[float, Sequence[float]], number: int, name: str) -> None:
    dots: dict[str, Any] = {**style.marks(number), "marker": ".", "markersize": None}
    bars: dict[str, Any] = {**style.marks(number), "capsize": 2, "linestyle": None, "linewidth": 1}
    for at, values in rows.items():
        axis.plot(values, [at] * len(values), alpha=0.35, markeredgewidth=0, **dots)
        spread = np.std(values, ddof=1) if len(values) > 1 else 0.0
        axis.errorbar(mean_of(values) or 0.0, at, xerr=spread, label=name, **bars)
        name = "_"  # one legend entry per run


# Maximum length of a line below a panel, in characters.
_CAPTION = 40
_NO_BREAK = "\N{NO-BREAK SPACE}"
HEADS = ("in-focus", "defocus", "ground truth", "prediction", "prediction − truth")


class Shown(Figure):
    """A figure that a notebook shows without pyplot and its state."""

    def _repr_png_(self) -> bytes:
        content = io.BytesIO()
        self.savefig(content, format="png", dpi=90)
        return content.getvalue()


def show(pair: Capture, prediction: NDArray[np.floating[Any]] | None = None) -> Figure:
    """Draw a pair; this is ``dfdbench.show``.

    Parameters
    ----------
    pair : Capture
        From `dfdbench.Dataset.captures`.
    prediction : ndarray, shape (y, x), optional
        Depth levels from a method; drawn with its error.

    Returns
    -------
    Figure
        A notebook shows it, and ``savefig`` writes it. Unknown depth is grey.

    Raises
    ------
    TypeError
        If it is not a pair.
    InputError
        If the prediction's shape differs from that of the pair's images.

    Examples
    --------
    >>> from dfdbench.datasets.manifest import Pair
    >>> grey, level = np.full((2, 6, 8, 3), 90, np.uint8), np.full((6, 8), 40, np.float32)
    >>> figure = show(Capture(Pair("Desk", (("view", 1),)), grey, level))
    >>> [axis.get_title() for axis in figure.axes][:3]
    ['in-focus', 'defocus', 'ground truth']
    """
    if not isinstance(pair, Capture):
        raise TypeError(
            f"show draws a capture, as dataset.captures()[0], not {type(pair).__name__}"
        )
    count = 3 if prediction is None else len(HEADS)
    if prediction is not None and np.shape(prediction) != pair.depth.shape:
        expected, got = f"shape {pair.depth.shape}", f"shape {np.shape(prediction)}"
        what, fix = "no depth map of this pair", "give what a method answers for its images"
        raise InputError(what, where=pair.pair.id, expected=expected, got=got, fix=fix)
    rows, columns = pair.depth.shape
    figure = Shown(figsize=(3 * count, 3 * rows / columns + 0.6), layout="constrained")
    figure.suptitle(style.plain_text(pair.pair.id), fontsize=10)
    axes = list(figure.subplots(1, count))
    for axis, head in zip(axes, HEADS, strict=False):
        axis.set_title(head, fontsize=10)
    draw_pair(figure, axes, pair, *([] if prediction is None else [prediction]), both=True)
    return figure


def draw_pair(
    figure: Figure,
    axes: Sequence[Axes],
    images: Capture,
    *predictions: NDArray[np.floating[Any]],
    both: bool = False,
) -> None:
    """Draw a pair into axes: its images, its truth, the predictions, then their errors.

    If `both`, draw both images, otherwise only the in-focus one. Depth and error get scales.
    """
    known = images.depth.astype(np.float64)
    scale, errors = style.depth_scales(images.about, known)
    unit = images.about.kind
    times = style.brightening(images.shown[0])
    shown = images.shown[: 1 + both]
    for axis, image in zip(axes, shown, strict=False):
        axis.imshow(style.brightened(image, times))
    if times > 1:
        which = "both images shown" if both else "shown"
        axes[0].set_xlabel(f"{which} {times} times brighter", fontsize=8)
    maps = (known, *predictions)
    last = len(shown) + len(maps)
    for axis, depth in zip(axes[len(shown) : last], maps, strict=True):
        drawn = axis.imshow(depth, interpolation="nearest", **scale)
    style.without_ticks(axes, "0.75")
    figure.colorbar(drawn, ax=axes[last - 1], label=style.DEPTH_LABELS[unit], fraction=0.05)
    for axis, depth in zip(axes[last:], predictions, strict=True):
        error = axis.imshow(depth - known, interpolation="nearest", **errors)
    if predictions:
        figure.colorbar(error, ax=axes[-1], label=unit, fraction=0.05, extend="both")


def predicted_figure(
    infocus: NDArray[np.uint8],
    defocus: NDArray[np.uint8],
    depth: NDArray[np.floating[Any]],
    unit: Unit,
    grows_with: Literal["nearness", "distance"],
) -> Figure:
    """Draw two photographs, shape (y, x, 3), and the depth estimated from them: near is bright."""
    rows, columns = depth.shape
    figure = Shown(figsize=(9, 3 * rows / columns + 0.4), layout="constrained")
    axes = figure.subplots(1, 3)
    for axis, head, image in zip(axes, HEADS, (infocus, defocus), strict=False):
        axis.set_title(head, fontsize=10)
        axis.imshow(image)
    whole = LAST_LEVEL if unit == "levels" else float(np.nanmax(depth))
    low, high = style.depth_span(np.asarray(depth, np.float64), whole)
    colours = "viridis" if grows_with == "nearness" else "viridis_r"
    shown = axes[2].imshow(depth, cmap=colours, vmin=low, vmax=high, interpolation="nearest")
    axes[2].set_title("depth", fontsize=10)
    style.without_ticks(axes, "0.75")
    label = f"{style.DEPTH_LABELS[unit]} (brighter is nearer)"
    figure.colorbar(shown, ax=axes[2], label=label, fraction=0.05)
    return figure
