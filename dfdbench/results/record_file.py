"""A result's file: written whole, read, and held against itself."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from dfdbench.errors import Problem, ResultError, reason_of
from dfdbench.metrics.protocol import label_of
from dfdbench.results.record import SCORED, PairResult, Result, average
from dfdbench.system.files import read_text, write_whole
from dfdbench.system.strict import problems_of
from dfdbench.system.text import parse_json

RESULT_SCHEMA_VERSION = 1
#: What a result is called in the folder of its run.
RESULT = "result.json"
# Each holds all pixels of the one before.
_WIDER = ("delta_105", "delta_115", "delta_125")
#: How far a recorded average may be from the one recomputed from the pairs.
_TOLERANCE = 1e-9


def save_result(result: Result, path: Path) -> None:
    """Write a result as JSON, whole or not at all."""
    write_whole(path, result.model_dump_json(indent=1) + "\n")


def load_result(path: Path | str) -> Result:
    """Read a run's result, check it, and compute its averages anew.

    Parameters
    ----------
    path : Path or str
        The result file, or the folder of the run.

    Raises
    ------
    ResultError
        Where it cannot be read, is of another schema version, or contradicts itself.
    """
    path = Path(path)
    path = path / RESULT if path.is_dir() else path
    content = read_json(path)
    found = content.get("schema_version") if isinstance(content, dict) else None
    # True equals 1 too.
    if type(found) is not int or found != RESULT_SCHEMA_VERSION:
        raise ResultError(
            "result of another version",
            where=str(path),
            expected=str(RESULT_SCHEMA_VERSION),
            got=str(found),
            fix="run the method again with this version of dfdbench",
        )
    try:
        result = Result.model_validate(content, strict=True)
    except ValidationError as error:
        problems = problems_of(error, "wrong value in the result", file=path)
        raise ResultError.of(problems) from error
    if problems := _contradictions(result, str(path)):
        raise ResultError.of(problems)
    return result


def read_json(path: Path) -> Any:
    """Return what a JSON file that a run wrote says.

    Raises
    ------
    ResultError
        Where it cannot be read.
    """
    try:
        text = read_text(path)
    except (OSError, UnicodeDecodeError) as error:
        reason = reason_of(error)
        raise ResultError(
            "cannot read the result",
            where=str(path),
            expected="a result file or the folder of a run",
            got=reason,
            fix="name what `dfdbench run` wrote: results/DATASET-SPLIT/METHOD",
        ) from error
    try:
        return parse_json(text)
    except ValueError as error:
        raise ResultError(
            "the result is damaged",
            where=str(path),
            expected="JSON as `dfdbench run` wrote it",
            got="an empty file" if not text.strip() else str(error),
            fix="the same `dfdbench run` writes it anew, from the pairs that it kept",
        ) from error


def _misplaced(result: Result, path: str) -> list[Problem]:
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
        twice = Problem("an axis is listed twice", where=f"{path}: dataset.axes", got=str(axes))
        problems.append(twice)
    for number, pair in enumerate(result.pairs):
        where = f"{path}: pairs.{number}"
        if pair.coordinates.keys() != set(axes):
            found = ", ".join(pair.coordinates)
            problems.append(
                Problem(
                    "a pair is not on the axes", where=where, expected=", ".join(axes), got=found
                )
            )
        elif pair.id != (name := pair.pair_on(axes).id):
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


def _contradictions(result: Result, path: str) -> list[Problem]:
    evaluated = [pair for pair in result.pairs if pair.status == "ok"]
    problems = [
        *_misplaced(result, path),
        *_miscounted(result, evaluated, path),
        *_unscored(result, evaluated, path),
        *_impossible(evaluated, path),
        *_not_run(result, path),
    ]
    return problems or list(_wrong_averages(result, evaluated, path))


def _miscounted(result: Result, evaluated: list[PairResult], path: str) -> Iterator[Problem]:
    ids = [pair.id for pair in result.pairs]
    if len(set(ids)) != len(ids) or len(ids) != result.dataset.expected:
        yield Problem(
            "pairs do not add up",
            where=f"{path}: pairs",
            expected=f"{result.dataset.expected} pairs, each once",
            got=f"{len(ids)} pairs, {len(set(ids))} different",
        )
    if len(evaluated) != result.dataset.evaluated:
        yield Problem(
            "evaluated pairs do not add up",
            where=f"{path}: dataset.evaluated",
            expected=str(len(evaluated)),
            got=str(result.dataset.evaluated),
        )
    if any(pair.machine >= len(result.environments) for pair in result.pairs):
        yield Problem("a pair was run on a machine that is not listed", where=f"{path}: pairs")


def _unscored(result: Result, evaluated: list[PairResult], path: str) -> Iterator[Problem]:
    names = result.protocol_names
    # What protocols in metres score they name; the others have the same metrics all over.
    named = {label_of(protocol): protocol.get("metrics") for protocol in result.protocols}
    metrics: set[str] | None = None
    for pair in evaluated:
        if set(pair.scores) != set(names):
            yield Problem(
                "scores are missing",
                where=f"{path}: {pair.id}",
                expected=", ".join(names),
                got=", ".join(pair.scores),
            )
        # A run from before a metric lacks it altogether: no mean is of some of the pairs.
        for protocol, scores in pair.scores.items():
            of_metres = named.get(protocol)
            metrics = metrics if of_metres else metrics or set(scores)
            wanted = set(of_metres or metrics or ())
            if set(scores) != wanted:
                yield Problem(
                    "the pairs are not scored by the same metrics",
                    where=f"{path}: {pair.id}, {protocol}",
                    expected=", ".join(sorted(wanted)),
                    got=", ".join(sorted(scores)),
                )


def _impossible(evaluated: list[PairResult], path: str) -> Iterator[Problem]:
    # What holds for every error cannot be otherwise: its mean never exceeds its root mean square,
    # and a wider bound holds more pixels.
    for pair in evaluated:
        for protocol in pair.scores:
            nrmse, nmae = pair.score(protocol, "nrmse"), pair.score(protocol, "nmae")
            if nrmse is not None and nmae is not None and nmae > nrmse + _TOLERANCE:
                yield Problem(
                    "NMAE is larger than NRMSE",
                    where=f"{path}: {pair.id}, {protocol}",
                    expected=f"at most {nrmse}",
                    got=str(nmae),
                )
            shares = [pair.score(protocol, name) or 0.0 for name in _WIDER]
            if shares != sorted(shares):
                yield Problem(
                    "fewer pixels lie within a wider bound",
                    where=f"{path}: {pair.id}, {protocol}",
                    expected=" <= ".join(_WIDER),
                    got=", ".join(map(str, shares)),
                )


def _not_run(result: Result, path: str) -> Iterator[Problem]:
    timed = [pair.id for pair in result.pairs if pair.seconds is not None]
    method = result.method
    if method.scored and (timed or method.source_sha256):
        yield Problem(
            f"{SCORED}, and yet it has a source or times",
            where=f"{path}: method.scored",
            expected="no source_sha256, no seconds",
            got=", ".join(timed[:1]) or str(method.source_sha256),
        )


def _wrong_averages(result: Result, evaluated: list[PairResult], path: str) -> Iterator[Problem]:
    expected = average(evaluated, list(result.protocol_names)) if result.complete else None
    if (result.averages is None) != (expected is None):
        state = "null: the run is incomplete" if expected is None else "averages"
        yield Problem("wrong averages", where=f"{path}: averages", expected=state)
        return
    recorded, expected = result.averages or {}, expected or {}
    for protocol, means in recorded.items():
        for name in means.keys() - expected.get(protocol, {}).keys():
            yield Problem(
                "an average of nothing that was scored", where=f"{path}: averages.{protocol}.{name}"
            )
    for protocol in recorded.keys() - expected.keys():
        yield Problem(
            "averages under a protocol that was not scored", where=f"{path}: averages.{protocol}"
        )
    for protocol, means in expected.items():
        for metric, value in means.items():
            got = recorded.get(protocol, {}).get(metric)
            if value is None or got is None:
                wrong = got is not value
            else:
                wrong = abs(got - value) > _TOLERANCE
            if wrong:
                yield Problem(
                    "average does not follow from the pairs",
                    where=f"{path}: averages.{protocol}.{metric}",
                    expected=str(value),
                    got=str(got),
                )
