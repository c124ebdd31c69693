"""The report as one HTML file: no server, no network, nothing beside it."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Sequence
from importlib import resources
from pathlib import Path
from typing import Any
from warnings import catch_warnings, filterwarnings
from xml.etree import ElementTree

import jinja2
import matplotlib as mpl
import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure
from numpy.typing import NDArray

from dfdbench.figures.style import ERROR_LIMIT, brightened, brightening
from dfdbench.metrics.protocol import metrics_of
from dfdbench.report.content import gather, write_plots
from dfdbench.results.record import SCORED, PairResult
from dfdbench.results.saved_run import SavedRun
from dfdbench.results.wording import score_text, seconds_text
from dfdbench.system.files import write_whole
from dfdbench.system.thumbnails import webp_address

_PAGE = "report.html"
_UNKNOWN = (191, 191, 191)
_PHOTO_QUALITY = 80
_MAP_QUALITY = 90
# Characters that XML cannot hold, not even escaped.
_NOT_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
# Stands for the text's colour while matplotlib draws, so that dark mode can change it.
_INK = "#010203"


def write_html(
    runs: Sequence[SavedRun],
    protocol: str,
    folder: Path,
    on_pair: Callable[[int, int], None] | None = None,
    also: Sequence[str] = (),
) -> Path:
    """Write a report on runs into a folder as ``report.html``; return its path.

    `on_pair` is called with (pairs done, pairs to do); `also` names forms of the plots, "pdf" and
    "svg", to write beside the page.
    """
    with mpl.rc_context(ink()):
        content = gather(runs, protocol)
        write_plots(content, folder, also)
        plots = [
            [
                (name, Markup(inline_svg(figure, f"{section.heading}: {name}")))
                for name, figure in section.plots.items()
            ]
            for section in content.sections
        ]
    # Many pairs and methods share a scene: each picture is in the page once.
    pictures: dict[str, str] = {}
    of_data: dict[tuple[str, str], dict[str, str]] = {}
    cards = []
    for number, (run, pair) in enumerate(content.pairs, 1):
        cards += _cards(run, pair, protocol, pictures, of_data)
        if on_pair:
            on_pair(number, len(content.pairs))
    templates = resources.files("dfdbench.report")
    # Names of methods are untrusted text: jinja escapes them.
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    text = environment.from_string((templates / "report.html.jinja").read_text("utf-8")).render(
        content=content,
        plots=plots,
        pairs=cards,
        pictures={key: address for address, key in pictures.items()},
        filters=_filters(cards, content.methods),
        scales={"depth": scale("viridis"), "error": scale("PuOr")},
        error_limit=int(ERROR_LIMIT),
        style=Markup((templates / "report.css").read_text("utf-8")),
        script=Markup((templates / "report.js").read_text("utf-8")),
    )
    path = folder / _PAGE
    write_whole(path, text)
    return path


def _cards(
    run: SavedRun,
    pair: PairResult,
    protocol: str,
    pictures: dict[str, str],
    of_data: dict[tuple[str, str], dict[str, str]],
) -> list[dict[str, Any]]:
    """Return the card of a pair, or none without its depth map; pictures are added."""
    found = run.images(pair)
    if found is None:
        return []
    images, prediction = found
    known = images.depth.astype(np.float64)
    low, high = float(np.nanmin(known)), float(np.nanmax(known))
    times = brightening(images.infocus)
    place = run.result.dataset.fingerprint, pair.id
    if place not in of_data:
        of_data[place] = {
            "infocus": photo(brightened(images.infocus, times)),
            "defocus": photo(brightened(images.defocus, times)),
            "truth": depth_map(known, low, high),
        }
    own = {
        "prediction": depth_map(prediction.astype(np.float64), low, high),
        "error": error_map(prediction - known),
    }
    shown = {
        kind: pictures.setdefault(address, f"p{len(pictures)}")
        for kind, address in (of_data[place] | own).items()
    }
    height, width = images.depth.shape
    size = {"width": width, "height": height, "low": f"{low:.0f}", "high": f"{high:.0f}"}
    return [_texts(run, pair, protocol) | size | {"pictures": shown, "brighter": times}]


def _texts(run: SavedRun, pair: PairResult, protocol: str) -> dict[str, Any]:
    coordinates = {axis: str(value) for axis, value in pair.coordinates.items()}
    return {
        "name": pair.id,
        "method": run.label,
        "places": {"method": run.label, "scene": pair.scene, **coordinates},
        "scores": [
            (metric.title, score_text(pair.score(protocol, name), "undefined"))
            for name, metric in metrics_of(protocol).items()
        ],
        "seconds": SCORED if pair.seconds is None else f"{seconds_text(pair.seconds)} s",
    }


def _filters(cards: Sequence[dict[str, Any]], methods: Sequence[str]) -> dict[str, list[str]]:
    found: dict[str, dict[str, None]] = {"method": dict.fromkeys(methods)}
    for card in cards:
        for name, value in card["places"].items():
            found.setdefault(name, {})[value] = None
    return {
        name: list(values) if name == "method" else sorted(values, key=lambda v: (len(v), v))
        for name, values in found.items()
        if len(values) > 1
    }


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
    """Return a figure as SVG for HTML, in the page's text colour.

    `name` is for readers who cannot see it, different for each figure of a page.
    """
    text = io.StringIO()
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": name}), catch_warnings():
        # The browser draws the letters, with fonts that matplotlib lacks.
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
    """Return the settings of matplotlib for drawing figures for `inline_svg`."""
    names = ["text.color", "axes.labelcolor", "axes.edgecolor", "axes.titlecolor", "xtick.color"]
    names += ["ytick.color", *(f"boxplot.{part}props.color" for part in ("box", "whisker", "cap"))]
    return {**dict.fromkeys(names, _INK), "legend.facecolor": "none", "font.family": "sans-serif"}


def _coloured(value: NDArray[np.float64], name: str, unknown: NDArray[np.bool_]) -> str:
    known = np.clip(np.where(unknown, 0.0, value), 0, 1)
    image = np.asarray(mpl.colormaps[name](known, bytes=True))[..., :3].copy()
    image[unknown] = _UNKNOWN
    return webp_address(image, _MAP_QUALITY)
