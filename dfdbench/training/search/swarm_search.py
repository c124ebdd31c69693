"""Run a search: move the swarm, train, log; tables of how it went."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dfdbench.methods.networks.choices import FILTERS, LAYERS, SITES, SIZED
from dfdbench.system.files import write_whole, writing_folder
from dfdbench.system.parallel import Pool
from dfdbench.system.text import toml_text
from dfdbench.tables.render import render
from dfdbench.tables.table import Format, Table
from dfdbench.training.configuration import TrainingConfiguration
from dfdbench.training.search import particle as pso
from dfdbench.training.search.log import PARTS, Evaluation, LogRow, Outcome, Place, SearchFolder
from dfdbench.training.search.search_plan import SearchPlan

#: In a search's folder, when it has an outcome.
BEST, TABLES = "best.toml", "search.md"


@dataclass(frozen=True)
class SearchOutcome:
    """What a call of `run_search` came to.

    Parameters
    ----------
    swarm : Swarm or None
        After the last iteration that is whole; None if not even the start is.
    course : tuple of Iteration
        The start, and each iteration that is whole.
    best : LogRow or None
        The best position of `swarm`, and its training; None if all failed.
    failures : tuple of LogRow
        Trainings that failed or diverged.
    trainings : int
        Done so far.
    finished : bool
        False where time was up before.
    """

    swarm: pso.Swarm | None
    course: tuple[Iteration, ...]
    best: LogRow | None
    failures: tuple[LogRow, ...]
    trainings: int
    finished: bool

    def write(self, plan: SearchPlan, folder: Path) -> list[Table]:
        """Write its tables, and the best network as a configuration; return the tables."""
        tables = [course_table(plan, self.course, self.failures)]
        if self.best:
            tables.append(network_table(plan, self.best))
            write_whole(folder / BEST, best_as_toml(plan, self.best))
        write_whole(folder / TABLES, render(tables, Format.markdown))
        return tables


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
        evaluation = Evaluation(plan, folder.absolute(), device, threads, until)
        judge = _Judge(evaluation, log, iterations, pool, on_done)
        finished = True
        try:
            particles, seed = plan.choices.particles, plan.choices.seed
            against = plan.variant.against_previous
            for swarm in pso.search(
                judge, plan.box, particles, iterations, seed, plan.known, against
            ):
                judge.close(swarm)
        except _TimeUpError:
            finished = False
    last = judge.swarm
    best = log[last.best_at] if last and np.isfinite(last.best_value) else None
    course, failures = tuple(judge.course), tuple(judge.failures)
    return SearchOutcome(last, course, best, failures, len(log), finished)


class _Judge:
    """Gives a swarm its values: from the log, and by training what is not there."""

    def __init__(
        self,
        evaluation: Evaluation,
        log: SearchFolder,
        iterations: int,
        pool: Pool | None,
        on_done: Callable[[int, int], None] | None,
    ) -> None:
        self._evaluate, self._log, self._pool, self._on_done = evaluation, log, pool, on_done
        self._total = (iterations + 1) * evaluation.plan.choices.particles
        self._values: pso.Numbers = np.empty(0)
        self.swarm: pso.Swarm | None = None
        self.course: list[Iteration] = []
        self.failures: list[LogRow] = []
        self._tell()

    def __call__(self, swarm: pso.Swarm) -> pso.Numbers:
        """Return a value for each position, each noted as soon as it is known."""
        places = [(swarm.iteration, number) for number in range(len(swarm.positions))]
        particles = list(zip(places, swarm.positions, strict=True))
        for particle in particles:
            self._log.require_same(*particle)
        left = [particle for particle in particles if self._log[particle[0]] is None]

        def note(particle: tuple[Place, pso.Numbers], outcome: Outcome | None) -> None:
            if outcome is not None:
                self._log.note(LogRow(*particle, outcome))
                self._tell()

        if self._pool is None:
            for particle in left:
                note(particle, self._evaluate(particle))
        elif left:
            self._pool.map(self._evaluate, left, on_outcome=note)
        rows = [self._log[place] for place in places]
        known = [row for row in rows if row is not None]
        if len(known) < len(rows):
            raise _TimeUpError
        self.failures += [row for row in known if row.outcome.failed]
        self._values = np.array([row.outcome.value for row in known])
        return self._values

    def close(self, swarm: pso.Swarm) -> None:
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


#: Shares of equal components at which the thesis's author calls a swarm converged.
MARKS = (0.90, 0.95, 0.99)


@dataclass(frozen=True)
class Iteration:
    """What a whole iteration came to.

    Parameters
    ----------
    number : int
        0 at the start.
    best : float
        The least value so far.
    least, mean : float
        Of this iteration's trainings that did not fail; NaN where all did.
    failed : int
        How many did.
    alike : float
        The share of all particles' components that are equal to the best position's.
    """

    number: int
    best: float
    least: float
    mean: float
    failed: int
    alike: float


def iteration_of(swarm: pso.Swarm, values: pso.Numbers) -> Iteration:
    """Return what an iteration came to.

    Parameters
    ----------
    swarm : Swarm
        Judged.
    values : ndarray of float64, shape (particles,)
        Of its positions.
    """
    there = values[np.isfinite(values)]
    least, mean = (float(there.min()), float(there.mean())) if len(there) else (np.nan, np.nan)
    alike = pso.whole_numbers(swarm.positions) == pso.whole_numbers(swarm.best)
    failed = len(values) - len(there)
    return Iteration(swarm.iteration, swarm.best_value, least, mean, failed, float(alike.mean()))


def course_table(
    plan: SearchPlan, course: Sequence[Iteration], failures: Sequence[LogRow]
) -> Table:
    """Return a row an iteration: best and mean objective, failures, convergence."""
    rows = []
    for item in course:
        name = str(item.number or "start")
        values = (f"{value:.4f}" for value in (item.best, item.least, item.mean))
        rows.append((name, *values, str(item.failed), f"{100 * item.alike:.1f} %"))
    notes = [f"selected on {plan.selected_on}", f"gamma {plan.choices.gamma:g}"]
    for row in failures:
        iteration, particle = row.place
        notes.append(f"iteration {iteration}, particle {particle}: {row.outcome.failed}")
    title = f"particle swarm, {plan.choices.particles} particles, variant {plan.choices.variant}"
    columns = ("iteration", "best so far", "least", "mean", "failed", "as the best")
    records = tuple(vars(item) for item in course)
    return Table(title, columns, tuple(rows), "lrrrrr", tuple(notes), records=records)


def network_table(plan: SearchPlan, best: LogRow) -> Table:
    """Return the network found, layer by layer, the baseline's widths beside it."""
    particle = pso.particle_at(best.position)
    sizes = dict(zip(SIZED, particle.kernels, strict=True))
    rows = []
    for layer, *widths in zip(LAYERS, particle.filters, FILTERS["original"], strict=True):
        size = "{} x {}".format(*sizes.get(layer, (2, 2)))
        rows.append((str(layer), *map(str, widths), size, *_site_of(layer, particle)))
    iteration, number = best.place
    configuration = plan.configuration_of(particle)
    outcome = best.outcome
    notes = [f"found in iteration {iteration}, particle {number}: objective {outcome.value:.4f}"]
    for name, scores in (("training pairs", outcome.train), ("pairs selected on", outcome.other)):
        notes.append(f"{name}: " + ", ".join(f"{p.upper()} {scores[p]:.4f}" for p in PARTS))
    notes.append(f"patches of {particle.crop}, {configuration.crops_per_step} a step")
    divided = f", all widths but the last divided by {plan.base.narrow}"
    notes.append(f"{outcome.parameters:,} parameters" + (divided if plan.base.narrow > 1 else ""))
    columns = ("layer", "filters", "baseline", "rows x columns", "normalized", "activation")
    return Table("the best network", columns, tuple(rows), "lrrrll", tuple(notes))


def _site_of(layer: int, particle: pso.Particle) -> tuple[str, str]:
    # What follows the convolution of this layer; before layer 1 they stand alone, after layer 5.
    sites = dict(zip((52, 48, 40, 32, 24, 20, 12, 8, 5), range(len(SITES)), strict=True))
    if layer not in sites:
        return "", ""
    place = sites[layer]
    return "yes" if particle.normalized[place] else "no", particle.activations[place]


def best_as_toml(plan: SearchPlan, best: LogRow) -> str:
    """Return the best network as a configuration that ``dfdbench train dfd-net`` takes."""
    fields = TrainingConfiguration.model_fields
    found = plan.configuration_of(pso.particle_at(best.position))
    named = ("filters", "kernels", "activations", "normalized", "crop", "crops_per_step")
    content: dict[str, Any] = {
        name: value
        for name, value in found.model_dump(mode="json").items()
        if name in named or (value is not None and getattr(found, name) != fields[name].default)
    }
    return (
        f"# Found by a particle swarm on {plan.store.manifest.stem}, objective "
        f"{best.outcome.value:.6g},\n# selected on {plan.selected_on}.\n{toml_text(content)}"
    )
