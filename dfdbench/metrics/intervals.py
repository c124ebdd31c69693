"""How sure a mean is: intervals and tests over independent groups of scenes."""

from collections.abc import Sequence
from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

#: The least number of groups for which the interval's coverage was simulated. With fewer groups
#: the range of their means is shown.
INTERVAL_GROUPS = 8
#: The least number of groups for which a difference may be called real.
GROUPS_TO_TELL = 10
#: A difference is real if chance alone would produce it less often; intervals leave out as much.
LEVEL = 0.05
# Hall's transformation is flat where skewness times reach is about 1.
_STEEP = 0.9


def interval_name(groups: int) -> str:
    """Return the column heading for what `group_interval` gives for this many groups.

    Examples
    --------
    >>> interval_name(8), interval_name(3)
    ('95 %', 'range of group means')
    """
    return "95 %" if groups >= INTERVAL_GROUPS else "range of group means"


def group_interval(values: Sequence[float], groups: Sequence[str]) -> tuple[float, float] | None:
    """Return the 95 % interval of the mean, or the range of group means below eight groups.

    Captures of one scene share their depth map, and scenes of one family or room share objects, so
    only groups are independent. Each end is the farther of two: Student's t over group means, and
    the same after Hall's cubic transformation (J. R. Statist. Soc. B 54, 1992, 221-228), which
    removes the skewness of errors. If that would turn flat within the interval, the skewness is
    reduced. The mean remains the mean over all values: in mean, variance and skewness a group has
    a weight w in proportion to its number of values, and 1 / sum(w^2) replaces the number of
    groups.

    Coverage of 95 % intervals in 200,000 simulations (bootstraps: 3,000), with 8, 16 and 24 groups:

    ======================  ===================  ===================  ===================
    interval                normal               lognormal, 0.5       exponential
    ======================  ===================  ===================  ===================
    this one                96.3, 95.8, 95.7     94.7, 95.1, 95.4     94.1, 95.4, 95.8
    t                       95.0, 95.0, 95.1     91.9, 92.7, 93.2     89.4, 91.3, 92.3
    Hall                    94.9, 94.9, 95.0     93.7, 94.1, 94.3     93.5, 94.5, 94.7
    bootstrap, percentile   89.5, 92.4, 92.7     85.3, 89.9, 91.0     83.5, 89.1, 90.1
    bootstrap, BCa          89.2, 91.9, 92.3     86.0, 89.9, 91.7     85.1, 90.5, 91.7
    bootstrap, t            94.7, 94.7, 94.4     93.2, 93.7, 93.8     92.7, 94.4, 94.4
    ======================  ===================  ===================  ===================

    For symmetric differences with heavy tails (Laplace), Hall's alone covers 93 %, this one 95 to
    96. For 17 groups of 1 to 4 scenes this one covers 96 to 98 %.

    Parameters
    ----------
    values : sequence of float
        One per capture.
    groups : sequence of str
        The group of each capture.

    Returns
    -------
    tuple of float, or None
        None if there is only one group.

    Examples
    --------
    >>> group_interval([1.0, 2.0, 3.0, 5.0], ["a", "a", "b", "b"])
    (1.5, 4.0)
    """
    found = _moments(values, groups)
    if len(found.means) < INTERVAL_GROUPS:
        ends = float(found.means.min()), float(found.means.max())
        return ends if len(found.means) > 1 else None

    third = found.third(found.reach)

    def hall(side: float) -> float:
        even = side - third / (2 * found.number)
        flat = abs(third) < 1e-9
        return even if flat else float(np.cbrt(1 + 3 * third * even) - 1) / third

    below, above = max(found.reach, hall(found.reach)), min(-found.reach, hall(-found.reach))
    return found.mean - below * found.spread, found.mean - above * found.spread


def chance(values: Sequence[float], groups: Sequence[str]) -> float | None:
    """Return how probable a mean this far from 0 is if the true one is 0; None below eight groups.

    It is below 5 % exactly where the interval of `group_interval` leaves out 0, and likewise for
    any other level.

    Examples
    --------
    >>> chance([0.1, -0.1] * 5, list("abcdefghij"))
    1.0
    """
    found = _moments(values, groups)
    if len(found.means) < INTERVAL_GROUPS:
        return None
    if found.spread == 0:
        return float(found.mean == 0)
    from scipy import special

    t = found.mean / found.spread
    touching, outside = 0.0, abs(t)
    # The reach of the interval that touches 0: each level has its own, with its own skewness.
    for _ in range(60):
        reach = (touching + outside) / 2
        third = found.third(reach)
        even = t + third * t**2 + third**2 * t**3 / 3 + third / (2 * found.number)
        if abs(even) > reach:
            touching = reach
        else:
            outside = reach
    return float(2 * special.stdtr(len(found.means) - 1, -touching * sqrt(found.number)))


def holm(chances: Sequence[float | None]) -> list[float | None]:
    """Return the probabilities of a table's differences, corrected for their number (Holm 1979).

    After correction, the level for one difference also bounds the chance of calling any
    difference in the table real by mistake. None stays None and does not count.

    Examples
    --------
    >>> holm([0.01, None, 0.04, 0.03])
    [0.03, None, 0.06, 0.06]
    """
    corrected = list(chances)
    left = sorted((p, at) for at, p in enumerate(chances) if p is not None)
    largest = 0.0
    for rank, (p, at) in enumerate(left):
        corrected[at] = largest = max(largest, min(1.0, p * (len(left) - rank)))
    return corrected


class _Moments(NamedTuple):
    """Moments of group means.

    `reach` is that of t's interval in units of `spread`; `number` is how many groups of equal size
    these amount to.
    """

    means: NDArray[np.float64]
    mean: float
    spread: float
    skewness: float
    number: float
    reach: float

    def third(self, reach: float) -> float:
        """Return a third of the skewness, so far reduced that it is steep as far as `reach`."""
        most = _STEEP / max(reach, 1e-12)
        return max(-most, min(most, self.skewness)) / 3


def _moments(values: Sequence[float], groups: Sequence[str]) -> _Moments:
    _, place, sizes = np.unique(np.asarray(groups), return_inverse=True, return_counts=True)
    means = np.bincount(place, np.asarray(values, float)) / sizes
    weights = sizes / sizes.sum()
    mean = float(weights @ means)
    squares, cubes = float(weights @ weights), float(weights @ weights**2)
    number, count = 1 / squares, len(means)
    if count < INTERVAL_GROUPS:
        return _Moments(means, mean, np.nan, np.nan, number, np.nan)
    from scipy import special  # slow to import, and showing a result does not need it

    reach = float(special.stdtrit(count - 1, 1 - LEVEL / 2)) / sqrt(number)
    # Divided so that both are unbiased if the means are independent.
    spread = sqrt(weights @ (means - mean) ** 2 / (1 - squares))
    scaled = (means - mean) / (spread or 1.0)
    skewness = float(weights @ scaled**3 / (1 - 3 * squares + 2 * cubes))
    return _Moments(means, mean, spread, skewness, number, reach)
