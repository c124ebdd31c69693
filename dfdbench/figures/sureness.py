"""A figure of how sure methods are: error against density, and truths within their intervals."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy import special

from dfdbench.figures import style
from dfdbench.metrics.protocol import SURE
from dfdbench.metrics.sureness import Errors, error_curve, squared_errors
from dfdbench.results.record import PairResult
from dfdbench.results.run_folder import read_prediction
from dfdbench.results.saved_run import SavedRun

_DENSITIES = np.arange(2, 101, 2) / 100
_INTERVALS = np.arange(5, 100, 5) / 100

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Curves:
    """A method's lines in `sureness_figure`, each a mean over its pairs.

    Parameters
    ----------
    label : str
        The method's name.
    errors, least : ndarray of float64, shape (density,)
        NRMSE of the surest 2 %, 4 % and so on of the known pixels, and of those with the smallest
        errors; NaN if a pair has too few answers.
    held : ndarray of float64, shape (interval,), or None
        The share of truths within the intervals of 5 %, 10 % and so on to 95 % of a Gaussian; None
        if no pair has a sigma.
    """

    label: str
    errors: Floats
    least: Floats
    held: Floats | None


def curves_of(run: SavedRun, label: str) -> Curves | None:
    """Return the lines of a run, from the answers that it kept.

    Return None if the method does not say how sure it is, if no answer was kept, or without images.

    Parameters
    ----------
    run : SavedRun
        The run.
    label : str
        The method's name.
    """
    if run.store is None or SURE not in run.result.protocol_names:
        return None
    errors, least, held = [], [], []
    for record in run.result.evaluated:
        found = _errors(run, record)
        if found is None or not found.squares.size:
            continue
        order = np.zeros(found.squares.size) if found.sigma is None else found.sigma
        errors.append(_curve(found, order))
        least.append(_curve(found, found.squares))
        if found.sigma is not None:
            ratios = np.sort(np.sqrt(found.squares) / found.sigma)
            reach = special.ndtri((1 + _INTERVALS) / 2)
            held.append(np.searchsorted(ratios, reach, side="right") / ratios.size)
    if not errors:
        return None
    whole = run.store.manifest.depth.span
    ours, best = (np.mean(lines, axis=0) / whole for lines in (errors, least))
    return Curves(label, ours, best, np.mean(held, axis=0) if held else None)


def _errors(run: SavedRun, record: PairResult) -> Errors | None:
    found = run.images(record)
    if found is None:
        return None
    images, depth = found
    shape, known = images.depth.shape, images.valid
    sigma = read_prediction(run.path.parent, images.pair, shape, "sigma")
    return squared_errors(np.where(known, images.truth, 0), depth, sigma, known)


def _curve(found: Errors, order: Floats) -> Floats:
    within = found.density >= _DENSITIES
    curve = np.full(_DENSITIES.shape, np.nan)
    if within.any():
        curve[within] = error_curve(found.squares, order, _DENSITIES[within] / found.density)
    return curve


def sureness_figure(methods: Sequence[Curves], title: str) -> Figure:
    """Draw error against density, one line per method, and the share of truths in each interval.

    Parameters
    ----------
    methods : sequence of Curves
        At least one, on the same data.
    title : str
        The data that they were run on.

    Examples
    --------
    >>> line = np.linspace(0.01, 0.05, 50)
    >>> figure = sureness_figure([Curves("mine", line, line / 2, None)], "demo-1")
    >>> [axis.get_title() for axis in figure.axes]
    ['error against density', 'truths within intervals']
    """
    figure = Figure(figsize=(10, 4.6), layout="constrained")
    figure.suptitle(title, fontsize=11)
    left, right = figure.subplots(1, 2)
    for number, method in enumerate(methods):
        look = {"color": style.COLOURS[number % len(style.COLOURS)]}
        label = style.plain_text(method.label)
        left.plot(100 * _DENSITIES, method.errors, label=label, **look)
        left.plot(100 * _DENSITIES, method.least, linestyle=":", **look)
        if method.held is not None:
            marker = style.MARKERS[number % len(style.MARKERS)]
            right.plot(100 * _INTERVALS, 100 * method.held, marker=marker, markersize=4, **look)
    right.plot([0, 100], [0, 100], color="0.6", linewidth=1)
    left.set_title("error against density", fontsize=10)
    left.set_xlabel("surest known pixels (%); dotted: those with the least errors")
    left.set(ylabel="NRMSE", xlim=(0, 100), ylim=(0, None))
    right.set_title("truths within intervals", fontsize=10)
    right.set(xlabel="interval of a Gaussian (%)", ylabel="truths within (%)")
    right.set(xlim=(0, 100), ylim=(0, 100))
    for axis in (left, right):
        axis.grid(alpha=0.3)
    style.legend_below(figure, left)
    return figure
