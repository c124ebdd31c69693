"""Look up what follows from a protocol's name: its metrics, what ranks, which data it scores.

What a protocol is, and all that there are, is `protocol.py`.
"""

from __future__ import annotations

from collections.abc import Mapping

from dfdbench.metrics.metric import IN_METRES, METRICS, RANKED_BY, TIES_BY, Metric
from dfdbench.metrics.protocol import RELEASED, Protocol


def protocols_of(in_metres: bool) -> dict[str, Protocol]:
    """Return the protocols that a run scores under, by label.

    Parameters
    ----------
    in_metres : bool
        Whether the data set says how levels become metres.

    Examples
    --------
    >>> list(protocols_of(False)), list(protocols_of(True))[3:]
    (['thesis', 'thesis-networks-2', 'valid'], ['metric', 'aligned'])
    """
    return {label: p for label, p in RELEASED.items() if in_metres or not p.metrics}


def metrics_of(label: str) -> Mapping[str, Metric]:
    """Return the metrics of a protocol by name, in the order in which they are shown.

    Examples
    --------
    >>> list(metrics_of("valid")), list(metrics_of("aligned"))[:2]
    (['nrmse', 'nmae', 'ssim'], ['abs_rel', 'delta_1'])
    """
    names = RELEASED[label].metrics if label in RELEASED else ()
    return {name: IN_METRES[name] for name in names} if names else METRICS


def ranked_by(label: str) -> tuple[str, str]:
    """Return the metrics that pairs and methods are ranked by, and by where the first ties.

    Examples
    --------
    >>> ranked_by("thesis"), ranked_by("metric"), ranked_by("aligned")
    (('nrmse', 'nmae'), ('abs_rel', 'rmse_m'), ('abs_rel', 'abs_rel'))
    """
    smaller = [name for name, metric in metrics_of(label).items() if not metric.larger_is_better]
    return (RANKED_BY, TIES_BY) if RANKED_BY in smaller else (smaller[0], smaller[-1])
