"""The least error that the blur allows: Cramér and Rao's bound under a law fitted on training."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.law import BlurLaw
from dfdbench.blur.recipe import LAST_LEVEL
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest import Manifest, Pair
from dfdbench.errors import InputError
from dfdbench.methods.blurred import blurred_by, information_at
from dfdbench.methods.calibration import calibrate
from dfdbench.methods.method import TrainingPair
from dfdbench.results.record import Result
from dfdbench.results.wording import NOTHING
from dfdbench.system.parallel import one_by_one
from dfdbench.system.text import as_json
from dfdbench.tables.table import Table

#: Sides in pixels of the windows that a method may judge a pixel by.
WINDOWS = (1, 7, 21)
#: The one that is drawn: as local methods have it.
DRAWN = 7
#: The protocol whose NRMSE the bound is one of.
PROTOCOL, METRIC = "valid", "nrmse"
_NOTES = (
    "W x W: the least NRMSE (protocol `valid`) of any method that judges a pixel by the W x W "
    "pixels around it; below, that bound as a part of a run's; all of them root mean squares over "
    "captures, a little more than the means that boards show",
    "assumed: normal noise, independent from pixel to pixel, and blur as fitted on training; the "
    "shape of the depth in the window known, but not how far it is; how the test's depths are "
    "spread known, too",
    "above 1: the run looks farther than the window, or rounding tells more than such noise would",
)


@dataclass(frozen=True)
class Bound:
    """How well depth can be told in one capture.

    Parameters
    ----------
    told : ndarray of float64, shape (y, x)
        What each pixel tells of its level, as of `information_at`; 0 where depth is not known.
    valid : ndarray of bool, shape (y, x)
        True where the depth is known.
    spread : float
        Standard deviation of depths before anything is seen, in levels.
    """

    told: NDArray[np.float64]
    valid: NDArray[np.bool_]
    spread: float

    def least_error(self, window: int) -> NDArray[np.float64]:
        """Return the least root mean square error in levels, shape (y, x).

        Parameters
        ----------
        window : int
            Side in pixels of the square around a pixel that is looked at, odd.

        Notes
        -----
        Van Trees's bound, ``1 / sqrt(J + 1 / s^2)``: J is the window's information, the sum over
        its pixels, as if the shape of the depth were known and only its distance were not; s is
        the spread. It holds for biased estimates too, in the mean over depths spread so, and a
        window without texture leaves s. The information at the true depth stands for its mean
        over depths: where a wrong level far away looks alike, no method comes near the bound.

        Examples
        --------
        >>> told = np.array([[0.0, 0.03, 0.0]])
        >>> bound = Bound(told, told >= 0, spread=10.0)
        >>> bound.least_error(1).round(6).tolist(), bound.least_error(3).tolist()
        ([[10.0, 5.0, 10.0]], [[5.0, 5.0, 5.0]])
        """
        size = (window, window)
        sums = cv2.boxFilter(self.told, -1, size, normalize=False, borderType=cv2.BORDER_CONSTANT)
        # Running sums leave less than nothing where there is nothing.
        return np.asarray(1 / np.sqrt(np.maximum(sums, 0) + 1 / self.spread**2))

    @cached_property
    def nrmse(self) -> dict[int, float]:
        """The least root mean square over known pixels by window, as a part of 255 levels."""
        if not self.valid.any():
            return dict.fromkeys(WINDOWS, math.nan)
        return {
            window: math.sqrt(np.square(self.least_error(window)[self.valid]).mean()) / LAST_LEVEL
            for window in WINDOWS
        }


def bound_of(law: BlurLaw, capture: TrainingPair, spread: float) -> Bound:
    """Return the bound of a capture under a law, at its true depth."""
    blurred = blurred_by(law, capture.infocus, capture.defocus)
    told = information_at(blurred, capture.levels.astype(np.intp))
    return Bound(np.where(capture.valid, told, 0), capture.valid, spread)


def split_bounds(
    store: Dataset,
    split: str,
    training: Sequence[TrainingPair],
    on_pair: Callable[[int, int], None],
) -> tuple[BlurLaw, dict[Pair, Bound]]:
    """Return the law of training pairs, and under it the bound of each capture of a split.

    Of stacks it is the bound of the two images for pairs.

    Raises
    ------
    InputError
        If the store holds no pair of the split with known depth, or a stack has no two images for
        pairs.
    """
    law = calibrate(training).law
    pairs = store.pairs(split)
    spread = _spread(store, pairs)
    found = {}
    for pair in one_by_one(pairs, on_pair):
        capture = store.read(pair).two_of(store.manifest.pair_images)
        found[pair] = bound_of(law, capture, spread)
    return law, found


def _spread(store: Dataset, pairs: Sequence[Pair]) -> float:
    """Return the standard deviation of depth levels, each capture weighing the same."""
    moments = []
    for pair in pairs:
        levels, valid = store.read_levels(pair)
        if valid.any():
            known = levels[valid].astype(np.float64)
            moments.append((known.mean(), np.square(known).mean()))
    if not moments:
        raise InputError("no pair with known depth", where=str(store.path))
    mean, square = np.mean(moments, axis=0)
    # A set of one depth only: still unknown within a level.
    return max(math.sqrt(max(square - mean**2, 0)), 1.0)


def bound_table(
    manifest: Manifest, split: str, found: Mapping[Pair, Bound], runs: Mapping[str, Result]
) -> Table:
    """Return the least NRMSE by window, root mean squares over captures, and runs by name.

    A run's captures are those of the bound; a run that lacks a score of one is but named.
    """
    least = {
        window: _root_mean_square(
            [n for bound in found.values() if not math.isnan(n := bound.nrmse[window])]
        )
        for window in WINDOWS
    }
    rows = [("least error", NOTHING, *(f"{least[window]:.4f}" for window in WINDOWS))]
    errors = {name: _nrmse(result, found) for name, result in runs.items()}
    for name, error in sorted(errors.items(), key=lambda item: item[1]):
        if not math.isnan(error):
            parts = (f"{least[window] / error:.2f}" if error else NOTHING for window in WINDOWS)
            rows.append((name, f"{error:.4f}", *parts))
    lacking = [name for name, error in errors.items() if math.isnan(error)]
    left_out = (f"without a score of every capture, so left out: {', '.join(lacking)}",)
    columns = ("", "NRMSE ↓", *(f"{window} x {window}" for window in WINDOWS))
    title = f"the least error that blur allows in {manifest.label}, {split}"
    notes = _NOTES + left_out if lacking else _NOTES
    return Table(title, columns, tuple(rows), "l" + "r" * (len(columns) - 1), notes)


def bound_as_json(
    manifest: Manifest, fingerprint: str, law: BlurLaw, found: Mapping[Pair, Bound]
) -> str:
    """Return the least NRMSE of each capture by window as JSON."""
    return as_json(
        "bound",
        dataset=manifest.stem,
        fingerprint=fingerprint,
        law=law.as_dict(),
        spread=next(iter(found.values())).spread,
        rows=[
            {"pair": pair.id} | {str(w): n for w, n in bound.nrmse.items()}
            for pair, bound in found.items()
        ],
    )


def _nrmse(result: Result, found: Mapping[Pair, Bound]) -> float:
    wanted = {pair.id for pair in found}
    scores = [pair.scores.get(PROTOCOL, {}) for pair in result.pairs if pair.id in wanted]
    values = [score for each in scores if (score := each.get(METRIC)) is not None]
    return _root_mean_square(values) if len(values) == len(wanted) else math.nan


def _root_mean_square(values: Sequence[float]) -> float:
    return math.sqrt(np.square(values).mean()) if values else math.nan
