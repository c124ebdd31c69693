"""The verb that trains a network, and what the verbs that train share."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from typer import Argument, Option

from dfdbench.cli.options import Cache, Facts, Out, Seed, data_sets, values_of
from dfdbench.cli.screen import progress, save_figure, say, show
from dfdbench.datasets.dataset import open_dataset
from dfdbench.errors import InputError, Problem
from dfdbench.results.output_place import output_place
from dfdbench.system.packages import needed
from dfdbench.tables.table import Table

if TYPE_CHECKING:
    from dfdbench.methods.networks.weights import Card
    from dfdbench.training.crops import Selections
    from dfdbench.training.task import Task
    from dfdbench.training.trainer import Log, TrainingFolder, TrainingOutcome


def train_command(
    method: Annotated[Trainable, Argument(help="The network to train.")],
    dataset: Annotated[
        str | None,
        Option(
            help="A data set's name, or a store's path or URL; stack-net and volume-net: rendered "
            "rooms.",
            show_default="middlebury",
            autocompletion=data_sets,
        ),
    ] = None,
    split: Annotated[
        str | None, Option(help="The split to train on.", show_default="train")
    ] = None,
    fold: Annotated[
        str | None, Option(help="Train on all scenes but this fold's, or this scene.")
    ] = None,
    config: Configuration = "published",
    changes: Changes = None,
    weights: Weights = None,
    max_time: MaxTime = None,
    resume: Annotated[
        bool, Option("--resume", help="Continue from the folder's checkpoint.")
    ] = False,
    fresh: Annotated[
        bool, Option("--fresh", help="Start over; the earlier training is removed.")
    ] = False,
    seed: Seed = 0,
    out: Out = None,
    format: Facts = "table",
    device: Device = "auto",
    threads: Threads = None,
    cache: Cache = None,
) -> None:
    """Train a network; write its weights, a model card, a log and figures."""
    limit = seconds_of(max_time)
    if method in ("stack-net", "volume-net"):
        _refuse_unused(method, fold is not None, config != "published", device != "auto")
        use_threads(threads)
        steps = values_of(changes, "--set")
        _train_on_cameras(
            method, dataset, split, weights, limit, resume, fresh, seed, out, steps, format, cache
        )
        return
    dataset = dataset or "middlebury"
    with needed():
        from dfdbench.methods.networks.inference import find_device
        from dfdbench.methods.networks.weights import find_weights
        from dfdbench.training.configuration import precision_for, read_configuration
        from dfdbench.training.task import task_of
        from dfdbench.training.trainer import train
    use_threads(threads)
    store = open_dataset(dataset, cache=cache)
    configuration = read_configuration(config, values_of(changes, "--set"))
    if split is not None and fold is not None:
        what = "--split and --fold both say what trains"
        raise InputError(what, where="--fold", fix="give one of them")
    split = split or "train"
    start = find_weights(method, weights) if weights else None
    task = task_of(method, store, configuration, split, fold, seed, start)
    name = f"{method}-{Path(config).stem}" + (f"-seed{seed}" if seed else "")
    trained = f"all-but-{fold}" if fold else split
    default = Path("training") / f"{store.path.stem}-{trained}" / name
    folder = _folder(out or default, start, resume, fresh)
    if configuration.precision == "auto":
        say("precision    {}: {}".format(*precision_for(find_device(device))))
    with progress(f"training {method}", RESUMED) as bar:
        outcome = train(task, folder.path, limit, device, bar, fresh)
    drawn = _keep_figures(folder, task, outcome, f"{method}, {task.trained_on}, seed {seed}")
    tables = [card_table(outcome.card), patches_table(drawn)]
    show(format, tables, weights=outcome.weights, card=outcome.card.model_dump())
    _tell_outcome(outcome, f"--method {method} --dataset {dataset}")


def _refuse_unused(method: str, fold: bool, config: bool, device: bool) -> None:
    InputError.raise_if(
        Problem(f"{method} has no such choice", where=name, fix="leave it out")
        for name, given in (("--fold", fold), ("--config", config), ("--device", device))
        if given
    )


def _train_on_cameras(
    method: str,
    dataset: str | None,
    split: str | None,
    weights: str | None,
    limit: float | None,
    resume: bool,
    fresh: bool,
    seed: int,
    out: str | None,
    changes: Mapping[str, Any],
    format: str,
    cache: Path | None,
) -> None:
    with needed():
        from dfdbench.figures.trainings import cameras_figure
        from dfdbench.methods.networks.weights import find_weights, load_weights
        from dfdbench.training.cameras import Course, set_examples, steps_of, train_on_cameras
        from dfdbench.training.stacks import STACK_NET
        from dfdbench.training.trainer import FIGURES
        from dfdbench.training.volumes import VOLUME_NET
    course: Course[Any] = STACK_NET if method == STACK_NET.method else VOLUME_NET
    steps = steps_of(course, changes)
    if split and not dataset:
        raise InputError("rendered rooms have no splits", where="--split", fix="name a --dataset")
    start = find_weights(method, weights) if weights else None
    if start:
        # Refused before examples are made, which takes long.
        load_weights(start, method)
    store = open_dataset(dataset, cache=cache) if dataset else None
    what = f"{store.path.stem}-{split or 'train'}" if store else "rooms"
    default = Path("training") / what / (method + (f"-seed{seed}" if seed else ""))
    place = _folder(out or default, start, resume, fresh).path
    if store:
        examples, trained_on = set_examples(course, store, split or "train")
    else:
        with progress("rendering rooms", "the same command goes on, at most a camera back") as bar:
            examples = course.of_rooms(place.parent / "examples", bar)
        trained_on = course.rooms
    with progress(f"training {method}", RESUMED) as bar:
        path, card, log = train_on_cameras(
            course, examples, trained_on, place, seed, steps, limit, start, bar, fresh
        )
    save_figure(cameras_figure(log, f"{method}, {trained_on}, seed {seed}"), place / FIGURES[0])
    show(format, [card_table(card)], weights=path, card=card.model_dump())
    where = f" --dataset {dataset}" if dataset else ""
    _tell(log, [], path, f"--method {method}{where}")


def _keep_figures(
    training: TrainingFolder, task: Task, outcome: TrainingOutcome, title: str
) -> Selections:
    from dfdbench.figures.trainings import levels_figure, patches_figure, training_figure
    from dfdbench.training.crops import selections_of
    from dfdbench.training.trainer import FIGURES

    course, levels, patches = (training.path / name for name in FIGURES)
    save_figure(training_figure(outcome.log, title), course)
    save_figure(levels_figure(outcome.log.levels, title), levels)
    names = [pair.id for pair in task.train]
    with progress("counting patches", RESUMED) as bar:
        drawn = selections_of(outcome.cropper, names, outcome.card.steps, bar)
    training.write_patches(drawn.rows())
    save_figure(patches_figure(drawn, title), patches)
    return drawn


def _tell_outcome(outcome: TrainingOutcome, run: str) -> None:
    if outcome.within_warm_up:
        say("time was up before the warm-up had ended: these weights have hardly been trained")
        say("--resume with a longer --max-time goes on; --fresh --set warm_up=N warms up faster")
    _tell(outcome.log, ["depth_levels.csv", "patches.csv"], outcome.weights, run)


def _tell(log: Log, others: Sequence[str], weights: Path, run: str) -> None:
    scores = ["scores.csv"] if log.scores else []
    say(f"log          {', '.join([str(weights.with_name('losses.csv')), *scores, *others])}")
    say(f"weights      {weights}, and their card {weights.with_suffix('.md')}")
    say(f"next         dfdbench run {run} --param weights={weights}")


def card_table(card: Card) -> Table:
    """Return what a training came to as a table."""
    machine = f"{card.environment['processor']}, threads {card.environment['threads']}"
    rows = [
        ("parameters", f"{card.parameters:,}"),
        ("trained on", card.trained_on),
        ("steps", f"{card.steps:,}, ended by {card.ended_by}"),
        ("time", f"{card.seconds:.0f} s on {machine}"),
    ]
    scored = {f" on {card.scored_on}": card.scores}
    scored |= {f", {protocol}": scores for protocol, scores in card.further_scores.items()}
    for where, scores in scored.items():
        rows += [(f"{name.upper()}{where}", f"{value:.4f}") for name, value in scores.items()]
    return Table(f"{card.method}, seed {card.seed}", ("what", "found"), tuple(rows), "ll")


def patches_table(drawn: Selections) -> Table:
    """Return from which pair the fewest and the most patches were drawn."""
    patches = drawn.patches
    rows = [("mean", f"{patches.mean():,.2f}", f"{len(patches)} pairs")]
    for name, number in (("least", int(patches.argmin())), ("most", int(patches.argmax()))):
        rows.append((name, f"{patches[number]:,}", drawn.pairs[number]))
    title = f"{patches.sum():,} patches drawn, by pair"
    return Table(title, ("which", "patches", "pair"), tuple(rows), "lrl")


def _folder(place: str | Path, start: Path | None, resume: bool, fresh: bool) -> TrainingFolder:
    """Return the folder of a training, or refuse one that holds what may not be lost."""
    from dfdbench.training.trainer import TrainingFolder

    # --fresh removes an earlier training, and must not remove the weights to begin with.
    folder = output_place(place, start if fresh else None, replaces=True)
    training, another = TrainingFolder(folder), "choose another with --out DIR"
    what, fix = "", another
    if folder.exists() and not folder.is_dir():
        what = "not a folder"
    elif resume and fresh:
        what, fix = "--resume goes on, --fresh starts anew", "choose one"
    elif training.foreign:
        what = "the folder holds something else than a training"
    elif resume and not training.started:
        what, fix = "no checkpoint to go on from", "leave --resume out"
    elif training.holds_files and not resume and not fresh:
        what = "there is a training already"
        fix = f"--resume goes on, --fresh starts anew, or {another}"
    if what:
        raise InputError(what, where=str(folder), fix=fix)
    return training


RESUMED = "--resume goes on from the last checkpoint, at most a minute back"
#: More than any machine has; a library that is asked for millions of them is killed.
MOST_THREADS = 1024
_SECONDS = {"h": 3600, "m": 60, "s": 1}


#: What can be trained on patches of a data set, and what can be trained at all.
Network = Literal["dfd-net", "u-net"]
Trainable = Literal["dfd-net", "stack-net", "u-net", "volume-net"]
Configuration = Annotated[
    str,
    Option(
        "--config",
        help="A TOML file, or published, published-realworld, demo, demo-fine, demo-u-net, robust "
        "or quick.",
    ),
]
Changes = Annotated[
    list[str] | None,
    Option("--set", metavar="NAME=VALUE", help="Change a setting: docs/training.md."),
]
Weights = Annotated[
    str | None, Option(metavar="FILE", help="Start from these, a file or a shipped name.")
]
MaxTime = Annotated[str | None, Option(metavar="30m", help="Stop then: 90s, 30m, 1h30m.")]
Threads = Annotated[int | None, Option(min=1, max=MOST_THREADS, help="Default: one a core.")]
Device = Annotated[str, Option(help="auto, cpu, cuda or mps.")]


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
        raise InputError(f"not a duration, as 90s, 30m or 1h30m: {text}", where="--max-time")
    units = zip(parts.groups(), _SECONDS.values(), strict=True)
    return sum(float(part or 0) * unit for part, unit in units)


def use_threads(threads: int | None) -> None:
    """Let PyTorch use this many processor threads; None leaves its choice."""
    if threads is not None:
        import torch

        torch.set_num_threads(threads)
