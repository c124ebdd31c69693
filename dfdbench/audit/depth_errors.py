"""How far runs are off at each true depth, beside a constant: where blur tells depth."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dfdbench.audit.depth_histogram import Mask
from dfdbench.audit.level_errors import LevelErrors, level_errors
from dfdbench.audit.level_ranges import range_text
from dfdbench.audit.run_errors import kept_predictions
from dfdbench.blur.recipe import LAST_LEVEL, LEVELS
from dfdbench.datasets.depth_scale import DepthScale
from dfdbench.datasets.store import Store
from dfdbench.errors import ResultError
from dfdbench.results.record import Result
from dfdbench.results.wording import NOTHING
from dfdbench.tables.table import Table
from dfdbench.tables.wording import percent

_BAND = 16


@dataclass(frozen=True)
class DepthErrors:
    """A run's errors by true depth, over all pixels of known depth of all its pairs.

    Parameters
    ----------
    name : str
        What tables and figures call the run.
    pairs : tuple of str
        The pairs.
    levels : LevelErrors
        Errors in levels.
    metres : LevelErrors or None
        The same in metres; None where nothing says what levels are in metres.
    answers : ndarray of int64, shape (256, 256)
        Pixels by true level and by predicted level, rounded.
    """

    name: str
    pairs: tuple[str, ...]
    levels: LevelErrors
    metres: LevelErrors | None
    answers: NDArray[np.int64]


def depth_errors(store: Store, result: Result, folder: Path, name: str) -> DepthErrors:
    """Read a run's predictions and sum their errors by true depth.

    Parameters
    ----------
    store : Store
        The data set that was run on.
    result : Result
        The run.
    folder : Path
        The run's folder, with its predictions.
    name : str
        What to call it.

    Raises
    ------
    ResultError
        As `dfdbench.audit.run_errors.kept_predictions` does.
    """
    found = kept_predictions(store, result, folder)
    return _summed(
        name,
        ((pair.id, depth, valid, answer) for pair, depth, valid, answer in found),
        store.manifest.depth.scale,
    )


def constant_errors(store: Store, result: Result, level: float, name: str) -> DepthErrors:
    """Return the errors that one level everywhere makes on the pairs of a run.

    Parameters
    ----------
    store : Store
        The data set that was run on.
    result : Result
        The run.
    level : float
        The depth level.
    name : str
        What to call it.
    """
    evaluated = [pair for pair in result.pairs if pair.status == "ok"]
    depths = ((pair.id, *store.read_depth(pair.pair)) for pair in evaluated)
    return _summed(
        name,
        (
            (id_, depth, valid, np.full(depth.shape, level, np.float32))
            for id_, depth, valid in depths
        ),
        store.manifest.depth.scale,
    )


def depth_error_tables(store: Store, split: str, found: Sequence[DepthErrors]) -> list[Table]:
    """Return the mean absolute error by depth, a column a run: in levels, and in metres if told.

    Parameters
    ----------
    store : Store
        The data set that was run on.
    split : str
        The split.
    found : sequence of DepthErrors
        The runs, all of the same pairs.

    Raises
    ------
    ResultError
        Where they are of different pairs.
    """
    first = found[0]
    for other in found[1:]:
        if set(other.pairs) != set(first.pairs):
            raise ResultError(
                "the runs are of different pairs",
                where=f"{first.name}, {other.name}",
                expected=f"{len(first.pairs)} pairs of split {split}",
                got=f"{len(set(first.pairs) & set(other.pairs))} of them in both",
                fix="compare runs of one split, both complete",
            )
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
        told = np.clip(np.rint(prediction[valid]), 0, LAST_LEVEL).astype(np.int64)
        answers += np.bincount(
            depth[valid].astype(np.int64) * LEVELS + told, minlength=LEVELS * LEVELS
        )
    return DepthErrors(
        name,
        tuple(ids),
        LevelErrors.total(levels),
        LevelErrors.total(metres) if scale is not None else None,
        answers.reshape(LEVELS, LEVELS),
    )


def _table(
    title: str, errors: dict[str, LevelErrors], scale: DepthScale | None, note: str, form: str
) -> Table:
    pixels = next(iter(errors.values()))
    bands = [_band(first, first + _BAND - 1) for first in range(0, LEVELS, _BAND)]
    rows = [
        (
            range_text(int(there[0]), int(there[-1])),
            *([_metres(there, scale)] if scale else []),
            percent(pixels.share(band)),
            *(_number(one.mean(band), form) for one in errors.values()),
        )
        for band in bands
        if (there := np.flatnonzero(band & (pixels.pixels > 0))).size
    ]
    whole = np.ones(LEVELS, bool)
    overall = (
        "all",
        *([""] if scale else []),
        percent(1.0),
        *(_number(one.mean(whole), form) for one in errors.values()),
    )
    return Table(
        title,
        ("levels", *(["metres"] if scale else []), "of all", *errors),
        (*rows, overall),
        "l" + "l" * bool(scale) + "r" * (1 + len(errors)),
        (note,),
        frozenset({len(rows) - 1}),
    )


def _band(first: int, last: int) -> Mask:
    inside = np.zeros(LEVELS, bool)
    inside[first : last + 1] = True
    return inside


def _metres(levels: NDArray[np.int64], scale: DepthScale) -> str:
    ends = sorted(float(end) for end in scale.to_metres(levels[[0, -1]]))
    return f"{ends[0]:.2f} to {ends[1]:.2f}"


def _number(value: float, form: str) -> str:
    return NOTHING if math.isnan(value) else form.format(value)
