"""What a metric is, and all that there are, each defined here once.

Tables, figures and checks loop over `dfdbench.metrics.protocol.metrics_of` a protocol.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from math import fsum
from types import MappingProxyType

from dfdbench.metrics.metres import abs_rel, boundary_f1, rmse_metres, share_within
from dfdbench.metrics.scores import nmae, nrmse, ssim


@dataclass(frozen=True)
class Metric:
    """A metric, as protocols score it, results keep it and tables show it.

    Parameters
    ----------
    name : str
        As results and protocols have it.
    larger_is_better : bool
        Its direction.
    function : callable
        Called with ground truth and estimate in depth levels, shape (y, x), with `data_range`
        and with `mask`, true where a pixel counts, or None; gives the score, NaN where it is
        undefined. One of metres is called with distances, and without `data_range`.
    lowest, highest : float
        What it may be; a result that says otherwise is refused.
    data_range : float, optional
        What the function is handed as such; if not given, the protocol's divisor.
    younger : bool
        Whether there are results from before the metric. They lack it, and that is no mistake:
        it was not scored. Of every other metric a result has a score, null where undefined.
    shown : str
        What text calls it; if not given, its name in capitals.

    Examples
    --------
    >>> METRICS["nrmse"].heading, METRICS["ssim"].heading
    ('NRMSE ↓', 'SSIM ↑')
    >>> METRICS["ssim"].axis_label
    'SSIM (higher is better)'
    """

    name: str
    larger_is_better: bool
    function: Callable[..., float]
    lowest: float
    highest: float
    data_range: float | None = None
    younger: bool = False
    shown: str = ""

    @property
    def title(self) -> str:
        """What text calls it."""
        return self.shown or self.name.upper()

    @property
    def heading(self) -> str:
        """What heads its column: its title, and which way is better."""
        return f"{self.title} {'↑' if self.larger_is_better else '↓'}"

    @property
    def axis_label(self) -> str:
        """What a figure's axis is called."""
        return f"{self.title} ({'higher' if self.larger_is_better else 'lower'} is better)"


# Levels are at most 255 apart, and what divides them is 255 or a range of at least one level.
_METRICS = {
    metric.name: metric
    for metric in (
        Metric("nrmse", False, nrmse, 0, 255),
        Metric("nmae", False, nmae, 0, 255),
        Metric("ssim", True, ssim, -1, 1, data_range=255.0),
    )
}
# Far above any distance that a camera sees; sums of such numbers stay finite.
_FAR = 1e9
_IN_METRES = {
    metric.name: metric
    for metric in (
        Metric("abs_rel", False, abs_rel, 0, _FAR, shown="AbsRel"),
        Metric("rmse_m", False, rmse_metres, 0, _FAR, shown="RMSE (m)"),
        Metric("delta_105", True, partial(share_within, factor=1.05), 0, 1, shown="δ < 1.05"),
        Metric("delta_115", True, partial(share_within, factor=1.15), 0, 1, shown="δ < 1.15"),
        Metric("delta_125", True, share_within, 0, 1, shown="δ < 1.25"),
        Metric("boundary_f1", True, boundary_f1, 0, 1, shown="boundary F1"),
    )
}
#: Every metric of depth levels by name, in the order in which they are shown.
METRICS: Mapping[str, Metric] = MappingProxyType(_METRICS)
#: Every metric of distances, scored where a manifest says how levels become metres.
IN_METRES: Mapping[str, Metric] = MappingProxyType(_IN_METRES)
#: What pairs and methods are ranked by, and what by where that ties: as the thesis ranks.
RANKED_BY, TIES_BY = "nrmse", "nmae"


def find_metric(name: str) -> Metric:
    """Return a metric of either kind by its name.

    Examples
    --------
    >>> find_metric("nmae").heading, find_metric("delta_125").heading
    ('NMAE ↓', 'δ < 1.25 ↑')
    """
    return METRICS[name] if name in METRICS else IN_METRES[name]


def mean_of(scores: Iterable[float | None]) -> float | None:
    """Return the mean of the scores that are defined; None if there are none.

    It does not depend on their order, so that it is the same wherever it is taken.

    Examples
    --------
    >>> mean_of([0.1, None, 0.3]), mean_of([None])
    (0.2, None)
    """
    defined = [score for score in scores if score is not None]
    return fsum(defined) / len(defined) if defined else None
