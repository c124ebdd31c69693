"""Run a sample of a result's pairs again and see whether the same comes out."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path

from dfdbench.datasets.store import Store
from dfdbench.errors import InputError, Problem, ResultError, unknown_name
from dfdbench.evaluation.fitting import fit_method
from dfdbench.evaluation.loading import load_for
from dfdbench.evaluation.pair import PairEvaluator
from dfdbench.evaluation.result import trained_on_of
from dfdbench.leaderboard.claimed_method import (
    ClaimedMethod,
    claimed_method,
    other_claims,
    parameters_to_run,
)
from dfdbench.leaderboard.entry_problems import entry_problems
from dfdbench.leaderboard.verification_file import (
    SCORE_TOLERANCE,
    VerifiedSample,
    name_on_track,
    sample,
    tracks_sample,
)
from dfdbench.metrics.metric import find_metric
from dfdbench.metrics.protocol import RELEASED, Protocol
from dfdbench.results.folder import require_pairs_of
from dfdbench.results.record import PairResult, Result


def claim_of(result: Result, path: Path) -> ClaimedMethod:
    """Return what running a result's method would import, without importing it.

    Raises
    ------
    ResultError, UnknownNameError
        As `dfdbench.leaderboard.claimed_method.claimed_method`,
        and where name and entry are not one, or where nothing was run.
    """
    if result.method.scored:
        raise ResultError(
            "depth maps made elsewhere: there is nothing to run again",
            where=f"{path}: method",
            expected="a result that `dfdbench run` wrote",
            got=result.method.title,
        )
    if problems := entry_problems(result.method, path):
        raise ResultError.of(problems)
    return claimed_method(result.method, path)


def verify_result(
    result: Result,
    path: Path,
    store: Store,
    count: int = 5,
    seed: int = 0,
    tolerance: float = SCORE_TOLERANCE,
    trusted: Collection[str] = (),
    weights: Path | None = None,
    on_pair: Callable[[int, int], None] | None = None,
) -> VerifiedSample:
    """Run a random sample of a result's pairs again and compare.

    A method with a fit is fitted anew first: what the result's run had learned is not asked for.

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
        How far a score may be off, 0 to 1.
    trusted : collection of str
        Entries, as results record them, of methods that are not built in and may be imported.
    weights : Path, optional
        The file of weights that a result names, where they are not shipped.
    on_pair : callable, optional
        Called with (pairs done, pairs to do).

    Raises
    ------
    InputError
        For a tolerance that is none.
    ResultError
        Where the data or the method are others than the result says, the method is neither built
        in nor trusted, or a pair gives another depth map and another score.
    UnknownNameError
        Where the result was scored under a protocol that is not released here.
    """
    _require_tolerance(tolerance)
    _require_data(result, store, path)
    claim_of(result, path).require_consent(trusted, path)
    chosen = sample(result, count, seed)
    if not chosen:
        raise ResultError("no pair was evaluated: nothing to verify", where=str(path))
    compared = _Comparison(path, tolerance, len(chosen), on_pair)
    same_source = compared.run_again(result, chosen, store, weights)
    return compared.outcome([claim.id for claim in chosen], same_source)


def verify_tracks(
    results: Mapping[str, Result],
    path: Path,
    open_named: Callable[[str], Store],
    count: int = 5,
    seed: int = 0,
    tolerance: float = SCORE_TOLERANCE,
    trusted: Collection[str] = (),
    weights: Path | None = None,
    on_pair: Callable[[int, int], None] | None = None,
) -> VerifiedSample:
    """Run a random sample of the pairs of runs on tracks again, as `verify_result` does.

    Parameters
    ----------
    results : mapping of str to Result
        What was claimed, by ``clean`` and ``TRACK-SEVERITY``.
    path : Path
        Its file.
    open_named : callable
        Opens a data set by its name, on a track or not; called for those that were drawn.
    count, seed, tolerance, trusted, weights, on_pair
        As for `verify_result`; the sample is over all runs together.

    Raises
    ------
    InputError, ResultError, UnknownNameError
        As of `verify_result`.
    """
    _require_tolerance(tolerance)
    claim_of(next(iter(results.values())), path).require_consent(trusted, path)
    chosen = tracks_sample(results, count, seed)
    if not chosen:
        raise ResultError("no pair was evaluated: nothing to verify", where=str(path))
    compared = _Comparison(path, tolerance, len(chosen), on_pair)
    same_source = True
    # A fit is made once for all pairs of its run.
    for label in dict.fromkeys(label for label, _ in chosen):
        result = results[label]
        store = open_named(result.dataset.name)
        _require_data(result, store, path)
        claims = [pair for name, pair in chosen if name == label]
        same_source &= compared.run_again(result, claims, store, weights)
    return compared.outcome([name_on_track(*each) for each in chosen], same_source)


class _Comparison:
    """Pairs that are run again, held against what was claimed."""

    def __init__(
        self, path: Path, tolerance: float, count: int, on_pair: Callable[[int, int], None] | None
    ) -> None:
        self._path, self._tolerance = path, tolerance
        self._count, self._on_pair = count, on_pair
        self._problems: list[Problem] = []
        self._identical = self._done = 0
        self._largest = 0.0

    def run_again(
        self, result: Result, claims: Sequence[PairResult], store: Store, weights: Path | None
    ) -> bool:
        """Run some pairs of a result again; return whether the method's source is the same."""
        record = result.method
        # By its entry, which was agreed to: a name may hold a folder of another machine.
        parameters = parameters_to_run(record, weights, self._path)
        told = store.manifest.on_track and "recipe" in record.uses
        method = load_for(store, record.entry, parameters, result.seed, told)
        protocols = _protocols_of(result, self._path)
        fit = fit_method(store, method, result.dataset.split, result.seed)
        found: dict[str, object] = {
            "uses": sorted(method.uses),
            "trained_on": trained_on_of(method, store.manifest),
            "weights_sha256": method.weights_sha256,
            "fitted_on": fit.fitted_on if fit else None,
        }
        self._problems += other_claims(record, found, self._path)
        evaluate = PairEvaluator(store, method, result.seed, protocols)
        for claim in claims:
            self._compare(claim, evaluate(claim.pair)[0])
        return method.source_sha256 == record.source_sha256

    def _compare(self, claim: PairResult, rerun: PairResult) -> None:
        self._done += 1
        if self._on_pair:
            self._on_pair(self._done, self._count)
        self._identical += claim.prediction_sha256 == rerun.prediction_sha256
        difference = _difference(claim, rerun)
        if difference is None or difference > self._tolerance:
            self._problems.append(_mismatch(claim, rerun, self._path, self._tolerance))
        else:
            self._largest = max(self._largest, difference)

    def outcome(self, pairs: Sequence[str], same_source: bool) -> VerifiedSample:
        """Return what was found.

        Raises
        ------
        ResultError
            Where a pair gave another depth map and other scores.
        """
        if self._problems:
            raise ResultError.of(self._problems)
        return VerifiedSample(tuple(pairs), self._identical, self._largest, same_source)


def _require_tolerance(tolerance: float) -> None:
    if not 0 <= tolerance <= 1:
        raise InputError(
            what="not a tolerance", expected="a number from 0 to 1", got=f"{tolerance:g}"
        )


def _require_data(result: Result, store: Store, path: Path) -> None:
    if store.fingerprint != result.dataset.fingerprint:
        raise ResultError(
            "the result was made with other data",
            where=f"{path}: dataset.fingerprint",
            expected=f"{store.fingerprint} ({store.path})",
            got=result.dataset.fingerprint,
            fix=f"dfdbench build {result.dataset.name}, or name the store: --dataset PATH",
        )
    require_pairs_of(result, store, path)


def _protocols_of(result: Result, path: Path) -> list[Protocol]:
    # The versions that the result names: its scores are of no other.
    unknown = [label for label in result.protocol_names if label not in RELEASED]
    if unknown:
        raise unknown_name(f"protocol of {path}", unknown[0], RELEASED)
    return [RELEASED[label] for label in result.protocol_names]


def _difference(claim: PairResult, rerun: PairResult) -> float | None:
    largest = 0.0
    for protocol, scores in claim.scores.items():
        # By the metrics that the result has: it may be from before the youngest.
        for metric, claimed in scores.items():
            found = rerun.score(protocol, metric) if rerun.scores else None
            if (claimed is None) != (found is None):
                return None
            if claimed is not None and found is not None:
                largest = max(largest, abs(claimed - found))
    return largest if rerun.scores else None


def _mismatch(claim: PairResult, rerun: PairResult, path: Path, tolerance: float) -> Problem:
    def told(pair: PairResult, protocol: str) -> str:
        if not pair.scores:
            return pair.error or pair.status
        return ", ".join(
            f"{find_metric(name).title} {'undefined' if value is None else format(value, '.6f')}"
            for name, value in pair.scores[protocol].items()
        )

    protocol = next(iter(claim.scores))
    same = claim.prediction_sha256 == rerun.prediction_sha256
    return Problem(
        "the same depth map has other scores" if same else "the pair gives another depth map",
        where=f"{path}: {claim.id}",
        expected=f"{told(rerun, protocol)} (run here), within {tolerance:g}",
        got=f"{told(claim, protocol)} (in the file)",
    )
