"""Run a sample of a result's pairs again and see whether the same comes out."""

from __future__ import annotations

import json
import random
from collections.abc import Callable
from datetime import UTC, datetime
from hashlib import sha256
from pathlib import Path
from typing import Literal

from pydantic import Field, ValidationError

from dfdbench.environment import describe_environment
from dfdbench.errors import Problem, ResultError, unknown_name
from dfdbench.evaluate import without_folder
from dfdbench.files import write_whole
from dfdbench.manifest import Pair
from dfdbench.methods import registered_methods
from dfdbench.pair_evaluation import PairEvaluator, load_for
from dfdbench.protocol import METRICS, RELEASED
from dfdbench.result import (
    Environment,
    Finite,
    MethodRecord,
    Model,
    PairResult,
    Result,
    Sha256,
)
from dfdbench.store import Store
from dfdbench.submission import TIME_FORMAT

SUFFIX = ".verified.json"


class Verification(Model):
    """What a verification found, kept beside the result.

    `result_sha256` is that of the result's file: a result that changes is no longer verified.
    `identical` of the `pairs` gave the very same depth map; the others' scores are at most
    `largest_difference` away.
    """

    schema_version: Literal[1] = 1
    result_sha256: Sha256
    verified: str
    seed: int
    tolerance: Finite
    pairs: list[str] = Field(min_length=1)
    identical: int
    largest_difference: Finite
    same_source: bool
    environment: Environment


def verify(
    result: Result,
    path: Path,
    store: Store,
    count: int = 5,
    seed: int = 0,
    tolerance: float = 1e-3,
    on_pair: Callable[[int, int], None] | None = None,
) -> Verification:
    """Run a random sample of a result's pairs again and compare.

    Parameters
    ----------
    result : Result
        What was claimed.
    path : Path
        Its file.
    store : Store
        The data set.
    count : int
        How many pairs; all where there are fewer.
    seed : int
        Of the sample.
    tolerance : float
        How far a score may be off where the depth map is not the very same: float32 filters
        differ in the last digits between processors.
    on_pair : callable, optional
        Called with (pairs done, pairs to do).

    Raises
    ------
    ResultError
        Where the data or the method are others than the result says, or a pair gives another
        depth map and another score.
    UnknownNameError
        Where the result was scored under a protocol that is not released here.
    """
    if store.fingerprint != result.dataset.fingerprint:
        raise ResultError(
            Problem(
                "the result was made with other data", f"{path}: dataset.fingerprint",
                f"{store.fingerprint} ({store.path})", result.dataset.fingerprint,
                f"dfdbench build {result.dataset.name}, or name the store: --dataset PATH",
            )
        )  # fmt: skip
    if problems := entry_problems(result.method, path):
        raise ResultError(problems)
    evaluated = [pair for pair in result.pairs if pair.status == "ok"]
    if not evaluated:
        raise ResultError(Problem("no pair was evaluated: nothing to verify", str(path)))
    chosen = random.Random(seed).sample(evaluated, min(count, len(evaluated)))
    record = result.method
    method = load_for(store, record.name, record.parameters, result.seed)
    pairs = [Pair(claim.scene, tuple(claim.coordinates.items())) for claim in chosen]
    # Under the versions that the result names: its scores are of no other.
    unknown = [label for label in result.protocol_names if label not in RELEASED]
    if unknown:
        raise unknown_name(f"protocol of {path}", unknown[0], RELEASED)
    protocols = [RELEASED[label] for label in result.protocol_names]
    evaluate = PairEvaluator(store, method, result.seed, protocols)
    problems, identical, largest = [], 0, 0.0
    for number, (claim, pair) in enumerate(zip(chosen, pairs, strict=True), 1):
        rerun, _ = evaluate(pair)
        if on_pair:
            on_pair(number, len(pairs))
        identical += claim.prediction_sha256 == rerun.prediction_sha256
        difference = _difference(claim, rerun)
        if difference is None or difference > tolerance:
            problems.append(_mismatch(claim, rerun, path, tolerance))
        else:
            largest = max(largest, difference)
    if problems:
        raise ResultError(problems)
    return Verification(
        result_sha256=sha256(path.read_bytes()).hexdigest(),
        verified=datetime.now(UTC).strftime(TIME_FORMAT),
        seed=seed,
        tolerance=tolerance,
        pairs=[claim.id for claim in chosen],
        identical=identical,
        largest_difference=largest,
        same_source=method.source_sha256 == record.source_sha256,
        environment=describe_environment(),
    )


def entry_problems(method: MethodRecord, path: Path) -> list[Problem]:
    """Return what is wrong where a result's method is not found by its name.

    The name is what runs, the entry what a reader takes for its origin: they must be one. A
    name that is not registered here is another package's, of which nothing is known.
    """
    entry = method.name if ":" in method.name else registered_methods().get(method.name)
    if entry is None or without_folder(entry) == method.entry:
        return []
    return [
        Problem(
            "the method's name leads to another entry", f"{path}: method.entry",
            without_folder(entry), method.entry, "submit the run again with this version",
        )
    ]  # fmt: skip


def save_verification(verification: Verification, path: Path) -> Path:
    """Write a verification beside the result that it is of."""
    place = path.with_name(path.stem + SUFFIX)
    write_whole(place, verification.model_dump_json(indent=1) + "\n")
    return place


def load_verification(path: Path) -> Verification | None:
    """Read the verification beside a result; None where there is none.

    Raises
    ------
    ResultError
        Where it cannot be read or is of another content of the result's file.
    """
    place = path.with_name(path.stem + SUFFIX)
    if not place.exists():
        return None
    try:
        verification = Verification.model_validate(json.loads(place.read_text(encoding="utf-8")))
    except (UnicodeDecodeError, json.JSONDecodeError, ValidationError) as error:
        raise ResultError(
            Problem("cannot read the verification", str(place), got=str(error))
        ) from error
    there = sha256(path.read_bytes()).hexdigest()
    if verification.result_sha256 != there:
        raise ResultError(
            Problem(
                "the verification is of another file than the result beside it",
                f"{place}: result_sha256", there, verification.result_sha256,
                f"dfdbench leaderboard verify {path} --record",
            )
        )  # fmt: skip
    return verification


def _difference(claim: PairResult, rerun: PairResult) -> float | None:
    largest = 0.0
    for protocol, scores in claim.scores.items():
        for metric in METRICS:
            claimed = getattr(scores, metric)
            found = getattr(rerun.scores[protocol], metric) if rerun.scores else None
            if (claimed is None) != (found is None):
                return None
            if claimed is not None:
                largest = max(largest, abs(claimed - found))
    return largest if rerun.scores else None


def _mismatch(claim: PairResult, rerun: PairResult, path: Path, tolerance: float) -> Problem:
    def told(pair: PairResult, protocol: str) -> str:
        if not pair.scores:
            return pair.error or pair.status
        scores = pair.scores[protocol]
        return ", ".join(
            f"{metric.upper()} {value:.6f}" if value is not None else f"{metric.upper()} undefined"
            for metric in METRICS
            for value in [getattr(scores, metric)]
        )

    protocol = next(iter(claim.scores))
    same = claim.prediction_sha256 == rerun.prediction_sha256
    return Problem(
        "the same depth map has other scores" if same else "the pair gives another depth map",
        f"{path}: {claim.id}",
        f"{told(rerun, protocol)} (run here), within {tolerance:g}",
        f"{told(claim, protocol)} (in the file)",
    )
