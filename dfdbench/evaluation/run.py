"""Run a method over a split: predict once a pair, score under every protocol, keep it all."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from dfdbench.datasets.manifest import Pair
from dfdbench.datasets.store import Store
from dfdbench.errors import MethodError
from dfdbench.evaluation.fitting import Fit, fit_again, fit_method, keep_fit
from dfdbench.evaluation.pair import Evaluated, PairEvaluator, RemoteEvaluator, blank_record
from dfdbench.evaluation.plan import RunOptions, RunPlan, plan_run
from dfdbench.evaluation.result import result_of
from dfdbench.methods.method import Method
from dfdbench.results.folder import (
    add_to_journal,
    is_of_run,
    keep_prediction,
    keep_store_place,
    open_run_folder,
    read_journal,
)
from dfdbench.results.record import PairResult, Result
from dfdbench.results.record_file import RESULT, save_result
from dfdbench.system.parallel import Pool
from dfdbench.system.work_folder import writing_folder

_BATCH = 256  # pairs whose depth maps are in memory together when many run at once


@dataclass(frozen=True)
class Run:
    """What `run_method` did.

    Parameters
    ----------
    result : Result
        The scores.
    folder : Path
        Where ``result.json`` and ``predictions.zarr`` lie.
    reused : int
        Pairs taken over from an earlier call that was stopped or limited.
    set_aside : Path or None
        Where an earlier run of another kind in the same folder was moved.
    """

    result: Result
    folder: Path
    reused: int
    set_aside: Path | None


def run_method(
    store: Store,
    method: Method,
    split: str,
    folder: Path,
    options: RunOptions | None = None,
    pool: Pool | None = None,
    warnings: Sequence[str] = (),
    on_pair: Callable[[int, int], None] | None = None,
) -> Run:
    """Evaluate a method on a split; go on where an earlier call was stopped.

    A method with a fit is fitted first, before anything is written, or is given what it learned
    in an earlier call of the same run.

    Parameters
    ----------
    store : Store
        The data set.
    method : Method
        From `load_for`.
    split : str
        Which pairs.
    folder : Path
        Where result and predictions go.
    options : RunOptions, optional
        How the run is made.
    pool : Pool, optional
        Where pairs are evaluated several at once, in other processes; by default one after the
        other in this one, which alone gives times that can be compared.
    warnings : sequence of str
        What the result is to say besides, such as
        `dfdbench.audit.trained_on.coverage_warnings` of training and test.
    on_pair : callable, optional
        Called with (pairs done, pairs to do).

    Raises
    ------
    StoreError
        Where the store holds no pair of the split, or none to fit the method on.
    MethodError
        Where the method cannot be fitted, or not for this split or this pool.
    ResultError
        Where the folder cannot be written.
    """
    plan = plan_run(store, method, split, options or RunOptions())
    identity = plan.identity
    with writing_folder(folder, "run"):
        goes_on = not plan.options.fresh and is_of_run(folder, identity)
        plan = replace(plan, fit=_fitted(plan, folder if goes_on else None, pool))
        set_aside = open_run_folder(folder, identity, plan.options.fresh)
        if plan.fit:
            keep_fit(folder, plan.fit)
        keep_store_place(folder, store.path)
        journal = _Journal(plan, folder, on_pair)
        reused = journal.done
        _evaluate(plan, journal, pool)
        result = result_of(plan, journal.records(), warnings)
        save_result(result, folder / RESULT)
    return Run(result, folder, reused, set_aside)


def _fitted(plan: RunPlan, before: Path | None, pool: Pool | None) -> Fit | None:
    fit = fit_again(plan.method, before) if before else None
    fit = fit or fit_method(plan.store, plan.method, plan.split, plan.options.seed)
    if fit and fit.learned is None and pool is not None:
        raise MethodError(
            "what the method learned cannot be sent to other processes",
            where=f"{plan.method.entry}: fit",
            expected="a fit that returns what it learned, as numbers and arrays by name",
            got="None: it is kept in the method itself",
            fix="leave out --workers and --scheduler",
        )
    return fit


class _Journal:
    """The records of a run's pairs, each written down as it comes."""

    def __init__(
        self, plan: RunPlan, folder: Path, on_pair: Callable[[int, int], None] | None
    ) -> None:
        self._plan, self._folder, self._on_pair = plan, folder, on_pair
        self._finished = read_journal(folder)
        self.to_do = [pair for pair in plan.chosen if pair.id not in self._finished]
        self.done = len(plan.chosen) - len(self.to_do)

    def note(self, pair: Pair, evaluated: Evaluated) -> None:
        """Write down what became of a pair."""
        record, depth = evaluated
        plan = self._plan
        if depth is not None and plan.options.keep_predictions:
            keep_prediction(self._folder, plan.store.manifest, pair, depth)
        self._finished[pair.id] = record
        add_to_journal(self._folder, record)
        self.done += 1
        if self._on_pair:
            self._on_pair(self.done, len(plan.chosen))

    def records(self) -> list[PairResult]:
        """Return the records of all pairs of the split, those not evaluated too."""
        wanted = {pair.id for pair in self._plan.chosen}
        present = {pair.id for pair in self._plan.available}
        return [
            self._finished[pair.id]
            if pair.id in wanted
            else blank_record(pair, "not-run" if pair.id in present else "missing")
            for pair in self._plan.expected
        ]


def _evaluate(plan: RunPlan, journal: _Journal, pool: Pool | None) -> None:
    if pool is None:
        evaluate = PairEvaluator(plan.store, plan.method, plan.options.seed)
        for pair in journal.to_do:
            journal.note(pair, evaluate(pair))
        return
    remote = RemoteEvaluator.of(plan.store, plan.method, plan.options.seed, plan.fit)
    for start in range(0, len(journal.to_do), _BATCH):
        pool.map(remote, journal.to_do[start : start + _BATCH], on_outcome=journal.note)
