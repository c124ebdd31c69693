"""Split a run's errors by covered, scarce and missing level: is it the data or the method."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dfdbench.audit.coverage import CoverageRecord, Verdict, leak_text
from dfdbench.audit.sides import Mask, Side, as_ranges, field_sums, range_text
from dfdbench.audit.trained_on import Training
from dfdbench.blur.recipe import LAST_LEVEL, LEVELS
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.depth_scale import DepthScale
from dfdbench.datasets.manifest import Pair
from dfdbench.errors import ResultError
from dfdbench.results.record import PairResult, Result
from dfdbench.results.run_folder import answer_digest, read_prediction, require_pairs_of
from dfdbench.results.wording import NOTHING
from dfdbench.system.text import as_json
from dfdbench.tables.table import Table, counted, grouped, listed, percent

#: An evaluated pair, its depth, a mask of known and answered pixels, and the answer; in levels that
#: are not rounded.
Told = tuple[PairResult, NDArray[np.float32], Mask, NDArray[np.float32]]
#: Below this share of the error, uncovered levels are not the cause.
_SMALL = 0.1
WHOLE = np.ones(LEVELS, bool)


@dataclass(frozen=True)
class LevelErrors:
    """Sums over pixels by their true level, for means over any set of levels.

    Parameters
    ----------
    pixels : ndarray of int64, shape (256,)
        Known pixels of each level.
    absolute, squared : ndarray of float64, shape (256,)
        Sums of their absolute and squared errors, in levels or in metres.
    """

    pixels: NDArray[np.int64]
    absolute: NDArray[np.float64]
    squared: NDArray[np.float64]

    def share(self, levels: Mask) -> float:
        """Return the share of the known pixels on some levels."""
        return float(self.pixels[levels].sum() / max(self.pixels.sum(), 1))

    def mean(self, levels: Mask = WHOLE) -> float:
        """Return the mean absolute error on some levels (Eq. 7.2); NaN without a pixel."""
        pixels = self.pixels[levels].sum()
        return float(self.absolute[levels].sum() / pixels) if pixels else math.nan

    def root_mean_square(self, levels: Mask) -> float:
        """Return the root mean square error on some levels; NaN without a pixel."""
        pixels = self.pixels[levels].sum()
        return math.sqrt(self.squared[levels].sum() / pixels) if pixels else math.nan

    def excess(self, levels: Mask) -> float:
        """Return the relative fall of the mean error if these levels did as well as the others.

        It is negative if they do better, and NaN if one of the two has no pixel.
        """
        rest, mean = self.mean(~levels), self.mean()
        return 1 - rest / mean if mean and self.pixels[levels].any() else math.nan


def level_errors(
    depth: NDArray[np.uint8] | NDArray[np.float32],
    valid: Mask,
    prediction: NDArray[np.float32],
    scale: DepthScale | None = None,
) -> LevelErrors:
    """Sum a prediction's errors by true level where depth is known; in metres if given a scale.

    The errors are those of the depth as it is, which is rounded only to find its level.

    Examples
    --------
    >>> depth = np.array([[9, 9, 80]], np.uint8)
    >>> errors = level_errors(depth, depth > 0, np.array([[19, 13, 81]], np.float32))
    >>> scarce = np.arange(256) == 9
    >>> errors.mean(scarce), errors.mean(~scarce), round(errors.excess(scarce), 3)
    (7.0, 1.0, 0.8)
    """
    known = depth[valid]
    estimate = prediction[valid].astype(np.float64)
    if scale is None:
        error = np.abs(estimate - known)
    else:
        error = np.abs(scale.to_metres(estimate) - scale.to_metres(known))
    level = np.rint(known).astype(np.int64)
    return LevelErrors(
        np.bincount(level, minlength=LEVELS).astype(np.int64),
        np.asarray(np.bincount(level, weights=error, minlength=LEVELS), np.float64),
        np.asarray(np.bincount(level, weights=error**2, minlength=LEVELS), np.float64),
    )


@dataclass(frozen=True)
class ErrorJoin:
    """Errors by level of each pair with a prediction, with the verdicts on the levels.

    Parameters
    ----------
    pairs : dict of Pair to LevelErrors
        In the result's order.
    levels : dict of Verdict to ndarray of bool, shape (256,)
        The levels of each verdict, in the ground truth's sense of depth.
    """

    pairs: dict[Pair, LevelErrors]
    levels: dict[Verdict, Mask]

    @property
    def uncovered(self) -> Mask:
        """Levels that are missing or scarce."""
        return np.asarray(self.levels[Verdict.missing] | self.levels[Verdict.scarce])

    @property
    def total(self) -> LevelErrors:
        """The errors of all pairs."""
        return field_sums(*self.pairs.values())

    def of_scenes(self) -> dict[str, LevelErrors]:
        """Return the errors by scene."""
        of_scenes = grouped((pair.scene, errors) for pair, errors in self.pairs.items())
        return {name: field_sums(*errors) for name, errors in of_scenes.items()}


def join_errors(store: Dataset, result: Result, folder: Path, record: CoverageRecord) -> ErrorJoin:
    """Sum a run's errors by true level, and join them with the verdicts on its split's levels.

    Raises
    ------
    ResultError
        As in `kept_predictions`.
    """
    errors = {
        pair.pair: level_errors(depth, valid, prediction)
        for pair, depth, valid, prediction in kept_predictions(store, result, folder)
    }
    levels = {verdict: record.levels(verdict) for verdict in Verdict}
    if record.test.inverted:
        levels = {verdict: mask[::-1] for verdict, mask in levels.items()}
    return ErrorJoin(errors, levels)


def kept_predictions(store: Dataset, result: Result, folder: Path) -> Iterator[Told]:
    """Yield each evaluated pair of a run, its depth, where that is known, and the prediction.

    Parameters
    ----------
    store : Dataset
        The data set that was run on.
    result : Result
        The run.
    folder : Path
        The run's folder, with its predictions.

    Raises
    ------
    ResultError
        If the run is on another data set; after the last pair, if a prediction was not kept or is
        not the run's own, or no pair was evaluated.
    """
    if result.dataset.fingerprint != store.fingerprint:
        fix = "name the store that was run on"
        raise ResultError("the result is of another data set", where=str(store.path), fix=fix)
    require_pairs_of(result, store, folder)
    problems = []
    for pair in result.evaluated:
        depth, valid = _exact_levels(store, pair)
        of_pair, unit = (folder, pair.pair, depth.shape), store.manifest.depth.kind
        prediction = read_prediction(*of_pair, "depth", unit)
        sigma = read_prediction(*of_pair, "sigma", unit)
        if prediction is None:
            problems.append(("no prediction was kept", pair.id))
        elif answer_digest(prediction, sigma) != pair.prediction_sha256:
            problems.append(("the prediction is not the result's", pair.id))
        else:
            # Count errors only where the method answered.
            levels = store.manifest.depth.exact_levels(prediction)
            yield pair, depth, valid & ~np.isnan(prediction), levels
    if problems or not result.evaluated:
        what, where = problems[0] if problems else ("no pair was evaluated", "")
        what += f" ({len(problems)} of {result.dataset.evaluated} pairs)"
        fix = "run the method again, without --no-predictions"
        raise ResultError(what, where=f"{folder}: {where}", fix=fix)


def _exact_levels(store: Dataset, pair: PairResult) -> tuple[NDArray[np.float32], Mask]:
    """Return a pair's depth in levels that are not rounded, NaN where unknown; and where known."""
    depth = store.read_depth(pair.pair)
    return store.manifest.depth.exact_levels(depth), np.isfinite(depth)


def error_table(join: ErrorJoin, title: str, meaning: str) -> Table:
    """Return mean errors by verdict, with the `conclusion` below."""
    total = join.total
    kinds = {str(verdict): join.levels[verdict] for verdict in reversed(Verdict)}
    kinds["all known"] = WHOLE
    rows = [
        (
            kind,
            f"{int(total.pixels[mask].sum()):,}",
            percent(total.share(mask)),
            _number(total.mean(mask)),
            _number(total.root_mean_square(mask)),
        )
        for kind, mask in kinds.items()
    ]
    columns = ("levels", "pixels", "of all", "mean absolute error", "root mean square")
    return Table(title, columns, tuple(rows), "lrrrr", (meaning,), frozenset({len(rows) - 2}))


def scene_table(join: ErrorJoin) -> Table:
    """Return mean absolute errors by scene on covered, scarce and missing levels."""
    rows = [
        (
            scene,
            percent(errors.share(join.uncovered)),
            *(_number(errors.mean(join.levels[verdict])) for verdict in reversed(Verdict)),
            percent(excess) if (excess := errors.excess(join.uncovered)) > 0 else NOTHING,
        )
        for scene, errors in join.of_scenes().items()
    ]
    columns = ("scene", "uncovered", *map(str, reversed(Verdict)), "excess")
    note = (
        "excess: by what share the scene's mean error would fall if its uncovered levels did as "
        "well as its covered ones; – where they do no worse"
    )
    return Table("mean absolute error by scene, in levels", columns, tuple(rows), "lrrrrr", (note,))


def conclusion(join: ErrorJoin, record: CoverageRecord, training: Training) -> str:
    """Say in one sentence whether the errors are on levels that training lacks.

    A method that was never trained cannot fail for lack of training; its errors show what else
    makes these levels hard.
    """
    if record.leaks:
        return f"{leak_text(record)}: these errors say nothing of scenes that are new"
    total, levels = join.total, join.uncovered
    share = total.share(levels)
    unknown = "what the method was trained on is not known: its trained_on names no scenes"
    if not share and training is Training.unknown:
        return f"every pixel lies on a level of the scenes compared with, but {unknown}"
    if not share:
        return "every pixel lies on a covered level: what is wrong is not coverage"
    excess = total.excess(levels)
    if math.isnan(excess):
        return "no pixel lies on a covered level: there is nothing to compare with"
    facts = (
        f"{percent(share)} of the pixels lie on uncovered levels; if they did as well as the "
        f"others, the mean error would fall by {percent(max(excess, 0.0))}"
    )
    if training is Training.unknown:
        return f"{facts}; {unknown}"
    if excess < _SMALL:
        return f"{facts}: most of the error has another cause than coverage"
    if training is Training.none:
        return f"{facts}; the method names no training, so these levels are hard for other reasons"
    return f"{facts}: the errors gather where training lacks levels"


def errors_as_json(
    join: ErrorJoin, result: Result, record: CoverageRecord, training: Training
) -> str:
    """Return the errors by verdict and by level as JSON."""
    total = join.total
    by_verdict = {
        str(verdict): {
            "pixels": int(total.pixels[mask].sum()),
            "mean_absolute_error": total.mean(mask),
            "root_mean_square_error": total.root_mean_square(mask),
        }
        for verdict, mask in join.levels.items()
    }
    return as_json(
        "coverage errors",
        method=result.method.title,
        dataset=result.dataset.name,
        fingerprint=result.dataset.fingerprint,
        split=result.dataset.split,
        expected=result.dataset.expected,
        evaluated=result.dataset.evaluated,
        trained_on=result.method.trained_on,
        training=training,
        compared_with=f"{record.train.dataset}, {record.train.split}",
        leaks=record.leaks,
        verdicts=by_verdict,
        uncovered_share=total.share(join.uncovered),
        excess=total.excess(join.uncovered),
        conclusion=conclusion(join, record, training),
        levels={
            "pixels": total.pixels.tolist(),
            "mean_absolute_error": [total.mean(mask) for mask in np.eye(LEVELS, dtype=bool)],
        },
    )


def _number(value: float, digits: int = 2) -> str:
    return NOTHING if math.isnan(value) else f"{value:.{digits}f}"


_BAND = 16
_BANDS = np.arange(LEVELS).reshape(-1, _BAND)


def level_count_table(side: Side) -> Table:
    """Return how often levels occur: 16 levels per row; the records have each separately."""
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
    held = f"{counted(histogram.pairs, 'pair')} of {counted(len(side.scenes), 'scene')}"
    title = f"depths of {side.store.manifest.label}, {side.name} ({held})"
    columns = ("levels", "pixels", "share", "do not occur")
    records = tuple(
        {"level": level, "pixels": count, "share": count / known}
        for level, count in enumerate(counts.tolist())
    )
    return Table(title, columns, tuple(rows), "lrrl", tuple(notes), records=records)


@dataclass(frozen=True)
class DepthErrors:
    """A run's errors by true depth, over all pixels of known depth in all its pairs.

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
        As in `dfdbench.audit.run_errors.kept_predictions`.
    """
    found = kept_predictions(store, result, folder)
    return _summed(name, found, store.manifest.depth.scale)


def constant_errors(store: Dataset, result: Result, level: float, name: str) -> DepthErrors:
    """Return the errors of predicting one level everywhere on the pairs of a run."""
    depths = ((pair, *_exact_levels(store, pair)) for pair in result.evaluated)
    found = (
        (pair, depth, valid, np.full(depth.shape, level, np.float32))
        for pair, depth, valid in depths
    )
    return _summed(name, found, store.manifest.depth.scale)


def _summed(name: str, found: Iterable[Told], scale: DepthScale | None) -> DepthErrors:
    ids, levels, metres = [], [], []
    answers = np.zeros(LEVELS * LEVELS, np.int64)
    for pair, depth, valid, prediction in found:
        ids.append(pair.id)
        levels.append(level_errors(depth, valid, prediction))
        if scale is not None:
            metres.append(level_errors(depth, valid, prediction, scale))
        answer = np.clip(np.rint(prediction[valid]), 0, LAST_LEVEL).astype(np.int64)
        known = np.rint(depth[valid]).astype(np.int64)
        answers += np.bincount(known * LEVELS + answer, minlength=LEVELS * LEVELS)
    in_metres = field_sums(*metres) if metres else None
    by_answer = answers.reshape(LEVELS, LEVELS)
    return DepthErrors(name, tuple(ids), field_sums(*levels), in_metres, by_answer)


def depth_error_tables(store: Dataset, split: str, found: Sequence[DepthErrors]) -> list[Table]:
    """Return the mean absolute error by depth, one column per run: in levels and, if known, metres.

    Raises
    ------
    ResultError
        If the runs are on different pairs.
    """
    first = found[0]
    for other in found[1:]:
        if set(other.pairs) != set(first.pairs):
            where, fix = f"{first.name}, {other.name}", f"compare complete runs of split {split}"
            raise ResultError("the runs are of different pairs", where=where, fix=fix)
    what = f"mean absolute error by depth, {store.manifest.label}, split {split}"
    run, whole = len(first.pairs), len(store.manifest.pairs(split))
    pairs = "all pairs" if run == whole else f"{run} of {whole} pairs"
    note = (
        f"over the pixels of known depth of {pairs} together, by their true depth; the level grows "
        f"with {store.manifest.depth.grows_with}"
    )
    counts = {one.name: int(one.levels.pixels.sum()) for one in found}
    most = max(counts.values())
    fewer = [f"{name} {percent(n / most)}" for name, n in counts.items() if n < most]
    if fewer:
        note += f"; errors over fewer pixels, for want of answers: {listed(fewer)} of the others'"
    scale = store.manifest.depth.scale
    errors = {one.name: one.levels for one in found}
    tables = [_table(f"{what}, in levels", errors, scale, note, 2)]
    if scale is not None:
        metres = {one.name: one.metres for one in found if one.metres is not None}
        tables.append(_table(f"{what}, in metres", metres, scale, note, 3))
    return tables


def _table(
    title: str, errors: dict[str, LevelErrors], scale: DepthScale | None, note: str, digits: int
) -> Table:
    def means(levels: Mask) -> list[str]:
        return [_number(one.mean(levels), digits) for one in errors.values()]

    # Runs that leave pixels out have fewer than others.
    whole = max(errors.values(), key=lambda one: int(one.pixels.sum()))
    rows: list[tuple[str, ...]] = []
    for band in _BANDS:
        if (there := band[whole.pixels[band] > 0]).size:
            inside = np.isin(np.arange(LEVELS), band)
            metres = [_metres(there, scale)] if scale else []
            levels = range_text(int(there[0]), int(there[-1]))
            rows.append((levels, *metres, percent(whole.share(inside)), *means(inside)))
    where = ["metres"] if scale else []
    columns = ("levels", *where, "of all", *errors)
    total = ("all", *[""] * len(where), percent(1.0), *means(WHOLE))
    align = "l" * (1 + len(where))
    return Table(title, columns, (*rows, total), align, (note,), frozenset({len(rows) - 1}))


def _metres(levels: NDArray[np.int64], scale: DepthScale) -> str:
    near, far = sorted(float(end) for end in scale.to_metres(levels[[0, -1]]))
    return f"{near:.2f} to {far:.2f}"
