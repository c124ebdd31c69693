"""How sure a method is of a pixel: its own spread, made honest by one factor.

What a cost volume says of its own errors is in the right order but not of the right size: noise is
not all that is wrong, and neighbours do not err independently. So one number is fitted on training
captures, by which nine truths in ten lie within 1.645 standard deviations.
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

#: Captures that a factor is fitted on, evenly among all, and pixels of each.
MOST_CAPTURES, _PIXELS = 16, 20_000
# What a fit returns it as.
_NAME = "spread"
_HELD = 0.9


@dataclass(frozen=True)
class Sureness:
    """Whether a method is to say how sure it is, and by what factor of its own spread.

    Parameters
    ----------
    asked : bool
        Whether it is.
    method : str
        Its name, for errors.
    factor : float or None
        What a fit found; None before.
    """

    asked: bool
    method: str
    factor: float | None = None

    def require_factor(self) -> float:
        """Return the factor that was fitted.

        Raises
        ------
        MethodError
            If none was.
        """
        if self.factor is None:
            what = "the method has seen no training captures, and cannot say how sure it is"
            fix = "fit it, or leave out sure=true"
            raise MethodError(what, where=f"{self.method}: sure", fix=fix)
        return self.factor

    def answer(self, depth: Array, raw: Any) -> Any:
        """Return depth; and, if it is asked for, sigma, which follows from the method's own spread.

        Parameters
        ----------
        depth, raw : ndarray of float32, shape (y, x)
            `raw` does not matter if nothing is asked for.
        """
        return (depth, np.asarray(self.require_factor() * raw, np.float32)) if self.asked else depth

    def restored(self, learned: Learned) -> Sureness:
        """Take the factor out of what a fit learned; None without it."""
        found = learned.pop(_NAME, None)
        return replace(self, factor=None if found is None else float(found))

    def learned_on(
        self, answer: Callable[[TrainingPair], tuple[Array, Any]], captures: Sequence[TrainingPair]
    ) -> Learned:
        """Learn the factor on whole training captures, evenly among all.

        Parameters
        ----------
        answer : callable
            Gives the depth levels of a capture, and the method's own spread; shape (y, x).
        captures : sequence of TrainingPair
            With depth.
        """

        def found(index: int) -> tuple[Array, Array]:
            # One capture after the other: they may be large.
            capture = captures[index]
            depth, raw = answer(capture)
            known = capture.valid
            return np.abs(depth.astype(np.float64) - capture.levels)[known], raw[known]

        chosen = evenly_spread(len(captures), MOST_CAPTURES)
        return {_NAME: fit_spread(map(found, chosen), self.method)}


def fit_spread(found: Iterable[tuple[Array, Array]], method: str) -> float:
    """Fit the factor by which nine truths in ten lie within 1.645 standard deviations.

    Parameters
    ----------
    found : iterable of (ndarray, ndarray)
        Of each capture the absolute errors of its known pixels, and the method's own spread there,
        above 0. A capture counts as much as another, whatever its size.
    method : str
        Its name, for errors.

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
    # A method that is never wrong, as on made images, still has to name a number above 0.
    return max(float(ratio[order[place]]) / REACH_90, 1e-3)
