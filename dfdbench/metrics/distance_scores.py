"""Score levels as distances, by a data set's scale: what the protocols in metres do."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dfdbench.errors import InputError
from dfdbench.metrics.metres import aligned
from dfdbench.metrics.metric import IN_METRES


class Scale(Protocol):
    """How depth levels become metres; `far` is the farthest distance there is."""

    @property
    def far(self) -> float:
        """In metres."""

    def to_metres(self, levels: NDArray[Any]) -> NDArray[np.float64]:
        """Return the distance of each level."""


def score_distances(
    metrics: Iterable[str],
    align: bool,
    truth: NDArray[np.uint8],
    estimate: NDArray[np.float32],
    mask: NDArray[np.bool_] | None,
    scale: Scale | None,
) -> dict[str, float]:
    """Return the scores of depth levels that are taken as distances.

    Parameters
    ----------
    metrics : iterable of str
        Which of `dfdbench.metrics.metric.IN_METRES`.
    align : bool
        Whether scale and shift in inverse depth are fitted first, see
        `dfdbench.metrics.metres.aligned`.
    truth, estimate : ndarray, shape (y, x)
        Depth levels.
    mask : ndarray of bool, shape (y, x), or None
        True where a pixel counts.
    scale : Scale or None
        How levels become metres.

    Raises
    ------
    InputError
        Where there is no scale.
    """
    if scale is None:
        raise InputError("nothing says how levels become metres", where="scale")
    true, found = scale.to_metres(truth), scale.to_metres(estimate)
    if align:
        found = aligned(true, found, scale.far, mask)
    return {name: IN_METRES[name].function(true, found, mask=mask) for name in metrics}
