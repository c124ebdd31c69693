"""What figures have in common: colours, markers, the span of depths, text as it stands."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# Okabe and Ito's colours, which the colour-blind can tell apart; markers differ as well.
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#000000")
_LEAST_SPAN = 20.0
MARKERS = ("o", "s", "^", "D", "v", "P", "X")


def depth_span(levels: NDArray[np.float64]) -> tuple[float, float]:
    """Return between which levels depths are drawn: all there are, and twenty at least.

    A flat board would be drawn as its noise otherwise. Levels that are unknown are NaN.

    Examples
    --------
    >>> depth_span(np.array([100.0, np.nan, 102.0])), depth_span(np.array([10.0, 240.0]))
    ((91.0, 111.0), (10.0, 240.0))
    """
    low, high = float(np.nanmin(levels)), float(np.nanmax(levels))
    more = max(_LEAST_SPAN - (high - low), 0.0) / 2
    return low - more, high + more


def plain_text(text: str) -> str:
    r"""Return text as matplotlib shows it letter by letter: no formulas, no hidden legends.

    Examples
    --------
    >>> plain_text("_a$b$")
    ' _a\\$b\\$'
    """
    text = " ".join(text.splitlines()).replace("$", r"\$")
    return f" {text}" if text.startswith("_") else text
