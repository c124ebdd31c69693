"""A search carried out: trainings at once, a log of each, and the same end after any kill."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dfdbench.system.parallel import Pool
from dfdbench.system.work_folder import writing_folder
from dfdbench.training.search.course import Iteration, iteration_of
from dfdbench.training.search.evaluation import Job, Outcome, evaluate
from dfdbench.training.search.log import Row, SearchFolder
from dfdbench.training.search.plan import SearchPlan
from dfdbench.training.search.swarm import Numbers, Swarm, search


@dataclass(frozen=True)
class SearchOutcome:
    """What a call of `run_search` came to.

    Parameters
    ----------
    swarm : Swarm or None
        After the last iteration that is whole; None if not even the start is.
    course : tuple of Iteration
        The start, and each iteration that is whole.
    best : Row or None
        The best position of `swarm`, and its training; None if all failed.
    failures : tuple of Row
        Trainings that failed or diverged.
    trainings : int
        Done so far.
    finished : bool
        False where time was up before.
    """

    swarm: Swarm | None
    course: tuple[Iteration, ...]
    best: Row | None
    failures: tuple[Row, ...]
    trainings: int
    finished: bool


class _TimeUpError(Exception):
    pass


def run_search(
    plan: SearchPlan,
    folder: Path,
    iterations: int,
    pool: Pool | None = None,
    device: str = "auto",
    threads: int | None = None,
    max_seconds: float | None = None,
    on_done: Callable[[int, int], None] | None = None,
) -> SearchOutcome:
    """Search until the iterations are done or time is up; go on from the folder's log.

    Parameters
    ----------
    plan : SearchPlan
        From `plan_search`.
    folder : Path
        Where log, record and the best training go; workers on other machines have to see it.
    iterations : int
        Moves after the start; more than an earlier call asked for go on from its end.
    pool : Pool, optional
        Where trainings are done several at once; by default one after the other, here.
    device, threads
        Of each training.
    max_seconds : float, optional
        Time of this call at most.
    on_done : callable, optional
        Called with (trainings done, trainings in all).

    Raises
    ------
    InputError
        If the folder holds another search, its log was changed, or the scheduler went away.
    ResultError
        If the folder cannot be written, or another process is searching in it.

    Notes
    -----
    Nothing is kept of the swarm but what its trainings came to: called again, it moves as it did,
    and takes the values from the log. A training that was stopped goes on from its checkpoint.
    """
    until = time.time() + max_seconds if max_seconds is not None else float("inf")
    with writing_folder(folder, "search"):
        log = SearchFolder(folder)
        log.open(plan.identity)
        judge = _Judge(plan, log, iterations, pool, device, threads, until, on_done)
        finished = True
        try:
            particles, seed = plan.choices.particles, plan.choices.seed
            against = plan.variant.against_previous
            for swarm in search(judge, plan.box, particles, iterations, seed, plan.known, against):
                judge.close(swarm)
        except _TimeUpError:
            finished = False
    last = judge.swarm
    found = np.isfinite(last.best_value) if last else False
    return SearchOutcome(
        last,
        tuple(judge.course),
        log[last.best_at] if last and found else None,
        tuple(judge.failures),
        len(log),
        finished,
    )


class _Judge:
    """Gives a swarm its values: from the log, and by training what is not there."""

    def __init__(
        self,
        plan: SearchPlan,
        log: SearchFolder,
        iterations: int,
        pool: Pool | None,
        device: str,
        threads: int | None,
        until: float,
        on_done: Callable[[int, int], None] | None,
    ) -> None:
        self._plan, self._log, self._pool, self._on_done = plan, log, pool, on_done
        self._work = plan.work(device, threads, until)
        self._total = (iterations + 1) * plan.choices.particles
        self._values: Numbers = np.empty(0)
        self.swarm: Swarm | None = None
        self.course: list[Iteration] = []
        self.failures: list[Row] = []
        self._tell()

    def __call__(self, swarm: Swarm) -> Numbers:
        """Return a value for each position, each noted as soon as it is known."""
        places = [(swarm.iteration, number) for number in range(len(swarm.positions))]
        jobs = []
        for place, position in zip(places, swarm.positions, strict=True):
            self._log.require_same(place, position)
            if self._log[place] is None:
                folder = self._log.training(place).absolute()
                jobs.append(self._plan.job(self._work, *place, position, folder))

        def note(job: Job, outcome: Outcome | None) -> None:
            if outcome is not None:
                place = (job.iteration, job.particle)
                self._log.note(Row(place, swarm.positions[job.particle], outcome))
                self._tell()

        if self._pool is None:
            for job in jobs:
                note(job, evaluate(job))
        elif jobs:
            self._pool.map(evaluate, jobs, on_outcome=note)
        rows = [self._log[place] for place in places]
        known = [row for row in rows if row is not None]
        if len(known) < len(rows):
            raise _TimeUpError
        self.failures += [row for row in known if row.outcome.failed]
        self._values = np.array([row.outcome.value for row in known])
        return self._values

    def close(self, swarm: Swarm) -> None:
        """Take note of an iteration that is whole; of its trainings the best one is kept."""
        before = self.swarm.best_at if self.swarm else None
        own = [(swarm.iteration, number) for number in range(len(swarm.positions))]
        # What was best before an earlier call ended may be long gone: only what is known now goes.
        gone = [place for place in own if place != swarm.best_at]
        if before and before != swarm.best_at:
            gone.append(before)
        self._log.forget(gone)
        self.swarm = swarm
        self.course.append(iteration_of(swarm, self._values))

    def _tell(self) -> None:
        if self._on_done:
            self._on_done(len(self._log), self._total)
