"""The report as one HTML file: no server, no network, nothing beside it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import resources
from pathlib import Path

import jinja2
import matplotlib as mpl
import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from dfdbench.datasets.pair_images import PairImages
from dfdbench.figures.style import ERROR_LIMIT, brightened, brightening
from dfdbench.metrics.protocol import metrics_of
from dfdbench.report.content import Content, ShownPair, gather
from dfdbench.report.pictures import depth_map, error_map, ink, inline_svg, photo, scale
from dfdbench.report.plot_files import write_plots
from dfdbench.results.record import SCORED
from dfdbench.results.saved_run import SavedRun
from dfdbench.results.wording import score_text, seconds_text
from dfdbench.system.files import write_whole

_PAGE = "report.html"


def write_html(
    runs: Sequence[SavedRun],
    protocol: str,
    folder: Path,
    on_pair: Callable[[int, int], None] | None = None,
    also: Sequence[str] = (),
) -> Path:
    """Write the report as ``report.html``; return its path.

    Parameters
    ----------
    runs : sequence of SavedRun
        What it is about.
    protocol : str
        Under which protocol.
    folder : Path
        Where it goes.
    on_pair : callable, optional
        Called with (pairs done, pairs to do).
    also : sequence of str
        Forms in which plots are written beside the page too: "pdf", "svg".
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
    # The same scene serves many pairs and methods: each picture stands in the page once.
    pictures: dict[str, str] = {}
    pairs = _cards(content, pictures, on_pair)
    templates = resources.files("dfdbench.report")
    # Names of methods are untrusted text: jinja escapes them wherever they stand.
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    text = environment.from_string(
        (templates / "report.html.jinja").read_text(encoding="utf-8")
    ).render(
        content=content,
        plots=plots,
        pairs=pairs,
        pictures={key: address for address, key in pictures.items()},
        filters=_filters(pairs, content.methods),
        scales={"depth": scale("viridis"), "error": scale("PuOr")},
        error_limit=int(ERROR_LIMIT),
        style=Markup((templates / "report.css").read_text(encoding="utf-8")),
        script=Markup((templates / "report.js").read_text(encoding="utf-8")),
    )
    path = folder / _PAGE
    write_whole(path, text)
    return path


def _cards(
    content: Content, pictures: dict[str, str], on_pair: Callable[[int, int], None] | None
) -> list[dict[str, object]]:
    of_data: dict[tuple[str, str], dict[str, str]] = {}
    cards = []
    for number, shown in enumerate(content.pairs, 1):
        card = _card(shown, content, pictures, of_data)
        if card:
            cards.append(card)
        if on_pair:
            on_pair(number, len(content.pairs))
    return cards


def _card(
    shown: ShownPair,
    content: Content,
    pictures: dict[str, str],
    of_data: dict[tuple[str, str], dict[str, str]],
) -> dict[str, object] | None:
    found = shown.run.images(shown.pair)
    if found is None:
        return None
    images, prediction = found
    known = np.where(images.valid, images.depth, np.nan).astype(np.float64)
    low, high = float(np.nanmin(known)), float(np.nanmax(known))
    pair = shown.pair
    times = brightening(images.infocus)
    place = shown.run.result.dataset.fingerprint, pair.id
    if place not in of_data:
        of_data[place] = _pictures_of_data(images, known, times)
    addresses = {
        **of_data[place],
        "prediction": depth_map(prediction.astype(np.float64), low, high),
        "error": error_map(prediction - known),
    }
    return {
        "name": pair.id,
        "method": shown.run.label,
        "places": {
            "method": shown.run.label,
            "scene": pair.scene,
            **{a: str(v) for a, v in pair.coordinates.items()},
        },
        "pictures": {
            kind: pictures.setdefault(address, f"p{len(pictures)}")
            for kind, address in addresses.items()
        },
        "width": images.depth.shape[1],
        "height": images.depth.shape[0],
        "brighter": times,
        "low": f"{low:.0f}",
        "high": f"{high:.0f}",
        "scores": [
            (metric.title, score_text(pair.score(content.protocol, name), "undefined"))
            for name, metric in metrics_of(content.protocol).items()
        ],
        "seconds": SCORED if pair.seconds is None else f"{seconds_text(pair.seconds)} s",
    }


def _pictures_of_data(images: PairImages, known: NDArray[np.float64], times: int) -> dict[str, str]:
    return {
        "infocus": photo(brightened(images.infocus, times)),
        "defocus": photo(brightened(images.defocus, times)),
        "truth": depth_map(known, float(np.nanmin(known)), float(np.nanmax(known))),
    }


def _filters(pairs: Sequence[dict[str, object]], methods: Sequence[str]) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {"method": list(methods)}
    for pair in pairs:
        places = pair["places"]
        assert isinstance(places, dict)
        for name, value in places.items():
            values = found.setdefault(name, [])
            if value not in values:
                values.append(value)
    return {
        name: values if name == "method" else sorted(values, key=lambda v: (len(v), v))
        for name, values in found.items()
        if len(values) > 1
    }
