"""Write or update a row of the leaderboard with a method's runs, and rerun part of one."""

import math
import random
import secrets
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dfdbench.blur.tracks import CLEAN, SUITES
from dfdbench.board import LEADERBOARD, SCORE_TOLERANCE, board, cards, row_file
from dfdbench.board.row_file import Row
from dfdbench.datasets.dataset import Dataset, open_dataset
from dfdbench.datasets.fingerprint import require_sound
from dfdbench.errors import InputError, Problem, ResultError, StoreError, refuse_both
from dfdbench.evaluation.fitting import fit_method
from dfdbench.evaluation.loading import load_for
from dfdbench.evaluation.pair import PairEvaluator
from dfdbench.evaluation.run import trained_on_of
from dfdbench.methods.method import Method
from dfdbench.methods.registry import built_in_methods
from dfdbench.metrics.protocol import RELEASED
from dfdbench.results.record import PairResult, Result
from dfdbench.results.wording import without_folders
from dfdbench.system.files import write_whole
from dfdbench.system.text import differences

# Ours, too, though no name leads there.
_UNNAMED = "dfdbench.methods.baselines:ConstantMedian"


def require_submittable(limit: int | None) -> None:
    """Before a run, refuse it if there is no leaderboard or the leaderboard would refuse it.

    Raises
    ------
    InputError, ResultError
        If the run is limited to some pairs, or there is no leaderboard here.
    """
    refuse_both({"--submit": True}, {"--limit": limit})
    if not LEADERBOARD.is_dir():
        fix = "run this in the root of a clone of dfdbench"
        raise ResultError("no leaderboard here to submit to", where=str(LEADERBOARD), fix=fix)
    board.require_leaderboard(LEADERBOARD)


def require_fit_to_submit(method: Method, store: Dataset, split: str) -> None:
    """Refuse a damaged data set, a method without a card, and one trained on the test.

    Raises
    ------
    StoreError, ResultError, InputError
        If the data set does not hold what was built; if the method has no card; if its weights were
        trained on scenes of the test.
    """
    parameters = without_folders(method.parameters)
    cards.find_card(LEADERBOARD, method.name, without_folders(method.entry), parameters)
    require_sound(store)
    saw, where = (method.trained_on, method.weights_sha256), f"--split {split}"
    InputError.raise_if(row_file.training_problems(*saw, store.manifest.stem, split, where))


def submit(results: Result | Sequence[Result], folder: Path) -> Path:
    """Write runs into the row of their method's card, and return its file.

    The row's runs on other tracks stay if they are of the same method.

    Parameters
    ----------
    results : Result or sequence of Result
        Runs of one method on one split, on clean images, on tracks, or both.
    folder : Path
        The leaderboard's folder.

    Raises
    ------
    ResultError
        If a run is not on a released data set's split, the runs are not of one method, the method
        has no card, another method's row is there, or a partial run would replace a complete one.
        Then nothing is written.
    """
    runs = [results] if isinstance(results, Result) else list(results)
    labels = {run.dataset.degradation for run in runs}
    _require_one_method(runs)
    row = row_file.row_of(runs, [CLEAN])
    row_file.require_pairs(row, "this run")
    ResultError.raise_if(row_file.row_problems(row, folder, "this run"))
    method = row.method
    name = cards.find_card(folder, method.name, method.entry, method.parameters, row.given_blur)
    path = row.place(folder, name)
    suites: list[str] = []
    if path.exists():
        there = row_file.read_row(path)
        _require_same_method(there.results[0], runs[0], path)
        _require_no_less(there.results, runs, path)
        runs += [run for run in there.results if run.dataset.degradation not in labels]
        suites = there.suites
    # Clean images that were run along with tracks do not enter the ranking of clean images.
    clean = labels == {CLEAN}
    entered = [CLEAN] if clean else _suites({r.dataset.degradation for r in runs})
    order = [CLEAN, *SUITES]
    row = row_file.row_of(runs, sorted({*suites, *entered}, key=order.index))
    write_whole(path, row_file.row_text(row))
    return path


def _suites(labels: set[str]) -> list[str]:
    whole = [name for name, suite in SUITES.items() if labels.issuperset(suite)]
    begun = [name for name, suite in SUITES.items() if (labels - {CLEAN}).issubset(suite)]
    return whole or begun[:1] or [next(iter(SUITES))]


def facts_of(result: Result) -> dict[str, Any]:
    """Return what two runs of one method on one split have in common."""
    method, dataset = result.method, result.dataset
    facts = {
        "name": method.name,
        "parameters": method.parameters,
        "split": dataset.split,
        "manifest_sha256": dataset.manifest_sha256,
        "entry": method.entry,
        "weights_sha256": method.weights_sha256,
        "files_sha256": method.files_sha256,
        "seed": result.seed,
    }
    # The source of our own methods may change in ways that do not matter.
    if method.entry not in built_in_methods().values():
        facts["source_sha256"] = method.source_sha256
    return facts


def _require_one_method(runs: Sequence[Result]) -> None:
    what = "the runs are not of one method on one split"
    ResultError.raise_if(
        Problem(f"{what}: {value}, not {first}", where=f"{run.dataset.degradation}: {name}")
        for run in runs
        for name, first, value in differences(facts_of(runs[0]), facts_of(run))
    )


def _require_same_method(there: Result, new: Result, path: Path) -> None:
    for name, found, own in differences(facts_of(there), facts_of(new)):
        what = f"another method is there: its {name} is {found}, not {own}"
        fix = "give your method a card of another name; if the row is yours, remove its file"
        raise ResultError(what, where=str(path), fix=fix)


def _require_no_less(there: Sequence[Result], new: Sequence[Result], path: Path) -> None:
    whole = {run.dataset.degradation for run in there if run.complete}
    for run in new:
        if run.dataset.degradation in whole and not run.complete:
            data, fix = run.dataset, "run the rest: the same command continues where it stopped"
            done = f"{data.degradation}, {data.evaluated} of {data.expected} pairs"
            what = f"a partial run on {done}, would replace a complete one"
            raise ResultError(what, where=str(path), fix=fix)


@dataclass(frozen=True)
class Rerun:
    """A pair that was run again.

    Parameters
    ----------
    name : str
        The run's label and the pair.
    same_map : bool
        Whether the depth maps are identical to the last bit.
    difference : float
        The largest difference of a score; infinite if just one has it, or the rerun has none.
    wrong : str
        What else differs from the row; empty if nothing does.
    """

    name: str
    same_map: bool
    difference: float
    wrong: str = ""

    def passes(self, tolerance: float) -> bool:
        """Return whether the rerun confirms the row."""
        return self.difference <= tolerance and not self.wrong

    def __str__(self) -> str:
        depth = "same depth map" if self.same_map else "another depth map"
        text = f"{self.name}: {depth}, scores at most {self.difference:.2g} off"
        return f"{text}; {self.wrong}" if self.wrong else text


@dataclass(frozen=True)
class Verification:
    """The result of running pairs of a row again, and the seed that drew them."""

    seed: int
    drawn_from: int
    tolerance: float
    pairs: tuple[Rerun, ...]
    same_source: bool

    @property
    def passed(self) -> bool:
        """Whether every pair confirmed the row."""
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
    """Rerun pairs of a row and compare depth maps and scores.

    Nobody can predict which pairs are drawn. A method with a fit is fitted anew for each track that
    is drawn.

    Parameters
    ----------
    row : Row
        What was claimed.
    path : Path
        Its file.
    count : int
        How many pairs to run over all runs; if there are fewer, all.
    seed : int, optional
        Repeats an earlier draw; by default, draw at random.
    tolerance : float
        How far a score may be off, 0 to 1.
    trusted : collection of str
        Entries of methods that are not built in but may be imported.
    weights : Path, optional
        Your copy of weights that are not shipped.
    on_pair : callable, optional
        Called with (pairs done, pairs to do).

    Raises
    ------
    InputError
        If the tolerance is not from 0 to 1.
    ResultError
        As for `require_trusted`; if there is no run, or data sets of the draw are missing here or
        differ.
    """
    if not 0 <= tolerance <= 1:
        raise InputError(f"a tolerance is a number from 0 to 1, not {tolerance:g}")
    require_trusted({path: row}, trusted)
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


def require_trusted(rows: Mapping[Path, Row], trusted: Collection[str]) -> None:
    """Refuse rows of methods that are neither this package's nor trusted.

    Raises
    ------
    ResultError
        If their code would have to be imported; it names all of them.
    """
    known = {*built_in_methods().values(), _UNNAMED, *trusted}
    ResultError.raise_if(
        Problem(
            f"{entry!a} is not built in, and its code is run only if you trust it",
            where=f"{path}: method.entry",
            fix=f"read the code, then add --trust {entry!a}; use a container (CONTRIBUTING.md)",
        )
        for path, entry in ((path, row.method.entry) for path, row in rows.items())
        if entry not in known
    )


def _opened(results: Sequence[Result], path: Path) -> list[Dataset]:
    """Open the data sets of runs as built here; the error names all that are not built."""
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
    """Rerun pairs of one run, loaded and fitted as before; yield whether the source matches too."""
    record, dataset = result.method, result.dataset
    parameters: dict[str, Any] = dict(record.parameters)
    if weights:
        parameters["weights"] = str(weights)
    given = dataset.degradation != CLEAN and "recipe" in record.uses
    # Load it by its entry, which is trusted: a name may lead elsewhere.
    method = load_for(store, record.entry, parameters, result.seed, given, dataset.split)
    fit = fit_method(store, method, dataset.split, result.seed)
    facts = {
        "uses": sorted(method.uses),
        "trained_on": trained_on_of(method, store.manifest, dataset.split),
        "weights_sha256": method.weights_sha256,
        "fitted_on": fit.fitted_on if fit else None,
        "recipe": store.attributes["recipe"],
    }
    claimed = {**record.model_dump(), "uses": sorted(record.uses), "recipe": dataset.recipe}
    wrong = [f"{k} is {v}, not {claimed[k]}" for k, v in facts.items() if claimed[k] != v]
    same_source = method.source_sha256 == record.source_sha256
    protocols = [RELEASED[label] for label in result.protocol_names]
    evaluate = PairEvaluator(store, method, result.seed, protocols)
    for claim in claims:
        rerun = evaluate(claim.pair)[0]
        same_map = claim.prediction_sha256 == rerun.prediction_sha256
        largest = max(_differences(claim, rerun), default=0.0)
        told = "; ".join(filter(None, (*wrong, *_other_facts(claim, rerun), rerun.error)))
        yield Rerun(f"{dataset.degradation}: {claim.id}", same_map, largest, told), same_source


def _differences(claim: PairResult, rerun: PairResult) -> Iterator[float]:
    for protocol, scores in claim.scores.items():
        for metric, claimed in scores.items():
            found = rerun.score(protocol, metric)
            if claimed is None or found is None:
                yield 0.0 if claimed is found and rerun.scores else float("inf")
            else:
                yield abs(claimed - found)


def _other_facts(claim: PairResult, rerun: PairResult) -> Iterator[str]:
    """Yield what differs besides scores: the answered share, and numbers that the method keeps."""
    found = {"answered": rerun.answered, **rerun.numbers}
    for name, number in {"answered": claim.answered, **claim.numbers}.items():
        if abs(found.get(name, math.inf) - number) > SCORE_TOLERANCE * max(abs(number), 1.0):
            yield f"{name} is {found.get(name)}, not {number}"
