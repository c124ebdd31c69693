"""How sure a method is of a pixel: its own spread, calibrated by one factor.

The errors that a cost volume predicts are in the right order but of the wrong size: noise is not
the only error, and neighbours do not err independently. So we fit one factor on training captures,
with which nine truths in ten are within 1.645 standard deviations.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dfdbench.errors import MethodError
from dfdbench.methods.fitted import Array, evenly_spread, nothing_to_fit
from dfdbench.methods.method import Learned, TrainingPair
from dfdbench.metrics.sureness import REACH_90

#: How many captures a factor is fitted on, evenly among all, and how many pixels of each.
MOST_CAPTURES, _PIXELS = 16, 20_000
# The factor's name in what a fit returns.
_NAME = "spread"
_HELD = 0.9


@dataclass(frozen=True)
class Sureness:
    """Whether a method returns how sure it is, and the factor for its own spread.

    Parameters
    ----------
    asked : bool
        Whether it returns that.
    method : str
        The method's name, for errors.
    factor : float or None
        The fitted factor; None before the fit.
    """

    asked: bool
    method: str
    factor: float | None = None

    def require_factor(self) -> float:
        """Return the fitted factor.

        Raises
        ------
        MethodError
            If there is none.
        """
        if self.factor is None:
            what = "the method has seen no training captures, and cannot say how sure it is"
            fix = "fit it, or leave out sure=true"
            raise MethodError(what, where=f"{self.method}: sure", fix=fix)
        return self.factor

    def answer(self, depth: Array, raw: Any) -> Any:
        """Return depth or, if `asked`, depth and sigma, computed from the method's own spread.

        Parameters
        ----------
        depth, raw : ndarray of float32, shape (y, x)
            Depth, and the method's own spread, which is ignored unless `asked`.
        """
        return (depth, np.asarray(self.require_factor() * raw, np.float32)) if self.asked else depth

    def restored(self, learned: Learned) -> Sureness:
        """Take the factor out of what a fit learned; it is None if there is none."""
        found = learned.pop(_NAME, None)
        return replace(self, factor=None if found is None else float(found))

    def learned_on(
        self, answer: Callable[[TrainingPair], tuple[Array, Any]], captures: Sequence[TrainingPair]
    ) -> Learned:
        """Learn the factor on whole training captures, evenly among all.

        Parameters
        ----------
        answer : callable
            Returns a capture's depth levels and the method's own spread, shape (y, x).
        captures : sequence of TrainingPair
            Captures with depth.
        """

        def found(index: int) -> tuple[Array, Array]:
            # One capture at a time, as they may be large.
            capture = captures[index]
            depth, raw = answer(capture)
            known = capture.valid
            return np.abs(depth.astype(np.float64) - capture.levels)[known], raw[known]

        chosen = evenly_spread(len(captures), MOST_CAPTURES)
        return {_NAME: fit_spread(map(found, chosen), self.method)}


def fit_spread(found: Iterable[tuple[Array, Array]], method: str) -> float:
    """Fit the factor with which nine truths in ten are within 1.645 standard deviations.

    Parameters
    ----------
    found : iterable of (ndarray, ndarray)
        For each capture, the absolute errors of its known pixels and the method's own spread there,
        above 0. All captures count equally, whatever their size.
    method : str
        The method's name, for errors.

    Raises
    ------
    MethodError
        If no pixel is known.

    Examples
    --------
    >>> errors = np.arange(1, 1001) / 1000
    >>> round(1.645 * fit_spread([(errors, np.ones(1000))], "mine"), 2)
    0.9
    """
    ratios, weights = [], []
    for errors, raw in found:
        chosen = evenly_spread(errors.size, _PIXELS)
        if chosen:
            ratios.append(errors[chosen] / raw[chosen])
            weights.append(np.full(len(chosen), 1 / len(chosen)))
    if not ratios:
        raise nothing_to_fit(method, "training captures with known depth", "none")
    ratio, weight = np.concatenate(ratios), np.concatenate(weights)
    order = np.argsort(ratio, kind="stable")
    reached = np.cumsum(weight[order]) / len(ratios)
    place = min(int(np.searchsorted(reached, _HELD)), ratio.size - 1)
    # A method that is never wrong, as on synthetic images, still needs a number above 0.
    return max(float(ratio[order[place]]) / REACH_90, 1e-3)
