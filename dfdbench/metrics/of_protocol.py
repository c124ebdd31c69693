"""Which metrics a protocol scores by, and which of them rank."""

from __future__ import annotations

from collections.abc import Mapping

from dfdbench.metrics.metric import IN_METRES, METRICS, RANKED_BY, TIES_BY, Metric
from dfdbench.metrics.protocol import RELEASED


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
