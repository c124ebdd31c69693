"""Run pairs of a row again, drawn anew each time, and see whether the same comes out."""

import random
import secrets
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dfdbench.blur.tracks import CLEAN
from dfdbench.board import SCORE_TOLERANCE
from dfdbench.board.row_file import Row
from dfdbench.datasets.dataset import Dataset, open_dataset
from dfdbench.errors import InputError, Problem, ResultError, StoreError
from dfdbench.evaluation.fitting import fit_method
from dfdbench.evaluation.loading import load_for
from dfdbench.evaluation.pair import PairEvaluator
from dfdbench.evaluation.run import trained_on_of
from dfdbench.methods.registry import built_in_methods
from dfdbench.metrics.protocol import RELEASED
from dfdbench.results.record import PairResult, Result


@dataclass(frozen=True)
class Rerun:
    """A pair that was run again.

    Parameters
    ----------
    name : str
        The run's label and the pair.
    same_map : bool
        Whether the depth map is the same to the last bit.
    difference : float
        The largest difference of a score; infinite if one of the two has no score.
    wrong : str
        What else is not as the row says; empty if nothing.
    """

    name: str
    same_map: bool
    difference: float
    wrong: str = ""

    def passes(self, tolerance: float) -> bool:
        """Return whether the pair gave what the row says."""
        return self.difference <= tolerance and not self.wrong

    def __str__(self) -> str:
        depth = "same depth map" if self.same_map else "another depth map"
        text = f"{self.name}: {depth}, scores at most {self.difference:.2g} off"
        return f"{text}; {self.wrong}" if self.wrong else text


@dataclass(frozen=True)
class Verification:
    """What running pairs of a row again gave, and the seed that drew them."""

    seed: int
    drawn_from: int
    tolerance: float
    pairs: tuple[Rerun, ...]
    same_source: bool

    @property
    def passed(self) -> bool:
        """Whether every pair gave what the row says."""
        return all(pair.passes(self.tolerance) for pair in self.pairs)


def verify(
    row: Row,
    path: Path,
    count: int = 5,
    seed: int | None = None,
    tolerance: float = SCORE_TOLERANCE,
    trusted: Collection[str] = (),
    weights: Path | None = None,
    on_pair: Callable[[int, int], None] | None = None,
) -> Verification:
    """Run pairs of a row again and compare depth maps and scores.

    Nobody can know beforehand which pairs are drawn. A method with a fit is fitted anew for each
    track that is drawn.

    Parameters
    ----------
    row : Row
        What was claimed.
    path : Path
        Its file.
    count : int
        How many pairs of all runs together; all if there are fewer.
    seed : int, optional
        Repeats an earlier draw; default: fresh randomness.
    tolerance : float
        How far a score may be off, 0 to 1.
    trusted : collection of str
        Entries of methods that are not built in and may be imported.
    weights : Path, optional
        Your copy of weights that are not shipped.
    on_pair : callable, optional
        Called with (pairs done, pairs to do).

    Raises
    ------
    InputError
        If the tolerance is not from 0 to 1.
    ResultError
        If the method is neither built in nor trusted, nothing was run, or data sets of the draw
        are not built here or are others.
    """
    if not 0 <= tolerance <= 1:
        raise InputError(f"a tolerance is a number from 0 to 1, not {tolerance:g}")
    if row.method.entry not in {*built_in_methods().values(), *trusted}:
        entry, where = f"{row.method.entry!a}", f"{path}: method.entry"
        what = f"{entry} is not built in, and its code is run only if you trust it"
        fix = f"read the code, then add --trust {entry}; use a container (CONTRIBUTING.md)"
        raise ResultError(what, where=where, fix=fix)
    done = [(result, pair) for result in row.results for pair in result.evaluated]
    if not done:
        raise ResultError("no pair was evaluated: nothing to verify", where=str(path))
    seed = secrets.randbits(32) if seed is None else seed
    drawn = random.Random(seed).sample(done, min(count, len(done)))
    claims = {
        number: own
        for number, result in enumerate(row.results)
        if (own := [pair for drawn_from, pair in drawn if drawn_from is result])
    }
    stores = _opened([row.results[number] for number in claims], path)
    found: list[Rerun] = []
    same_source = True
    for (number, own), store in zip(claims.items(), stores, strict=True):
        for rerun, same in _run_again(row.results[number], own, store, weights):
            found.append(rerun)
            same_source &= same
            if on_pair:
                on_pair(len(found), len(drawn))
    return Verification(seed, len(done), tolerance, tuple(found), same_source)


def _opened(results: Sequence[Result], path: Path) -> list[Dataset]:
    """Return the data sets of runs as they are built here; all that are not are named."""
    stores, problems = list[Dataset](), list[Problem]()
    for dataset in (result.dataset for result in results):
        where, fix = f"{path}: {dataset.degradation}", f"dfdbench build {dataset.name}"
        try:
            stores.append(open_dataset(dataset.name))
        except StoreError as error:
            problems += [Problem(found.what, where=where, fix=fix) for found in error.problems]
            continue
        if stores[-1].fingerprint != dataset.fingerprint:
            what = f"{dataset.name} as it is built here is not what the row was run on"
            problems.append(Problem(what, where=f"{where}, fingerprint", fix=fix))
    ResultError.raise_if(problems)
    return stores


def _run_again(
    result: Result, claims: Sequence[PairResult], store: Dataset, weights: Path | None
) -> Iterator[tuple[Rerun, bool]]:
    """Run pairs of one run again, loaded and fitted as it was; tell whether the source is too."""
    record, dataset = result.method, result.dataset
    parameters: dict[str, Any] = dict(record.parameters)
    if weights:
        parameters["weights"] = str(weights)
    given = dataset.degradation != CLEAN and "recipe" in record.uses
    # By its entry, which is trusted: a name may lead elsewhere.
    method = load_for(store, record.entry, parameters, result.seed, given)
    fit = fit_method(store, method, dataset.split, result.seed)
    facts = {
        "uses": sorted(method.uses),
        "trained_on": trained_on_of(method, store.manifest),
        "weights_sha256": method.weights_sha256,
        "fitted_on": fit.fitted_on if fit else None,
    }
    claimed = {**record.model_dump(), "uses": sorted(record.uses)}
    wrong = [f"{k} is {v}, not {claimed[k]}" for k, v in facts.items() if claimed[k] != v]
    same_source = method.source_sha256 == record.source_sha256
    protocols = [RELEASED[label] for label in result.protocol_names]
    evaluate = PairEvaluator(store, method, result.seed, protocols)
    for claim in claims:
        rerun = evaluate(claim.pair)[0]
        same_map = claim.prediction_sha256 == rerun.prediction_sha256
        largest = max(_differences(claim, rerun), default=0.0)
        told = "; ".join(filter(None, (*wrong, rerun.error)))
        yield Rerun(f"{dataset.degradation}: {claim.id}", same_map, largest, told), same_source


def _differences(claim: PairResult, rerun: PairResult) -> Iterator[float]:
    for protocol, scores in claim.scores.items():
        for metric, claimed in scores.items():
            found = rerun.score(protocol, metric) if rerun.scores else None
            if claimed is None or found is None:
                yield 0.0 if claimed is found and rerun.scores else float("inf")
            else:
                yield abs(claimed - found)
