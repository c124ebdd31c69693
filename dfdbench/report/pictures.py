"""Arrays and figures as text that stands in a page: data addresses and inline SVG."""

from __future__ import annotations

import io
import re
from typing import Any
from warnings import catch_warnings, filterwarnings
from xml.etree import ElementTree

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from dfdbench.figures.style import ERROR_LIMIT
from dfdbench.system.data_address import webp_address

_UNKNOWN = (191, 191, 191)
_PHOTO_QUALITY = 80
_MAP_QUALITY = 90
# Characters that XML cannot hold, not even escaped.
_NOT_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
# Stands for the text's colour while matplotlib draws, so that dark mode can change it.
_INK = "#010203"


def photo(image: NDArray[np.uint8]) -> str:
    """Return an RGB image, shape (y, x, 3), as a data address."""
    return webp_address(image, _PHOTO_QUALITY)


def depth_map(depth: NDArray[np.float64], low: float, high: float) -> str:
    """Return depth levels, shape (y, x), NaN where unknown, as a coloured data address."""
    return _coloured((depth - low) / max(high - low, 1.0), "viridis", np.isnan(depth))


def error_map(error: NDArray[np.float64]) -> str:
    """Return prediction less truth in levels, NaN where unknown, as a coloured data address."""
    return _coloured(error / (2 * ERROR_LIMIT) + 0.5, "PuOr", np.isnan(error))


def scale(name: str) -> str:
    """Return a colour map's scale, low to high, as a data address."""
    return _coloured(np.tile(np.linspace(0, 1, 256), (8, 1)), name, np.zeros((8, 256), bool))


def inline_svg(figure: Figure, name: str) -> str:
    """Return a figure as SVG to stand in HTML; its ink takes the page's text colour.

    Parameters
    ----------
    figure : Figure
        What was drawn.
    name : str
        For readers who cannot see it; no two on a page alike.
    """
    text = io.StringIO()
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": name}), catch_warnings():
        # Letters are drawn by the browser, which has fonts that matplotlib lacks.
        filterwarnings("ignore", r"Glyph .* missing", UserWarning)
        figure.set_facecolor("none")
        for axis in figure.axes:
            axis.set_facecolor("none")
        figure.savefig(text, format="svg", metadata={"Date": None, "Creator": None})
    ElementTree.register_namespace("", "http://www.w3.org/2000/svg")
    ElementTree.register_namespace("xlink", "http://www.w3.org/1999/xlink")
    root = ElementTree.fromstring(_NOT_XML.sub("\N{REPLACEMENT CHARACTER}", text.getvalue()))
    for unwanted in root.findall("{http://www.w3.org/2000/svg}metadata"):
        root.remove(unwanted)
    root.set("role", "img")
    root.set("aria-label", _NOT_XML.sub("\N{REPLACEMENT CHARACTER}", name))
    return ElementTree.tostring(root, encoding="unicode").replace(_INK, "currentColor")


def ink() -> dict[Any, str]:
    """Return matplotlib's settings under which figures for `inline_svg` are drawn."""
    names = (
        "text.color",
        "axes.labelcolor",
        "axes.edgecolor",
        "axes.titlecolor",
        "xtick.color",
        "ytick.color",
        "boxplot.boxprops.color",
        "boxplot.whiskerprops.color",
        "boxplot.capprops.color",
    )
    return {**dict.fromkeys(names, _INK), "legend.facecolor": "none", "font.family": "sans-serif"}


def _coloured(value: NDArray[np.float64], name: str, unknown: NDArray[np.bool_]) -> str:
    known = np.clip(np.where(unknown, 0.0, value), 0, 1)
    image = np.asarray(mpl.colormaps[name](known, bytes=True))[..., :3].copy()
    image[unknown] = _UNKNOWN
    return webp_address(image, _MAP_QUALITY)
