"""The verb that searches: search architecture."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dfdbench.cli.options import Cache, DataSet, Out, Scheduler, Seed, pool_of_processes, values_of
from dfdbench.cli.screen import print_table, progress, save_figure, say
from dfdbench.cli.training import Changes, Configuration, Device, Threads, seconds_of, use_threads
from dfdbench.datasets.dataset import open_dataset
from dfdbench.errors import InputError
from dfdbench.results.output_place import output_place
from dfdbench.system.files import write_whole
from dfdbench.system.packages import needed
from dfdbench.tables.render import render
from dfdbench.tables.table import Format

if TYPE_CHECKING:
    from dfdbench.system.parallel import Pool
    from dfdbench.training.search.plan import SearchPlan
    from dfdbench.training.search.run import SearchOutcome

app = typer.Typer(
    help="Search for a network's architecture, as chapter 6 of the thesis does.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
)

_BEST, _TABLE = "best.toml", "search.md"


@app.callback()
def _search() -> None:
    pass


@app.command("architecture")
def architecture(
    dataset: DataSet = "middlebury",
    split: Annotated[str, typer.Option(help="The split to train on.")] = "train",
    as_thesis: Annotated[
        bool,
        typer.Option(
            "--as-thesis", help="Select on the test split, as the thesis did; the result says so."
        ),
    ] = False,
    hold_out: Annotated[
        int | None,
        typer.Option(
            min=1, help="Training scenes held out to select on.", show_default="a fifth of them"
        ),
    ] = None,
    gamma: Annotated[
        float, typer.Option(min=0, max=1, help="Weight of the training pairs in Eq. 6.1.")
    ] = 0.3,
    variant: Annotated[
        str, typer.Option(help="thesis, or author for what the author's programs do otherwise.")
    ] = "thesis",
    bounds: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=LOW:HIGH",
            help="Narrower bounds than width=8:512, kernel=1:9, crop=12:64; repeatable.",
        ),
    ] = None,
    particles: Annotated[int, typer.Option(min=1, max=10_000, help="Networks in the swarm.")] = 20,
    iterations: Annotated[int, typer.Option(min=0, help="Moves after the start.")] = 50,
    steps: Annotated[
        int | None, typer.Option(min=1, help="Steps of each training at most; as --set steps=N.")
    ] = None,
    score_pairs: Annotated[
        int | None,
        typer.Option(
            min=1, help="Pairs of each set that are scored, spread over it; default: all."
        ),
    ] = None,
    max_time: Annotated[
        str | None,
        typer.Option(metavar="30m", help="Stop this call after this time, as 90s, 30m, 1h30m."),
    ] = None,
    config: Configuration = "published",
    changes: Changes = None,
    seed: Seed = 0,
    out: Out = None,
    workers: Annotated[
        int | None,
        typer.Option(min=1, max=1024, help="Trainings at once; default: one, in this process."),
    ] = None,
    scheduler: Scheduler = None,
    device: Device = "auto",
    threads: Threads = None,
    cache: Cache = None,
) -> None:
    """Search DfD-Net's widths, filters, activations and patches by a swarm; a stopped one resumes.

    Each particle's network is trained from scratch; the objective is Eq. 6.1.
    """
    limit = seconds_of(max_time)
    with needed():
        from dfdbench.training.configuration import read_configuration
        from dfdbench.training.search.particle import bounds_of
        from dfdbench.training.search.plan import Choices, plan_search
    changed = values_of(changes, "--set") | ({"steps": steps} if steps else {})
    base = read_configuration(config, changed)
    asked = Choices(
        split,
        as_thesis,
        hold_out,
        gamma,
        variant,
        bounds_of(_named(bounds)),
        particles,
        score_pairs,
        seed,
    )
    if as_thesis and hold_out:
        raise InputError(
            "--as-thesis holds no scenes out", where="--hold-out", fix="leave one of them out"
        )
    store = open_dataset(dataset, cache=cache)
    plan = plan_search(store, base, changed, asked, device)
    name = f"{variant}-{Path(config).stem}" + (f"-seed{seed}" if seed else "")
    folder = output_place(out or Path("training") / f"{store.path.stem}-search" / name)
    say(f"select on    {plan.selected_on}")
    where = _Where(pool_of_processes(workers, scheduler), device, _threads(threads, workers))
    use_threads(where.threads)
    outcome = _searched(plan, folder, iterations, where, limit)
    _tell(plan, folder, outcome, dataset)


@dataclass(frozen=True)
class _Where:
    pool: Pool | None
    device: str
    threads: int | None


def _threads(threads: int | None, workers: int | None) -> int | None:
    # Several trainings that each take every core would wait for each other.
    if threads is None and workers and workers > 1:
        return max(1, (os.cpu_count() or 1) // workers)
    return threads


def _searched(
    plan: SearchPlan, folder: Path, iterations: int, where: _Where, limit: float | None
) -> SearchOutcome:
    from dfdbench.training.search.run import run_search

    with progress("trainings of the search") as bar:
        return run_search(
            plan, folder, iterations, where.pool, where.device, where.threads, limit, bar
        )


def _tell(plan: SearchPlan, folder: Path, outcome: SearchOutcome, dataset: str) -> None:
    from dfdbench.figures.trainings import convergence_figure, objective_figure, widths_figure
    from dfdbench.training.search.particle import particle_at
    from dfdbench.training.search.run import best_as_toml, course_table, network_table

    if not outcome.finished:
        say(f"time was up after {outcome.trainings} trainings; the same command goes on")
    if not outcome.course:
        return
    title = f"particle swarm on {plan.store.manifest.stem}, seed {plan.choices.seed}"
    save_figure(objective_figure(outcome.course, title), folder / "objective.png")
    save_figure(convergence_figure(outcome.course, title), folder / "convergence.png")
    tables = [course_table(plan, outcome.course, outcome.failures)]
    if outcome.best:
        tables.append(network_table(plan, outcome.best))
        filters = particle_at(outcome.best.position).filters
        save_figure(widths_figure(filters, title), folder / "widths.png")
    for table in tables:
        print_table(table)
    write_whole(folder / _TABLE, render(tables, Format.markdown))
    say(f"log          {folder / 'positions.csv'}; tables {folder / _TABLE}")
    if outcome.best is None:
        say("every training failed: nothing was found")
        raise typer.Exit(1)
    write_whole(folder / _BEST, best_as_toml(plan, outcome.best))
    say(f"best         {folder / _BEST}")
    say(f"next         dfdbench train dfd-net --dataset {dataset} --config {folder / _BEST}")


def _named(bounds: list[str] | None) -> dict[str, Any]:
    # As text: JSON has no 8:512.
    return {name: str(value) for name, value in values_of(bounds, "--bounds").items()}
