"""Figures of the scores by exposure, by geometry, by texture: one for each of a run's tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from dfdbench.datasets.manifest import Scene
from dfdbench.figures.style import COLOURS, MARKERS, legend_below, plain_text
from dfdbench.metrics.protocol import METRICS, title_of
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
    figure = Figure(figsize=(9, height), layout="constrained")
    grid = figure.subplots(1, len(METRICS), sharey=True)
    for axis, (metric, up) in zip(grid, METRICS.items(), strict=True):
        for number, (name, result) in enumerate(results.items()):
            colour = COLOURS[number % len(COLOURS)]
            offset = (number - (len(results) - 1) / 2) * 0.7 / len(results)
            named = plain_text(name)
            for place, group in enumerate(labels):
                values = [
                    score
                    for pair in result.pairs
                    if pair.status == "ok"
                    and label(pair) == group
                    and (score := getattr(pair.scores[protocol], metric)) is not None
                ]
                if not values:
                    continue
                at = place + offset
                axis.plot(
                    values,
                    [at] * len(values),
                    linestyle="none",
                    marker=".",
                    color=colour,
                    alpha=0.35,
                    markeredgewidth=0,
                )
                spread = np.std(values, ddof=1) if len(values) > 1 else 0.0
                axis.errorbar(
                    np.mean(values),
                    at,
                    xerr=spread,
                    marker=MARKERS[number % len(MARKERS)],
                    markersize=5,
                    color=colour,
                    capsize=2,
                    linewidth=1,
                    label=named,
                )
                named = "_"  # one entry of the legend a run
        axis.set_xlabel(f"{metric.upper()} ({'higher' if up else 'lower'} is better)")
        axis.locator_params(axis="x", nbins=4)
        axis.grid(axis="x", alpha=0.3)
    grid[0].set_yticks(range(len(labels)), labels)
    grid[0].set_ylim(len(labels) - 0.5, -0.5)
    grid[0].set_ylabel(what)
    first = next(iter(results.values()))
    whose = "" if several else f"{plain_text(next(iter(results)))} on "
    figure.suptitle(
        f"{whose}{first.dataset.name}, split {first.dataset.split}, protocol {title_of(protocol)}: "
        "mean and standard deviation; a dot is a pair",
        fontsize=10,
    )
    if several:
        legend_below(figure, grid[0])
    return figure
