"""The experiments of chapters 5 to 7: a training for each value and seed, a table of scores."""

import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from statistics import fmean, stdev
from typing import Any

from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest import Manifest
from dfdbench.errors import InputError, MethodError, unknown_name
from dfdbench.methods.networks.inference import find_device
from dfdbench.methods.networks.weights import Card, described, load_weights
from dfdbench.metrics.metric import METRICS
from dfdbench.results.wording import score_text
from dfdbench.system.parallel import Shown
from dfdbench.system.strict import Record
from dfdbench.tables.table import Table, grouped
from dfdbench.training.configuration import TrainingConfiguration, read_configuration, settled
from dfdbench.training.learner import Learner
from dfdbench.training.reduction.reduce import comparison_table, seconds_an_image, write_tables
from dfdbench.training.task import LOGGED, PROTOCOL, Task, require_trainable, task_of
from dfdbench.training.trainer import WEIGHTS, EndedBy, OnStep, TrainingFolder, train

#: An experiment that varies this changes no choice of the configuration, but what is left out.
FOLD = "fold"
#: The pair of voltage steps: each value has its own data set.
PAIR = "pair"
#: The experiment that also compares the networks' speed.
REDUCTION = "reduction"


class Experiment(Record):
    """What is trained again and again.

    Parameters
    ----------
    name, title : str
        The experiment's name, and the heading of its table.
    varies : str
        A choice of the configuration, ``"fold"``, ``"pair"``, or empty: only the seed.
    values : tuple
        The values to try; for folds, those of the data set.
    repeats : int
        Trainings of each value, with seeds from 0.
    split : str
        The split to train on, unless a fold does.
    baseline : str
        The value, as text, whose spread the figure shades; empty if only the seed varies.
    """

    name: str
    title: str
    varies: str = ""
    values: tuple[Any, ...] = ()
    repeats: int
    split: str = "train"
    baseline: str = ""


def experiments() -> dict[str, Experiment]:
    """Return the thesis's experiments by name.

    Examples
    --------
    >>> experiments()["noise"].values
    (0, 1, 2, 3)
    """
    source = files("dfdbench.training").joinpath("experiments.toml")
    content = tomllib.loads(source.read_text(encoding="utf-8"))
    return {name: Experiment(name=name, **item) for name, item in content.items()}


def find_experiment(name: str) -> Experiment:
    """Return an experiment by name.

    Raises
    ------
    UnknownNameError
        If there is none; near misses are named.
    """
    known = experiments()
    if name not in known:
        raise unknown_name("experiment", name, known)
    return known[name]


def folds_of(manifest: Manifest) -> tuple[str, ...]:
    """Return a data set's folds; if it has none, each scene is one."""
    return tuple(fold.name for fold in manifest.folds) or manifest.scene_names


@dataclass(frozen=True)
class Trial:
    """One training of an experiment.

    Parameters
    ----------
    value : str
        The varied value, as text.
    task : Task
        What to train.
    folder : Path
        Its folder.
    """

    value: str
    task: Task
    folder: Path


def trials(
    experiment: Experiment,
    method: str,
    store: Dataset | Mapping[str, Dataset],
    config: str | Mapping[str, str],
    changes: Mapping[str, Any],
    folder: Path,
    values: Sequence[Any] | None = None,
    repeats: int | None = None,
    start: Path | None = None,
) -> list[Trial]:
    """Return the trainings of an experiment, checked before the first begins.

    Parameters
    ----------
    experiment : Experiment
        The experiment.
    method : str
        The network to train.
    store : Dataset or mapping of str to Dataset
        The data set; if pairs of voltage steps vary, the set of each by its value.
    config : str or mapping of str to str
        The configuration to start from, a file or a shipped name; or one for each value, which is
        then the only difference.
    changes : mapping
        Values that replace the file's.
    folder : Path
        The folder that holds a folder for each training.
    values, repeats
        Replace the experiment's own.
    start : Path, optional
        Weights that every training starts from, in place of random ones.

    Raises
    ------
    InputError
        If the configuration does not take a value, or the network cannot be trained.
    """
    chosen = tuple(values or (experiment.values if isinstance(config, str) else config))
    if not isinstance(store, Dataset):
        chosen = tuple(store)
    elif experiment.varies == FOLD:
        chosen = tuple(values or folds_of(store.manifest))
    elif not experiment.varies:
        if values:
            raise InputError(f"{experiment.name} varies the seed alone", where="--values")
        chosen = ("",)
    if experiment.varies in changes:
        what = f"{experiment.name} varies {experiment.varies} itself"
        raise InputError(what, where="--set", fix="choose its values with --values")
    found = []
    # Ignore repeated values: their trainings would be counted twice.
    for value in dict.fromkeys(chosen):
        fold = str(value) if experiment.varies == FOLD else None
        choice = experiment.varies not in ("", FOLD, PAIR) and isinstance(config, str)
        varied = {experiment.varies: value} if choice else {}
        named = config if isinstance(config, str) else config[str(value)]
        configuration = read_configuration(named, {**changes, **varied})
        if experiment.varies == "expansion":
            configuration = configuration.with_examples_of_eight()
        for seed in range(repeats or experiment.repeats):
            data = store if isinstance(store, Dataset) else store[str(value)]
            task = task_of(method, data, configuration, experiment.split, fold, seed, start)
            require_trainable(task)
            name = "-".join(str(part) for part in (value, f"seed{seed}") if part != "")
            found.append(Trial(str(value), task, folder / name))
    return found


def run_trial(
    trial: Trial, max_seconds: float | None, device: str, on_step: OnStep | None = None
) -> Card:
    """Train, or continue; if the training has ended, only return its card.

    Raises
    ------
    InputError
        If the folder holds another training.
    """
    path = trial.folder / WEIGHTS
    try:
        card = load_weights(path, trial.task.method)[1] if path.exists() else None
    except MethodError:
        # From a checkpoint, damaged weights are written again.
        if not TrainingFolder(trial.folder).started:
            raise
        card = None
    if card is not None:
        if not _is_of(card, trial.task, device):
            what = "the folder holds another training"
            raise InputError(what, where=str(trial.folder), fix="choose another with --out")
        early = card.ended_by.startswith(EndedBy.TIME_LIMIT)
        if not early or (max_seconds is not None and card.seconds >= max_seconds):
            return card
    return train(Learner(trial.task, device), trial.folder, max_seconds, on_step).card


def run_trials(
    experiment: Experiment,
    planned: Sequence[Trial],
    folder: Path,
    max_seconds: float | None,
    device: str,
    shown: Shown,
) -> tuple[list[Table], list[tuple[str, Card]]]:
    """Run all planned trainings; return the tables, and the value and card of each training.

    The folder has the tables of what has been trained so far. `shown` shows the progress of each
    training; `max_seconds` and `device` apply to each.

    Raises
    ------
    InputError
        As in `run_trial`.
    """
    cards: list[tuple[str, Card]] = []
    tables: list[Table] = []
    for number, trial in enumerate(planned, 1):
        with shown(f"{number} of {len(planned)}: {trial.folder.name}") as step:
            cards.append((trial.value, run_trial(trial, max_seconds, device, step)))
        tables = [experiment_table(experiment, cards, protocol) for protocol in LOGGED]
        write_tables(folder / experiment.name, tables)
    if experiment.name == REDUCTION:
        weights = {trial.value: trial.folder / WEIGHTS for trial in planned}
        seconds = seconds_an_image(weights, planned[0].task.store, device)
        tables = [comparison_table(experiment.title, cards, seconds, label) for label in LOGGED]
        write_tables(folder / experiment.name, tables)
    return tables, cards


def _is_of(card: Card, task: Task, device: str) -> bool:
    begun = described(task.start, load_weights(task.start, task.method)[1]) if task.start else ""
    chosen = TrainingConfiguration.model_validate(card.configuration)
    same = chosen == settled(task.configuration, find_device(device))
    facts = (task.store.fingerprint, task.trained_on, task.seed, begun)
    return same and facts == (card.fingerprint, card.trained_on, card.seed, card.started_from)


def experiment_table(
    experiment: Experiment, cards: Sequence[tuple[str, Card]], protocol: str = PROTOCOL
) -> Table:
    """Return minimum, mean, maximum and deviation of the scores, as in Tables 5.6 and 5.7.

    Parameters
    ----------
    experiment : Experiment
        The experiment that was run.
    cards : sequence of (str, Card)
        Value and card of each finished training.
    protocol : str
        The label of one of `dfdbench.training.task.LOGGED`.
    """
    rows, records = [], []
    for value, group in grouped(cards).items():
        of_each = [card.scores_under(protocol) for card in group]
        scored = [metric for metric in METRICS if all(metric in scores for scores in of_each)]
        for statistic, of in (_STATISTICS if len(group) > 1 else {"score": fmean}).items():
            scores = {metric: of([scores[metric] for scores in of_each]) for metric in scored}
            cells = (score_text(scores.get(metric)) for metric in METRICS)
            rows.append((value or "all seeds", str(len(group)), statistic, *cells))
            facts = {"value": value, "trainings": len(group), "statistic": statistic}
            records.append({**facts, **scores, "protocol": protocol})
    some = cards[0][1]
    notes = [f"{some.method} on {some.dataset}, protocol {protocol}"]
    notes += sorted({f"steps {card.steps:,}, ended by {card.ended_by}" for _, card in cards})
    heading = experiment.varies.replace("_", " ") or "value"
    columns = (heading, "trainings", "", *(metric.heading for metric in METRICS.values()))
    title = experiment.title
    return Table(title, columns, tuple(rows), "lrl", tuple(notes), records=tuple(records))


_STATISTICS: dict[str, Callable[[Sequence[float]], float]] = {
    "minimum": min,
    "mean": fmean,
    "maximum": max,
    "std deviation": stdev,
}
