"""Figures of the scores by exposure, by geometry, by texture: one for each of a run's tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dfdbench.datasets.manifest import Scene
from dfdbench.figures.style import COLOURS, MARKERS, legend_below, plain_text
from dfdbench.metrics.metric import mean_of
from dfdbench.metrics.protocol import metrics_of, title_of
from dfdbench.results.record import PairResult, Result
from dfdbench.results.summary import scene_labels


def group_figures(
    results: Mapping[str, Result], protocol: str, scenes: Sequence[Scene]
) -> dict[str, Figure]:
    """Draw each metric by exposure, geometry and texture, as the thesis parts Figs 7.2 to 7.17.

    Parameters
    ----------
    results : mapping of str to Result
        Runs on the same data, by what they are called.
    protocol : str
        Under which protocol.
    scenes : sequence of Scene
        Of the manifest; where they have neither geometry nor texture, nothing is drawn.

    Returns
    -------
    dict of str to Figure
        By what parts the pairs.
    """
    labels = scene_labels(scenes)
    if not labels or not any(p.status == "ok" for r in results.values() for p in r.pairs):
        return {}
    blocks = next(iter(results.values())).dataset.blocks
    figures = {blocks: _figure(results, protocol, blocks, None)}
    return figures | {
        what: _figure(results, protocol, what, label_of) for what, label_of in labels.items()
    }


def _figure(
    results: Mapping[str, Result], protocol: str, what: str, label_of: Mapping[str, str] | None
) -> Figure:
    def label(pair: PairResult) -> str | None:
        return label_of.get(pair.scene) if label_of else str(pair.coordinates[what])

    found = [pair for result in results.values() for pair in result.pairs if pair.status == "ok"]
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
            rows = {
                place + offset: by_label[group]
                for place, group in enumerate(labels)
                if group in by_label
            }
            _draw_run(axis, rows, number, plain_text(name))
        axis.set_xlabel(metric.axis_label)
        axis.locator_params(axis="x", nbins=4)
        axis.grid(axis="x", alpha=0.3)
    grid[0].set_yticks(range(len(labels)), labels)
    grid[0].set_ylim(len(labels) - 0.5, -0.5)
    grid[0].set_ylabel(what)
    first = next(iter(results.values()))
    whose = "" if several else f"{plain_text(next(iter(results)))} on "
    figure.suptitle(
        f"{whose}{first.dataset.label}, split {first.dataset.split}, "
        f"protocol {title_of(protocol)}: mean and standard deviation; a dot is a pair",
        fontsize=10,
    )
    if several:
        legend_below(figure, grid[0])
    return figure


def _by_label(
    result: Result, protocol: str, metric: str, label: Callable[[PairResult], str | None]
) -> dict[str, list[float]]:
    found: dict[str, list[float]] = {}
    for pair in result.pairs:
        name = label(pair)
        if pair.status != "ok" or name is None:
            continue
        if (score := pair.score(protocol, metric)) is not None:
            found.setdefault(name, []).append(score)
    return found


def _draw_run(axis: Axes, rows: Mapping[float, Sequence[float]], number: int, name: str) -> None:
    colour = COLOURS[number % len(COLOURS)]
    for at, values in rows.items():
        axis.plot(
            values,
            [at] * len(values),
            linestyle="none",
            marker=".",
            color=colour,
            alpha=0.35,
            markeredgewidth=0,
        )
        axis.errorbar(
            mean_of(values) or 0.0,
            at,
            xerr=np.std(values, ddof=1) if len(values) > 1 else 0.0,
            marker=MARKERS[number % len(MARKERS)],
            markersize=5,
            color=colour,
            capsize=2,
            linewidth=1,
            label=name,
        )
        name = "_"  # one entry of the legend a run
