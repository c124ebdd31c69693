"""What figures share: colours, markers, legends, brightness, plain text, files."""

import io
import math
import textwrap
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from dfdbench.blur.recipe import LAST_LEVEL
from dfdbench.datasets.manifest import Depth
from dfdbench.errors import unknown_name
from dfdbench.system.files import write_whole

# Okabe and Ito's colours, which colour-blind people can tell apart; markers differ as well.
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#000000")
BLUE, ORANGE, GREEN, PINK, SKY, RED, BLACK = COLOURS
_DPI = 120
_FORMS = ("png", "pdf", "svg")
_LEAST_SPAN = 20.0
# An image counts as dark if nearly all of it is below half of this grey level.
_BRIGHT, _NEARLY_ALL = 235.0, 99
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
#: Depth errors are drawn up to this many levels.
ERROR_LIMIT = 50.0
_LEGEND_COLUMNS = 3
_LABEL_LENGTH = 60
# In ems: a character, rather wide because browsers use their own fonts; a mark and the space around
# it; a line.
_CHARACTER, _MARK, _LINE = 0.65, 5.0, 1.6


def single_axes(width: float, height: float, **grid: Any) -> tuple[Figure, Axes]:
    """Return a figure, its size in inches, with one axes and a faint grid with `grid` lines."""
    figure = Figure(figsize=(width, height), layout="constrained")
    axis = figure.subplots()
    axis.grid(alpha=0.3, **grid)
    return figure, axis


def rows_of_images(names: Sequence[str], heads: Sequence[str], height: float) -> tuple[Figure, Any]:
    """Return a figure with a row of axes for each name, and a column under each head."""
    figure = Figure(figsize=(15, height * len(names) + 0.9), layout="constrained")
    grid = figure.subplots(len(names), len(heads), squeeze=False)
    for axis, head in zip(grid[0], heads, strict=True):
        axis.set_title(head, fontsize=10)
    for axis, name in zip(grid[:, 0], names, strict=True):
        axis.set_ylabel(name.replace("/", "\n"), fontsize=8)
    return figure, grid


def marks(number: int) -> dict[str, Any]:
    """Return the colour and marker of a method or other series, by its number."""
    colour, marker = COLOURS[number % len(COLOURS)], MARKERS[number % len(MARKERS)]
    return {"linestyle": "none", "markersize": 5, "color": colour, "marker": marker}


def write_figure(figure: Figure, path: Path) -> None:
    """Write a figure in the format of the file's suffix.

    The same figure gives the same bytes: no format contains the time.
    """
    form, content = path.suffix[1:].lower(), io.BytesIO()
    undated = {"pdf": {"CreationDate": None}, "svg": {"Date": None}}.get(form)
    with mpl.rc_context({"svg.hashsalt": path.stem}):
        figure.savefig(content, format=form, dpi=_DPI, metadata=undated)
    write_whole(path, content.getvalue())


def forms_of(forms: Sequence[str]) -> Sequence[str]:
    """Return the formats to draw in, given as a list or as one name.

    Raises
    ------
    UnknownNameError
        If one is neither "png", "pdf" nor "svg".

    Examples
    --------
    >>> forms_of("pdf"), forms_of(("png", "svg"))
    (['pdf'], ('png', 'svg'))
    """
    forms = [forms] if isinstance(forms, str) else forms
    for form in forms:
        if form not in _FORMS:
            raise unknown_name("form of a figure", form, _FORMS)
    return forms


def write_forms(figure: Figure, folder: Path, name: str, forms: Sequence[str]) -> list[Path]:
    """Write a figure once in each of several formats, "png", "pdf", "svg"; return the files."""
    paths = [folder / f"{name}.{form}" for form in dict.fromkeys(forms)]
    for path in paths:
        write_figure(figure, path)
    return paths


def without_ticks(axes: Iterable[Axes], background: str) -> None:
    """Remove the ticks around images; `background` fills their masked parts."""
    for axis in axes:
        axis.set(xticks=[], yticks=[], facecolor=background)


def depth_span(depth: NDArray[np.float64], whole: float = LAST_LEVEL) -> tuple[float, float]:
    """Return the least and largest depth to draw, ignoring NaN.

    They are at least 20 levels apart, or as much of the data set's `whole` range. Otherwise a flat
    board would be drawn as its noise.

    Examples
    --------
    >>> depth_span(np.array([100.0, np.nan, 102.0])), depth_span(np.array([10.0, 240.0]))
    ((91.0, 111.0), (10.0, 240.0))
    """
    low, high = float(np.nanmin(depth)), float(np.nanmax(depth))
    more = max(_LEAST_SPAN * whole / LAST_LEVEL - (high - low), 0.0) / 2
    return low - more, high + more


def depth_scales(about: Depth, known: NDArray[np.float64]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return how to draw a depth map and its error: near is bright, errors up to a fifth."""
    low, high = depth_span(known, about.span)
    near_bright = about.ends[0] > about.ends[1]
    limit = ERROR_LIMIT * about.span / LAST_LEVEL
    return (
        {"cmap": "viridis" if near_bright else "viridis_r", "vmin": low, "vmax": high},
        {"cmap": "PuOr" if near_bright else "PuOr_r", "vmin": -limit, "vmax": limit},
    )


#: The labels of the depth and error scales, by the kind of depth.
DEPTH_LABELS = {"levels": "depth level", "metres": "metres"}


def brightening(infocus: NDArray[np.uint8]) -> int:
    """Return the factor by which to brighten a dark pair; 1 for most pairs.

    Examples
    --------
    >>> brightening(np.full((4, 5, 3), 200, np.uint8)), brightening(np.full((4, 5), 9, np.uint8))
    (1, 26)
    """
    return max(1, int(_BRIGHT / max(float(np.percentile(infocus, _NEARLY_ALL)), 1.0)))


def brightened(image: NDArray[np.uint8], times: int) -> NDArray[np.uint8]:
    """Multiply an image's brightness, clipped at white.

    Examples
    --------
    >>> brightened(np.array([[9, 200]], np.uint8), 3).tolist()
    [[27, 255]]
    """
    return np.minimum(image.astype(np.int64) * times, LAST_LEVEL).astype(np.uint8)


def plain_text(text: str) -> str:
    r"""Escape text that matplotlib would take for a formula or a hidden legend entry.

    Examples
    --------
    >>> plain_text("_a$b$")
    ' _a\\$b\\$'
    """
    text = " ".join(text.splitlines()).replace("$", r"\$")
    return f" {text}" if text.startswith("_") else text


def wrapped(text: str, width: int = _LABEL_LENGTH) -> str:
    r"""Wrap plain text, so that no name is wider than a figure.

    Examples
    --------
    >>> wrapped("graph-cuts color_space=rgb", 15)
    'graph-cuts\ncolor_space=rgb'
    """
    # A dollar and the backslash before it must stay on one line.
    lines = textwrap.wrap(text.replace(r"\$", "\0"), width, break_on_hyphens=False)
    return "\n".join(lines).replace("\0", r"\$") or text


def legend_beside(axis: Axes, handles: Sequence[Artist] | None = None) -> None:
    """Put the axes' legend to their right, where it hides no data."""
    shown = axis.get_legend_handles_labels()[0] if handles is None else handles
    axis.legend(handles=list(shown), loc="upper left", bbox_to_anchor=(1, 1), fontsize=9)


def legend_below(figure: Figure, axis: Axes) -> None:
    """Put the legend of one axes below the figure, in up to three columns.

    The figure grows if names need more room.
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
