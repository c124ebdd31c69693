"""Run a method over a split: predict once a pair, score under every protocol, keep it all."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest import Pair
from dfdbench.errors import MethodError
from dfdbench.evaluation.fitting import Fit, fit_again, fit_method, keep_fit
from dfdbench.evaluation.pair import (
    DIFFERS,
    EvaluatedElsewhere,
    PairEvaluator,
    RemoteEvaluator,
    blank_record,
)
from dfdbench.evaluation.plan import RunOptions, RunPlan, plan_run
from dfdbench.evaluation.result import result_of
from dfdbench.methods.calling import difference
from dfdbench.methods.method import Method
from dfdbench.methods.sources import Hashes
from dfdbench.results.environment import describe_environment
from dfdbench.results.folder import (
    add_to_journal,
    keep_identity,
    keep_prediction,
    keep_store_place,
    open_run_folder,
    read_identity,
    read_journal,
)
from dfdbench.results.record import Environment, PairResult, Result
from dfdbench.results.record_file import RESULT, save_result
from dfdbench.system.parallel import Pool
from dfdbench.system.work_folder import writing_folder
from dfdbench.tables.wording import counted, listed

_BATCH = 256  # pairs whose depth maps are in memory together when many run at once
_ENVIRONMENTS = "environments"
_Environments = TypeAdapter(list[Environment])


@dataclass(frozen=True)
class RunDone:
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
    because : tuple of str
        In what that differed from this one; empty if it was to be started over anyway.
    """

    result: Result
    folder: Path
    reused: int
    set_aside: Path | None
    because: tuple[str, ...] = ()

    @property
    def notes(self) -> list[str]:
        """What is to be said of an earlier run in the same folder."""
        notes = []
        if self.because:
            notes.append(f"started over: {listed(self.because, most=5)}")
        if self.set_aside:
            notes.append(f"the earlier run was moved to {self.set_aside}")
        if self.reused:
            pairs = counted(self.reused, "pair")
            notes.append(f"{pairs} taken over from an earlier call (--fresh evaluates anew)")
        return notes


def run_method(
    store: Dataset,
    method: Method,
    split: str,
    folder: Path,
    options: RunOptions | None = None,
    pool: Pool | None = None,
    warnings: Sequence[str] = (),
    on_pair: Callable[[int, int], None] | None = None,
) -> RunDone:
    """Evaluate a method on a split; go on where an earlier call was stopped.

    An earlier call of the same run has the same data, method (its modules and the files it opened),
    parameters, versions and processor architecture; any other run is set aside.

    A method with a fit is fitted first, before anything is written, or is given what it learned
    in an earlier call of the same run. The first pair is run twice, to see whether the answers are
    the same; its time is that of the first call.

    Parameters
    ----------
    store : Dataset
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
    with writing_folder(folder, "run"):
        before = None if plan.options.fresh else _begun(folder)
        because = plan.differs_from(before) if before is not None else []
        if because:
            before = None
        plan = replace(plan, fit=_fitted(plan, folder if before else None, pool))
        known = _Known(plan.identity, before)
        set_aside = open_run_folder(folder, known.content, before is not None)
        if plan.fit:
            keep_fit(folder, plan.fit)
        keep_store_place(folder, store.path)
        journal = _Journal(plan, folder, known, on_pair)
        reused = journal.done
        _evaluate(plan, journal, pool)
        said = [*_edited_meanwhile(plan, known), *warnings]
        result = result_of(plan, journal.records(), known.environments, said)
        save_result(result, folder / RESULT)
    return RunDone(result, folder, reused, set_aside, tuple(because))


def _begun(folder: Path) -> dict[str, Any] | None:
    """Return what a folder's run is known by; None if there is none, empty if it is damaged."""
    found = read_identity(folder)
    try:
        _Environments.validate_python((found or {}).get(_ENVIRONMENTS, []), strict=True)
    except ValidationError:
        return {}
    return found


def _edited_meanwhile(plan: RunPlan, known: _Known) -> list[str]:
    edited = plan.differs_from(known.content)
    return [f"{listed(edited)} while it was run: run it again"] if edited else []


class _Known:
    """By what a run is known, on disk too: its identity, and the machines that it was run on.

    Parameters
    ----------
    identity : dict
        Of this call.
    before : dict or None
        The content that an earlier call of the same run left.
    """

    def __init__(self, identity: dict[str, Any], before: dict[str, Any] | None) -> None:
        found = before or {}
        self.environments = _Environments.validate_python(found.get(_ENVIRONMENTS, []))
        self._identity = identity
        self._used: Hashes = dict(found.get("used", {}))
        self.add(identity["used"], None)

    @property
    def content(self) -> dict[str, Any]:
        """What is written down."""
        environments = [environment.model_dump() for environment in self.environments]
        return {**self._identity, "used": self._used, _ENVIRONMENTS: environments}

    def add(self, used: Hashes, environment: Environment | None) -> bool:
        """Add what was used and where; return whether that was new."""
        before = len(self.environments), dict(self._used)
        if environment and environment not in self.environments:
            self.environments.append(environment)
        for label, found in used.items():
            if found is None or label not in self._used:
                self._used[label] = found
        return before != (len(self.environments), self._used)


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
        self, plan: RunPlan, folder: Path, known: _Known, on_pair: Callable[[int, int], None] | None
    ) -> None:
        self._plan, self._folder, self._known, self._on_pair = plan, folder, known, on_pair
        places = range(len(known.environments))
        found = read_journal(folder)
        self._finished = {name: each for name, each in found.items() if each.machine in places}
        self.to_do = [pair for pair in plan.chosen if pair.id not in self._finished]
        self.done = len(plan.chosen) - len(self.to_do)
        self._first: EvaluatedElsewhere | None = None

    def note(self, pair: Pair, evaluated: EvaluatedElsewhere) -> None:
        """Write down what became of a pair; the first comes twice, and is compared."""
        plan = self._plan
        if pair == self.to_do[0]:
            if self._first is not None:
                self._compare(self._first, evaluated)
                return
            self._first = evaluated
        if self._known.add(evaluated.used, evaluated.environment):
            keep_identity(self._folder, self._known.content)
        if evaluated.depth is not None and plan.options.keep_predictions:
            keep_prediction(self._folder, plan.store.manifest, pair, evaluated.depth)
        machine = self._known.environments.index(evaluated.environment)
        self._keep(evaluated.record.model_copy(update={"machine": machine}))
        self.done += 1
        if self._on_pair:
            self._on_pair(self.done, len(plan.chosen))

    def _keep(self, record: PairResult) -> None:
        self._finished[record.id] = record
        add_to_journal(self._folder, record)

    def _compare(self, first: EvaluatedElsewhere, second: EvaluatedElsewhere) -> None:
        differs = difference(first.depth, second.depth)
        if differs:
            record = self._finished[first.record.id]
            said = [*record.warnings, f"{DIFFERS} {differs}"]
            self._keep(record.model_copy(update={"warnings": said}))

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
    to_do = [*journal.to_do[:1], *journal.to_do]
    if pool is None:
        evaluate = PairEvaluator(plan.store, plan.method, plan.options.seed)
        environment = None
        for pair in to_do:
            record, depth = evaluate(pair)
            # After the first pair: a method may load PyTorch only then.
            environment = environment or describe_environment()
            journal.note(pair, EvaluatedElsewhere(record, depth, plan.method.used, environment))
        return
    remote = RemoteEvaluator.of(plan.store, plan.method, plan.options.seed, plan.fit)
    for start in range(0, len(to_do), _BATCH):
        pool.map(remote, to_do[start : start + _BATCH], on_outcome=journal.note)
