"""Measure how hard a test is: the smallest depth step its blur shows, the least possible error."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from dfdbench.audit.sides import depth_maps
from dfdbench.blur.law import BlurLaw
from dfdbench.blur.recipe import LAST_LEVEL, LEVELS, BlurRecipe
from dfdbench.blur.synthesis import synthesize
from dfdbench.datasets.captures import Capture
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest import Depth, Manifest, Pair
from dfdbench.errors import InputError
from dfdbench.methods.blurred import blurred_by, information_at
from dfdbench.methods.calibration import calibrate
from dfdbench.methods.method import TrainingPair
from dfdbench.results.record import Result
from dfdbench.results.wording import NOTHING
from dfdbench.system.parallel import OnDone, one_by_one
from dfdbench.system.text import as_json
from dfdbench.tables.table import Table, grouped, percent

#: A useful depth difference: an eighth of the range that 256 levels span.
COARSE = 32
#: The steps tried, in depth levels.
STEPS = (1, 2, 4, 8, 16, 32, 64, 128)
#: Means that no step is visible.
UNSEEN = LEVELS
_SEEN = (
    "a step is seen where the defocus pixel, as stored in whole grey levels, differs in some "
    "channel by more than {noise} grey levels at the level that much nearer and at the level that "
    "much farther"
)


@dataclass(frozen=True)
class Difficulty:
    """What a pair's blur shows of its depth.

    Parameters
    ----------
    step : ndarray of int64, shape (y, x)
        The smallest of `STEPS` that is visible, nearer and farther; or `UNSEEN`.
    valid : ndarray of bool, shape (y, x)
        True where the depth is known; only these pixels count.
    """

    step: NDArray[np.int64]
    valid: NDArray[np.bool_]

    def share_above(self, step: int) -> float:
        """Return the share of known pixels that need a larger step than this one.

        For step 1: pixels whose blur does not show the difference between neighbouring levels.
        """
        return float((self.step[self.valid] > step).mean()) if self.valid.any() else float("nan")


def median_step(parts: Sequence[Difficulty]) -> int | None:
    """Return the median step over the known pixels of some pairs.

    It is one of `STEPS`, or `UNSEEN` if no step is visible for most pixels; None without known
    pixels.
    """
    steps = np.concatenate([part.step[part.valid] for part in parts])
    return int(np.percentile(steps, 50, method="inverted_cdf")) if steps.size else None


def smallest_step(
    infocus: NDArray[np.uint8],
    depth: NDArray[np.uint8],
    valid: NDArray[np.bool_],
    recipe: BlurRecipe,
    noise: int = 0,
) -> Difficulty:
    """Find the smallest level step that each pixel's blur shows.

    The in-focus image is blurred at each pixel's own level and at levels a step nearer and farther.
    A step is visible if the defocus pixel, as stored in whole grey levels, differs from both in
    some channel by more than the noise. At the ends of the scale only one of the two exists.

    Parameters
    ----------
    infocus : ndarray of uint8, shape (y, x, 3)
        The in-focus image.
    depth : ndarray of uint8, shape (y, x)
        Depth levels in the recipe's sense, brighter for nearer.
    valid : ndarray of bool, shape (y, x)
        True where the depth is known.
    recipe : BlurRecipe
        How the defocus image was made.
    noise : int
        How many grey levels a difference must exceed; by default any difference counts.

    Raises
    ------
    InputError
        If noise is not a whole number of at least 0.

    Notes
    -----
    In a synthetic pair each defocus pixel is made from the in-focus image and its own depth alone
    (Eq. 3.1 to 3.4). So a step that is not visible here is in no pixel of the pair: a method can
    only guess it from the depth around. Both sides must differ: a level that looks like one of its
    neighbours cannot be told apart from it.

    Examples
    --------
    >>> from dfdbench.blur import RECIPES
    >>> flat = np.full((30, 30, 3), 90, np.uint8)
    >>> depth = np.full((30, 30), 120, np.uint8)
    >>> smallest_step(flat, depth, depth > 0, RECIPES["published"]).share_above(1)
    1.0
    """
    here = synthesize(infocus, depth, recipe).astype(np.int16)
    found = np.full(depth.shape, UNSEEN, np.int64)
    for step in STEPS:
        seen = np.ones(depth.shape, bool)
        tried = np.zeros(depth.shape, bool)
        for move in (-step, step):
            level = depth.astype(np.int64) + move
            inside = (level >= 0) & (level < recipe.levels)
            moved = np.where(inside, level, depth).astype(np.uint8)
            change = np.abs(synthesize(infocus, moved, recipe).astype(np.int16) - here).max(axis=2)
            seen &= ~inside | (change > noise)
            tried |= inside
        found[seen & tried & (found == UNSEEN)] = step
    return Difficulty(found, valid)


def split_difficulty(
    store: Dataset, split: str, noise: int, on_pair: OnDone
) -> dict[Pair, Difficulty]:
    """Find the smallest step that each pixel's blur shows, for each pair of a split.

    Raises
    ------
    InputError
        If no blur recipe is known.
    StoreError
        If the store holds no pair of the split, or a depth map is damaged.
    """
    manifest, recipe = store.manifest, store.recipe
    pairs = store.some_pairs(split)
    if recipe is None:
        why = "its track gives none" if manifest.on_track else "captured images"
        fix = "--bound fits the blur to the training pairs"
        raise InputError(f"no blur recipe is known: {why}", where=str(store.path), fix=fix)
    for scene in dict.fromkeys(pair.scene for pair in pairs):
        depth_maps(store, scene)
    found = {}
    for pair in one_by_one(pairs, on_pair):
        images = store.read(pair)
        found[pair] = smallest_step(images.infocus, images.levels, images.valid, recipe, noise)
    return found


def difficulty_rows(manifest: Manifest, found: Mapping[Pair, Difficulty]) -> list[dict[str, Any]]:
    """Return mean shares and median steps by scene and lighting, with the views combined."""
    lighting = _lighting(manifest)
    groups = grouped(
        ((pair.scene, tuple(pair.at[axis] for axis in lighting)), difficulty)
        for pair, difficulty in found.items()
    )
    return [
        {
            "scene": scene,
            **dict(zip(lighting, values, strict=True)),
            "neighbours": _mean([d.share_above(STEPS[0]) for d in group]),
            "coarse": _mean([d.share_above(COARSE) for d in group]),
            "median_step": median_step(group),
        }
        for (scene, values), group in groups.items()
    ]


def difficulty_table(
    manifest: Manifest, split: str, rows: list[dict[str, Any]], noise: int
) -> Table:
    """Return the rows as a table."""
    lighting = _lighting(manifest)
    columns = ("scene", *lighting, "1 apart", f"{COARSE} apart", "median step")
    cells = tuple(
        (
            str(row["scene"]),
            *(str(row[axis]) for axis in lighting),
            _percent(row["neighbours"]),
            _percent(row["coarse"]),
            _step(row["median_step"]),
        )
        for row in rows
    )
    notes = (
        f"1 apart, {COARSE} apart: share of the pixels whose blur cannot tell levels that far "
        "from each other",
        _SEEN.format(noise=noise),
        "steps tried: " + ", ".join(map(str, STEPS)),
    )
    title = f"what blur does not show of depth in {manifest.label}, {split}"
    return Table(title, columns, cells, "l", notes)


def difficulty_as_json(
    manifest: Manifest, fingerprint: str, noise: int, rows: list[dict[str, Any]]
) -> str:
    """Return the rows as JSON."""
    return as_json(
        "difficulty",
        dataset=manifest.stem,
        fingerprint=fingerprint,
        noise=noise,
        steps=STEPS,
        coarse_step=COARSE,
        rows=[
            row | {"median_step": None if row["median_step"] == UNSEEN else row["median_step"]}
            for row in rows
        ],
    )


def _lighting(manifest: Manifest) -> list[str]:
    return [axis for axis in manifest.axes if axis not in manifest.depth.axes]


def _mean(values: list[float]) -> float:
    defined = [value for value in values if not math.isnan(value)]
    return math.fsum(defined) / len(defined) if defined else math.nan


def _percent(value: float) -> str:
    return NOTHING if math.isnan(value) else percent(value)


def _step(value: int | None) -> str:
    return NOTHING if value is None else "none" if value == UNSEEN else str(value)


#: Sides in pixels of the windows from which a method may judge a pixel.
WINDOWS = (1, 7, 21)
#: The window that figures show, typical of local methods.
DRAWN = 7
#: The bound is an NRMSE under this protocol.
PROTOCOL, METRIC = "valid", "nrmse"
_NOTES = (
    "W x W: the least NRMSE (protocol `valid`) of any method that {given}judges a pixel by the "
    "W x W pixels around it; {run}all of them root mean squares over captures, a little more than "
    "the means that boards show",
    "assumed: normal noise, independent from pixel to pixel, and blur as fitted on training; the "
    "shape of the depth in the window known, but not how far it is; depths normally distributed, "
    "with the test's spread",
    "above 1: the run {sees}looks farther than the window or knows more of the depths than their "
    "spread, or rounding tells more than such noise would",
)


@dataclass(frozen=True)
class Bound:
    """How precisely one capture determines depth.

    Parameters
    ----------
    told : ndarray of float64, shape (y, x)
        Each pixel's information on its depth, from `information_at`; 0 if the depth is unknown.
        As below, a level is a 255th of the set's range: of metres, if it is in metres.
    valid : ndarray of bool, shape (y, x)
        True where the depth is known.
    spread : float
        Standard deviation of depths before seeing anything, in levels.
    """

    told: NDArray[np.float64]
    valid: NDArray[np.bool_]
    spread: float

    def least_error(self, window: int) -> NDArray[np.float64]:
        """Return the least root mean square error in levels, shape (y, x).

        Parameters
        ----------
        window : int
            Side in pixels of the square around a pixel that a method sees, odd.

        Notes
        -----
        ``1 / sqrt(J + 1 / s^2)``, van Trees's bound if depths are normally distributed with spread
        s. J is the window's information, the sum over its pixels, as if the shape of the depth were
        known and only its distance were not. It also holds for biased estimates, in the mean over
        depths; a window without texture leaves s. Of all distributions of that spread the normal
        one says least: who knows that there are two depths only may do better. We use the
        information at the true depth in place of its mean over depths: if a wrong level far away
        looks alike, no method comes near the bound.

        Examples
        --------
        >>> told = np.array([[0.0, 0.03, 0.0]])
        >>> bound = Bound(told, told >= 0, spread=10.0)
        >>> bound.least_error(1).round(6).tolist(), bound.least_error(3).tolist()
        ([[10.0, 5.0, 10.0]], [[5.0, 5.0, 5.0]])
        """
        size = (window, window)
        sums = cv2.boxFilter(self.told, -1, size, normalize=False, borderType=cv2.BORDER_CONSTANT)
        # Running sums may round to slightly below 0.
        return np.asarray(1 / np.sqrt(np.maximum(sums, 0) + 1 / self.spread**2))

    @cached_property
    def nrmse(self) -> dict[int, float]:
        """By window, the root mean square of the least error over known pixels, divided by 255."""
        if not self.valid.any():
            return dict.fromkeys(WINDOWS, math.nan)
        return {
            window: math.sqrt(np.square(self.least_error(window)[self.valid]).mean()) / LAST_LEVEL
            for window in WINDOWS
        }


def bound_of(law: BlurLaw, capture: Capture, spread: float) -> Bound:
    """Return the bound of a capture under a law, at its true depth."""
    blurred = blurred_by(law, capture.infocus, capture.defocus)
    told = information_at(blurred, capture.levels.astype(np.intp))
    # Level 0 is no depth, and as far as level 1.
    steps = np.gradient(_scored(capture.about)[1:])
    told = told / np.square(np.r_[steps[0], steps][capture.levels])
    return Bound(np.where(capture.valid, told, 0), capture.valid, spread)


def split_bounds(
    store: Dataset, split: str, training: Sequence[TrainingPair], on_pair: OnDone
) -> tuple[BlurLaw, dict[Pair, Bound]]:
    """Return the law of training pairs and, under this law, the bound of each capture of a split.

    For stacks, it is the bound of the two images for pairs.

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


def _scored(about: Depth) -> NDArray[np.float64]:
    """Return each level's depth in 255ths of the set's range: metres are not linear in levels."""
    levels = np.arange(LEVELS, dtype=np.float64)
    if about.kind == "levels" or about.scale is None:
        return levels
    return about.scale.to_metres(levels) * LAST_LEVEL / about.span


def _spread(store: Dataset, pairs: Sequence[Pair]) -> float:
    """Return the standard deviation of depths, with equal weight for each capture."""
    moments = []
    for pair in pairs:
        levels, valid = store.read_levels(pair)
        if valid.any():
            known = _scored(store.manifest.depth)[levels[valid]]
            moments.append((known.mean(), np.square(known).mean()))
    if not moments:
        raise InputError("no pair with known depth", where=str(store.path))
    mean, square = np.mean(moments, axis=0)
    # Even in a set with one depth only, the depth within a level is unknown.
    return max(math.sqrt(max(square - mean**2, 0)), 1.0)


def bound_table(
    manifest: Manifest, split: str, found: Mapping[Pair, Bound], runs: Mapping[str, Result]
) -> Table:
    """Return the least NRMSE by window, root mean squares over captures, and runs by name.

    Runs are scored on the bound's captures; a run that lacks a score on any is only named.
    """
    least = {
        window: _root_mean_square(
            [n for bound in found.values() if not math.isnan(n := bound.nrmse[window])]
        )
        for window in WINDOWS
    }
    beside = [NOTHING] * bool(runs)
    rows = [("least error", *beside, *(f"{least[window]:.4f}" for window in WINDOWS))]
    errors = {name: _nrmse(result, found) for name, result in runs.items()}
    for name, error in sorted(errors.items(), key=lambda item: item[1]):
        if not math.isnan(error):
            parts = (f"{least[window] / error:.2f}" if error else NOTHING for window in WINDOWS)
            rows.append((name, f"{error:.4f}", *parts))
    lacking = [name for name, error in errors.items() if math.isnan(error)]
    left_out = (f"without a score of every capture, so left out: {', '.join(lacking)}",)
    columns = ("", *["NRMSE ↓"] * bool(runs), *(f"{window} x {window}" for window in WINDOWS))
    title = f"the least error that blur allows in {manifest.label}, {split}"
    given = f"is given the two images pair_images = {manifest.pair_images} alone and "
    words = {"given": given, "sees": "is given more images, "} if manifest.pair_images else {}
    words["run"] = "below, that bound as a part of a run's; " * bool(runs)
    told = _NOTES if runs else _NOTES[:-1]
    notes = tuple(note.format_map({"given": "", "sees": ""} | words) for note in told)
    notes = notes + left_out if lacking else notes
    return Table(title, columns, tuple(rows), "l", notes)


def bound_as_json(
    manifest: Manifest, fingerprint: str, law: BlurLaw, found: Mapping[Pair, Bound]
) -> str:
    """Return the least NRMSE of each capture, by window, as JSON."""
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
    scores = [pair.score(PROTOCOL, METRIC) for pair in result.pairs if pair.id in wanted]
    values = [score for score in scores if score is not None]
    return _root_mean_square(values) if len(values) == len(wanted) else math.nan


def _root_mean_square(values: Sequence[float]) -> float:
    return math.sqrt(np.square(values).mean()) if values else math.nan
