"""What a pair holds: two images, the ground truth, and where it is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dfdbench.datasets.manifest import Pair


@dataclass(frozen=True)
class PairImages:
    """What a pair holds: two images, the ground truth, and where it is known.

    Parameters
    ----------
    pair : Pair
        Which pair it is.
    infocus, defocus : ndarray of uint8, shape (y, x, channel)
        RGB.
    depth : ndarray of uint8, shape (y, x)
        Depth levels.
    valid : ndarray of bool, shape (y, x)
        True where the depth is known.
    """

    pair: Pair
    infocus: NDArray[np.uint8]
    defocus: NDArray[np.uint8]
    depth: NDArray[np.uint8]
    valid: NDArray[np.bool_]

    def _repr_html_(self) -> str:
        from dfdbench.datasets.notebook import pair_html

        return pair_html(self)
