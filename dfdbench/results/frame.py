"""A result's pairs as a pandas table, one row per pair."""

from __future__ import annotations

import pandas as pd

from dfdbench.metrics.protocol import metrics_of, require_scored
from dfdbench.results.first_table import shown_protocol
from dfdbench.results.record import Result


def frame_of(result: Result, protocol: str | None = None) -> pd.DataFrame:
    """Return a result's pairs as a table; this is `Result.to_frame`.

    Parameters
    ----------
    result : Result
        The run.
    protocol : str, optional
        Whose scores; default: the one that the data set's tables show first.

    Returns
    -------
    DataFrame
        One row per pair, by ``pair``, its name: ``scene``, the axes, ``status``, each metric and
        ``seconds``; NaN where there is none.

    Raises
    ------
    UnknownNameError
        Where the result was not scored under that protocol.
    """
    shown = protocol or shown_protocol(result)
    require_scored(shown, result.protocol_names, f"{result.method.name}'s result")
    metrics = tuple(metrics_of(shown))
    rows = [
        {
            "pair": pair.id,
            "scene": pair.scene,
            **{axis: pair.coordinates[axis] for axis in result.dataset.axes},
            "status": pair.status,
            **{name: pair.score(shown, name) if pair.scores else None for name in metrics},
            "seconds": pair.seconds,
        }
        for pair in result.pairs
    ]
    frame = pd.DataFrame(rows).set_index("pair")
    return frame.astype(dict.fromkeys((*metrics, "seconds"), float))
