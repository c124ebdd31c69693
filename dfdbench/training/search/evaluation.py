"""One training of a search: in this process, in another, or on another machine."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch
from torch import nn

from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest import Pair
from dfdbench.errors import InputError, MethodError
from dfdbench.methods.networks.inference import Predictor, Readout, find_device
from dfdbench.methods.networks.weights import load_weights
from dfdbench.metrics.metric import mean_of
from dfdbench.metrics.protocol import Protocol, find_protocol, score
from dfdbench.system.work_folder import hold
from dfdbench.training.checkpoint import WEIGHTS
from dfdbench.training.configuration import TrainingConfiguration
from dfdbench.training.learner import DivergedError
from dfdbench.training.scoring import evenly_spaced, same_threads
from dfdbench.training.task import Task
from dfdbench.training.trainer import train

#: How much the training pairs count.
GAMMA = 0.3
#: What the objective is made of.
PARTS = ("nrmse", "nmae", "ssim")
#: What the thesis's author scores in his search: the centre of an image, divided by 255.
CENTRE = (368, 400)
_OF_CENTRE = Protocol(
    "search", 1, "all", "255", "whole", "the search published with the thesis's networks"
)


def objective(train: Mapping[str, float], other: Mapping[str, float], gamma: float) -> float:
    """Return Eq. 6.1: NMAE + NRMSE + 1 - SSIM, of two sets; infinite where one is not defined.

    Parameters
    ----------
    train, other : mapping
        Means of the three metrics on the training pairs, and on those that select.
    gamma : float
        The weight of the training pairs, 0 to 1.

    Examples
    --------
    >>> good, poor = dict(nrmse=0.1, nmae=0.1, ssim=0.8), dict(nrmse=0.2, nmae=0.2, ssim=0.4)
    >>> round(objective(good, poor, 0.3), 3), objective(good, {}, 0.3)
    (0.82, inf)
    """
    parts = [
        weight * (scores["nmae"] + scores["nrmse"] + 1 - scores["ssim"])
        for weight, scores in ((gamma, train), (1 - gamma, other))
        if all(math.isfinite(scores.get(name, math.nan)) for name in PARTS)
    ]
    return sum(parts) if len(parts) == 2 else math.inf


@same_threads()
def mean_parts(
    network: nn.Module,
    store: Dataset,
    pairs: Sequence[Pair],
    device: torch.device,
    readout: Readout,
    centre: bool,
) -> dict[str, float]:
    """Return the mean of each metric of the objective over pairs.

    Parameters
    ----------
    network : nn.Module
        In evaluation mode; its batch normalization is folded in place.
    store : Dataset
        If the pairs lie.
    pairs : sequence of Pair
        Which pairs.
    device : torch.device
        If it runs.
    readout : {"mode", "median"}
        Which level of a pixel's distribution is the answer.
    centre : bool
        Score the centre as the thesis's author does, else whole images under ``thesis``.
    """
    predict = Predictor(network, device, readout=readout)
    protocol = _OF_CENTRE if centre else find_protocol("thesis")
    values: dict[str, list[float]] = {name: [] for name in PARTS}
    for pair in pairs:
        images = store.read(pair)
        levels = predict(images.infocus, images.defocus).astype(np.float32)
        rows, columns = _seen(levels.shape, centre)
        depth, valid = images.levels[rows, columns], images.valid[rows, columns]
        scores = score(protocol, depth, valid, levels[rows, columns], store.manifest.network_crop)
        for name in PARTS:
            if not math.isnan(scores[name]):
                values[name].append(scores[name])
    means = {name: mean_of(found) for name, found in values.items()}
    return {name: mean for name, mean in means.items() if mean is not None}


def _seen(shape: tuple[int, ...], centre: bool) -> tuple[slice, slice]:
    if not centre:
        return slice(None), slice(None)
    starts = [max(0, (side - most) // 2) for side, most in zip(shape, CENTRE, strict=True)]
    rows, columns = (slice(s, s + most) for s, most in zip(starts, CENTRE, strict=True))
    return rows, columns


@dataclass(frozen=True)
class Work:
    """What all trainings of a search have in common.

    Parameters
    ----------
    place : str
        The store's path or URL.
    train, other : tuple of str
        Scenes to train on, and those that select.
    trained_on : str
        The training scenes in words, for the weights' cards.
    gamma : float
        Of the objective.
    pairs : int or None
        Pairs of each set that are scored, spread over it; None for all.
    centre : bool
        As of `dfdbench.training.search.evaluation.mean_parts`.
    device : str
        As of `dfdbench.training.trainer.train`.
    threads : int or None
        Processor threads of each training; None leaves PyTorch's choice.
    until : float
        The time, in seconds since 1970, at which trainings stop where they are.
    """

    place: str
    train: tuple[str, ...]
    other: tuple[str, ...]
    trained_on: str
    gamma: float
    pairs: int | None
    centre: bool
    device: str
    threads: int | None
    until: float = math.inf


@dataclass(frozen=True)
class Job:
    """One particle in one iteration.

    Parameters
    ----------
    work : Work
        What it has in common with others.
    iteration, particle : int
        Which.
    configuration : TrainingConfiguration
        What its position means.
    seed : int
        Of the training.
    folder : Path
        If it is trained.
    """

    work: Work
    iteration: int
    particle: int
    configuration: TrainingConfiguration
    seed: int
    folder: Path


@dataclass(frozen=True)
class Outcome:
    """What a job came to.

    Parameters
    ----------
    value : float
        The objective; infinite where the training failed.
    failed : str
        Why it failed; empty where it did not.
    train, other : dict
        Mean scores on the two sets.
    parameters, steps : int
        Of the network, of the training.
    seconds : float
        Time spent training.
    """

    value: float = math.inf
    failed: str = ""
    train: dict[str, float] = field(default_factory=dict)
    other: dict[str, float] = field(default_factory=dict)
    parameters: int = 0
    steps: int = 0
    seconds: float = 0.0


class _TimeUpError(Exception):
    pass


def training_seed(seed: int, iteration: int, particle: int) -> int:
    """Return the seed of one training, which follows from that of the search.

    Examples
    --------
    >>> training_seed(0, 3, 1) == training_seed(0, 3, 1) != training_seed(0, 3, 2)
    True
    """
    # A key of its own: the swarm draws from the same numbers.
    sequence = np.random.SeedSequence((seed, iteration, particle), spawn_key=(1,))
    return int(sequence.generate_state(1)[0])


def evaluate(job: Job) -> Outcome | None:
    """Train a particle's network and score it; None if time was up before.

    A training that diverges, or that the machine cannot do, is a failed one. What concerns the
    disk or the data set is raised: it says nothing of the network.

    Raises
    ------
    InputError
        Where another process is at the same training.
    """
    if job.work.threads is not None:
        torch.set_num_threads(job.work.threads)
    job.folder.parent.mkdir(parents=True, exist_ok=True)
    taken = InputError(
        "another process is training this particle", where=str(job.folder), fix="wait for it to end"
    )
    with hold(job.folder.with_name(f".{job.folder.name}.lock"), taken):
        try:
            return _trained_and_scored(job)
        except _TimeUpError:
            return None
        except DivergedError as error:
            return Outcome(failed=f"diverged: {error.problems[0].what}, {error.problems[0].where}")
        except MethodError as error:
            # Its last step broke the weights, after a loss that was still a number.
            return Outcome(failed=f"diverged: {error.problems[0].what}")
        except (MemoryError, RuntimeError) as error:
            # What PyTorch cannot do is a RuntimeError, too little memory on a card among them.
            why = str(error).partition("\n")[0][:200]
            return Outcome(failed=f"failed: {why or type(error).__name__}")


def _trained_and_scored(job: Job) -> Outcome:
    work, readout = job.work, job.configuration.readout
    if time.time() >= work.until:
        raise _TimeUpError
    store = Dataset(work.place)
    sides = [tuple(p for p in store.pairs("all") if p.scene in s) for s in (work.train, work.other)]
    task = Task(
        "dfd-net", store, sides[0], (), work.trained_on, "", job.configuration, seed=job.seed
    )

    def on_step(step: int, steps: int | None, loss: float) -> None:
        if time.time() >= work.until:
            raise _TimeUpError

    card = train(task, job.folder, device=work.device, on_step=on_step).card
    scores = []
    for pairs in sides:
        network = load_weights(job.folder / WEIGHTS, "dfd-net")[0]
        chosen = pairs if work.pairs is None else evenly_spaced(pairs, work.pairs)
        found = mean_parts(network, store, chosen, find_device(work.device), readout, work.centre)
        scores.append(found)
    value = objective(scores[0], scores[1], work.gamma)
    return Outcome(
        value,
        "" if math.isfinite(value) else "failed: its scores are not defined",
        scores[0],
        scores[1],
        card.parameters,
        card.steps,
        card.seconds,
    )
