"""A method's runs on clean images and on tracks, as one file that says nothing twice.

A run on each of 21 tracks is 22 results of some 30 KB, of which the pairs' names, the method and
the machine are the same in all. Here they stand once, and the pairs' scores in columns: a tenth of
the size, so that a method's row of the leaderboard is one file.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, model_validator

from dfdbench.blur.tracks import CLEAN, find_degradation
from dfdbench.datasets.manifest import Name
from dfdbench.datasets.tracked import AT
from dfdbench.errors import DfdbenchError
from dfdbench.metrics.metric import METRICS
from dfdbench.metrics.protocol import label_of
from dfdbench.results.record import (
    Coordinate,
    Count,
    DataName,
    DatasetRecord,
    Environment,
    Finite,
    MethodRecord,
    PairResult,
    ProtocolRecord,
    RecipeRecord,
    Result,
    Seconds,
    Seed,
    Sha256,
    Submission,
    average,
)
from dfdbench.system.record import Record

#: Digits after the point that scores and seconds are kept with: verifying allows for 0.001.
_DIGITS = 6
_SECONDS_DIGITS = 3


class PairPlace(Record):
    """Which pair a column's place is of."""

    id: str
    scene: Name
    coordinates: dict[Name, Coordinate]


class TrackRun(Record):
    """A run on clean images or on a track at a severity, in what it has of its own.

    Lists have a place for each of the file's pairs, null where it was not evaluated. `environment`
    is null where it is the file's. `machine` is empty if all pairs were run there.
    """

    fingerprint: Sha256
    recipe: RecipeRecord
    options: dict[str, Any]
    uses: list[str]
    trained_on: str | None
    fitted_on: str | None
    fit_seconds: Seconds | None
    environment: Environment | None = None
    other_environments: list[Environment] = Field(default_factory=list)
    machine: list[Count] = Field(default_factory=list)
    status: list[Literal["ok", "failed", "missing", "not-run"]]
    timed_alone: bool
    seconds: list[Seconds | None]
    prediction_sha256: list[Sha256 | None]
    scores: dict[Name, list[Finite | None]]
    warnings: list[str] = Field(default_factory=list)


def _labels(runs: dict[str, TrackRun]) -> dict[str, TrackRun]:
    for label in runs:
        try:
            found = find_degradation(label).label if label != CLEAN else CLEAN
        except DfdbenchError as error:
            raise ValueError(f"no such track: {label}") from error
        if found != label:
            raise ValueError(f"severity 0 is called {CLEAN}")
    if CLEAN not in runs:
        raise ValueError(f"the run on {CLEAN} images is lacking")
    return runs


class TracksRecord(Record):
    """All runs of one method on a split of a data set and on its tracks, under one protocol.

    `dataset` and `short` name the data set without a track; `runs` are by ``clean`` and
    ``TRACK-SEVERITY``. Averages follow from the scores.
    """

    schema_version: Literal[1] = 1
    dataset: DataName
    short: DataName
    manifest_sha256: Sha256
    split: Name
    axes: Annotated[list[Name], Field(min_length=1)]
    blocks: Name
    rows: Name | None
    protocol: ProtocolRecord
    method: MethodRecord
    environment: Environment
    seed: Seed
    pairs: Annotated[list[PairPlace], Field(min_length=1)]
    runs: Annotated[dict[str, TrackRun], AfterValidator(_labels)]
    submission: Submission | None = None

    @model_validator(mode="after")
    def _columns(self) -> TracksRecord:
        count = len(self.pairs)
        for label, run in self.runs.items():
            columns: dict[str, list[Any]] = {
                "status": run.status,
                "seconds": run.seconds,
                "prediction_sha256": run.prediction_sha256,
                "machine": run.machine or [0] * count,
                **run.scores,
            }
            for name, column in columns.items():
                if len(column) != count:
                    raise ValueError(f"{label}: {name} is of {len(column)} pairs, not {count}")
            needed = {m.name for m in METRICS.values() if not m.younger and "ok" in run.status}
            for what, names in (
                ("no such metric", run.scores.keys() - METRICS.keys()),
                ("a metric is lacking", needed - run.scores.keys()),
            ):
                if names:
                    raise ValueError(f"{label}: {what}: {', '.join(sorted(names))}")
        return self


def tracks_record(results: Mapping[str, Result], protocol: str) -> TracksRecord:
    """Return runs of one method by ``clean`` and ``TRACK-SEVERITY`` as one record.

    Parameters
    ----------
    results : mapping of str to Result
        The runs, that on clean images among them, all of one split.
    protocol : str
        The label of the protocol that is kept.
    """
    clean = results[CLEAN]
    dataset = clean.dataset
    definition = next(each for each in clean.protocols if label_of(each) == protocol)
    own: dict[str, Any] = {"uses": [], "trained_on": None, "fitted_on": None, "fit_seconds": None}
    return TracksRecord(
        dataset=dataset.name,
        short=dataset.short,
        manifest_sha256=dataset.manifest_sha256,
        split=dataset.split,
        axes=dataset.axes,
        blocks=dataset.blocks,
        rows=dataset.rows,
        protocol=definition,
        method=clean.method.model_copy(update=own),
        environment=clean.environment,
        seed=clean.seed,
        pairs=[
            PairPlace(id=pair.id, scene=pair.scene, coordinates=pair.coordinates)
            for pair in clean.pairs
        ],
        runs={label: _run(result, clean, protocol) for label, result in results.items()},
    )


def _run(result: Result, clean: Result, protocol: str) -> TrackRun:
    method, pairs = result.method, result.pairs
    scored = [pair.scores.get(protocol, {}) for pair in pairs]
    metrics = dict.fromkeys(name for scores in scored for name in scores)
    same = result.environment == clean.environment
    return TrackRun(
        fingerprint=result.dataset.fingerprint,
        recipe=result.dataset.recipe,
        options=result.dataset.options,
        uses=method.uses,
        trained_on=method.trained_on,
        fitted_on=method.fitted_on,
        fit_seconds=_short(method.fit_seconds, _SECONDS_DIGITS),
        environment=None if same else result.environment,
        other_environments=result.other_environments,
        machine=[pair.machine for pair in pairs] if result.other_environments else [],
        status=[pair.status for pair in pairs],
        timed_alone=all(pair.timed_alone for pair in pairs),
        seconds=[_short(pair.seconds, _SECONDS_DIGITS) for pair in pairs],
        prediction_sha256=[pair.prediction_sha256 for pair in pairs],
        scores={name: [_short(scores.get(name), _DIGITS) for scores in scored] for name in metrics},
        warnings=result.warnings,
    )


def results_of(record: TracksRecord) -> dict[str, Result]:
    """Return each run of a record as the result that it is, by ``clean`` and ``TRACK-SEVERITY``.

    What results say besides, numbers of each pair and errors for example, is not kept.
    """
    return {label: _result(record, label, run) for label, run in record.runs.items()}


def _result(record: TracksRecord, label: str, run: TrackRun) -> Result:
    protocol = label_of(record.protocol)
    pairs = [_pair(record, run, number, protocol) for number in range(len(record.pairs))]
    evaluated = [pair for pair in pairs if pair.status == "ok"]
    suffix = "" if label == CLEAN else f"{AT}{label}"
    own = {name: getattr(run, name) for name in ("uses", "trained_on", "fitted_on", "fit_seconds")}
    return Result(
        schema_version=1,
        dataset=DatasetRecord(
            name=record.dataset + suffix,
            short=record.short + suffix,
            manifest_sha256=record.manifest_sha256,
            fingerprint=run.fingerprint,
            split=record.split,
            expected=len(pairs),
            evaluated=len(evaluated),
            recipe=run.recipe,
            degradation=label,
            options=run.options,
            axes=record.axes,
            blocks=record.blocks,
            rows=record.rows,
        ),
        protocols=[record.protocol],
        method=record.method.model_copy(update=own),
        environment=run.environment or record.environment,
        other_environments=run.other_environments,
        seed=record.seed,
        pairs=pairs,
        averages=average(pairs, [protocol]) if len(evaluated) == len(pairs) else None,
        warnings=run.warnings,
    )


def _pair(record: TracksRecord, run: TrackRun, number: int, protocol: str) -> PairResult:
    place = record.pairs[number]
    scores = {name: column[number] for name, column in run.scores.items()}
    return PairResult(
        id=place.id,
        scene=place.scene,
        coordinates=place.coordinates,
        status=run.status[number],
        seconds=run.seconds[number],
        timed_alone=run.timed_alone,
        machine=run.machine[number] if run.machine else 0,
        prediction_sha256=run.prediction_sha256[number],
        scores={protocol: scores} if run.status[number] == "ok" else {},
    )


def _short(value: float | None, digits: int) -> float | None:
    return None if value is None else round(value, digits)
