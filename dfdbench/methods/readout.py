"""How to read an answer from a volume of costs, and what a fit chose for that."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.recipe import LEVELS
from dfdbench.methods.method import Learned

Array = NDArray[Any]


def least_label(costs: NDArray[Any]) -> NDArray[np.float64]:
    """Return each pixel's label of least cost, refined to a fraction of a label.

    The fraction is the minimum of a parabola through the least cost and its two neighbours. The
    first and the last label stay whole, and so does a label whose neighbours cost the same.

    Parameters
    ----------
    costs : ndarray, shape (label, y, x)
        Of any real type.

    Returns
    -------
    ndarray of float64, shape (y, x)
        0 to the number of labels minus one.

    Examples
    --------
    >>> least_label(np.array([9, 1, 3, 9]).reshape(4, 1, 1)).tolist()
    [[1.3]]
    """
    labels = costs.argmin(axis=0)
    inner = np.clip(labels, 1, max(len(costs) - 2, 1))
    if len(costs) < 3:
        return np.asarray(labels, np.float64)
    before, least, after = (
        np.take_along_axis(costs, (inner + step)[np.newaxis], 0)[0].astype(np.float64)
        for step in (-1, 0, 1)
    )
    bend = before - 2 * least + after
    fits = (labels == inner) & (bend > 0)
    fraction = np.divide(before - after, 2 * bend, out=np.zeros(bend.shape), where=fits)
    return np.asarray(labels + fraction)


def read_out(costs: Array, sharpness: float) -> NDArray[np.float64]:
    """Return each pixel's label from costs in nats, shape (label, y, x).

    Parameters
    ----------
    costs : ndarray
        Costs including the prior's.
    sharpness : float
        See `Chosen`.

    Examples
    --------
    >>> costs = np.array([0.0, 0.1, 0.2, 5.0]).reshape(4, 1, 1)
    >>> read_out(costs, 0).tolist(), read_out(costs, 1).round(2).tolist()
    ([[0.0]], [[0.9]])
    """
    if not sharpness:
        return least_label(costs)
    least = costs.min(axis=0)
    total = np.zeros(least.shape)
    sums = np.empty(costs.shape, np.float32)
    for label, cost in enumerate(costs):
        total += np.exp(-sharpness * (cost - least))
        sums[label] = total
    half = total / 2
    label = (sums < half).sum(axis=0)
    after = np.take_along_axis(sums, label[np.newaxis], 0)[0]
    before = np.take_along_axis(sums, np.maximum(label - 1, 0)[np.newaxis], 0)[0]
    before = np.where(label > 0, before, 0)
    # Spread each label's share evenly over half a label to either side.
    part = np.divide(
        half - before, after - before, out=np.full(half.shape, 0.5), where=after > before
    )
    return np.asarray(np.clip(label + part - 0.5, 0, len(costs) - 1))


def rescaled(
    depth: NDArray[np.float32],
    deviation: NDArray[np.float32],
    scale: NDArray[np.float64],
    other: NDArray[np.float64],
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return depth and its standard deviation by another scale, by its mean slope about the depth.

    Parameters
    ----------
    depth, deviation : ndarray of float32, shape (y, x)
        By `scale`.
    scale, other : ndarray of float64, shape (level,)
        What both scales have for the same depths, rising or falling; beyond the ends is the end.

    Examples
    --------
    >>> near, far = np.float32([[1]]), np.float32([[0.5]])
    >>> [each.tolist() for each in rescaled(near, far, np.arange(3.0), np.arange(0, -30, -10.0))]
    [[[-10.0]], [[5.0]]]
    """
    if scale is other:
        return depth, deviation
    turn = np.sign(scale[-1] - scale[0])
    # Where depths beyond an end are the end, only the innermost of them says how steep it is.
    rises = np.diff(turn * scale) > 0
    inner = np.append(rises, False) | np.append(False, rises)
    rising, other, place = turn * scale[inner], other[inner], turn * depth
    step = (rising[-1] - rising[0]) / 1000
    low = np.clip(place - deviation, rising[0], rising[-1] - step)
    high = np.clip(place + deviation, low + step, rising[-1])
    slope = np.abs(np.interp(high, rising, other) - np.interp(low, rising, other)) / (high - low)
    found = np.interp(place, rising, other)
    return found.astype(np.float32), np.asarray(slope * deviation, np.float32)


# Their names in what a fit returns.
_FIELDS = ("prior", "prior_weight", "sharpness", "smoothing", "finer", "strength")
# No number that a fit chooses comes near this.
_MOST = 1e6


@dataclass(frozen=True)
class Chosen:
    """What a fit chose by cross-validation, apart from what it measured.

    Parameters
    ----------
    energy : ndarray of float64, shape (level,)
        The prior's cost of each level, in nats; all 0 if a prior does not help.
    weight : float
        The factor for the logarithm of the training depths' histogram.
    sharpness : float
        0 to read the level of least cost, else the median of ``exp(-sharpness * cost)``.
    smoothing : int
        The factor by which the method smooths more than usual.
    finer : float
        How many standard deviations around a network's answer to search again in finer steps; 0 to
        leave the answer as it is.
    strength : float
        How strongly to smooth that answer `within_edges`; 0 for not at all.
    """

    energy: NDArray[np.float64]
    weight: float = 0.0
    sharpness: float = 0.0
    smoothing: int = 1
    finer: float = 0.0
    strength: float = 0.0

    def as_learned(self) -> Learned:
        """Return it in the form that a method's fit returns."""
        values = (self.energy, self.weight, self.sharpness, self.smoothing, self.finer)
        return dict(zip(_FIELDS, (*values, self.strength), strict=True))

    def as_dict(self) -> dict[str, float]:
        """Return it for a run's record, without what is as usual."""
        found = {
            "prior": (self.weight, 0.0),
            "smoothing": (self.smoothing, 1),
            "sharpness": (self.sharpness, 0.0),
            "finer": (self.finer, 0.0),
            "strength": (self.strength, 0.0),
        }
        return {name: value for name, (value, usual) in found.items() if value != usual}

    def weigh_in(self, costs: Array, levels: Any = slice(None)) -> None:
        """Add the prior to costs of unknown unit, shape (label, y, x), in place.

        Their unit is taken to be the image's median of the least cost.

        Parameters
        ----------
        costs : ndarray of float32
        levels : ndarray of int, optional
            The level of each label; by default labels are levels.
        """
        if self.weight:
            costs /= max(float(np.median(costs.min(axis=0))), 1e-12)
            costs += self.energy[levels, np.newaxis, np.newaxis].astype(np.float32)

    @staticmethod
    def left_out_of(learned: Learned) -> Learned:
        """Return what a fit learned, without what it chose."""
        return {name: value for name, value in learned.items() if name not in _FIELDS}

    @classmethod
    def taken_from(cls, learned: Learned) -> Chosen:
        """Take it out of what a fit learned; return `AS_USUAL` if nothing was chosen.

        Raises
        ------
        ValueError
            If a part is missing, or a number out of range.
        """
        if _FIELDS[0] not in learned:
            return AS_USUAL
        if not all(name in learned for name in _FIELDS):
            raise ValueError("not all that the fit chose")
        energy, *chosen = (np.asarray(learned.pop(name), np.float64) for name in _FIELDS)
        numbers = np.array(chosen)
        if numbers.ndim != 1 or not ((numbers >= 0) & (numbers < _MOST)).all():
            raise ValueError("out of range")
        weight, sharpness, smoothing, *rest = numbers.tolist()
        return cls(energy, weight, sharpness, int(smoothing), *rest)


class Choice(NamedTuple):
    """How a fit of `wls` chose to measure the blur, and to smooth what it measured.

    Parameters
    ----------
    smoothing : float
        Standard deviation of the Gaussian that both images are smoothed with first, in pixels.
    window : int
        Side of the square window of the measure, odd.
    strength : float
        How strongly to smooth `within_edges`; 0 for not at all.
    """

    smoothing: float = 2.5
    window: int = 9
    strength: float = 1000.0

    def as_dict(self) -> dict[str, float]:
        """Return it for a run's record, empty if nothing was chosen."""
        return {} if self == Choice() else self._asdict()


#: No prior, the level of least cost, and no more smoothing than usual.
AS_USUAL = Chosen(np.zeros(LEVELS))
