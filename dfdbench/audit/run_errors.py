"""A run's errors on covered, scarce and missing levels: is the data at fault, or the method."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dfdbench.audit.coverage import CoverageRecord, Verdict, leak_text
from dfdbench.audit.sides import Mask
from dfdbench.audit.trained_on import Training
from dfdbench.blur.recipe import LEVELS
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.depth_scale import DepthScale
from dfdbench.datasets.fingerprint import array_digest
from dfdbench.errors import ResultError
from dfdbench.results.record import PairResult, Result
from dfdbench.results.run_folder import read_prediction, require_pairs_of
from dfdbench.results.wording import NOTHING
from dfdbench.tables.table import Table, percent

SCHEMA_VERSION = 1
#: Below this share of the error, uncovered levels are not what is wrong.
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

    def __add__(self, other: LevelErrors) -> LevelErrors:
        return LevelErrors(
            self.pixels + other.pixels, self.absolute + other.absolute, self.squared + other.squared
        )

    @classmethod
    def total(cls, parts: Iterable[LevelErrors]) -> LevelErrors:
        """Return the sum of several."""
        return sum(parts, start=cls(np.zeros(LEVELS, np.int64), np.zeros(LEVELS), np.zeros(LEVELS)))

    def share(self, levels: Mask) -> float:
        """Return the share of the known pixels on some levels."""
        return float(self.pixels[levels].sum() / max(self.pixels.sum(), 1))

    def mean(self, levels: Mask = WHOLE) -> float:
        """Return the mean absolute error on some levels (Eq. 7.2), NaN without a pixel."""
        pixels = self.pixels[levels].sum()
        return float(self.absolute[levels].sum() / pixels) if pixels else math.nan

    def root_mean_square(self, levels: Mask) -> float:
        """Return the root mean square error on some levels, NaN without a pixel."""
        pixels = self.pixels[levels].sum()
        return math.sqrt(self.squared[levels].sum() / pixels) if pixels else math.nan

    def excess(self, levels: Mask) -> float:
        """Return by what share the mean error would fall if these levels did as well as the others.

        Negative if they do better; NaN if one of the two has no pixel.
        """
        rest, mean = self.mean(~levels), self.mean()
        return 1 - rest / mean if mean and self.pixels[levels].any() else math.nan


def level_errors(
    depth: NDArray[np.uint8],
    valid: Mask,
    prediction: NDArray[np.float32],
    scale: DepthScale | None = None,
) -> LevelErrors:
    """Sum a prediction's errors by true level where depth is known; in metres with a scale.

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
    return LevelErrors(
        np.bincount(known, minlength=LEVELS).astype(np.int64),
        np.asarray(np.bincount(known, weights=error, minlength=LEVELS), np.float64),
        np.asarray(np.bincount(known, weights=error**2, minlength=LEVELS), np.float64),
    )


@dataclass(frozen=True)
class ErrorJoin:
    """Errors by level of each pair with a prediction, with the verdicts on the levels.

    Parameters
    ----------
    pairs : dict of str to LevelErrors
        By the pair's id, in the result's order.
    scenes : dict of str to str
        The scene of each pair.
    levels : dict of Verdict to ndarray of bool, shape (256,)
        The levels of each verdict, in the ground truth's sense of depth.
    """

    pairs: dict[str, LevelErrors]
    scenes: dict[str, str]
    levels: dict[Verdict, Mask]

    @property
    def uncovered(self) -> Mask:
        """Levels that are missing or scarce."""
        return np.asarray(self.levels[Verdict.missing] | self.levels[Verdict.scarce])

    @property
    def total(self) -> LevelErrors:
        """The errors of all pairs."""
        return LevelErrors.total(self.pairs.values())

    def of_scenes(self) -> dict[str, LevelErrors]:
        """Return the errors by scene."""
        names = dict.fromkeys(self.scenes.values())
        return {
            name: LevelErrors.total(e for id_, e in self.pairs.items() if self.scenes[id_] == name)
            for name in names
        }


def join_errors(store: Dataset, result: Result, folder: Path, record: CoverageRecord) -> ErrorJoin:
    """Sum a run's errors by true level, and join them with the verdicts on its split's levels.

    Raises
    ------
    ResultError
        As by `kept_predictions`.
    """
    errors, scenes = {}, {}
    for pair, depth, valid, prediction in kept_predictions(store, result, folder):
        errors[pair.id] = level_errors(depth, valid, prediction)
        scenes[pair.id] = pair.scene
    levels = {verdict: record.levels(verdict) for verdict in Verdict}
    if record.test.inverted:
        levels = {verdict: mask[::-1] for verdict, mask in levels.items()}
    return ErrorJoin(errors, scenes, levels)


def kept_predictions(
    store: Dataset, result: Result, folder: Path
) -> Iterator[tuple[PairResult, NDArray[np.uint8], Mask, NDArray[np.float32]]]:
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
        If the run is of another data set; after the last pair, if a prediction was not kept or is
        not the run's own, or no pair was evaluated.
    """
    if result.dataset.fingerprint != store.fingerprint:
        fix = "name the store that was run on"
        raise ResultError("the result is of another data set", where=str(store.path), fix=fix)
    require_pairs_of(result, store, folder)
    problems = []
    evaluated = [pair for pair in result.pairs if pair.status == "ok"]
    for pair in evaluated:
        depth, valid = store.read_levels(pair.pair)
        prediction = read_prediction(folder, pair.pair, depth.shape)
        if prediction is None:
            problems.append(("no prediction was kept", pair.id))
        elif array_digest("depth", ("y", "x"), prediction) != pair.prediction_sha256:
            problems.append(("the prediction is not the result's", pair.id))
        else:
            yield pair, depth, valid, store.manifest.depth.exact_levels(prediction)
    if problems or not evaluated:
        what, where = problems[0] if problems else ("no pair was evaluated", "")
        what += f" ({len(problems)} of {len(evaluated)} pairs)"
        fix = "run the method again, without --no-predictions"
        raise ResultError(what, where=f"{folder}: {where}", fix=fix)


def error_table(join: ErrorJoin, title: str, meaning: str) -> Table:
    """Return mean errors by verdict, and below what `conclusion` says of them."""
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
    return Table(
        title,
        ("levels", "pixels", "of all", "mean absolute error", "root mean square"),
        tuple(rows),
        "lrrrr",
        (meaning,),
        frozenset({len(rows) - 2}),
    )


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

    A method that was never trained cannot fail for lack of training: its errors show what else is
    hard about those levels.
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
            "mean_absolute_error": _or_null(total.mean(mask)),
            "root_mean_square_error": _or_null(total.root_mean_square(mask)),
        }
        for verdict, mask in join.levels.items()
    }
    single = np.eye(LEVELS, dtype=bool)
    content = {
        "format": "dfdbench coverage errors",
        "schema_version": SCHEMA_VERSION,
        "method": result.method.title,
        "dataset": result.dataset.name,
        "fingerprint": result.dataset.fingerprint,
        "split": result.dataset.split,
        "trained_on": result.method.trained_on,
        "training": training,
        "compared_with": f"{record.train.dataset}, {record.train.split}",
        "leaks": [leak.model_dump() for leak in record.leaks],
        "verdicts": by_verdict,
        "uncovered_share": total.share(join.uncovered),
        "excess": _or_null(total.excess(join.uncovered)),
        "conclusion": conclusion(join, record, training),
        "levels": {
            "pixels": total.pixels.tolist(),
            "mean_absolute_error": [_or_null(total.mean(mask)) for mask in single],
        },
    }
    return json.dumps(content, indent=1, allow_nan=False) + "\n"


def _or_null(value: float) -> float | None:
    return None if math.isnan(value) else value


def _number(value: float) -> str:
    return NOTHING if math.isnan(value) else f"{value:.2f}"
