"""What figures have in common: colours, markers, the span of depths, text as it stands."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

# Okabe and Ito's colours, which the colour-blind can tell apart; markers differ as well.
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#000000")
_DPI = 120
_LEAST_SPAN = 20.0
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
_LEGEND_COLUMNS = 3
_LABEL_LENGTH = 60
# In ems: a character, rather wide since browsers use fonts of their own; a mark and the space
# around it; a line.
_CHARACTER, _MARK, _LINE = 0.65, 5.0, 1.6


def write_figure(figure: Figure, path: Path) -> None:
    """Write a figure, in the form that the file's suffix names: every figure is as fine."""
    figure.savefig(path, dpi=_DPI)


def without_ticks(axes: Iterable[Axes], background: str) -> None:
    """Make axes bare, as images have them; `background` shows where an image is masked."""
    for axis in axes:
        axis.set_xticks([])
        axis.set_yticks([])
        axis.set_facecolor(background)


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


def wrapped(text: str, width: int = _LABEL_LENGTH) -> str:
    r"""Return plain text in lines of a few words, so that no name is wider than a figure.

    Examples
    --------
    >>> wrapped("graph-cuts color_space=rgb", 15)
    'graph-cuts\ncolor_space=rgb'
    """
    # A dollar and the backslash before it are one letter, and stay on one line.
    lines = textwrap.wrap(text.replace(r"\$", "\0"), width, break_on_hyphens=False)
    return "\n".join(lines).replace("\0", r"\$") or text


def legend_below(figure: Figure, axis: Axes) -> None:
    """Give a figure the legend of one of its axes, below it and whole.

    There are as many columns as fit, three at most; the figure grows where names need more room.
    """
    handles, names = axis.get_legend_handles_labels()
    labels = [wrapped(name) for name in names]
    em = 10 / 72
    longest = max((len(line) for label in labels for line in label.split("\n")), default=0)
    column = (_CHARACTER * longest + _MARK) * em
    columns = max(1, min(_LEGEND_COLUMNS, len(labels), int(figure.get_figwidth() / column)))
    lines = math.ceil(len(labels) / columns) * max((x.count("\n") + 1 for x in labels), default=0)
    figure.set_figwidth(max(figure.get_figwidth(), column))
    figure.set_figheight(figure.get_figheight() + _LINE * em * max(lines - 1, 0))
    figure.legend(handles, labels, loc="outside lower center", ncols=columns, fontsize=10)
