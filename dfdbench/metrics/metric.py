"""What a metric is, and the definitions of all metrics.

Tables, figures and checks loop over a protocol's metrics: `dfdbench.metrics.protocol.metrics_of`.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from math import fsum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dfdbench.errors import InputError
from dfdbench.metrics.scores import checked, nmae, nrmse, ssim
from dfdbench.metrics.sureness import ause, density, surest_nrmse, within_interval

#: The thresholds of `boundary_f1`: first, last, number.
EDGES = (1.05, 1.25, 10)
_EXPECTED = "metres above 0"
Floats = NDArray[np.float64]


def abs_rel(truth: ArrayLike, estimate: ArrayLike, *, mask: ArrayLike | None = None) -> float:
    """Return the mean absolute relative error; smaller is better.

    Parameters
    ----------
    truth, estimate : array_like of real numbers, shape (y, x)
        Distances in metres, above 0.
    mask : array_like of bool, shape (y, x), optional
        True where a pixel counts. By default all do.

    Returns
    -------
    float
        NaN if no pixel counts.

    Raises
    ------
    InputError
        If shapes differ, or values are complex, non-finite or not above 0.

    Notes
    -----
    ``mean(|z - z*| / z*)`` with the ground truth z*; Eigen, Puhrsch and Fergus, Depth map
    prediction from a single image using a multi-scale deep network, NeurIPS 2014.

    Examples
    --------
    >>> abs_rel([[1.0, 2.0]], [[1.5, 2.0]])
    0.25
    """
    true, test = _distances(truth, estimate, mask)
    return float(np.mean(np.abs(test - true) / true)) if true.size else math.nan


def rmse_metres(truth: ArrayLike, estimate: ArrayLike, *, mask: ArrayLike | None = None) -> float:
    """Return the root mean square error in metres; smaller is better.

    Parameters, errors and the undefined case are those of `abs_rel`.

    Notes
    -----
    ``sqrt(mean((z - z*)^2))``, RMSE (linear) of Eigen et al. 2014.

    Examples
    --------
    >>> rmse_metres([[1.0, 2.0]], [[4.0, 6.0]]) == 12.5**0.5
    True
    """
    true, test = _distances(truth, estimate, mask)
    return float(np.sqrt(np.mean((test - true) ** 2))) if true.size else math.nan


def share_within(
    truth: ArrayLike, estimate: ArrayLike, *, mask: ArrayLike | None = None, factor: float = 1.25
) -> float:
    """Return the share of pixels that are off by less than a factor; larger is better.

    Parameters, errors and the undefined case are those of `abs_rel`; `factor` is above 1.

    Notes
    -----
    The share with ``max(z / z*, z* / z) < factor``, called delta; Eigen et al. 2014 with factors
    1.25, 1.25^2 and 1.25^3.

    Examples
    --------
    >>> share_within([[1.0, 1.0, 1.0, 1.0]], [[1.0, 1.25, 0.9, 0.8]])
    0.5
    """
    true, test = _distances(truth, estimate, mask)
    return float(np.mean(np.maximum(test / true, true / test) < factor)) if true.size else math.nan


def boundary_f1(truth: ArrayLike, estimate: ArrayLike, *, mask: ArrayLike | None = None) -> float:
    """Return how well the estimate finds depth edges, 0 to 1; larger is better.

    Parameters and errors are those of `abs_rel`.

    Returns
    -------
    float
        NaN if the truth has no edge.

    Notes
    -----
    Neighbours p and q form an edge at threshold t if ``d_p / d_q > t``. Precision and recall count
    the edges in all four directions between pixels of known depth. F1 is averaged over ten
    thresholds from 1.05 to 1.25, weighted by the threshold: the scale-invariant boundary F1 of
    Bochkovskii et al., Depth Pro, 2024.

    Examples
    --------
    >>> step = np.array([[1.0, 1.0, 2.0, 2.0]])
    >>> boundary_f1(step, 3 * step), boundary_f1(step, np.ones((1, 4)))
    (1.0, 0.0)
    """
    true, test, counts = checked(truth, estimate, mask)
    _distances(true, test, counts)
    ours, theirs = (_log_steps(depth, counts) for depth in (true, test))
    scores, weights = [], np.linspace(*EDGES)
    for least in np.log(weights):
        edges, answered = ours > least, theirs > least
        hits = 2 * np.count_nonzero(edges & answered)
        all_of_both = np.count_nonzero(edges) + np.count_nonzero(answered)
        scores.append(hits / all_of_both if edges.any() else math.nan)
    told = np.isfinite(scores)
    if not told.any():
        return math.nan
    return float(np.average(np.array(scores)[told], weights=weights[told]))


def _log_steps(depth: Floats, counts: NDArray[np.bool_]) -> Floats:
    """Return the steps in log depth between neighbours that count, in all four directions."""
    with np.errstate(divide="ignore", invalid="ignore"):
        log = np.log(depth)
        down = np.diff(log, axis=0)[counts[1:] & counts[:-1]]
        right = np.diff(log, axis=1)[counts[:, 1:] & counts[:, :-1]]
    return np.concatenate([down, right, -down, -right])


def aligned(
    truth: ArrayLike, estimate: ArrayLike, farthest: float, mask: ArrayLike | None = None
) -> Floats:
    """Scale and shift an estimate in inverse depth to fit the ground truth best.

    Parameters
    ----------
    truth, estimate : array_like of real numbers, shape (y, x)
        Distances in metres, above 0.
    farthest : float
        The farthest distance there is, in metres; the result is capped at it.
    mask : array_like of bool, shape (y, x), optional
        True where a pixel counts for the fit.

    Returns
    -------
    ndarray of float64, shape (y, x)
        Distances in metres. The estimate itself if no pixel counts.

    Raises
    ------
    InputError
        As for `abs_rel`, and if `farthest` is not a distance.

    Notes
    -----
    ``(s, t) = argmin sum (s / z + t - 1 / z*)^2`` over the pixels that count; Ranftl et al.,
    Towards robust monocular depth estimation, PAMI 2020, who align so in training and evaluation.
    The shift may push inverse depth to zero or below, which is no distance. Values below
    ``1 / farthest`` are therefore set to it; their evaluation caps depth in the same way. A flat
    estimate has no scale: it becomes the mean of the inverse truth. The fit is unconstrained, so
    the scale may be negative.

    Examples
    --------
    >>> truth = np.array([[1.0, 2.0, 4.0]])
    >>> aligned(truth, 1 / (3 / truth + 0.5), 10.0).round(6).tolist()
    [[1.0, 2.0, 4.0]]
    """
    if not (math.isfinite(farthest) and farthest > 0):
        raise InputError("no distance", where="farthest", expected=_EXPECTED, got=str(farthest))
    true, test = _distances(truth, estimate, mask)
    whole = np.asarray(estimate, np.float64)
    if not true.size:
        return whole
    goal, given = 1 / true, 1 / test
    off = given - given.mean()
    spread = float(off @ off)
    # A map that is flat except for rounding has no scale either.
    flat = spread <= given.size * (1e-9 * float(given.mean())) ** 2
    scale = 0.0 if flat else float(off @ (goal - goal.mean())) / spread
    inverse = scale * (1 / whole - given.mean()) + goal.mean()
    return np.asarray(1 / np.maximum(inverse, 1 / farthest))


def _distances(
    truth: ArrayLike, estimate: ArrayLike, mask: ArrayLike | None
) -> tuple[Floats, Floats]:
    """Return the true and the estimated distances of the pixels that count, shape (pixel,)."""
    true, test, counts = checked(truth, estimate, mask)
    true, test = true[counts], test[counts]
    for name, distances in (("truth", true), ("estimate", test)):
        if not (distances > 0).all():
            got = f"{distances.min():g}"
            raise InputError("no distance", where=name, expected=_EXPECTED, got=got)
    return true, test


@dataclass(frozen=True)
class Metric:
    """A metric that protocols score, results keep and tables show.

    Parameters
    ----------
    name : str
        The name in results and protocols.
    larger_is_better : bool
        Its direction.
    function : callable
        Called with ground truth and estimate in depth levels, shape (y, x), with `data_range`
        and with `mask`, True where a pixel counts, or None; returns the score, NaN if undefined.
        A metric in metres gets distances and no `data_range`. A metric of sureness gets the
        `dfdbench.metrics.sureness.squared_errors` and no `mask`.
    lowest, highest : float
        The limits of the score; a result outside them is refused.
    data_range : float, optional
        The function's `data_range`; by default the protocol's divisor.
    younger : bool
        Whether some results are older than the metric. They may lack it, because it was not
        scored. A result must have every other metric, null where undefined.
    shown : str
        The name in text; by default `name` in capitals.
    best : float, optional
        The best score, if neither smaller nor larger is better.

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
    best: float | None = None

    @property
    def title(self) -> str:
        """The name in text."""
        return self.shown or self.name.upper()

    @property
    def heading(self) -> str:
        """The column heading: the title, and an arrow for which way is better."""
        way = "↑" if self.larger_is_better else "↓"
        return f"{self.title} {way if self.best is None else f'→ {self.best:g}'}"

    @property
    def axis_label(self) -> str:
        """The label of a figure's axis."""
        if self.best is not None:
            return f"{self.title} (best at {self.best:g})"
        return f"{self.title} ({'higher' if self.larger_is_better else 'lower'} is better)"

    def compared(self, score: float) -> float:
        """Return the value to compare: the score, or its distance from `best` if there is one.

        Examples
        --------
        >>> METRICS["ssim"].compared(0.8), round(SURENESS["within_90"].compared(0.8), 6)
        (0.8, 0.1)
        """
        return score if self.best is None else abs(score - self.best)


def _by_name(*metrics: Metric) -> Mapping[str, Metric]:
    return {metric.name: metric for metric in metrics}


# Levels differ by at most 255, and the divisor is 255 or a range of at least one level.
#: Every metric of depth levels by name, in the order in which they are shown.
METRICS = _by_name(
    Metric("nrmse", False, nrmse, 0, 255),
    Metric("nmae", False, nmae, 0, 255),
    Metric("ssim", True, ssim, -1, 1, data_range=255.0),
)
# Far above any distance that a camera sees, but sums of such numbers stay finite.
_FAR = 1e9
#: Every metric of distances, scored if the manifest says how levels become metres.
IN_METRES = _by_name(
    Metric("abs_rel", False, abs_rel, 0, _FAR, shown="AbsRel"),
    Metric("rmse_m", False, rmse_metres, 0, _FAR, shown="RMSE (m)"),
    Metric("delta_105", True, partial(share_within, factor=1.05), 0, 1, shown="δ < 1.05"),
    Metric("delta_115", True, partial(share_within, factor=1.15), 0, 1, shown="δ < 1.15"),
    Metric("delta_125", True, share_within, 0, 1, shown="δ < 1.25"),
    Metric("boundary_f1", True, boundary_f1, 0, 1, shown="boundary F1"),
)
#: Every metric of sureness, scored if a method says how sure it is or leaves pixels out.
SURENESS = _by_name(
    Metric("density", True, density, 0, 1, shown="density"),
    Metric("nrmse_50", False, partial(surest_nrmse, share=0.5), 0, 255, shown="surest 50 %"),
    Metric("nrmse_90", False, partial(surest_nrmse, share=0.9), 0, 255, shown="surest 90 %"),
    Metric("ause", False, ause, 0, 255),
    Metric("within_90", False, within_interval, 0, 1, shown="in 90 % intervals", best=0.9),
)
#: The metric that pairs and methods are ranked by, and the one that breaks ties, as in the thesis.
RANKED_BY, TIES_BY = "nrmse", "nmae"


def find_metric(name: str) -> Metric:
    """Return a metric of any kind by its name.

    Examples
    --------
    >>> find_metric("nmae").heading, find_metric("delta_125").heading
    ('NMAE ↓', 'δ < 1.25 ↑')
    """
    return next(kind[name] for kind in (METRICS, IN_METRES, SURENESS) if name in kind)


def mean_of(scores: Iterable[float | None]) -> float | None:
    """Return the mean of the scores that are defined; None if there are none.

    The order of the scores does not matter, so the mean is the same wherever it is computed.

    Examples
    --------
    >>> mean_of([0.1, None, 0.3]), mean_of([None])
    (0.2, None)
    """
    defined = [score for score in scores if score is not None]
    return fsum(defined) / len(defined) if defined else None
