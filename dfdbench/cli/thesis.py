"""The verbs that repeat the thesis's experiments: experiment, search, reduce."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from typer import Argument, Exit, Option

from dfdbench.building.obtaining import voltage_pair_sets
from dfdbench.cli import options, training
from dfdbench.cli.screen import command, progress, save_figure, say, show
from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.dataset import Dataset, open_dataset
from dfdbench.errors import InputError, refuse_both
from dfdbench.results.output_place import output_place
from dfdbench.statuses import NO
from dfdbench.system.packages import needed
from dfdbench.tables.table import Format, counted

if TYPE_CHECKING:
    from dfdbench.building.build import BuildReport
    from dfdbench.training.experiments import Experiment
    from dfdbench.training.search.search_plan import SearchPlan
    from dfdbench.training.search.swarm_search import SearchOutcome


_PUBLISHED = "published"


def experiment(
    name: Annotated[
        str,
        Argument(
            help="repeatability, cross-validation, patch-size, noise, sampling-size, expansion, "
            "reduction, sharpest-step or voltage-pairs."
        ),
    ],
    method: Annotated[training.Network, Option(help="The network to train.")] = "dfd-net",
    dataset: Annotated[
        str | None, Option(help="A data set; default: middlebury, for voltage steps realworld.")
    ] = None,
    source: Annotated[
        Path | None, Option(help="Folder of the captures, where the voltage steps vary.")
    ] = None,
    rows: Annotated[
        Path | None,
        Option(metavar="DIR", help="Of reduction: networks that `reduce` wrote, not Table D.2's."),
    ] = None,
    config: training.Configuration = _PUBLISHED,
    changes: training.Changes = None,
    weights: training.Weights = None,
    values: Annotated[
        str | None, Option(metavar="A,B,...", help="Values to try instead of the thesis's.")
    ] = None,
    repeats: Annotated[
        int | None, Option(min=1, help="Trainings a value; default: as the thesis.")
    ] = None,
    max_time: training.MaxTime = None,
    out: options.TrainingOut = None,
    format: options.Printed = Format.table,
    device: training.Device = "auto",
    threads: training.Threads = None,
    cache: options.Cache = None,
) -> None:
    """Train for each value and seed of an experiment of the thesis; a stopped one is resumed."""
    limit = training.seconds_of(max_time)
    with needed():
        from dfdbench.figures.trainings import experiment_figure
        from dfdbench.methods.networks.weights import find_weights
        from dfdbench.training.experiments import find_experiment, run_trials, trials
    training.use_threads(threads)
    asked, chosen = find_experiment(name), _listed(values)
    configs = _rows_of(name, rows, chosen, config)
    store, stem = _data_of(asked, name, dataset, chosen, source, cache)
    default = Path("training") / f"{stem}-experiments" / f"{name}-{method}"
    folder = output_place(out or default, source, rows)
    start = find_weights(method, weights) if weights else None
    how, changed = configs or config, options.values_of(changes, "--set")
    planned = trials(asked, method, store, how, changed, folder, chosen, repeats, start)
    tables, cards = run_trials(asked, planned, folder, limit, device, progress)
    figure = experiment_figure(asked.title, cards, asked.baseline, asked.varies)
    save_figure(figure, folder / f"{name}.png")
    show(format, tables, folder=folder)
    say(f"table        {folder / f'{name}.md'}, {name}.csv")


def _rows_of(
    name: str, rows: Path | None, chosen: list[Any] | None, config: str
) -> dict[str, str] | None:
    from dfdbench.training.experiments import REDUCTION
    from dfdbench.training.reduction.reduce import configurations_in

    refuse_both({name: name != REDUCTION}, {"--rows": rows})
    refuse_both({"--rows": rows}, {"--config": config != _PUBLISHED})
    return None if rows is None else configurations_in(rows, chosen)


def _data_of(
    asked: Experiment,
    name: str,
    dataset: str | None,
    chosen: list[Any] | None,
    source: Path | None,
    cache: Path | None,
) -> tuple[Dataset | dict[str, Dataset], str]:
    from dfdbench.training.experiments import PAIR

    if asked.varies == PAIR:
        manifest = find_manifest(dataset or "realworld")
        pairs, pool = chosen or asked.values, options.pool_of(None)
        sets = voltage_pair_sets(manifest, pairs, source, cache, pool, progress, _say_built)
        return sets, manifest.stem
    refuse_both({name: True}, {"--source": source})
    store = open_dataset(dataset or "middlebury", cache=cache)
    return store, store.path.stem


def _say_built(report: BuildReport) -> None:
    pairs = counted(report.pairs, "pair")
    say(f"built        {report.path}: {pairs}, {len(report.missing)} missing")


def _listed(text: str | None) -> list[Any] | None:
    if text is None:
        return None
    if not all(part.strip() for part in text.split(",")):
        raise InputError(f"not a list of values, as 0,1,2: {text!r}", where="--values")
    return options.several(text, "--values")


def reduce(
    weights: Annotated[str, Option(metavar="FILE", help="Of a DfD-Net, a file or a shipped name.")],
    dataset: options.DataSet = "middlebury",
    split: Annotated[
        str, Option(help="Sample the first pair of each scene of this split.")
    ] = "test",
    level: Annotated[
        int | None,
        Option(min=1, max=3, help="Iterative rows F of this level, not ensemble rows B."),
    ] = None,
    rounds: Annotated[
        Literal["H", "L"] | None, Option(help="Round to multiples of 8, up or down.")
    ] = None,
    config: training.Configuration = "published",
    changes: training.Changes = None,
    seed: options.Seed = 0,
    tuning: Annotated[
        Literal["own", "neighbours"], Option(help="Whose inputs a neuron follows after 100 epochs.")
    ] = "own",
    out: options.TrainingOut = None,
    format: options.Printed = Format.table,
    device: training.Device = "auto",
    threads: training.Threads = None,
    cache: options.Cache = None,
) -> None:
    """Count the different outputs of each layer; write configurations of narrower networks."""
    with needed():
        from dfdbench.methods.networks.inference import find_device
        from dfdbench.methods.networks.weights import find_weights
        from dfdbench.training.configuration import read_configuration
        from dfdbench.training.reduction.reduce import reduce_weights
    training.use_threads(threads)
    place = find_weights("dfd-net", weights)
    store = open_dataset(dataset, cache=cache)
    configuration = read_configuration(config, options.values_of(changes, "--set"))
    name = Path(weights).stem + (f"-level{level}" if level else "")
    default = Path("training") / f"{store.path.stem}-reduction" / name
    folder = output_place(default if out is None else out, place)
    on = find_device(device)
    with progress("training maps", "nothing was written") as bar:
        found = reduce_weights(
            place, store, configuration, split, level, rounds, seed, tuning, on, bar
        )
    for file in found.files:
        output_place(folder / file, config)
    found.write(folder)
    show(format, found.tables, folder=folder, networks=list(found.files))
    say(f"tables       {folder / 'counts.md'}, rows.md, and both as CSV")
    say(f"networks     {', '.join(found.files)} in {folder}")
    words = ("thesis", "experiment", "reduction")
    say(f"next         {command(*words, dataset=dataset, rows=folder, cache=cache)}")


def architecture(
    dataset: options.DataSet = "middlebury",
    split: Annotated[str, Option(help="The split to train on.")] = "train",
    as_thesis: Annotated[
        bool, Option("--as-thesis", help="Select on the test split, as the thesis did.")
    ] = False,
    hold_out: Annotated[
        int | None,
        Option(
            min=1,
            help="Scenes held out to select on, or more: groups stay whole.",
            show_default="a fifth of them",
        ),
    ] = None,
    gamma: Annotated[
        float, Option(min=0, max=1, help="Weight of the training pairs in Eq. 6.1.")
    ] = 0.3,
    variant: Annotated[
        str, Option(help="thesis, or author for what the author's programs do otherwise.")
    ] = "thesis",
    bounds: Annotated[
        list[str] | None,
        Option(
            metavar="NAME=LOW:HIGH",
            help="Narrower than width=8:512, kernel=1:9, crop=12:64; repeatable.",
        ),
    ] = None,
    particles: Annotated[int, Option(min=1, max=10_000, help="Networks in the swarm.")] = 20,
    iterations: Annotated[int, Option(min=0, help="Moves after the start.")] = 50,
    steps: Annotated[
        int | None, Option(min=1, help="Steps of each training at most; as --set steps=N.")
    ] = None,
    score_pairs: Annotated[
        int | None, Option(min=1, help="Pairs scored of each set; default: all.")
    ] = None,
    max_time: training.MaxTime = None,
    config: training.Configuration = "published",
    changes: training.Changes = None,
    seed: options.Seed = 0,
    out: options.TrainingOut = None,
    workers: Annotated[
        int | None, Option(min=1, max=1024, help="Trainings at once; default: one, here.")
    ] = None,
    scheduler: options.Scheduler = None,
    format: options.Printed = Format.table,
    device: training.Device = "auto",
    threads: training.Threads = None,
    cache: options.Cache = None,
) -> None:
    """Search DfD-Net's widths, filters, activations and patches by a swarm; a stopped one resumes.

    Each particle's network is trained from scratch; the objective is Eq. 6.1.
    """
    limit = training.seconds_of(max_time)
    with needed():
        from dfdbench.training.configuration import read_configuration
        from dfdbench.training.search.particle import bounds_of
        from dfdbench.training.search.search_plan import Choices, plan_search
        from dfdbench.training.search.swarm_search import run_search
    changed = options.values_of(changes, "--set") | ({"steps": steps} if steps else {})
    base = read_configuration(config, changed)
    # As text: JSON has no 8:512.
    narrowed = {n: str(value) for n, value in options.values_of(bounds, "--bounds").items()}
    on = (split, as_thesis, hold_out, gamma, variant)
    asked = Choices(*on, bounds_of(narrowed), particles, score_pairs, seed)
    store = open_dataset(dataset, cache=cache)
    plan = plan_search(store, base, changed, asked, device)
    name = f"{variant}-{Path(config).stem}" + (f"-seed{seed}" if seed else "")
    folder = output_place(out or Path("training") / f"{store.path.stem}-search" / name)
    say(f"select on    {plan.selected_on}")
    pool = options.pool_of_processes(workers, scheduler)
    if threads is None and workers and workers > 1:
        # Several trainings that each use every core would slow each other down.
        threads = max(1, (os.cpu_count() or 1) // workers)
    training.use_threads(threads)
    with progress("trainings of the search") as bar:
        outcome = run_search(plan, folder, iterations, pool, device, threads, limit, bar)
    _tell(plan, folder, outcome, dataset, cache, format)


def _tell(
    plan: SearchPlan,
    folder: Path,
    outcome: SearchOutcome,
    dataset: str,
    cache: Path | None,
    format: Format,
) -> None:
    from dfdbench.figures.trainings import convergence_figure, objective_figure, widths_figure
    from dfdbench.training.search.particle import particle_at
    from dfdbench.training.search.swarm_search import BEST, TABLES

    if not outcome.finished:
        say(f"time was up after {outcome.trainings} trainings; the same command goes on")
    facts = dict[str, Any](folder=folder, trainings=outcome.trainings, finished=outcome.finished)
    if not outcome.course:
        show(format, **facts)
        return
    title = f"particle swarm on {plan.store.manifest.stem}, seed {plan.choices.seed}"
    save_figure(objective_figure(outcome.course, title), folder / "objective.png")
    save_figure(convergence_figure(outcome.course, title), folder / "convergence.png")
    if outcome.best:
        filters = particle_at(outcome.best.position).filters
        save_figure(widths_figure(filters, title), folder / "widths.png")
    best = folder / BEST if outcome.best else None
    show(format, outcome.write(plan, folder), best=best, **facts)
    say(f"log          {folder / 'positions.csv'}; tables {folder / TABLES}")
    if outcome.best is None:
        say("every training failed: nothing was found")
        raise Exit(NO)
    say(f"best         {folder / BEST}")
    then = command("train", "dfd-net", dataset=dataset, config=folder / BEST, cache=cache)
    say(f"next         {then}")
