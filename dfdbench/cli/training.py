"""The verbs that train: train, experiment."""

from __future__ import annotations

import re
from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dfdbench.cli.building import voltage_pair_stores
from dfdbench.cli.options import Cache, value_of, values_of
from dfdbench.cli.screen import print_table, progress, save_figure, say
from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.store import Store, open_store
from dfdbench.errors import InputError
from dfdbench.system.extras import needed
from dfdbench.system.files import write_whole
from dfdbench.tables.render import render
from dfdbench.tables.table import Format, Table

if TYPE_CHECKING:
    from dfdbench.methods.networks.weights import Card
    from dfdbench.training.checkpoint import TrainingFolder
    from dfdbench.training.selections import Selections

_RESUMED = "--resume goes on from the last checkpoint, at most a minute back"
_SECONDS = {"h": 3600, "m": 60, "s": 1}


class Network(StrEnum):
    """What can be trained."""

    dfd_net = "dfd-net"
    u_net = "u-net"


MethodArgument = Annotated[Network, typer.Argument(help="What is trained.")]
Configuration = Annotated[
    str,
    typer.Option(
        "--config",
        help="A TOML file, or one of: published, published-realworld, demo, demo-fine, "
        "demo-u-net, quick.",
    ),
]
Changes = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="NAME=VALUE", help="In place of the file's; docs/training.md names all."
    ),
]
MaxTime = Annotated[
    str | None, typer.Option(metavar="30m", help="Time at most, as 90s, 30m, 1h30m.")
]
Threads = Annotated[int | None, typer.Option(min=1, help="Processor threads; default: one a core.")]
Device = Annotated[str, typer.Option(help="auto, cpu, cuda or mps.")]


def train(
    method: MethodArgument,
    dataset: Annotated[
        str, typer.Option(help="A data set's name or a store's path.")
    ] = "middlebury",
    split: Annotated[
        str | None, typer.Option(help="The split that trains.", show_default="train")
    ] = None,
    fold: Annotated[
        str | None, typer.Option(help="Train on all scenes but this fold's, or this scene.")
    ] = None,
    config: Configuration = "published",
    changes: Changes = None,
    weights: Annotated[
        str | None,
        typer.Option(metavar="FILE", help="Begin with these weights in place of random ones."),
    ] = None,
    max_time: MaxTime = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on from the folder's checkpoint.")
    ] = False,
    fresh: Annotated[
        bool, typer.Option("--fresh", help="Start anew; the earlier training is removed.")
    ] = False,
    seed: Annotated[
        int, typer.Option(min=0, max=2**32 - 1, help="Of weights, patches and noise.")
    ] = 0,
    out: Annotated[
        Path | None, typer.Option(help="Folder; default: training/DATASET-SPLIT/METHOD-CONFIG.")
    ] = None,
    device: Device = "auto",
    threads: Threads = None,
    cache: Cache = None,
) -> None:
    """Train a network; write its weights, a model card, a log and figures."""
    limit = seconds_of(max_time)
    with needed():
        from dfdbench.figures.training import levels_figure, patches_figure, training_figure
        from dfdbench.methods.networks.weights import find_weights
        from dfdbench.training.checkpoint import (
            LEVELS_FIGURE,
            PATCHES_FIGURE,
            TRAINING_FIGURE,
            TrainingFolder,
        )
        from dfdbench.training.configuration import read_configuration
        from dfdbench.training.selections import selections_of
        from dfdbench.training.task import task_of
        from dfdbench.training.trainer import train as train_task
    use_threads(threads)
    store = open_store(dataset, cache=cache)
    configuration = read_configuration(config, values_of(changes, "--set"))
    if split is not None and fold is not None:
        raise InputError(
            "--split and --fold both say what trains", where="--fold", fix="give one of them"
        )
    split = split or "train"
    start = find_weights(method.value, weights) if weights else None
    task = task_of(method.value, store, configuration, split, fold, seed, start)
    name = f"{method.value}-{Path(config).stem}" + (f"-seed{seed}" if seed else "")
    trained = f"all-but-{fold}" if fold else split
    folder = out or Path("training") / f"{store.path.stem}-{trained}" / name
    _prepare(TrainingFolder(folder), resume, fresh, start)
    with progress(f"training {method.value}", _RESUMED) as bar:
        outcome = train_task(task, folder, limit, device, _stepping(bar), fresh)
    log = TrainingFolder(folder)
    title = f"{method.value}, {task.trained_on}, seed {seed}"
    save_figure(training_figure(log.log(), title), folder / TRAINING_FIGURE)
    save_figure(levels_figure(log.levels(), title), folder / LEVELS_FIGURE)
    names = [pair.id for pair in task.train]
    with progress("counting patches", _RESUMED) as bar:
        drawn = selections_of(outcome.cropper, names, outcome.card.steps, bar)
    log.write_patches(drawn.rows())
    save_figure(patches_figure(drawn, title), folder / PATCHES_FIGURE)
    print_table(card_table(outcome.card))
    print_table(patches_table(drawn))
    if outcome.within_warm_up:
        say("time was up before the warm-up had ended: these weights have hardly been trained")
        say("--resume with a longer --max-time goes on; --fresh --set warm_up=N warms up faster")
    scores = "scores.csv, " if log.log().scores else ""
    say(f"log          {folder / 'losses.csv'}, {scores}depth_levels.csv, patches.csv")
    say(f"weights      {outcome.weights}, and their card {outcome.weights.with_suffix('.md')}")
    say(
        f"next         dfdbench run --method {method.value} --dataset {dataset} "
        f"--param weights={outcome.weights}"
    )


def experiment(
    name: Annotated[
        str,
        typer.Argument(
            help="repeatability, cross-validation, patch-size, noise, sampling-size, expansion, "
            "sharpest-step or voltage-pairs."
        ),
    ],
    method: Annotated[Network, typer.Option(help="What is trained.")] = Network.dfd_net,
    dataset: Annotated[
        str | None,
        typer.Option(
            help="A data set's name or a store's path; default: middlebury, for voltage steps "
            "realworld."
        ),
    ] = None,
    source: Annotated[
        Path | None, typer.Option(help="Folder of the captures, where the voltage steps vary.")
    ] = None,
    config: Configuration = "published",
    changes: Changes = None,
    values: Annotated[
        str | None, typer.Option(metavar="A,B,...", help="In place of the thesis's values.")
    ] = None,
    repeats: Annotated[
        int | None, typer.Option(min=1, help="Trainings of each value; default: the thesis's.")
    ] = None,
    max_time: Annotated[
        str | None, typer.Option(metavar="30m", help="Of each training at most, as 90s, 30m.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder; default: training/DATASET-experiments/NAME-METHOD.")
    ] = None,
    format: Annotated[Format, typer.Option(help="How the table is printed.")] = Format.table,
    device: Device = "auto",
    threads: Threads = None,
    cache: Cache = None,
) -> None:
    """Train for each value and seed of an experiment of the thesis; a stopped one goes on."""
    limit = seconds_of(max_time)
    with needed():
        from dfdbench.figures.training import experiment_figure
        from dfdbench.training.experiments import (
            PAIR,
            experiment_table,
            find_experiment,
            run_trial,
            trials,
        )
    use_threads(threads)
    asked = find_experiment(name)
    chosen = _listed(values)
    store: Store | dict[str, Store]
    if asked.varies == PAIR:
        manifest = find_manifest(dataset or "realworld")
        store = voltage_pair_stores(manifest, chosen or asked.values, source, cache)
        stem = manifest.stem
    else:
        if source:
            raise InputError(
                f"{name} reads a built data set", where="--source", expected="--dataset"
            )
        store = open_store(dataset or "middlebury", cache=cache)
        stem = store.path.stem
    folder = out or Path("training") / f"{stem}-experiments" / f"{name}-{method.value}"
    planned = trials(
        asked, method.value, store, config, values_of(changes, "--set"), folder, chosen, repeats
    )
    cards = []
    for number, trial in enumerate(planned, 1):
        label = f"{number} of {len(planned)}: {trial.folder.name}"
        with progress(label) as bar:
            card = run_trial(trial, limit, device, _stepping(bar))
        cards.append((trial.value, card))
        table = experiment_table(asked, cards)
        keep_table(folder, table)
    save_figure(experiment_figure(asked.title, cards, asked.baseline), folder / "scores.png")
    print_table(table) if format is Format.table else print(render([table], format), end="")
    say(f"table        {folder / 'scores.md'}, scores.csv")


def keep_table(folder: Path, table: Table) -> None:
    """Write a table as Markdown and CSV."""
    for format, suffix in ((Format.markdown, "md"), (Format.csv, "csv")):
        write_whole(folder / f"scores.{suffix}", render([table], format))


def _stepping(bar: Callable[[int, int | None], None]) -> Callable[[int, int | None, float], None]:
    def step(done: int, steps: int | None, loss: float) -> None:
        bar(done, steps)

    return step


def _listed(text: str | None) -> list[Any] | None:
    if text is None:
        return None
    values = [part.strip() for part in text.split(",")]
    if not all(values):
        raise InputError(
            "not a list of values", where="--values", expected="as 0,1,2", got=repr(text)
        )
    return [value_of(value) for value in values]


def use_threads(threads: int | None) -> None:
    """Let PyTorch use this many processor threads; None leaves its choice."""
    if threads is not None:
        import torch

        torch.set_num_threads(threads)


def card_table(card: Card) -> Table:
    """Return what a training came to as a table."""
    rows = [
        ("parameters", f"{card.parameters:,}"),
        ("trained on", card.trained_on),
        ("steps", f"{card.steps:,}, ended by {card.ended_by}"),
        (
            "time",
            f"{card.seconds:.0f} s on {card.environment['processor']}, "
            f"{card.environment['threads']} threads",
        ),
        *(
            (f"{name.upper()} on {card.scored_on}", f"{value:.4f}")
            for name, value in card.scores.items()
        ),
    ]
    return Table(f"{card.method}, seed {card.seed}", ("", ""), tuple(rows), "ll")


def patches_table(drawn: Selections) -> Table:
    """Return from which pair the fewest and the most patches were drawn."""
    patches = drawn.patches
    rows = [("mean", f"{patches.mean():,.2f}", f"{len(patches)} pairs")]
    for name, number in (("least", int(patches.argmin())), ("most", int(patches.argmax()))):
        rows.append((name, f"{patches[number]:,}", drawn.pairs[number]))
    title = f"{patches.sum():,} patches drawn, by pair"
    return Table(title, ("", "patches", "pair"), tuple(rows), "lrl")


def seconds_of(text: str | None) -> float | None:
    """Return a duration such as ``1h30m`` in seconds.

    Raises
    ------
    InputError
        Where it is none.

    Examples
    --------
    >>> seconds_of("1h30m")
    5400.0
    """
    if text is None:
        return None
    parts = re.fullmatch(r"(?:(\d+(?:\.\d+)?)h)?(?:(\d+(?:\.\d+)?)m)?(?:(\d+(?:\.\d+)?)s)?", text)
    if not parts or not any(float(part or 0) for part in parts.groups()):
        raise InputError(
            "not a duration", where="--max-time", expected="as 90s, 30m, 1h30m", got=text
        )
    units = zip(parts.groups(), _SECONDS.values(), strict=True)
    return sum(float(part or 0) * unit for part, unit in units)


def _prepare(training: TrainingFolder, resume: bool, fresh: bool, start: Path | None) -> None:
    folder, started = training.path, training.started
    if folder.exists() and not folder.is_dir():
        raise InputError(
            "not a folder", where=str(folder), fix="choose another place with --out DIR"
        )
    if resume and fresh:
        raise InputError("--resume goes on, --fresh starts anew", fix="choose one")
    if training.foreign:
        raise InputError(
            "the folder holds something else than a training",
            where=str(folder),
            fix="choose another with --out DIR",
        )
    if fresh and start and start.resolve().parent == folder.resolve():
        raise InputError(
            "--fresh would remove the weights to begin with",
            where=str(start),
            fix="choose another folder with --out DIR",
        )
    if resume and not started:
        raise InputError("no checkpoint to go on from", where=str(folder), fix="leave --resume out")
    if training.holds_files and not resume and not fresh:
        raise InputError(
            "there is a training already",
            where=str(folder),
            fix="--resume goes on, --fresh starts anew, --out DIR takes another folder",
        )
