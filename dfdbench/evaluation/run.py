"""Run a method over a split: predict each pair once, score it under every protocol, keep it all."""

import functools
import os
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest import Manifest, Pair
from dfdbench.errors import MethodError
from dfdbench.evaluation.fitting import Fit, fit_again, fit_from, fit_method, keep_fit, mean_scenes
from dfdbench.evaluation.pair import Evaluated, PairEvaluator, RemoteEvaluator, blank_record, warned
from dfdbench.evaluation.plan import RunOptions, RunPlan, differences_from, plan_run, protocols_on
from dfdbench.methods.method import Method
from dfdbench.methods.readout import Choice, Chosen
from dfdbench.methods.sources import Hashes
from dfdbench.metrics.metric import find_metric, mean_of
from dfdbench.metrics.protocol import RELEASED, SURE, metrics_of, ranked_by
from dfdbench.results import record, run_folder
from dfdbench.results.environment import describe_environment
from dfdbench.results.wording import score_text, without_folders
from dfdbench.system.files import writing_folder
from dfdbench.system.parallel import Pool
from dfdbench.tables.table import counted, listed

_BATCH = 256  # pairs whose depth maps are in memory together when many run at once


@functools.cache
def _one_at_a_time(process: int) -> threading.RLock:
    # Calls wait for one another anyway; whole runs do, so that their times can be compared.
    return threading.RLock()


@dataclass(frozen=True)
class RunDone:
    """What `run_method` did.

    Parameters
    ----------
    result : Result
        The scores.
    folder : Path
        Where ``result.json`` and ``predictions.zarr`` are.
    reused : int
        Pairs kept from an earlier call that was stopped or limited.
    set_aside : Path or None
        Where a different earlier run in the same folder was moved.
    because : tuple of str
        How that run differed from this one; empty if this one was to start afresh anyway.
    """

    result: record.Result
    folder: Path
    reused: int
    set_aside: Path | None
    because: tuple[str, ...] = ()

    @property
    def notes(self) -> list[str]:
        """Notes about an earlier run in the same folder."""
        notes = []
        if self.because:
            notes.append(f"started over: {listed(self.because, most=5)}")
        if self.set_aside:
            notes.append(f"the earlier run was moved to {self.set_aside}")
        if self.reused:
            pairs = counted(self.reused, "pair")
            notes.append(f"{pairs} kept from an earlier run (--fresh starts over)")
        return notes


#: Pairs done, pairs to do, and the mean score of those done, as text.
OnPair = Callable[[int, int, str], None]


def run_method(
    store: Dataset,
    method: Method,
    split: str,
    folder: Path,
    options: RunOptions | None = None,
    pool: Pool | None = None,
    warnings: Sequence[str] = (),
    on_pair: OnPair | None = None,
) -> RunDone:
    """Evaluate a method on a split, resuming an earlier call that was stopped.

    A call is of the same run if it has the same data, method (its modules and the files it opened),
    parameters, versions and processor architecture. Any other run is set aside.

    A method with a fit is fitted first, before anything is written, or gets what it learned in an
    earlier call of the same run. The first pair is run again after the second, to check that the
    answers are the same; its time is that of the first call.

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
        The options of the run.
    pool : Pool, optional
        Processes that evaluate several pairs at once. By default pairs are evaluated one after the
        other in this process; only then can times be compared.
    warnings : sequence of str
        Further warnings for the result, such as the `dfdbench.audit.leaks.coverage_warnings` of
        training and test.
    on_pair : callable, optional
        Called with the number of pairs done, the number to do, and the mean score so far as text.

    Raises
    ------
    StoreError
        If the store holds no pair of the split, or none to fit the method on.
    MethodError
        If the method cannot be fitted, or not for this split or this pool.
    ResultError
        If the folder cannot be written.
    """
    if pool is not None and method.source_sha256 is None:
        # Others would take what has its name: of an object, a new one of its class.
        fix = "put it at the top of a file and pass its name, or leave out the pool"
        what = "only this process knows the method, so no other can run it"
        raise MethodError(what, where=method.entry, fix=fix)
    plan = plan_run(store, method, split, options or RunOptions())
    with _one_at_a_time(os.getpid()), writing_folder(folder, "run"):
        before = None if plan.options.fresh else run_folder.read_identity(folder)
        because = differences_from(before, plan.identity, method) if before is not None else []
        if because:
            before = None
        if pool is not None and before is None:
            # A cluster that does not answer says so before anything is moved or fitted.
            pool.map(str, ())
        plan = replace(plan, fit=_fitted(plan, folder if before else None, pool))
        known = _Known(plan.identity, before)
        set_aside = run_folder.open_run_folder(folder, known.content, before is not None)
        if plan.fit:
            keep_fit(folder, plan.fit)
        run_folder.keep_store_place(folder, store.path)
        journal = _Journal(plan, folder, known, on_pair)
        _evaluate(plan, journal, pool)
        seed = plan.options.seed
        said = [*method.warnings, *warnings]
        if edited := differences_from(known.content, plan.identity, method):
            said.append(f"{listed(edited)} while it was run: run it again")
        ran, pairs = _method_record(plan), journal.records()
        result = compose(store, split, ran, pairs, seed, said, known.environments)
        record.save_result(result, folder / record.RESULT)
    return RunDone(result, folder, journal.reused, set_aside, tuple(because))


class _Known:
    """What identifies a run, here and on disk: its identity, and the machines it was run on.

    Parameters
    ----------
    identity : dict
        The identity of this call.
    before : dict or None
        The content that an earlier call of the same run left.
    """

    def __init__(self, identity: dict[str, Any], before: dict[str, Any] | None) -> None:
        found = before or {}
        environments = found.get(run_folder.ENVIRONMENTS, [])
        self.environments = run_folder.Environments.validate_python(environments)
        self._identity = identity
        self._used: Hashes = dict(found.get("used", {}))
        self.add(identity["used"], None)

    @property
    def content(self) -> dict[str, Any]:
        """What is written to disk."""
        environments = [environment.model_dump() for environment in self.environments]
        return {**self._identity, "used": self._used, run_folder.ENVIRONMENTS: environments}

    def add(self, used: Hashes, environment: record.Environment | None) -> bool:
        """Add the files that were used and the machine; return whether any were new."""
        before = len(self.environments), dict(self._used)
        if environment and environment not in self.environments:
            self.environments.append(environment)
        for label, found in used.items():
            if found is None or label not in self._used:
                self._used[label] = found
        return before != (len(self.environments), self._used)


def _fitted(plan: RunPlan, before: Path | None, pool: Pool | None) -> Fit | None:
    fit = fit_again(plan.method, before) if before else None
    if fit is None and plan.options.fitted is not None:
        fit = fit_from(plan.method, plan.options.fitted, plan.store.manifest.stem)
    fit = fit or fit_method(plan.store, plan.method, plan.split, plan.options.seed)
    if fit and fit.learned is None and pool is not None:
        what = "what the method learned cannot be sent to other processes: its fit returns None"
        fix = "leave out --workers and --scheduler"
        raise MethodError(what, where=f"{plan.method.entry}: fit", fix=fix)
    return fit


class _Journal:
    """The records of a run's pairs, each written down as it comes."""

    def __init__(self, plan: RunPlan, folder: Path, known: _Known, on_pair: OnPair | None) -> None:
        self._plan, self._folder, self._known, self._on_pair = plan, folder, known, on_pair
        self._predictions = run_folder.Predictions(folder, plan.store.manifest)
        places, kept = range(len(known.environments)), plan.options.keep_predictions
        journal, has = run_folder.read_journal(folder), self._predictions.has
        found = {pair: journal[pair.id] for pair in plan.expected if pair.id in journal}
        self._finished = {
            pair.id: each
            for pair, each in found.items()
            # A map without any answer is not written.
            if each.machine in places and (not kept or not each.answered or has(pair))
        }
        self.reused = len(self._finished)
        self.to_do = [pair for pair in plan.chosen if pair.id not in self._finished]
        self.done = len(plan.chosen) - len(self.to_do)
        self._first: Evaluated | None = None

    def note(self, pair: Pair, evaluated: Evaluated) -> None:
        """Write down a pair's record; the first pair comes twice, and its answers are compared."""
        plan = self._plan
        if pair == self.to_do[0]:
            if self._first is not None:
                self._compare(self._first, evaluated)
                return
            self._first = evaluated
        if self._known.add(evaluated.used, evaluated.environment):
            run_folder.keep_identity(self._folder, self._known.content)
        answer = evaluated.answer
        if answer.depth is not None and plan.options.keep_predictions:
            self._predictions.keep(pair, answer.depth, answer.sigma)
        machine = self._known.environments.index(evaluated.environment)
        self._keep(evaluated.record.model_copy(update={"machine": machine}))
        self.done += 1
        if self._on_pair:
            self._on_pair(self.done, len(plan.chosen), self._so_far())

    def _so_far(self) -> str:
        """Return the mean score so far, in the metric that ranks on this data set."""
        protocol = record.first_protocol(self._plan.store.manifest.short)
        metric = ranked_by(protocol)[0]
        found = (each.score(protocol, metric) for each in self._finished.values())
        return f"{find_metric(metric).title} {score_text(mean_of(found))}"

    def _keep(self, found: record.PairResult) -> None:
        self._finished[found.id] = found
        run_folder.add_to_journal(self._folder, found)

    def _compare(self, first: Evaluated, second: Evaluated) -> None:
        if differs := first.differs_from(second):
            kept = self._finished[first.record.id]
            self._keep(kept.model_copy(update={"warnings": [*kept.warnings, differs]}))

    def records(self) -> list[record.PairResult]:
        """Return the records of all pairs of the split, including those not evaluated."""
        present = {pair.id for pair in self._plan.available}
        return [
            self._finished.get(pair.id)
            or blank_record(pair, "not-run" if pair.id in present else "missing")
            for pair in self._plan.expected
        ]


def _evaluate(plan: RunPlan, journal: _Journal, pool: Pool | None) -> None:
    # After another pair, so that an answer kept from an earlier call shows.
    to_do = [*journal.to_do[:2], *journal.to_do[:1], *journal.to_do[2:]]
    if pool is None:
        evaluate = PairEvaluator(plan.store, plan.method, plan.options.seed)
        environment = None
        for pair in to_do:
            found, answer = evaluate(pair)
            # After the first pair, since a method may load PyTorch only then.
            environment = environment or describe_environment()
            journal.note(pair, Evaluated(found, answer, plan.method.used, environment))
        return
    if to_do and plan.method.warm_up:
        # Once, here: otherwise every worker would compile the same code at the same time.
        PairEvaluator(plan.store, plan.method, plan.options.seed).warm_up(to_do[0])
    seed, split = plan.options.seed, plan.split
    remote = RemoteEvaluator.of(plan.store, plan.method, seed, split, plan.fit)
    for start in range(0, len(to_do), _BATCH):
        pool.map(remote, to_do[start : start + _BATCH], on_outcome=journal.note)


def compose(
    store: Dataset,
    split: str,
    method: record.MethodRecord,
    pairs: list[record.PairResult],
    seed: int = 0,
    warnings: Sequence[str] = (),
    environments: Sequence[record.Environment] = (),
) -> record.Result:
    """Return the result of a split's pairs.

    Parameters
    ----------
    store : Dataset
        The data set.
    split : str
        Which of its pairs.
    method : MethodRecord
        The method that made the depth maps.
    pairs : list of PairResult
        A record for each pair of the split.
    seed : int
        The seed of the run.
    warnings : sequence of str
        Warnings to add after those that follow from the records.
    environments : sequence of Environment
        Where the pairs were run; each pair's `machine` is an index into it. By default here.
    """
    first, *others = environments or [describe_environment()]
    manifest, protocols = store.manifest, list(protocols_on(store))
    if any(SURE in pair.scores for pair in pairs):
        pairs = list(map(_with_sureness, pairs))
        protocols.append(RELEASED[SURE])
    evaluated = [pair for pair in pairs if pair.status == "ok"]
    labels = [protocol.label for protocol in protocols]
    return record.Result(
        schema_version=1,
        dataset=record.DatasetRecord.of(
            manifest,
            name=manifest.stem,
            short=manifest.short,
            manifest_sha256=manifest.sha256,
            fingerprint=store.fingerprint,
            split=split,
            expected=len(pairs),
            evaluated=len(evaluated),
            recipe=store.attributes["recipe"],
            degradation=store.attributes["degradation"],
            options=store.attributes["options"],
        ),
        protocols=[protocol.as_dict() for protocol in protocols],
        method=method,
        environment=first,
        other_environments=others,
        seed=seed,
        pairs=pairs,
        averages=record.average(evaluated, labels) if len(evaluated) == len(pairs) else None,
        warnings=[*warned(manifest, pairs, evaluated, [first, *others]), *warnings],
    )


def _with_sureness(pair: record.PairResult) -> record.PairResult:
    """Add scores of how sure the method is to a pair that lacks them.

    Such a pair has an answer everywhere and no sigma, so its error is the same at any density.
    """
    if pair.status != "ok" or SURE in pair.scores:
        return pair
    error = pair.score("valid", "nrmse")
    scores = dict.fromkeys(metrics_of(SURE)) | {"density": 1.0}
    scores |= {"nrmse_50": error, "nrmse_90": error}
    return pair.model_copy(update={"scores": pair.scores | {SURE: scores}})


def _method_record(plan: RunPlan) -> record.MethodRecord:
    method = plan.method
    chosen = method.attribute("chosen")
    return record.MethodRecord(
        name=method.name,
        entry=without_folders(method.entry),
        source_sha256=method.source_sha256,
        parameters={name: without_folders(value) for name, value in method.parameters.items()},
        uses=list(method.uses),
        trained_on=trained_on_of(method, plan.store.manifest, plan.split),
        weights_sha256=method.weights_sha256,
        files_sha256=method.files_sha256,
        fitted_on=plan.fit.fitted_on if plan.fit else None,
        fit_seconds=plan.fit.seconds if plan.fit else None,
        # Someone else's method may have something else of that name.
        chosen=chosen.as_dict() if isinstance(chosen, Chosen | Choice) else {},
        paper=method.paper,
    )


def trained_on_of(method: Method, manifest: Manifest, split: str) -> str | None:
    """Return a result's `trained_on`: what the method says, or what its mean depth is of."""
    if method.trained_on is None and {"training_mean", "training_median"} & {*method.uses}:
        return mean_scenes(manifest, split)[0]
    return method.trained_on
