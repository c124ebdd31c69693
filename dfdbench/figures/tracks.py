"""The figure over tracks: how a metric grows with severity."""

from __future__ import annotations

from collections.abc import Mapping

import pandas as pd
from matplotlib.figure import Figure

from dfdbench.blur.tracks import CLEAN
from dfdbench.figures.style import COLOURS, MARKERS, plain_text
from dfdbench.metrics.metric import find_metric

_COLUMNS = 4
_WIDTH, _HEIGHT = 2.7, 2.4
# Where colours and marks begin anew.
_LINES = ("-", "--", ":")


def tracks_figure(scores: Mapping[str, pd.DataFrame], metric: str, title: str) -> Figure:
    """Draw a metric against severity, a panel a track, a line a method.

    Parameters
    ----------
    scores : mapping of str to DataFrame
        By method: a row a track, a column a severity, 0 for clean images; see
        `dfdbench.results.track_tables.track_means`.
    metric : str
        Which.
    title : str
        Above all panels.
    """
    tracks = list(dict.fromkeys(track for means in scores.values() for track in means.index))
    rows = -(-len(tracks) // _COLUMNS)
    columns = min(_COLUMNS, len(tracks))
    figure = Figure((_WIDTH * columns, _HEIGHT * rows + 0.5), layout="constrained")
    axes = figure.subplots(rows, columns, sharey=True, squeeze=False)
    for axis in axes.flat[len(tracks) :]:
        axis.set_axis_off()
    for track, axis in zip(tracks, axes.flat, strict=False):
        longest = 0
        for number, (method, means) in enumerate(scores.items()):
            values = means.loc[track].tolist() if track in means.index else []
            longest = max(longest, len(values))
            axis.plot(
                range(len(values)),
                values,
                color=COLOURS[number % len(COLOURS)],
                marker=MARKERS[number % len(MARKERS)],
                linestyle=_LINES[number // len(COLOURS) % len(_LINES)],
                label=plain_text(method),
            )
        axis.set_title(track, fontsize=10)
        axis.set_xlabel("severity")
        axis.set_xticks(range(longest), [CLEAN, *map(str, range(1, longest))])
        axis.grid(alpha=0.3)
    for axis in axes[:, 0]:
        axis.set_ylabel(find_metric(metric).heading)
    # The axis is shared: before the last panel is drawn nobody knows how high it reaches.
    axes.flat[0].set_ylim(bottom=0)
    figure.suptitle(plain_text(title), fontsize=11)
    if len(scores) > 1:
        handles, labels = axes.flat[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return figure
