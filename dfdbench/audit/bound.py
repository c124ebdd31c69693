"""The least error that the blur allows: Cramér and Rao's bound under a law fitted on training."""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.law import BlurLaw
from dfdbench.blur.recipe import LAST_LEVEL, LEVELS
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest import Manifest, Pair
from dfdbench.errors import InputError
from dfdbench.methods.calibration import calibrate
from dfdbench.methods.choices import depth_shares
from dfdbench.methods.fitted import evenly_spread
from dfdbench.methods.law_cost import blurred_by, information_at
from dfdbench.methods.method import TrainingPair
from dfdbench.results.record import Result
from dfdbench.results.wording import NOTHING
from dfdbench.tables.table import Table

SCHEMA_VERSION = 1
#: Sides in pixels of the windows that a method may judge a pixel by.
WINDOWS = (1, 7, 21)
#: The one that is drawn: as local methods have it.
DRAWN = 7
#: The protocol whose NRMSE the bound is one of.
PROTOCOL, METRIC = "valid", "nrmse"
_NOTES = (
    "W x W: the least NRMSE (protocol `valid`) of any method that judges a pixel by the W x W "
    "pixels around it; below, that bound as a part of a run's NRMSE",
    "assumed: normal noise, independent from pixel to pixel, and blur as fitted on training; the "
    "shape of the depth in the window known, but not how far it is; depths spread as in training",
    "above 1: the run looks farther than the window, or rounding tells more than such noise would",
)


@dataclass(frozen=True)
class Known:
    """What is known before a pixel is looked at, measured on training captures.

    Parameters
    ----------
    law : BlurLaw
        How defocus images come about.
    spread : float
        Standard deviation of the depths of training, in levels.
    """

    law: BlurLaw
    spread: float

    @classmethod
    def measured(cls, captures: Sequence[TrainingPair]) -> "Known":
        """Measure it on training captures; each weighs the same in the spread."""
        few = [captures[index] for index in evenly_spread(len(captures))]
        shares = depth_shares(few).mean(axis=0)
        levels = np.arange(LEVELS)
        mean = np.average(levels, weights=shares)
        spread = math.sqrt(np.average(np.square(levels - mean), weights=shares))
        return cls(calibrate(captures).law, spread)

    def bound(self, capture: TrainingPair) -> "Bound":
        """Return the bound of a capture, at its true depth."""
        blurred = blurred_by(self.law, capture.infocus, capture.defocus)
        told = information_at(blurred, capture.levels.astype(np.intp))
        return Bound(np.where(capture.valid, told, 0), capture.valid, self.spread)


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
        over depths: where blur does not change evenly with the level, the true bound is higher.

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


def split_bounds(
    store: Dataset, split: str, known: Known, on_pair: Callable[[int, int], None]
) -> dict[Pair, Bound]:
    """Return the bound of each capture of a split; of stacks, of the two images for pairs.

    Raises
    ------
    InputError
        If the store holds no pair of the split, or a stack has no two images for pairs.
    """
    pairs = store.pairs(split)
    if not pairs:
        raise InputError(f"no pair of split {split}", where=str(store.path))
    found = {}
    for number, pair in enumerate(pairs, 1):
        found[pair] = known.bound(store.read(pair).two_of(store.manifest.pair_images))
        on_pair(number, len(pairs))
    return found


def bound_table(
    manifest: Manifest, split: str, found: Mapping[Pair, Bound], runs: Mapping[str, Result]
) -> Table:
    """Return the least NRMSE by window, the mean over captures, and runs beside it by name.

    A run's captures are those of the bound; a run that lacks a score has none here.
    """
    least = _means(found)
    rows = [("least error", NOTHING, *(f"{least[window]:.4f}" for window in WINDOWS))]
    errors = {name: _nrmse(result, found) for name, result in runs.items()}
    for name in sorted(errors, key=lambda name: errors[name]):
        error = errors[name]
        if not math.isnan(error):
            parts = (f"{least[window] / error:.2f}" if error else NOTHING for window in WINDOWS)
            rows.append((name, f"{error:.4f}", *parts))
    columns = ("", "NRMSE ↓", *(f"{window} x {window}" for window in WINDOWS))
    title = f"the least error that blur allows in {manifest.label}, {split}"
    return Table(title, columns, tuple(rows), "l" + "r" * (len(columns) - 1), _NOTES)


def bound_as_json(
    manifest: Manifest, fingerprint: str, known: Known, found: Mapping[Pair, Bound]
) -> str:
    """Return the least NRMSE of each capture by window as JSON."""
    content = {
        "format": "dfdbench bound",
        "schema_version": SCHEMA_VERSION,
        "dataset": manifest.stem,
        "fingerprint": fingerprint,
        "spread": known.spread,
        "law": known.law.as_dict(),
        "rows": [
            {"pair": pair.id, **{str(window): _or_none(n) for window, n in bound.nrmse.items()}}
            for pair, bound in found.items()
        ],
    }
    return json.dumps(content, indent=1, allow_nan=False) + "\n"


def _means(found: Mapping[Pair, Bound]) -> dict[int, float]:
    numbers = [bound.nrmse for bound in found.values() if bound.valid.any()]
    return {
        window: math.fsum(n[window] for n in numbers) / len(numbers) if numbers else math.nan
        for window in WINDOWS
    }


def _nrmse(result: Result, found: Mapping[Pair, Bound]) -> float:
    wanted = {pair.id for pair in found}
    scores = [pair.scores.get(PROTOCOL, {}) for pair in result.pairs if pair.id in wanted]
    values = [score for each in scores if (score := each.get(METRIC)) is not None]
    return math.fsum(values) / len(values) if len(values) == len(wanted) else math.nan


def _or_none(number: float) -> float | None:
    return None if math.isnan(number) else number
