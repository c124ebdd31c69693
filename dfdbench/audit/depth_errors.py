"""Tables by true depth: how often each level occurs, and how far runs are off at it."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dfdbench.audit.run_errors import LevelErrors, kept_predictions, level_errors
from dfdbench.audit.sides import Mask, Side, as_ranges, range_text
from dfdbench.blur.recipe import LAST_LEVEL, LEVELS
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.depth_scale import DepthScale
from dfdbench.errors import ResultError
from dfdbench.results.record import Result
from dfdbench.results.wording import NOTHING
from dfdbench.tables.table import Table, counted, percent

_BAND = 16
_BANDS = np.arange(LEVELS).reshape(-1, _BAND)


def level_count_table(side: Side) -> Table:
    """Return how often levels occur: 16 levels a row, each by itself in the records."""
    histogram = side.histogram
    counts, known = histogram.counts, histogram.known
    rows = []
    for band in _BANDS:
        pixels = int(counts[band].sum())
        absent = np.isin(np.arange(LEVELS), band) & (counts == 0)
        gaps = "all" if not pixels else as_ranges(absent) or NOTHING
        rows.append((f"{band[0]}-{band[-1]}", f"{pixels:,}", percent(pixels / known), gaps))
    notes = [
        f"{known:,} pixels of known depth; unknown, and left out, are "
        f"{percent(histogram.unknown / (known + histogram.unknown))} of all",
        "pixels: each depth map once for each of its pairs in the manifest; the level "
        f"grows with {side.store.manifest.depth.grows_with}",
        "--format csv and --format json have each level by itself",
    ]
    if side.absent:
        notes.append(f"not in the store, so not counted: {', '.join(side.absent)}")
    scenes = counted(len(side.scenes), "scene")
    return Table(
        f"depths of {side.label}, {side.name} ({counted(histogram.pairs, 'pair')} of {scenes})",
        ("levels", "pixels", "share", "do not occur"),
        tuple(rows),
        "lrrl",
        tuple(notes),
        records=tuple(
            {"level": level, "pixels": int(count), "share": int(count) / known}
            for level, count in enumerate(counts)
        ),
    )


@dataclass(frozen=True)
class DepthErrors:
    """A run's errors by true depth, over all pixels of known depth of all its pairs.

    Parameters
    ----------
    name : str
        The run's name in tables and figures.
    pairs : tuple of str
        The pairs.
    levels : LevelErrors
        Errors in levels.
    metres : LevelErrors or None
        The same in metres; None if the manifest does not say what levels are in metres.
    answers : ndarray of int64, shape (256, 256)
        Pixels by true level and by predicted level, rounded.
    """

    name: str
    pairs: tuple[str, ...]
    levels: LevelErrors
    metres: LevelErrors | None
    answers: NDArray[np.int64]


def depth_errors(store: Dataset, result: Result, folder: Path, name: str) -> DepthErrors:
    """Sum a run's errors by true depth.

    Raises
    ------
    ResultError
        As by `dfdbench.audit.run_errors.kept_predictions`.
    """
    found = kept_predictions(store, result, folder)
    pairs = ((pair.id, depth, valid, answer) for pair, depth, valid, answer in found)
    return _summed(name, pairs, store.manifest.depth.scale)


def constant_errors(store: Dataset, result: Result, level: float, name: str) -> DepthErrors:
    """Return the errors that one level everywhere makes on the pairs of a run."""
    evaluated = [pair for pair in result.pairs if pair.status == "ok"]
    depths = ((pair.id, *store.read_levels(pair.pair)) for pair in evaluated)
    pairs = (
        (i, depth, valid, np.full(depth.shape, level, np.float32)) for i, depth, valid in depths
    )
    return _summed(name, pairs, store.manifest.depth.scale)


def _summed(
    name: str,
    pairs: Iterable[tuple[str, NDArray[np.uint8], Mask, NDArray[np.float32]]],
    scale: DepthScale | None,
) -> DepthErrors:
    ids, levels, metres = [], [], []
    answers = np.zeros(LEVELS * LEVELS, np.int64)
    for id_, depth, valid, prediction in pairs:
        ids.append(id_)
        levels.append(level_errors(depth, valid, prediction))
        if scale is not None:
            metres.append(level_errors(depth, valid, prediction, scale))
        answer = np.clip(np.rint(prediction[valid]), 0, LAST_LEVEL).astype(np.int64)
        answers += np.bincount(
            depth[valid].astype(np.int64) * LEVELS + answer, minlength=LEVELS * LEVELS
        )
    in_metres = LevelErrors.total(metres) if scale is not None else None
    total = LevelErrors.total(levels)
    return DepthErrors(name, tuple(ids), total, in_metres, answers.reshape(LEVELS, LEVELS))


def depth_error_tables(store: Dataset, split: str, found: Sequence[DepthErrors]) -> list[Table]:
    """Return the mean absolute error by depth, a column a run: in levels, and in metres if known.

    Raises
    ------
    ResultError
        If the runs are of different pairs.
    """
    first = found[0]
    for other in found[1:]:
        if set(other.pairs) != set(first.pairs):
            where, fix = f"{first.name}, {other.name}", f"compare complete runs of split {split}"
            raise ResultError("the runs are of different pairs", where=where, fix=fix)
    what = f"mean absolute error by depth, {store.manifest.label}, split {split}"
    note = (
        "over the pixels of known depth of all pairs together, by their true depth; the level "
        f"grows with {store.manifest.depth.grows_with}"
    )
    scale = store.manifest.depth.scale
    errors = {one.name: one.levels for one in found}
    tables = [_table(f"{what}, in levels", errors, scale, note, "{:.2f}")]
    if scale is not None:
        metres = {one.name: one.metres for one in found if one.metres is not None}
        tables.append(_table(f"{what}, in metres", metres, scale, note, "{:.3f}"))
    return tables


def _table(
    title: str, errors: dict[str, LevelErrors], scale: DepthScale | None, note: str, form: str
) -> Table:
    def means(levels: Mask) -> list[str]:
        found = [one.mean(levels) for one in errors.values()]
        return [NOTHING if math.isnan(mean) else form.format(mean) for mean in found]

    first = next(iter(errors.values()))
    rows: list[tuple[str, ...]] = []
    for band in _BANDS:
        if (there := band[first.pixels[band] > 0]).size:
            inside = np.isin(np.arange(LEVELS), band)
            metres = [_metres(there, scale)] if scale else []
            levels = range_text(int(there[0]), int(there[-1]))
            rows.append((levels, *metres, percent(first.share(inside)), *means(inside)))
    whole = np.ones(LEVELS, bool)
    return Table(
        title,
        ("levels", *(["metres"] if scale else []), "of all", *errors),
        (*rows, ("all", *([""] if scale else []), percent(1.0), *means(whole))),
        "l" + "l" * bool(scale) + "r" * (1 + len(errors)),
        (note,),
        frozenset({len(rows) - 1}),
    )


def _metres(levels: NDArray[np.int64], scale: DepthScale) -> str:
    near, far = sorted(float(end) for end in scale.to_metres(levels[[0, -1]]))
    return f"{near:.2f} to {far:.2f}"
