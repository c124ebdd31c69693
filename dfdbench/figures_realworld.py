"""Figures of captures: a depth map laid over its image, sharpness over temperature and voltage."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

Depth = tuple[NDArray[np.uint8], NDArray[np.bool_]]


def overlay_figure(image: NDArray[np.uint8], depths: Mapping[str, Depth], title: str) -> Figure:
    """Draw depth maps over an image, each in a panel, with the outline of what is known.

    Parameters
    ----------
    image : ndarray of uint8, shape (y, x, 3)
        RGB.
    depths : mapping of str to (levels, valid)
        What each panel shows.
    title : str
        Over all panels.
    """
    # Dark exposures are drawn brighter, or there would be nothing to compare with.
    shown = np.clip(image / max(float(np.percentile(image, 99)), 1.0), 0, 1)
    known = np.concatenate([levels[valid] for levels, valid in depths.values()])
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 255.0)
    figure = Figure(figsize=(5.2 * len(depths) + 1.2, 5.4), layout="constrained")
    grid = figure.subplots(1, len(depths), squeeze=False)[0]
    for axis, (name, (levels, valid)) in zip(grid, depths.items(), strict=True):
        axis.imshow(shown)
        drawn = axis.imshow(
            np.where(valid, levels, np.nan).astype(np.float64), cmap="viridis", alpha=0.4,
            vmin=low, vmax=high,
        )  # fmt: skip
        if valid.any() and not valid.all():
            axis.contour(valid, levels=[0.5], colors="#E69F00", linewidths=1.2)
        axis.set(xticks=[], yticks=[], title=name)
    figure.colorbar(drawn, ax=grid[-1], label="depth level (cm)", fraction=0.046)
    figure.suptitle(title)
    return figure
