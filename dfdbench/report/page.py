"""Gather a report on runs, and write it as one HTML file or as Markdown with figures."""

import io
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
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

from dfdbench.board.ranking import Entry, ScoreBoard, boards
from dfdbench.board.tables import lighting_table, runs_table, standings_table
from dfdbench.figures import comparisons, style, sureness
from dfdbench.figures.runs import group_figures, panel_figure
from dfdbench.metrics.metric import find_metric
from dfdbench.metrics.protocol import metrics_of, ranked_by, require_scored
from dfdbench.results.record import SCORED, PairResult
from dfdbench.results.run_tables import all_tables, region_table
from dfdbench.results.saved_run import SavedRun
from dfdbench.results.summary import RunSummary, summarise
from dfdbench.results.wording import score_text, seconds_text, titled_scores
from dfdbench.system.files import write_whole
from dfdbench.system.parallel import one_by_one
from dfdbench.system.thumbnails import webp_address
from dfdbench.tables.render import as_markdown, escape_markdown
from dfdbench.tables.table import Table, grouped


@dataclass(frozen=True)
class Section:
    """Comparable runs: on one data set fingerprint and split.

    `tables` are the ranking, the scores by lighting and how the runs were made; `details` are each
    method's own tables, by its label; `plots` are by what each shows.
    """

    heading: str
    fingerprint: str
    tables: tuple[Table, ...]
    details: tuple[tuple[str, tuple[Table, ...]], ...]
    plots: dict[str, Figure]


@dataclass(frozen=True)
class Content:
    """The content of a report.

    Parameters
    ----------
    title : str
        The report's title.
    protocol : str
        The protocol of every score.
    summary : tuple of str
        One sentence per section.
    methods : tuple of str
        The methods' labels, best first.
    sections : tuple of Section
        One for each set of comparable runs.
    pairs : tuple of (SavedRun, PairResult)
        Pairs whose images can be shown, worst first by the ranking metric.
    missing : tuple of str
        Runs without a gallery, and why.
    """

    title: str
    protocol: str
    summary: tuple[str, ...]
    methods: tuple[str, ...]
    sections: tuple[Section, ...]
    pairs: tuple[tuple[SavedRun, PairResult], ...]
    missing: tuple[str, ...]


def gather(runs: Sequence[SavedRun], protocol: str, folder: Path) -> Content:
    """Gather the content of a report on at least one run; links are relative to its folder.

    Raises
    ------
    UnknownNameError
        If no run was scored under the protocol.
    """
    others = [run for run in runs if protocol not in run.result.protocol_names]
    if len(others) == len(runs):
        require_scored(protocol, runs[0].result.protocol_names, str(runs[0].path))
    sections, sentences = [], [f"{run.label}: not scored under {protocol}." for run in others]
    shown: list[tuple[SavedRun, RunSummary]] = []
    for board in boards([Entry((run.result,), run.path, run.label) for run in runs]):
        if board.protocol != protocol:
            continue
        paths = [standing.entry.path for standing in board.standings]
        members = sorted((r for r in runs if r.path in paths), key=lambda r: paths.index(r.path))
        summaries = [(run, summarise(run.result, protocol)) for run in members]
        sections.append(_section_of(board, summaries, folder))
        sentences.append(_sentence(members, protocol, sections[-1].heading))
        shown += summaries
    labels = list(dict.fromkeys(run.label for run, _ in shown))
    title = f"Depth from defocus: {labels[0] if len(labels) == 1 else f'{len(labels)} methods'}"
    parts = tuple(sentences), tuple(labels), tuple(sections)
    worst = [(run, pair) for run, summary in shown if run.store for pair in summary.ranked]
    metric = ranked_by(protocol)[0]
    worst.sort(key=lambda of: of[1].score(protocol, metric) or 0.0, reverse=True)
    missing = tuple(f"{run.label}: {run.without}" for run, _ in shown if run.without)
    return Content(title, protocol, *parts, tuple(worst), missing)


def _section_of(
    board: ScoreBoard, summaries: Sequence[tuple[SavedRun, RunSummary]], folder: Path
) -> Section:
    members = [run for run, _ in summaries]
    store = next((run.store for run in members if run.store), None)
    scenes = store.manifest.scenes if store else []
    details = tuple((run.label, tuple(all_tables(summary, store))) for run, summary in summaries)
    plots = comparisons.lighting_figures(members, board.protocol)
    parted = group_figures({run.label: run.result for run in members}, board.protocol, scenes)
    plots |= {f"by {what}": figure for what, figure in parted.items()}
    if times := comparisons.time_figure(members):
        plots["seconds per pair"] = times
    if len(members) > 1 and (accuracy := comparisons.accuracy_figure(members, board.protocol)):
        plots["accuracy and seconds"] = accuracy
    ranking = standings_table(board, folder)
    sure = [curves for run in members if (curves := sureness.curves_of(run, run.label))]
    if sure:
        plots["how sure it is"] = sureness.sureness_figure(sure, board.result.dataset.heading)
    regions = region_table({run.label: run.result for run in members})
    tables = (ranking, regions, lighting_table(board), runs_table(board))
    return Section(ranking.title, board.result.dataset.fingerprint, tables, details, plots)


def _sentence(members: Sequence[SavedRun], protocol: str, where: str) -> str:
    # A complete run has no mean either if it leaves pixels out.
    first = ranked_by(protocol)[0]
    scored = [run for run in members if run.result.mean(protocol, first) is not None]
    if not scored:
        return f"{where}: no run has a mean {find_metric(first).title}."
    means = ((name, scored[0].result.mean(protocol, name)) for name in metrics_of(protocol))
    parts = [f"{find_metric(name).title} {score_text(n)}" for name, n in means if n is not None]
    lead = "" if len(scored) == 1 else f"best of {len(scored)}: "
    return f"{where}: {lead}{scored[0].label}, {', '.join(parts)}."


def write_plots(
    content: Content, folder: Path, forms: Sequence[str]
) -> list[list[tuple[str, str]]]:
    """Write each section's plots as ``1-seconds-per-pair.png`` in each form: png, pdf, svg.

    Return them by section, as (what, file of the first form).
    """
    written = []
    for number, section in enumerate(content.sections, 1):
        stems = {name: f"{number}-{name.replace(' ', '-')}" for name in section.plots}
        for name, figure in section.plots.items():
            style.write_forms(figure, folder, stems[name], forms)
        written.append([(name, f"{stem}.{forms[0]}") for name, stem in stems.items() if forms])
    return written


_TEMPLATES = jinja2.Environment(
    loader=jinja2.PackageLoader("dfdbench.report", ""),
    # Names of methods are untrusted text. In Markdown the filters escape them.
    autoescape=lambda name: name == "report.html.jinja",
    undefined=jinja2.StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)
_TEMPLATES.filters |= {"table": as_markdown, "text": escape_markdown}
_PAGE = "report.html"
_UNKNOWN = (191, 191, 191)
_PHOTO_QUALITY = 80
_MAP_QUALITY = 90
# Characters that XML cannot hold, not even escaped.
_NOT_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
# Replaces the text's colour while matplotlib draws, so that dark mode can change it.
_INK = "#010203"


def write_html(
    runs: Sequence[SavedRun],
    protocol: str,
    folder: Path,
    on_pair: Callable[[int, int], None] | None = None,
    also: Sequence[str] = (),
) -> Path:
    """Write a report on runs into a folder as ``report.html``; return its path.

    `on_pair` is called with (pairs done, total pairs); `also` names further formats of the plots,
    "pdf" and "svg", to write beside the page.
    """
    # Before the drawing, which takes a while.
    folder.mkdir(parents=True, exist_ok=True)
    with mpl.rc_context(ink()):
        content = gather(runs, protocol, folder)
        write_plots(content, folder, also)
        plots = [
            [
                (name, Markup(inline_svg(figure, f"{section.heading}: {name}")))
                for name, figure in section.plots.items()
            ]
            for section in content.sections
        ]
    # Many pairs and methods share a scene, so the page holds each picture only once.
    pictures: dict[str, str] = {}
    of_data: dict[tuple[str, str], dict[str, str]] = {}
    cards = []
    for run, pair in one_by_one(content.pairs, on_pair):
        cards += _cards(run, pair, protocol, pictures, of_data)
    text = _TEMPLATES.get_template("report.html.jinja").render(
        content=content,
        plots=plots,
        pairs=cards,
        pictures={key: address for address, key in pictures.items()},
        filters=_filters(cards, content.methods),
        scales={"depth": scale("viridis"), "error": scale("PuOr")},
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
    """Return the card of a pair, or none without its depth map; add its pictures to `pictures`."""
    found = run.images(pair)
    if found is None:
        return []
    images, prediction = found
    known = images.depth.astype(np.float64)
    scale, errors = style.depth_scales(images.about, known)
    low, high = scale["vmin"], scale["vmax"]
    sharp, blurred = images.shown
    times = style.brightening(sharp)
    place = run.result.dataset.fingerprint, pair.id
    if place not in of_data:
        of_data[place] = {
            "infocus": webp_address(style.brightened(sharp, times), _PHOTO_QUALITY),
            "defocus": webp_address(style.brightened(blurred, times), _PHOTO_QUALITY),
            "truth": depth_picture(known, scale),
        }
    own = {
        "prediction": depth_picture(prediction.astype(np.float64), scale),
        "error": depth_picture(prediction - known, errors),
    }
    shown = {
        kind: pictures.setdefault(address, f"p{len(pictures)}")
        for kind, address in (of_data[place] | own).items()
    }
    height, width = images.depth.shape
    size = {"width": width, "height": height, "low": f"{low:.3g}", "high": f"{high:.3g}"}
    more = {"limit": f"{errors['vmax']:.3g} {images.about.kind}", "brighter": times}
    return [_texts(run, pair, protocol) | size | more | {"pictures": shown}]


def _texts(run: SavedRun, pair: PairResult, protocol: str) -> dict[str, Any]:
    coordinates = {axis: str(value) for axis, value in pair.coordinates.items()}
    return {
        "name": pair.id,
        "method": run.label,
        "places": {"method": run.label, "scene": pair.scene, **coordinates},
        "scores": titled_scores(pair, protocol, "undefined"),
        "seconds": SCORED if pair.seconds is None else f"{seconds_text(pair.seconds)} s",
    }


def _filters(cards: Sequence[dict[str, Any]], methods: Sequence[str]) -> dict[str, list[str]]:
    found = grouped(place for card in cards for place in card["places"].items())
    values = {name: sorted({*some}, key=lambda v: (len(v), v)) for name, some in found.items()}
    values["method"] = [*methods]  # best first
    return {name: some for name, some in values.items() if len(some) > 1}


def depth_picture(depth: NDArray[np.float64], scale: Mapping[str, Any]) -> str:
    """Return depth or its error, shape (y, x), NaN where unknown, as a coloured data URL."""
    low, high = scale["vmin"], scale["vmax"]
    return _coloured((depth - low) / (high - low), scale["cmap"], np.isnan(depth))


def scale(name: str) -> str:
    """Return a colour map's scale, low to high, as a data URL."""
    return _coloured(np.tile(np.linspace(0, 1, 256), (8, 1)), name, np.zeros((8, 256), bool))


def inline_svg(figure: Figure, name: str) -> str:
    """Return a figure as SVG for HTML, in the page's text colour.

    `name` is for readers who cannot see it, and is unique on the page.
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
    """Return the matplotlib settings for drawing figures for `inline_svg`."""
    names = ["text.color", "axes.labelcolor", "axes.edgecolor", "axes.titlecolor", "xtick.color"]
    names += ["ytick.color", *(f"boxplot.{part}props.color" for part in ("box", "whisker", "cap"))]
    return {**dict.fromkeys(names, _INK), "legend.facecolor": "none", "font.family": "sans-serif"}


def _coloured(value: NDArray[np.float64], name: str, unknown: NDArray[np.bool_]) -> str:
    known = np.clip(np.where(unknown, 0.0, value), 0, 1)
    image = np.asarray(mpl.colormaps[name](known, bytes=True))[..., :3].copy()
    image[unknown] = _UNKNOWN
    return webp_address(image, _MAP_QUALITY)


_MARKDOWN_PAGE = "report.md"
_WORST = 6


def write_markdown(
    runs: Sequence[SavedRun], protocol: str, folder: Path, also: Sequence[str] = ()
) -> Path:
    """Write a report on runs into a folder as ``report.md`` with PNG files; return its path.

    `also` names further formats of the plots, "pdf" and "svg".
    """
    folder.mkdir(parents=True, exist_ok=True)
    content = gather(runs, protocol, folder)
    plots = write_plots(content, folder, ("png", *also))
    text = _TEMPLATES.get_template("report.md.jinja").render(
        content=content, plots=plots, panels=_panels(content, folder)
    )
    path = folder / _MARKDOWN_PAGE
    write_whole(path, text.rstrip("\n") + "\n")
    return path


def _panels(content: Content, folder: Path) -> list[tuple[str, str]]:
    runs = {run.path: run for run, _ in content.pairs}
    drawn = []
    for number, run in enumerate(runs.values(), 1):
        worst = tuple(pair for of, pair in content.pairs if of is run)[:_WORST]
        figure = panel_figure(run, worst, content.protocol, "worst")
        if figure is not None:
            file = f"worst-{number}.png"
            style.write_figure(figure, folder / file)
            drawn.append((run.label, file))
    return drawn
