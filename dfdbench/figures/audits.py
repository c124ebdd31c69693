"""Figures of audits: depths, coverage, errors by depth and on uncovered levels, difficulty."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import ArrayLike, NDArray

from dfdbench.audit.coverage import CoverageRecord, SideRecord, Verdict
from dfdbench.audit.difficulty import DRAWN, STEPS, Bound, Difficulty
from dfdbench.audit.run_errors import DepthErrors, ErrorJoin, LevelErrors
from dfdbench.audit.sides import Side, range_text, runs
from dfdbench.blur.recipe import LEVELS
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.depth_scale import DepthScale
from dfdbench.datasets.manifest import Pair
from dfdbench.figures import style
from dfdbench.results.record import PairResult, Result
from dfdbench.results.run_folder import read_prediction
from dfdbench.tables.table import counted

_OF_VERDICT = {
    Verdict.missing: style.PINK,
    Verdict.scarce: style.ORANGE,
    Verdict.covered: style.GREEN,
}
_UNKNOWN = style.SKY
_LABELLED = 12
_SHADE = 0.6
_ALL_COVERED = "largest errors; training covers every level"
_PANELS = 3
# Levels drawn as one: single levels come from few scenes.
_TOGETHER = 4
_METRES = (0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 10.0, 20.0, 50.0)
_LEAST_APART = 0.03  # of the axis: marks in metres that would overlap are left out


def coverage_figure(record: CoverageRecord) -> Figure:
    """Draw the depths of both sides as in Figs 5.10, 5.19 and 5.9, and mark uncovered ranges."""
    figure = Figure(figsize=(12, 10), layout="constrained")
    top, middle, bottom = figure.subplots(3, 1, sharex=True)
    figure.suptitle(f"depths of {_name(record.test)}, held against {_name(record.train)}")
    for axis in (top, middle):
        _steps(axis, record.train.counts, f"training ({record.train.split})", style.BLUE, fill=True)
        _steps(axis, record.test.counts, f"test ({record.test.split})", style.RED)
        axis.set_ylabel("pixels of all pairs")
        for item in record.ranges:
            look = {"color": _OF_VERDICT[item.verdict], "alpha": _SHADE, "linewidth": 0}
            axis.axvspan(item.first - 0.5, item.last + 0.5, zorder=0, **look)
    top.yaxis.set_major_formatter("{x:,.0f}")
    middle.set(yscale="log", ylabel="pixels of all pairs, log scale")
    _label_ranges(middle, record)
    _steps(bottom, _percent(record.train.counts), "training, as is", style.BLUE, fill=True)
    _steps(bottom, _percent(record.train.expanded), "training, as 32 x 32 crops", "black")
    _steps(bottom, _percent(record.test.counts), "test, as is", style.RED)
    bottom.set(ylabel="known pixels (%)", xlabel="depth level", xlim=(-1, LEVELS))
    handles = [
        Patch(color=_OF_VERDICT[verdict], alpha=_SHADE, label=f"{verdict}: {text}")
        for verdict in (Verdict.missing, Verdict.scarce)
        if (text := record.ranges_of(verdict)) and len(text) < 90
    ]
    style.legend_beside(top, [*top.get_legend_handles_labels()[0], *handles])
    style.legend_beside(bottom)
    for axis in (top, middle, bottom):
        axis.grid(alpha=0.3)
    return figure


def depths_figure(side: Side) -> Figure:
    """Draw how often each depth level occurs in some scenes, as in Figs 3.5, 3.9 and 7.4."""
    histogram = side.histogram
    figure, axis = style.single_axes(11, 5)
    axis.stairs(histogram.counts, np.arange(LEVELS + 1) - 0.5, fill=True, color=style.BLUE)
    shown = f"{counted(histogram.pairs, 'pair')} of {counted(len(side.scenes), 'scene')}"
    known = f"{histogram.known:,} pixels of known depth, {shown}"
    level = f"depth level, grows with {side.store.manifest.depth.grows_with}"
    axis.set(
        title=f"depths of {side.store.manifest.label}, {side.name}: {known}", xlim=(-1, LEVELS)
    )
    axis.set(xlabel=level, ylabel="pixels of all pairs")
    axis.yaxis.set_major_formatter("{x:,.0f}")
    return figure


def level_error_figure(join: ErrorJoin, title: str) -> Figure:
    """Draw the mean absolute error at each true level, coloured by the level's verdict."""
    total = join.total
    present = total.pixels > 0
    mean = total.absolute / np.maximum(total.pixels, 1)
    figure = Figure(figsize=(12, 6), layout="constrained")
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    levels = np.arange(LEVELS)
    for verdict, mask in join.levels.items():
        chosen = mask & present
        if chosen.any():
            colour = _OF_VERDICT[verdict]
            top.bar(levels[chosen], mean[chosen], width=1, color=colour, label=str(verdict))
            bottom.bar(levels[chosen], total.pixels[chosen], width=1, color=colour)
    top.set(title=title, ylabel="mean absolute error (levels)")
    style.legend_beside(top)
    bottom.set(xlabel="true depth level", ylabel="pixels", xlim=(-1, LEVELS), yscale="log")
    for axis in (top, bottom):
        axis.grid(alpha=0.3)
    return figure


def mask_figure(store: Dataset, result: Result, folder: Path, join: ErrorJoin) -> Figure:
    """Draw truth, prediction, mask, error and both overlaid, as in Figs 5.20 and 7.5.

    The pairs are from different scenes, those with the most uncovered pixels; if all is covered,
    those with the largest errors.
    """
    rows = _most_uncovered(result, join)
    heads = ("ground truth", "prediction", "uncovered levels", "|error|", "error under the mask")
    figure, grid = style.rows_of_images([record.id for record in rows], heads, 2.7)
    where = "where training lacks levels" if join.total.share(join.uncovered) else _ALL_COVERED
    figure.suptitle(f"{result.method.title} on {result.dataset.label}: {where}")
    verdicts = ListedColormap(["white", style.ORANGE, style.PINK])
    for record, axes in zip(rows, grid, strict=True):
        depth, valid = store.read_levels(record.pair)
        about = store.manifest.depth
        prediction = read_prediction(folder, record.pair, depth.shape, "depth", about.kind)
        assert prediction is not None
        prediction = about.exact_levels(prediction)
        kind = np.where(join.levels[Verdict.missing], 2, join.levels[Verdict.scarce])[depth]
        kind = np.ma.masked_where(~valid, kind)
        known = np.ma.masked_where(~valid, np.abs(prediction - depth))
        images: tuple[tuple[Any, Any, float], ...] = (
            (np.ma.masked_where(~valid, depth), "viridis", 255),
            (prediction, "viridis", 255),
            (kind, verdicts, 2),
            (known, "gray", style.ERROR_LIMIT),
            (known, "gray", style.ERROR_LIMIT),
        )
        shown = [
            axis.imshow(image, cmap=colours, vmin=0, vmax=most, interpolation="nearest")
            for axis, (image, colours, most) in zip(axes, images, strict=True)
        ]
        over = np.ma.masked_where(np.ma.filled(kind, 0) == 0, kind)
        axes[4].imshow(over, cmap=verdicts, vmin=0, vmax=2, interpolation="nearest", alpha=0.5)
        figure.colorbar(shown[0], ax=axes[1], label="depth level", fraction=0.05)
        figure.colorbar(shown[3], ax=axes[4], label="levels", fraction=0.05, extend="max")
        style.without_ticks(axes, _UNKNOWN)
    shown_as = {"scarce": style.ORANGE, "missing": style.PINK, "depth unknown": _UNKNOWN}
    handles = [Patch(color=colour, label=label) for label, colour in shown_as.items()]
    figure.legend(handles=handles, loc="outside lower center", ncols=3)
    return figure


def difficulty_figure(
    title: str, panels: Sequence[tuple[str, NDArray[np.uint8], Difficulty]]
) -> Figure:
    """Draw in-focus images and, beside them, the smallest level step that their blur shows.

    A panel is a pair's name, its in-focus image and the result of `smallest_step`. Pixels of
    unknown depth are light blue.
    """
    labels = [*map(str, STEPS), "none"]
    steps = [(name, image, np.log2(found.step), found.valid) for name, image, found in panels]
    return _beside_images(title, "smallest step that is seen", labels, steps)


def bound_figure(title: str, panels: Sequence[tuple[str, NDArray[np.uint8], Bound]]) -> Figure:
    """Draw in-focus images and, beside them, the least error of a method with a limited window.

    A panel is a pair's name, its in-focus image and its bound. Pixels of unknown depth are light
    blue.
    """
    errors = [(n, image, np.log2(b.least_error(DRAWN)), b.valid) for n, image, b in panels]
    what = f"least error, window of {DRAWN} x {DRAWN} pixels"
    return _beside_images(title, what, [*map(str, STEPS), str(LEVELS)], errors)


def _beside_images(
    title: str,
    what: str,
    labels: Sequence[str],
    panels: Sequence[tuple[str, NDArray[np.uint8], NDArray[np.float64], NDArray[np.bool_]]],
) -> Figure:
    """Draw images and, beside each, a map of levels as powers of 2, where it is valid."""
    figure = Figure(figsize=(9, 2.6 * len(panels) + 0.8), layout="constrained")
    grid = figure.subplots(len(panels), 2, squeeze=False)
    figure.suptitle(title)
    look: dict[str, Any] = {"cmap": "cividis", "vmin": 0, "vmax": len(labels) - 1}
    for (name, image, powers, valid), axes in zip(panels, grid, strict=True):
        axes[0].imshow(image)
        axes[0].set_title(name.replace("/", ", "), fontsize=9)
        axes[1].set_title(f"{what}; light blue: depth unknown", fontsize=9)
        known = np.ma.masked_where(~valid, powers)
        shown = axes[1].imshow(known, interpolation="nearest", **look)
        bar = figure.colorbar(shown, ax=axes[1], label="levels", fraction=0.05)
        bar.set_ticks(range(len(labels)), labels=labels)
        style.without_ticks(axes, _UNKNOWN)
    return figure


def _most_uncovered(result: Result, join: ErrorJoin) -> list[PairResult]:
    records = {pair.pair: pair for pair in result.pairs if pair.pair in join.pairs}

    def weight(pair: Pair) -> tuple[float, float]:
        errors = join.pairs[pair]
        return errors.share(join.uncovered), errors.mean(np.ones(LEVELS, bool))

    best: dict[str, Pair] = {}
    for pair in sorted(records, key=weight, reverse=True):
        best.setdefault(pair.scene, pair)
    return [records[pair] for pair in list(best.values())[:_PANELS]]


def _percent(counts: Sequence[float]) -> NDArray[np.float64]:
    values = np.asarray(counts, np.float64)
    percent: NDArray[np.float64] = 100 * values / max(values.sum(), 1)
    return percent


def _steps(axis: Axes, counts: ArrayLike, label: str, colour: str, fill: bool = False) -> None:
    values = np.asarray(counts, np.float64)
    levels = np.arange(LEVELS)
    if fill:
        axis.fill_between(levels, values, step="mid", color=colour, alpha=0.5, label=label)
    else:
        axis.step(levels, values, where="mid", color=colour, linewidth=1.2, label=label)


def _label_ranges(axis: Axes, record: CoverageRecord) -> None:
    # Neighbouring levels of one verdict share a label; there is only room for the largest.
    marked = [None if verdict is Verdict.covered else verdict for verdict in record.verdicts]
    counts = np.asarray(record.test.counts)
    largest = sorted(runs(marked), key=lambda span: -counts[span[0] : span[1] + 1].sum())
    above: dict[str, Any] = {"xycoords": ("data", "axes fraction"), "textcoords": "offset points"}
    upright: dict[str, Any] = {"rotation": 90, "ha": "center", "va": "bottom", "fontsize": 8}
    for first, last in largest[:_LABELLED]:
        middle = ((first + last) / 2, 1.0)
        axis.annotate(range_text(first, last), middle, xytext=(0, 3), **above, **upright)


def _name(side: SideRecord) -> str:
    return f"{side.label}, {side.split}"


def depth_error_figure(
    title: str, found: Sequence[DepthErrors], scale: DepthScale | None
) -> Figure:
    """Draw runs' mean absolute error over true depth, and below it each run's answers.

    If given a scale, an axis at the top shows metres.
    """
    figure = Figure(figsize=(max(9.0, 3.6 * len(found)), 8), layout="constrained")
    figure.suptitle(style.plain_text(title))
    grid = figure.add_gridspec(2, len(found), height_ratios=(1.1, 1))
    there = np.flatnonzero(sum(one.levels.pixels for one in found))
    span = (float(there[0]) - 2, float(there[-1]) + 2)
    top = figure.add_subplot(grid[0, :])
    for number, one in enumerate(found):
        levels, means = _curve(one.levels)
        colour = style.COLOURS[number % len(style.COLOURS)]
        top.plot(levels, means, color=colour, label=style.plain_text(one.name))
    top.set(xlabel="true depth level", ylabel="mean absolute error (levels)", xlim=span)
    top.set_ylim(bottom=0)
    top.grid(alpha=0.3)
    style.legend_beside(top)
    if scale is not None:
        _metres_on_top(top, scale, span)
    for number, one in enumerate(found):
        axis = figure.add_subplot(grid[1, number])
        _draw_answers(axis, one, span)
        axis.set_title(style.plain_text(one.name), fontsize=10)
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
    # Divide by the total of each true depth: otherwise common depths would hide answers at rare
    # ones.
    side = LEVELS // _TOGETHER
    answers = one.answers.reshape(side, _TOGETHER, side, _TOGETHER).sum(axis=(1, 3))
    known = answers.sum(axis=1, keepdims=True)
    share = np.divide(answers, known, out=np.zeros(answers.shape), where=known > 0)
    ends = (-0.5, LEVELS - 0.5)
    look: dict[str, Any] = {"cmap": "gray_r", "vmin": 0, "vmax": 1, "interpolation": "nearest"}
    axis.imshow(np.sqrt(share).T, origin="lower", extent=(*ends, *ends), aspect="auto", **look)
    axis.plot(span, span, color=style.RED, linewidth=1)
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
