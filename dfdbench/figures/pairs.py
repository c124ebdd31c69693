"""Draw one pair: two images, ground truth, and a prediction with its error, if any."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from dfdbench.datasets.captures import Capture
from dfdbench.figures.style import (
    ERROR_LIMIT,
    brightened,
    brightening,
    depth_span,
    plain_text,
    without_ticks,
)

HEADS = ("in-focus", "defocus", "ground truth", "prediction", "prediction − truth")


class Shown(Figure):
    """A figure that a notebook shows without pyplot and its state."""

    def _repr_png_(self) -> bytes:
        content = io.BytesIO()
        self.savefig(content, format="png", dpi=90)
        return content.getvalue()


def show(pair: Capture, prediction: NDArray[np.floating[Any]] | None = None) -> Figure:
    """Draw a pair; this is ``dfdbench.show``.

    Parameters
    ----------
    pair : Capture
        From `dfdbench.open`.
    prediction : ndarray, shape (y, x), optional
        Depth levels from a method; drawn with its error.

    Returns
    -------
    Figure
        A notebook shows it, and ``savefig`` writes it. Unknown depth is grey.

    Raises
    ------
    TypeError
        If it is not a pair.

    Examples
    --------
    >>> from dfdbench.datasets.manifest import Pair
    >>> grey, level = np.full((2, 6, 8, 3), 90, np.uint8), np.full((6, 8), 40, np.float32)
    >>> figure = show(Capture(Pair("Desk", (("view", 1),)), grey, level))
    >>> [axis.get_title() for axis in figure.axes][:3]
    ['in-focus', 'defocus', 'ground truth']
    """
    if not isinstance(pair, Capture):
        raise TypeError(
            f"show draws one pair, as dfdbench.open(...)[0] gives it; got {type(pair).__name__}"
        )
    count = 3 if prediction is None else len(HEADS)
    rows, columns = pair.depth.shape
    figure = Shown(figsize=(3 * count, 3 * rows / columns + 0.6), layout="constrained")
    figure.suptitle(plain_text(pair.pair.id), fontsize=10)
    axes = list(figure.subplots(1, count))
    for axis, head in zip(axes, HEADS, strict=False):
        axis.set_title(head, fontsize=10)
    draw_pair(figure, axes, pair, prediction)
    return figure


def draw_pair(
    figure: Figure,
    axes: Sequence[Axes],
    images: Capture,
    prediction: NDArray[np.floating[Any]] | None,
) -> None:
    """Draw a pair into three axes, or into five with a prediction; depth and error get scales."""
    known = images.depth.astype(np.float64)
    low, high = depth_span(known)
    levels: dict[str, Any] = {"cmap": "viridis", "vmin": low, "vmax": high}
    errors: dict[str, Any] = {"cmap": "PuOr", "vmin": -ERROR_LIMIT, "vmax": ERROR_LIMIT}
    times = brightening(images.infocus)
    axes[0].imshow(brightened(images.infocus, times))
    axes[1].imshow(brightened(images.defocus, times))
    if times > 1:
        axes[0].set_xlabel(f"both images shown {times} times brighter", fontsize=8)
    truth = axes[2].imshow(known, interpolation="nearest", **levels)
    without_ticks(axes, "0.75")
    if prediction is None:
        figure.colorbar(truth, ax=axes[2], label="depth level", fraction=0.05)
        return
    axes[3].imshow(prediction, interpolation="nearest", **levels)
    error = axes[4].imshow(prediction - known, interpolation="nearest", **errors)
    figure.colorbar(truth, ax=axes[3], label="depth level", fraction=0.05)
    figure.colorbar(error, ax=axes[4], label="levels", fraction=0.05, extend="both")


def depth_figure(
    infocus: NDArray[np.uint8], defocus: NDArray[np.uint8], depth: NDArray[np.floating[Any]]
) -> Figure:
    """Draw two photographs, shape (y, x, 3), and the depth levels estimated from them."""
    rows, columns = depth.shape
    figure = Shown(figsize=(9, 3 * rows / columns + 0.4), layout="constrained")
    axes = figure.subplots(1, 3)
    for axis, head, image in zip(axes, HEADS, (infocus, defocus), strict=False):
        axis.set_title(head, fontsize=10)
        axis.imshow(image)
    low, high = depth_span(np.asarray(depth, np.float64))
    shown = axes[2].imshow(depth, cmap="viridis", vmin=low, vmax=high, interpolation="nearest")
    axes[2].set_title("depth", fontsize=10)
    without_ticks(axes, "0.75")
    figure.colorbar(shown, ax=axes[2], label="depth level (brighter is nearer)", fraction=0.05)
    return figure
