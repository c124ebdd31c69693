"""What a verification found, kept beside the result and held against it."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from hashlib import sha256
from pathlib import Path
from typing import Annotated, Literal, TypeVar

from pydantic import Field, ValidationError

from dfdbench.errors import Problem, ResultError
from dfdbench.leaderboard.folder import REPRODUCED, read_own
from dfdbench.leaderboard.submission import TIME_FORMAT
from dfdbench.results.environment import describe_environment
from dfdbench.results.record import Count, Environment, PairResult, Result, Seed, Sha256, Time
from dfdbench.system.files import read_whole, write_whole
from dfdbench.system.record import Record, problems_of

T = TypeVar("T")

SUFFIX = f"{REPRODUCED}.json"
#: How far a score may be off where the depth map is not the very same: float32 filters differ in
#: the last digits between processors. What is recorded was found with this one.
SCORE_TOLERANCE = 1e-3


class Reproduction(Record):
    """What a verification found, kept beside the result.

    `result_sha256` is that of the result's file: of a result that changes nothing is known.
    `reproduced` says when; `seed` draws the `pairs`, of which `identical` gave the very same
    depth map; no score is more than `largest_difference` away.
    """

    schema_version: Literal[2] = 2
    result_sha256: Sha256
    reproduced: Time
    seed: Seed
    tolerance: Annotated[float, Field(ge=SCORE_TOLERANCE, le=SCORE_TOLERANCE)]
    pairs: list[str] = Field(min_length=1)
    identical: Count
    largest_difference: Annotated[float, Field(ge=0, le=SCORE_TOLERANCE)]
    same_source: bool
    environment: Environment


@dataclass(frozen=True)
class VerifiedSample:
    """What running a sample of pairs again gave.

    Parameters
    ----------
    pairs : tuple of str
        The sample.
    identical : int
        How many gave the very same depth map.
    largest_difference : float
        How far a score is off, at most.
    same_source : bool
        Whether the method's source file is the one that the result was made with.
    """

    pairs: tuple[str, ...]
    identical: int
    largest_difference: float
    same_source: bool


def sample(result: Result, count: int, seed: int) -> list[PairResult]:
    """Return the pairs that a seed draws from those that were evaluated; all if there are fewer."""
    return _drawn([pair for pair in result.pairs if pair.status == "ok"], count, seed)


def tracks_sample(
    results: Mapping[str, Result], count: int, seed: int
) -> list[tuple[str, PairResult]]:
    """Return the pairs that a seed draws from runs on tracks, each with its run's label."""
    evaluated = [
        (label, pair)
        for label, result in results.items()
        for pair in result.pairs
        if pair.status == "ok"
    ]
    return _drawn(evaluated, count, seed)


def name_on_track(label: str, pair: PairResult) -> str:
    """Return what a verification of runs on tracks calls a pair.

    Examples
    --------
    >>> pair = PairResult(id="Art/view1", scene="Art", coordinates={"view": 1}, status="ok")
    >>> name_on_track("camera-2", pair)
    'camera-2: Art/view1'
    """
    return f"{label}: {pair.id}"


def _drawn(evaluated: Sequence[T], count: int, seed: int) -> list[T]:
    return random.Random(seed).sample(evaluated, min(count, len(evaluated)))


def save_verification(outcome: VerifiedSample, seed: int, path: Path) -> Path:
    """Write what running pairs again gave beside the result that it is of.

    Parameters
    ----------
    outcome : VerifiedSample
        From `verify_result` with the released tolerance.
    seed : int
        Which drew the pairs.
    path : Path
        The result's file.
    """
    verification = Reproduction(
        result_sha256=sha256(read_whole(path)).hexdigest(),
        reproduced=datetime.now(UTC).strftime(TIME_FORMAT),
        seed=seed,
        tolerance=SCORE_TOLERANCE,
        pairs=list(outcome.pairs),
        identical=outcome.identical,
        largest_difference=outcome.largest_difference,
        same_source=outcome.same_source,
        environment=describe_environment(),
    )
    place = path.with_name(path.stem + SUFFIX)
    write_whole(place, verification.model_dump_json(indent=1) + "\n")
    return place


def load_verification(result: Result, path: Path) -> Reproduction | None:
    """Read the verification beside a result; None where there is none.

    Raises
    ------
    ResultError
        Where it cannot be read, is of another content of the result's file, or says what no
        verification of that result can say.
    """
    return _load(path, lambda count, seed: [pair.id for pair in sample(result, count, seed)])


def load_tracks_verification(results: Mapping[str, Result], path: Path) -> Reproduction | None:
    """Read the verification beside a file of runs on tracks, as `load_verification` does.

    Raises
    ------
    ResultError
        As of `load_verification`.
    """
    return _load(
        path,
        lambda count, seed: [
            name_on_track(label, pair) for label, pair in tracks_sample(results, count, seed)
        ],
    )


def status_of(verification: Reproduction | None) -> str:
    """Return whether a run was reproduced."""
    return "reproduced" if verification else "rerun"


def _load(path: Path, draw: Callable[[int, int], list[str]]) -> Reproduction | None:
    place = path.with_name(path.stem + SUFFIX)
    content = read_own(place)
    if content is None:
        return None
    fix = f"dfdbench leaderboard verify {path} --record"
    try:
        verification = Reproduction.model_validate_json(content, strict=True)
    except ValidationError as error:
        what = "wrong value in the verification"
        raise ResultError.of(problems_of(error, what, file=place, fix=fix)) from error
    problems = list(_contradictions(verification, draw, path, place, fix))
    if problems:
        raise ResultError.of(problems)
    return verification


def _contradictions(
    verification: Reproduction,
    draw: Callable[[int, int], list[str]],
    path: Path,
    place: Path,
    fix: str,
) -> Iterator[Problem]:
    there = sha256(read_whole(path)).hexdigest()
    if verification.result_sha256 != there:
        yield Problem(
            what="the verification is of another file than the result beside it",
            where=f"{place}: result_sha256",
            expected=there,
            got=verification.result_sha256,
            fix=fix,
        )
    drawn = draw(len(verification.pairs), verification.seed)
    if verification.pairs != drawn:
        yield Problem(
            what="the pairs are not those that the seed draws",
            where=f"{place}: pairs",
            expected=", ".join(drawn),
            got=", ".join(verification.pairs),
            fix=fix,
        )
    if verification.identical > len(verification.pairs):
        yield Problem(
            what="more depth maps are the same than were made",
            where=f"{place}: identical",
            expected=f"at most {len(verification.pairs)}",
            got=str(verification.identical),
            fix=fix,
        )
