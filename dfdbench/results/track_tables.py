"""A method's scores over tracks and their severities, as one table."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from dfdbench.blur.tracks import CLEAN, TRACKS
from dfdbench.metrics.protocol import metrics_of, ranked_by, title_of
from dfdbench.results.frame import mean_scores, scores_of
from dfdbench.results.record import Result
from dfdbench.results.told import told
from dfdbench.results.wording import method_label, score_text
from dfdbench.tables.table import Table


def track_means(scores: pd.DataFrame, protocol: str, metric: str) -> pd.DataFrame:
    """Return a method's means: a row a track, a column a severity, 0 for clean images.

    Parameters
    ----------
    scores : DataFrame
        Of one method on one split, from `dfdbench.results.frame.scores_of`.
    protocol, metric : str
        Which scores; NaN if a run is incomplete or lacking.
    """
    own = scores[(scores["protocol"] == protocol) & (scores["metric"] == metric)]
    means = mean_scores(own, "track", "severity")
    names = means.index.get_level_values("track")
    tracks = [name for name in dict.fromkeys(names) if name != CLEAN]
    most = max((len(TRACKS[name].severities) for name in tracks), default=0)
    table = means.unstack("severity").reindex(index=tracks, columns=range(most + 1))
    table[0] = means.get((CLEAN, 0), np.nan)
    return table


def tracks_table(results: Sequence[Result], protocol: str) -> Table:
    """Return a row a track: the score on clean images, at each severity, and their mean.

    The mean is over severities, clean left out; without all of them there is none.

    Parameters
    ----------
    results : sequence of Result
        Runs of one method on one split, on clean images and on tracks.
    protocol : str
        Under which protocol.
    """
    metrics, first_by = metrics_of(protocol), ranked_by(protocol)[0]
    scores = scores_of(results)
    by_metric = {}
    for name in metrics:
        means = track_means(scores, protocol, name)
        by_metric[name] = means.assign(mean=means.drop(columns=0).mean(axis=1, skipna=False))
    shown = by_metric[first_by]
    rows = tuple((str(track), *map(_shown, values)) for track, values in shown.iterrows())
    records = tuple(
        {
            "track": track,
            **{
                f"{name} {CLEAN if column == 0 else column}": None if np.isnan(value) else value
                for name, means in by_metric.items()
                for column, value in means.loc[track].items()
            },
        }
        for track in shown.index
    )
    dataset, method = results[0].dataset, results[0].method
    return Table(
        f"{method_label(method)} on the tracks of {dataset.name.partition('@')[0]}, "
        f"split {dataset.split}, protocol {title_of(protocol)}: {metrics[first_by].heading}",
        ("track", CLEAN, *map(str, shown.columns[1:-1]), "mean of severities"),
        rows,
        "l" + "r" * len(shown.columns),
        tuple(_notes(results)),
        records=records,
    )


def _shown(value: float) -> str:
    return score_text(None if np.isnan(value) else value)


def _notes(results: Sequence[Result]) -> list[str]:
    notes = [f"{CLEAN}: {told(run)}" for run in results if run.dataset.degradation == CLEAN]
    tracked = {told(run) for run in results if run.dataset.degradation != CLEAN}
    notes.append(f"on tracks: {'; '.join(sorted(tracked))}")
    for run in results:
        if not run.complete:
            data = run.dataset
            notes.append(
                f"{data.degradation}: {data.evaluated} of {data.expected} pairs, no average"
            )
    return notes
