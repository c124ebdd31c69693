"""The verb that trains a network, and what the verbs that train share."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from typer import Argument, Option

from dfdbench.cli.options import Cache, Facts, Seed, TrainingOut, data_sets, values_of
from dfdbench.cli.screen import command, progress, save_figure, say, show
from dfdbench.datasets.dataset import Dataset, open_dataset
from dfdbench.errors import InputError, refuse_alone, refuse_both
from dfdbench.results.output_place import output_place
from dfdbench.system.packages import PACKAGE_VERSION, needed
from dfdbench.tables.table import Table

if TYPE_CHECKING:
    from dfdbench.methods.networks.weights import Card
    from dfdbench.training.crops import Selections
    from dfdbench.training.task import Task
    from dfdbench.training.trainer import Trainee, TrainingFolder, TrainingOutcome


def train_command(
    method: Annotated[Trainable, Argument(help="The network to train.")],
    dataset: Annotated[
        str | None,
        Option(
            help="A data set's name, or a store's path or URL; default: middlebury, and rendered "
            "rooms for stack-net and volume-net.",
            autocompletion=data_sets,
        ),
    ] = None,
    split: Annotated[str | None, Option(help="The split to train on; default: train.")] = None,
    fold: Annotated[
        str | None, Option(help="Train on all scenes but this fold's, or this scene's group.")
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
    out: TrainingOut = None,
    format: Facts = "table",
    device: Device = "auto",
    threads: Threads = None,
    cache: Cache = None,
) -> None:
    """Train a network; write its weights, a model card, a log and figures."""
    limit, changed = seconds_of(max_time), values_of(changes, "--set")
    use_threads(threads)
    with needed():
        from dfdbench.methods.networks.weights import find_weights
        from dfdbench.training import configuration, task, trainer
    start = find_weights(method, weights) if weights else None
    seeded = f"-seed{seed}" if seed else ""
    make: Callable[[Path], Trainee]
    if method in ("stack-net", "volume-net"):
        others = {"--config": config != "published", "--device": device != "auto"}
        refuse_both({method: True}, {"--fold": fold, **others})
        refuse_alone({"--split": split}, {"--dataset": dataset})
        store = open_dataset(dataset, cache=cache) if dataset else None
        what, make = _on_cameras(method, store, split, start, seed, changed)
        part = task.other_part(store.manifest, split or "train") if store else None
        tested = {"dataset": dataset or _UNSEEN[method], "split": part or None}
        default = Path("training") / what / (method + seeded)
    else:
        refuse_both({"--split": split}, {"--fold": fold})
        dataset = dataset or "middlebury"
        store = open_dataset(dataset, cache=cache)
        settings = configuration.read_configuration(config, changed)
        asked = task.task_of(method, store, settings, split or "train", fold, seed, start)
        tested = {"dataset": dataset, "split": asked.tested_on or None}
        trained = f"all-but-{fold}" if fold else split or "train"
        name = f"{method}-{Path(config).stem}{seeded}"
        default = Path("training") / f"{store.path.stem}-{trained}" / name
        make = partial(_on_patches, asked, device)
    folder = _folder(out or default, start, resume, fresh)
    learner = make(folder.path)
    with progress(f"training {method}", RESUMED) as bar:
        again = "--resume goes on where it stopped"
        outcome = trainer.train(learner, folder.path, limit, bar, fresh, again)
    tables = [card_table(outcome.card), *_keep_figures(folder, learner, outcome)]
    show(format, tables, weights=outcome.weights, card=outcome.card.model_dump())
    param = f"weights={outcome.weights}"
    _tell(outcome, command("run", method=method, **tested, param=param, cache=cache))


def _on_patches(task: Task, device: str, _: Path) -> Trainee:
    from dfdbench.methods.networks.inference import find_device
    from dfdbench.training import configuration, learner

    if task.configuration.precision == "auto":
        say("precision    {}: {}".format(*configuration.precision_for(find_device(device))))
    return learner.Learner(task, device)


def _on_cameras(
    method: str,
    store: Dataset | None,
    split: str | None,
    start: Path | None,
    seed: int,
    changes: Mapping[str, Any],
) -> tuple[str, Callable[[Path], Trainee]]:
    """Return the label of a training on cameras, and what makes its learner in a folder."""
    from dfdbench.methods.networks.weights import load_weights
    from dfdbench.training import cameras, stacks, volumes

    course: cameras.Course[Any] = stacks.STACK_NET if method == "stack-net" else volumes.VOLUME_NET
    steps = cameras.steps_of(course, changes)
    if start:
        # Refuse this before making examples, which takes long.
        load_weights(start, method)

    def make(folder: Path) -> Trainee:
        examples: Mapping[str, Sequence[Any]]
        if store:
            stem, trained = store.manifest.stem, split or "train"
            examples = {stem: course.of_captures(store.captures(trained))}
            trained_on = f"{stem}, split {trained}"
        else:
            resumed = "the same command goes on, at most a camera back"
            # Another version, or the other network, makes different examples of the same names.
            kept = folder.parent / "examples" / f"{method}-{PACKAGE_VERSION}"
            with progress("rendering rooms", resumed) as bar:
                examples = course.of_rooms(kept, bar)
            trained_on = course.rooms
        return cameras.CameraLearner(course, examples, trained_on, seed, steps, start, store)

    return f"{store.path.stem}-{split or 'train'}" if store else "rooms", make


def _keep_figures(
    training: TrainingFolder, learner: Trainee, outcome: TrainingOutcome
) -> list[Table]:
    from dfdbench.figures import trainings
    from dfdbench.training.crops import selections_of
    from dfdbench.training.learner import Learner
    from dfdbench.training.trainer import FIGURES

    log, card = outcome.log, outcome.card
    course, levels, patches = (training.path / name for name in FIGURES)
    title = f"{card.method}, {card.trained_on}, seed {card.seed}"
    if not isinstance(learner, Learner):
        save_figure(trainings.cameras_figure(log, title), course)
        return []
    save_figure(trainings.training_figure(log, title), course)
    save_figure(trainings.levels_figure(log.levels, title), levels)
    with progress("counting patches", RESUMED) as bar:
        drawn = selections_of(learner.cropper, learner.pairs, card.steps, bar)
    training.write_patches(drawn.rows())
    save_figure(trainings.patches_figure(drawn, title), patches)
    return [patches_table(drawn)]


def _tell(outcome: TrainingOutcome, then: str) -> None:
    if outcome.within_warm_up:
        say("time was up before the warm-up had ended: these weights have hardly been trained")
        faster = "; --fresh --set warm_up=N warms up faster" * bool(outcome.log.levels)
        say(f"--resume with a longer --max-time goes on{faster}")
    log, weights = outcome.log, outcome.weights
    names = ["scores.csv"] * bool(log.scores)
    names += ["depth_levels.csv", "patches.csv"] * bool(log.levels)
    say(f"log          {', '.join([str(weights.with_name('losses.csv')), *names])}")
    say(f"weights      {weights}, and their card {weights.with_suffix('.md')}")
    say(f"next         {then}")


def card_table(card: Card) -> Table:
    """Return the outcome of a training as a table."""
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
    """Return a table of the pairs from which the fewest and the most patches were drawn."""
    patches = drawn.patches
    rows = [("mean", f"{patches.mean():,.2f}", f"{len(patches)} pairs")]
    for name, number in (("least", int(patches.argmin())), ("most", int(patches.argmax()))):
        rows.append((name, f"{patches[number]:,}", drawn.pairs[number]))
    title = f"{patches.sum():,} patches drawn, by pair"
    return Table(title, ("which", "patches", "pair"), tuple(rows), "lrl")


def _folder(place: str | Path, start: Path | None, resume: bool, fresh: bool) -> TrainingFolder:
    """Return the folder of a training; refuse one with files that must not be lost."""
    from dfdbench.training.trainer import TrainingFolder

    refuse_both({"--resume": resume}, {"--fresh": fresh})
    # --fresh removes an earlier training, but not the weights that this one starts from.
    folder = output_place(place, start if fresh else None, replaces=True)
    training, another = TrainingFolder(folder), "choose another with --out DIR"
    what, fix = "", another
    if folder.exists() and not folder.is_dir():
        what = "not a folder"
    elif training.foreign:
        what = "the folder holds something other than a training"
    elif resume and not training.started:
        what, fix = "no checkpoint to go on from", "leave --resume out"
    elif training.holds_files and not resume and not fresh:
        what = "there is a training already"
        fix = f"--resume goes on, --fresh starts anew, or {another}"
    if what:
        raise InputError(what, where=str(folder), fix=fix)
    return training


#: Rooms that a network trained on cameras has not seen.
_UNSEEN = {"stack-net": "unseen-stack-7", "volume-net": "unseen-7"}
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
Threads = Annotated[int | None, Option(min=1, max=MOST_THREADS, help="Default: one per core.")]
Device = Annotated[str, Option(help="auto, cpu, cuda or mps.")]


def seconds_of(text: str | None) -> float | None:
    """Return a duration such as ``1h30m`` in seconds.

    Raises
    ------
    InputError
        If it is not a duration.

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
    """Let PyTorch use this many processor threads; None leaves the choice to it."""
    if threads is not None:
        import torch

        torch.set_num_threads(threads)
