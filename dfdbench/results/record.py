"""A result: what a run found, pair by pair, in a file that checks itself."""

from __future__ import annotations

import hashlib
import json
import math
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    JsonValue,
    TypeAdapter,
    ValidationError,
)

from dfdbench.datasets.manifest import Name, Pair
from dfdbench.errors import Problem, ResultError
from dfdbench.metrics.protocol import METRICS, label_of
from dfdbench.system.files import write_whole

SCHEMA_VERSION = 1
#: What a result is called in the folder of its run.
RESULT = "result.json"
#: How far a recorded average may be from the one recomputed from the pairs.
_TOLERANCE = 1e-9
#: A larger number of a method's own is not kept.
LARGEST_NUMBER = 1e100

Finite = Annotated[float, Field(allow_inf_nan=False)]
#: Levels are at most 255 apart, and what divides them is 255 or a range of at least one level.
Error = Annotated[float, Field(allow_inf_nan=False, ge=0, le=255)]
#: Bounds far above any run's keep sums of such numbers finite.
Seconds = Annotated[float, Field(allow_inf_nan=False, ge=0, le=1e9)]
Number = Annotated[float, Field(allow_inf_nan=False, ge=-LARGEST_NUMBER, le=LARGEST_NUMBER)]
Coordinate = Annotated[int, Field(ge=-(2**31), lt=2**31)]
Count = Annotated[int, Field(ge=0, lt=2**31)]
#: What `numpy.random.seed` takes.
Seed = Annotated[int, Field(ge=0, lt=2**32)]
#: Text in one line, without what steers a terminal.
Line = Annotated[str, Field(pattern=r"^[^\x00-\x1f\x7f-\x9f]+$", max_length=1000)]
Similarity = Annotated[float, Field(allow_inf_nan=False, ge=-1, le=1)]
Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class Model(BaseModel):
    """A frozen record that refuses fields it does not know."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class PairScores(Model):
    """The metrics of one pair under one protocol; null where a metric is undefined."""

    nrmse: Error | None
    nmae: Error | None
    ssim: Similarity | None


class PairResult(Model):
    """What became of one pair.

    `status`: ``ok``; ``failed``, the method gave no usable depth (`error` says why);
    ``missing``, the store does not hold the pair; ``not-run``, the run was limited. Only where
    `timed_alone` can `seconds` be compared. `numbers` are what the method said of its answer,
    an energy for example.
    """

    id: str
    scene: Name
    coordinates: dict[Name, Coordinate]
    status: Literal["ok", "failed", "missing", "not-run"]
    seconds: Seconds | None = None
    timed_alone: bool = True
    prediction_sha256: Sha256 | None = None
    scores: dict[Name, PairScores] = Field(default_factory=dict)
    numbers: dict[str, Number] = Field(default_factory=dict)
    error: str | None = None
    warnings: list[str] = Field(default_factory=list)


def _with_name(record: dict[str, Any]) -> dict[str, Any]:
    if not isinstance(record.get("name"), str):
        raise ValueError("it has no name")
    return record


def _with_safe_name(record: dict[str, Any]) -> dict[str, Any]:
    TypeAdapter(Name).validate_python(_with_name(record)["name"])
    return record


class DatasetRecord(Model):
    """Which data the run used; names are such as may become part of a path."""

    name: Name
    short: Name
    manifest_sha256: Sha256
    fingerprint: Sha256
    split: Name
    expected: Count
    evaluated: Count
    recipe: Annotated[dict[str, Any], AfterValidator(_with_name)]
    degradation: str
    options: dict[str, Any]
    axes: Annotated[list[Name], Field(min_length=1)]
    blocks: Name
    rows: Name | None


def _as_utf8(parameters: dict[str, Any]) -> dict[str, Any]:
    # They stand in file names and tables.
    json.dumps(parameters, ensure_ascii=False, allow_nan=False).encode()
    return parameters


class MethodRecord(Model):
    """Which method was run, and how.

    `files_sha256` is of what parameters name: files, and folders by their files' names and
    contents.
    """

    name: Line
    entry: Line
    source_sha256: Sha256 | None
    parameters: Annotated[dict[str, JsonValue], AfterValidator(_as_utf8)]
    uses: list[str]
    trained_on: str | None
    paper: str | None
    weights_sha256: Sha256 | None = None
    files_sha256: dict[str, Sha256] = Field(default_factory=dict)


class Environment(Model):
    """Where it was run."""

    python: str
    platform: str
    cpu: str
    cpu_count: int
    threads: dict[str, int]
    gpu: str | None
    git: str | None
    versions: dict[str, str]


def _a_date(text: str) -> str:
    datetime.fromisoformat(text)
    return text


Time = Annotated[str, Field(pattern=r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ$"), AfterValidator(_a_date)]


class Submission(Model):
    """What makes a result fit for the leaderboard.

    `submitted` tells which of two results of one method is the newer; `seal` is the SHA-256
    of all else in the file, so that it cannot be edited without notice.
    """

    submitted: Time
    seal: Sha256


class Result(Model):
    """A run in full. `averages` is null unless every expected pair was evaluated."""

    schema_version: Literal[1]
    dataset: DatasetRecord
    protocols: list[Annotated[dict[str, Any], AfterValidator(_with_safe_name)]]
    method: MethodRecord
    environment: Environment
    seed: Seed
    pairs: list[PairResult]
    averages: dict[Name, dict[str, Finite | None]] | None
    warnings: list[str] = Field(default_factory=list)
    submission: Submission | None = None

    @property
    def protocol_names(self) -> tuple[str, ...]:
        """The labels of the protocols that were scored, under which `scores` has them."""
        return tuple(label_of(protocol) for protocol in self.protocols)

    @property
    def complete(self) -> bool:
        """True where every expected pair was evaluated; only then is there an average."""
        return all(pair.status == "ok" for pair in self.pairs)


def average(pairs: list[PairResult], protocols: list[str]) -> dict[str, dict[str, float | None]]:
    """Return each metric's mean over the pairs where it is defined, by protocol."""
    means: dict[str, dict[str, float | None]] = {}
    for protocol in protocols:
        means[protocol] = {}
        for metric in METRICS:
            values = [getattr(pair.scores[protocol], metric) for pair in pairs]
            defined = [value for value in values if value is not None]
            means[protocol][metric] = math.fsum(defined) / len(defined) if defined else None
    return means


def save_result(result: Result, path: Path) -> None:
    """Write a result as JSON, whole or not at all."""
    write_whole(path, result.model_dump_json(indent=1) + "\n")


def seal_of(content: dict[str, Any]) -> str:
    """Return the SHA-256 of a result file's content, its seal left out, in canonical JSON.

    Taken over what the file says, not over the model: fields that later versions add do not
    break the seals of older files.
    """
    submission = {key: v for key, v in (content.get("submission") or {}).items() if key != "seal"}
    text = json.dumps({**content, "submission": submission}, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def load_result(path: Path) -> Result:
    """Read a run's result, check it, and compute its averages anew.

    Parameters
    ----------
    path : Path
        The result file, or the folder of the run.

    Raises
    ------
    ResultError
        Where it cannot be read, is of another schema version, or contradicts itself.
    """
    result, problems = examine_result(path)
    if problems:
        raise ResultError.of(problems)
    return result


def examine_result(path: Path) -> tuple[Result, list[Problem]]:
    """Read a run's result, and return in what it contradicts itself.

    Parameters
    ----------
    path : Path
        The result file, or the folder of the run.

    Raises
    ------
    ResultError
        Where it cannot be read or is of another schema version.
    """
    path = path / RESULT if path.is_dir() else path
    content = _read_json(path)
    found = content.get("schema_version") if isinstance(content, dict) else None
    if found != SCHEMA_VERSION:
        raise ResultError(
            "result of another version",
            where=str(path),
            expected=str(SCHEMA_VERSION),
            got=str(found),
            fix="run the method again with this version of dfdbench",
        )
    try:
        result = Result.model_validate(content)
    except ValidationError as error:
        raise ResultError.of(
            Problem(
                "wrong value in the result",
                where=f"{path}: {'.'.join(map(str, detail['loc']))}",
                expected=detail["msg"],
                got=repr(detail["input"])[:80],
            )
            for detail in error.errors()
        ) from error
    problems = list(_contradictions(result, path))
    if result.submission and result.submission.seal != seal_of(content):
        problems.append(
            Problem(
                "the file was edited after it was sealed",
                where=f"{path}: submission.seal",
                expected="the SHA-256 of the file's content",
                got=result.submission.seal,
                fix="submit the run again: `dfdbench run ... --submit`",
            )
        )
    return result, problems


def _read_json(path: Path) -> Any:
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = (error.strerror if isinstance(error, OSError) else None) or str(error)
        raise ResultError(
            "cannot read the result",
            where=str(path),
            expected="a result file or the folder of a run",
            got=reason,
            fix="name what `dfdbench run` wrote: results/DATASET-SPLIT/METHOD",
        ) from error
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ResultError(
            "the result is damaged",
            where=str(path),
            expected="JSON as `dfdbench run` wrote it",
            got="an empty file" if not text.strip() else str(error),
            fix="the same `dfdbench run` writes it anew, from the pairs that it kept",
        ) from error


def _misplaced(result: Result, path: Path) -> list[Problem]:
    # Tables and figures look pairs up by axis, maps of depth by scene and coordinates.
    dataset = result.dataset
    axes = dataset.axes
    problems = [
        Problem(
            "no such axis", where=f"{path}: dataset.{field}", expected=", ".join(axes), got=axis
        )
        for field, axis in (("blocks", dataset.blocks), ("rows", dataset.rows))
        if axis is not None and axis not in axes
    ]
    if len(set(axes)) != len(axes):
        problems.append(
            Problem("an axis is listed twice", where=f"{path}: dataset.axes", got=str(axes))
        )
    for number, pair in enumerate(result.pairs):
        where = f"{path}: pairs.{number}"
        if pair.coordinates.keys() != set(axes):
            found = ", ".join(pair.coordinates)
            problems.append(
                Problem(
                    "a pair is not on the axes", where=where, expected=", ".join(axes), got=found
                )
            )
        elif pair.id != (name := _pair_of(pair, axes).id):
            problems.append(
                Problem(
                    "a pair is not where its name says", where=where, expected=name, got=pair.id
                )
            )
    names = result.protocol_names
    if len(set(names)) != len(names):
        problems.append(
            Problem("a protocol is listed twice", where=f"{path}: protocols", got=", ".join(names))
        )
    return problems


def _pair_of(record: PairResult, axes: list[str]) -> Pair:
    return Pair(record.scene, tuple((axis, record.coordinates[axis]) for axis in axes))


def _contradictions(result: Result, path: Path) -> list[Problem]:
    problems = _misplaced(result, path)
    ids = [pair.id for pair in result.pairs]
    if len(set(ids)) != len(ids) or len(ids) != result.dataset.expected:
        problems.append(
            Problem(
                "pairs do not add up",
                where=f"{path}: pairs",
                expected=f"{result.dataset.expected} pairs, each once",
                got=f"{len(ids)} pairs, {len(set(ids))} different",
            )
        )
    evaluated = [pair for pair in result.pairs if pair.status == "ok"]
    if len(evaluated) != result.dataset.evaluated:
        problems.append(
            Problem(
                "evaluated pairs do not add up",
                where=f"{path}: dataset.evaluated",
                expected=str(len(evaluated)),
                got=str(result.dataset.evaluated),
            )
        )
    names = list(result.protocol_names)
    problems += [
        Problem(
            "scores are missing",
            where=f"{path}: {pair.id}",
            expected=", ".join(names),
            got=", ".join(pair.scores),
        )
        for pair in evaluated
        if set(pair.scores) != set(names)
    ]
    # What holds for every error cannot be otherwise: its mean never exceeds its root mean square.
    problems += [
        Problem(
            "NMAE is larger than NRMSE",
            where=f"{path}: {pair.id}, {name}",
            expected=f"at most {nrmse}",
            got=str(nmae),
        )
        for pair in evaluated
        for name, scores in pair.scores.items()
        for nrmse, nmae in [(scores.nrmse, scores.nmae)]
        if nrmse is not None and nmae is not None and nmae > nrmse + _TOLERANCE
    ]
    if problems:
        return problems
    expected = average(evaluated, names) if result.complete else None
    if (result.averages is None) != (expected is None):
        state = "null: the run is incomplete" if expected is None else "averages"
        return [Problem("wrong averages", where=f"{path}: averages", expected=state)]
    for protocol, means in (expected or {}).items():
        for metric, value in means.items():
            recorded = (result.averages or {}).get(protocol, {}).get(metric)
            same = recorded is None and value is None
            if value is not None and recorded is not None:
                same = abs(recorded - value) <= _TOLERANCE
            if not same:
                problems.append(
                    Problem(
                        "average does not follow from the pairs",
                        where=f"{path}: averages.{protocol}.{metric}",
                        expected=str(value),
                        got=str(recorded),
                    )
                )
    return problems


def result_schema() -> str:
    """Return the JSON schema of a result, as published in ``dfdbench/schemas``."""
    return json.dumps(Result.model_json_schema(), indent=1, sort_keys=True) + "\n"
