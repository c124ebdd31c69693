"""Run a search: move the swarm, train, log, and tabulate its course."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from dfdbench.methods.networks.choices import FILTERS, LAYERS, SITES, SIZED
from dfdbench.system.files import write_whole, writing_folder
from dfdbench.system.parallel import Pool
from dfdbench.system.text import toml_text
from dfdbench.tables.render import render
from dfdbench.tables.table import Format, Table
from dfdbench.training.search import particle as pso
from dfdbench.training.search.log import PARTS, Evaluation, LogRow, SearchFolder, TimeUpError
from dfdbench.training.search.search_plan import SearchPlan

#: Written into a search's folder once it has a result.
BEST, TABLES = "best.toml", "search.md"


@dataclass
class SearchOutcome:
    """The result of a call of `run_search`.

    Parameters
    ----------
    swarm : Swarm or None
        After the last complete iteration; None if not even the start is complete.
    course : list of Iteration
        The start, and each complete iteration.
    best : LogRow or None
        The best position of `swarm`, and its training; None if all failed.
    failures : list of LogRow
        Trainings that failed or diverged.
    trainings : int
        How many are done so far.
    finished : bool
        False if time was up before.
    """

    swarm: pso.Swarm | None = None
    course: list[Iteration] = field(default_factory=list)
    best: LogRow | None = None
    failures: list[LogRow] = field(default_factory=list)
    trainings: int = 0
    finished: bool = True

    def close(self, swarm: pso.Swarm, log: SearchFolder) -> None:
        """Record a complete iteration; keep only the best of its trainings."""
        rows = log.rows_of(swarm)
        # The best of an earlier call may be long gone, so remove only what is known now.
        known = [row.place for row in rows] + ([self.swarm.best_at] if self.swarm else [])
        log.forget(place for place in known if place != swarm.best_at)
        self.swarm = swarm
        self.best = log.rows.get(swarm.best_at) if np.isfinite(swarm.best_value) else None
        self.failures += [row for row in rows if row.failed]
        self.course.append(iteration_of(swarm, np.array([row.objective for row in rows])))

    def write(self, plan: SearchPlan, folder: Path) -> list[Table]:
        """Write its tables, and the best network as a configuration; return the tables."""
        tables = [course_table(plan, self.course, self.failures)]
        if self.best:
            tables.append(network_table(plan, self.best))
            write_whole(folder / BEST, best_as_toml(plan, self.best))
        write_whole(folder / TABLES, render(tables, Format.markdown))
        return tables


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
    """Search until the iterations are done or time is up; continue from the folder's log.

    Parameters
    ----------
    plan : SearchPlan
        From `plan_search`.
    folder : Path
        The folder for log, record and best training; workers on other machines must see it.
    iterations : int
        Moves after the start; if more than in an earlier call, the search continues from its end.
    pool : Pool, optional
        Where trainings run, several at once; by default one after the other, here.
    device, threads
        Of each training.
    max_seconds : float, optional
        The most time for this call.
    on_done : callable, optional
        Called with (trainings done, total trainings).

    Raises
    ------
    InputError
        If the folder holds another search, its log was changed, or the scheduler went away.
    ResultError
        If the folder cannot be written, or another process is searching in it.

    Notes
    -----
    Of the swarm, only the results of trainings are saved: a later call moves it in the same way and
    takes the values from the log. A stopped training continues from its checkpoint.
    """
    until = time.time() + max_seconds if max_seconds is not None else float("inf")
    evaluate = Evaluation(plan, folder.absolute(), device, threads, until)
    log, found, choices = SearchFolder(folder), SearchOutcome(), plan.choices

    def tell() -> None:
        if on_done:
            on_done(len(log.rows), (iterations + 1) * choices.particles)

    def note(_: object, row: LogRow | None) -> None:
        if row is not None:
            log.note(row)
            tell()

    def judge(swarm: pso.Swarm) -> pso.Numbers:
        there = {row.place for row in log.rows_of(swarm)}
        particles = (((swarm.iteration, at), place) for at, place in enumerate(swarm.positions))
        left = [particle for particle in particles if particle[0] not in there]
        if pool and left:
            pool.map(evaluate, left, on_outcome=note)
        else:
            for particle in left:
                note(particle, evaluate(particle))
        rows = log.rows_of(swarm)
        if len(rows) < len(swarm.positions):
            raise TimeUpError
        return np.array([row.objective for row in rows])

    with writing_folder(folder, "search"):
        log.open(plan.identity)
        tell()
        how = plan.box, choices.particles, iterations, choices.seed, plan.known
        try:
            for swarm in pso.search(judge, *how, plan.author):
                found.close(swarm, log)
        except TimeUpError:
            found.finished = False
    found.trainings = len(log.rows)
    return found


#: Shares of equal components at which the thesis's author calls a swarm converged.
MARKS = (0.90, 0.95, 0.99)


@dataclass(frozen=True)
class Iteration:
    """The result of a complete iteration.

    Parameters
    ----------
    number : int
        0 at the start.
    best : float
        The lowest value so far.
    least, mean : float
        Over this iteration's trainings that did not fail; NaN if all did.
    failed : int
        How many failed.
    alike : float
        The share of all particles' components that equal the best position's.
    """

    number: int
    best: float
    least: float
    mean: float
    failed: int
    alike: float


def iteration_of(swarm: pso.Swarm, values: pso.Numbers) -> Iteration:
    """Return the result of an iteration.

    Parameters
    ----------
    swarm : Swarm
        With its values.
    values : ndarray of float64, shape (particles,)
        The values of its positions.
    """
    there = values[np.isfinite(values)]
    least, mean = (float(there.min()), float(there.mean())) if len(there) else (np.nan, np.nan)
    alike = pso.whole_numbers(swarm.positions) == pso.whole_numbers(swarm.best)
    failed = len(values) - len(there)
    return Iteration(swarm.iteration, swarm.best_value, least, mean, failed, float(alike.mean()))


def course_table(
    plan: SearchPlan, course: Sequence[Iteration], failures: Sequence[LogRow]
) -> Table:
    """Return one row per iteration: best and mean objective, failures, convergence."""
    rows = []
    for item in course:
        name = str(item.number or "start")
        values = (f"{value:.4f}" for value in (item.best, item.least, item.mean))
        rows.append((name, *values, str(item.failed), f"{100 * item.alike:.1f} %"))
    notes = [f"selected on {plan.selected_on}", f"gamma {plan.choices.gamma:g}"]
    for row in failures:
        iteration, particle = row.place
        notes.append(f"iteration {iteration}, particle {particle}: {row.failed}")
    title = f"particle swarm, {plan.choices.particles} particles, variant {plan.choices.variant}"
    columns = ("iteration", "best so far", "least", "mean", "failed", "as the best")
    records = tuple(vars(item) for item in course)
    return Table(title, columns, tuple(rows), "lrrrrr", tuple(notes), records=records)


def network_table(plan: SearchPlan, best: LogRow) -> Table:
    """Return the best network, layer by layer, beside the baseline's widths."""
    particle = pso.particle_at(best.position)
    sizes = dict(zip(SIZED, particle.kernels, strict=True))
    rows = []
    for layer, *widths in zip(LAYERS, particle.filters, FILTERS["original"], strict=True):
        size = "{} x {}".format(*sizes.get(layer, (2, 2)))
        rows.append((str(layer), *map(str, widths), size, *_site_of(layer, particle)))
    iteration, number = best.place
    configuration = plan.configuration_of(particle)
    notes = [f"found in iteration {iteration}, particle {number}: objective {best.objective:.4f}"]
    for name, side in (("training pairs", "train"), ("pairs selected on", "other")):
        scores = (f"{part.upper()} {best.scores[f'{side}_{part}']:.4f}" for part in PARTS)
        notes.append(f"{name}: {', '.join(scores)}")
    notes.append(f"patches of {particle.crop}, {configuration.crops_per_step} a step")
    divided = f", all widths but the last divided by {plan.base.narrow}"
    notes.append(f"{best.parameters:,} parameters" + (divided if plan.base.narrow > 1 else ""))
    columns = ("layer", "filters", "baseline", "rows x columns", "normalized", "activation")
    return Table("the best network", columns, tuple(rows), "lrrrll", tuple(notes))


def _site_of(layer: int, particle: pso.Particle) -> tuple[str, str]:
    # The site after this layer's convolution; the last one, after layer 5, stands alone before
    # layer 1.
    sites = dict(zip((52, 48, 40, 32, 24, 20, 12, 8, 5), range(len(SITES)), strict=True))
    if layer not in sites:
        return "", ""
    place = sites[layer]
    return "yes" if particle.normalized[place] else "no", particle.activations[place]


def best_as_toml(plan: SearchPlan, best: LogRow) -> str:
    """Return the best network as a configuration for ``dfdbench train dfd-net``."""
    found = plan.configuration_of(pso.particle_at(best.position))
    content = toml_text(found.model_dump(mode="json", exclude_defaults=True))
    return (
        f"# Found by a particle swarm on {plan.store.manifest.stem}, objective "
        f"{best.objective:.6g},\n# selected on {plan.selected_on}.\n{content}"
    )
