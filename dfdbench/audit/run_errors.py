"""A run's errors on covered, scarce and missing levels: the data's fault or the method's."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dfdbench.audit.coverage import Verdict
from dfdbench.audit.coverage_record import CoverageRecord
from dfdbench.audit.coverage_tables import leak_text
from dfdbench.audit.depth_histogram import Mask
from dfdbench.audit.level_errors import LevelErrors, level_errors
from dfdbench.audit.trained_on import Training
from dfdbench.blur.recipe import LEVELS
from dfdbench.datasets.fingerprint import array_digest
from dfdbench.datasets.store import Store
from dfdbench.errors import Problem, ResultError
from dfdbench.results.folder import read_prediction, require_pairs_of
from dfdbench.results.record import PairResult, Result
from dfdbench.tables.table import Table
from dfdbench.tables.wording import percent

SCHEMA_VERSION = 1
#: Below this share of the error, uncovered levels are not what is wrong.
_SMALL = 0.1
_NOTHING = "–"


@dataclass(frozen=True)
class ErrorJoin:
    """Errors by level of each pair, with the verdicts on the levels.

    Parameters
    ----------
    pairs : dict of str to LevelErrors
        By the pair's id, in the result's order; only pairs with a prediction.
    scenes : dict of str to str
        The scene of each pair.
    levels : dict of Verdict to ndarray of bool, shape (256,)
        The levels of each verdict, in the sense of the run's ground truth.
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


def join_errors(store: Store, result: Result, folder: Path, record: CoverageRecord) -> ErrorJoin:
    """Read a run's predictions and sum their errors by true level.

    Parameters
    ----------
    store : Store
        The data set that was run on.
    result : Result
        The run.
    folder : Path
        The run's folder, with its predictions.
    record : CoverageRecord
        The verdicts on the levels of the run's split.

    Raises
    ------
    ResultError
        Where the run is of another data set, kept no predictions, or they are not its own.
    """
    errors, scenes = {}, {}
    for pair, depth, valid, prediction in kept_predictions(store, result, folder):
        errors[pair.id] = level_errors(depth, valid, prediction)
        scenes[pair.id] = pair.scene
    levels = {verdict: np.array(record.levels(verdict)) for verdict in Verdict}
    if record.test.inverted:
        levels = {verdict: mask[::-1] for verdict, mask in levels.items()}
    return ErrorJoin(errors, scenes, levels)


def kept_predictions(
    store: Store, result: Result, folder: Path
) -> Iterator[tuple[PairResult, NDArray[np.uint8], Mask, NDArray[np.float32]]]:
    """Yield each evaluated pair of a run, its depth, where that is known, and the prediction.

    Parameters
    ----------
    store : Store
        The data set that was run on.
    result : Result
        The run.
    folder : Path
        The run's folder, with its predictions.

    Raises
    ------
    ResultError
        Where the run is of another data set; after the last pair, where predictions were not kept,
        are not the run's own, or there are none.
    """
    if result.dataset.fingerprint != store.fingerprint:
        raise ResultError(
            "the result is of another data set",
            where=str(store.path),
            expected=result.dataset.fingerprint,
            got=store.fingerprint,
            fix="name the store that was run on",
        )
    require_pairs_of(result, store, folder)
    problems = []
    evaluated = [pair for pair in result.pairs if pair.status == "ok"]
    for pair in evaluated:
        depth, valid = store.read_depth(pair.pair)
        prediction = read_prediction(folder, pair.pair, depth.shape)
        if prediction is None:
            problems.append(Problem("no prediction was kept", where=f"{folder}: {pair.id}"))
        elif array_digest("depth", ("y", "x"), prediction) != pair.prediction_sha256:
            problems.append(
                Problem("the prediction is not the result's", where=f"{folder}: {pair.id}")
            )
        else:
            yield pair, depth, valid, prediction
    if problems or not evaluated:
        more = f"{len(problems)} of {len(evaluated)} pairs"
        first = problems[0] if problems else Problem("no pair was evaluated", where=str(folder))
        raise ResultError(
            first.what,
            where=first.where,
            got=more,
            fix="run the method again, without --no-predictions",
        )


def error_table(join: ErrorJoin, title: str, meaning: str) -> Table:
    """Return mean errors by verdict, and below what `conclusion` says of them."""
    whole = np.ones(LEVELS, bool)
    total = join.total
    kinds: Mapping[str, Mask] = {
        **{str(verdict): join.levels[verdict] for verdict in reversed(Verdict)},
        "all known": whole,
    }
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
            percent(excess) if (excess := errors.excess(join.uncovered)) > 0 else _NOTHING,
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
    """Return in one sentence whether the errors lie where training lacks levels.

    Parameters
    ----------
    join : ErrorJoin
        The errors by level.
    record : CoverageRecord
        The verdicts, and what training and test share.
    training : Training
        Whether the verdicts are about the method's own training. A method that was never trained
        cannot fail for lack of it, so that its errors show what else is hard about those levels.
    """
    if record.leaks:
        return f"{leak_text(record)}: these errors say nothing of scenes that are new"
    return _of_levels(join, training)


def _of_levels(join: ErrorJoin, training: Training) -> str:
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
    return _NOTHING if math.isnan(value) else f"{value:.2f}"
