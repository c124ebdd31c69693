"""Train a network: steps, scores, checkpoints, and the contents of a training folder."""

from __future__ import annotations

import hashlib
import io
import math
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any, NamedTuple

import torch
from torch import Tensor, nn

from dfdbench.errors import InputError
from dfdbench.methods.networks.weights import Card, count_parameters, save_weights
from dfdbench.results.environment import describe_environment
from dfdbench.system.files import read_as, whole_files, write_whole, writing_folder
from dfdbench.system.packages import PACKAGE_VERSION
from dfdbench.system.text import require_same
from dfdbench.tables.render import as_csv

_SAVE_SECONDS = 60.0
#: Called with (steps done, total steps if known).
OnStep = Callable[[int, int | None], None]


class EndedBy(StrEnum):
    """Why a training ended, in the words with which a card's `ended_by` begins."""

    STEPS = "its number of steps"
    LEARNING_RATE = "learning rate"
    TIME_LIMIT = "its time limit"
    #: Such weights are hardly trained: their scores say nothing about the network.
    TIME_LIMIT_IN_WARM_UP = "its time limit, within the warm-up"


class TrainingOutcome(NamedTuple):
    """The results of `train`: the file of weights, its card, and the log."""

    weights: Path
    card: Card
    log: Log

    @property
    def within_warm_up(self) -> bool:
        """True if time was up before the learning rate had reached its maximum."""
        return self.card.ended_by.startswith(EndedBy.TIME_LIMIT_IN_WARM_UP)


class DivergedError(InputError):
    """A training whose loss became NaN or infinite."""


class Trainee(ABC):
    """What `train` trains: a network, and how it learns.

    Parameters
    ----------
    network : torch.nn.Module
        The network that learns.
    optimizer : torch.optim.Optimizer
        Changes its weights.
    steps : int or None
        Total steps, if known.
    identity : mapping
        What must be unchanged to continue from a checkpoint.
    started_from : str
        What the card says about the initial weights; empty for random ones.
    device : torch.device
        The device it learns on.

    Attributes
    ----------
    step : int
        Steps done.
    kept : torch.nn.Module
        The network whose weights are saved.
    warm_up : int
        Steps until the learning rate is greatest.
    """

    warm_up = 0

    def __init__(
        self,
        network: nn.Module,
        optimizer: torch.optim.Optimizer,
        steps: int | None,
        identity: Mapping[str, Any],
        started_from: str,
        device: torch.device,
    ) -> None:
        self.network = self.kept = network
        self.optimizer, self.started_from, self.device = optimizer, started_from, device
        self.step, self.steps = 0, steps
        self.identity = {"dfdbench": PACKAGE_VERSION, **identity}

    @property
    def ended(self) -> str:
        """Why there is no further step, in the card's words; empty if there is one."""
        return EndedBy.STEPS if self.steps is not None and self.step >= self.steps else ""

    @property
    def time_up(self) -> str:
        """The card's reason if time is up: within the warm-up, weights are hardly trained."""
        if self.step >= self.warm_up:
            return EndedBy.TIME_LIMIT
        return f"{EndedBy.TIME_LIMIT_IN_WARM_UP}, at step {self.step:,} of {self.warm_up:,}"

    @abstractmethod
    def learn(self, spent: float = 0.0) -> tuple[float, float]:
        """Do a step, given the share of time spent; return its learning rate and loss.

        Raises
        ------
        DivergedError
            If the loss became NaN or infinite.
        """

    def descend(self, loss: Tensor, rate: float, clip: float | None = None, fix: str = "") -> float:
        """Do a step at a learning rate, clipping gradients to a norm if given.

        Raises
        ------
        DivergedError
            If the loss became NaN or infinite; `fix` says what to do about it.
        """
        for group in self.optimizer.param_groups:
            group["lr"] = rate
        self.optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        if clip is not None:
            nn.utils.clip_grad_norm_(self.network.parameters(), clip)
        self.optimizer.step()
        value = float(loss.detach())
        if not math.isfinite(value):
            where = f"step {self.step + 1}"
            raise DivergedError(f"the loss became {value}", where=where, fix=fix)
        self.step += 1
        return value

    @abstractmethod
    def scores(self, last: bool) -> Row:
        """Return the scores at this step, if it is one to score or the last."""

    def levels(self) -> list[Row]:
        """Return how often each depth level was trained on; nothing if that is not counted."""
        return []

    @abstractmethod
    def facts(self, log: Log) -> dict[str, Any]:
        """Return the card's facts that are specific to this training, by the card's fields."""

    def state(self) -> dict[str, Any]:
        """Return the state for a checkpoint."""
        return {
            "step": self.step,
            "network": self.network.state_dict(),
            "optimizer": self.optimizer.state_dict(),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from what `state` returned."""
        self.step = state["step"]
        self.network.load_state_dict(state["network"])
        self.optimizer.load_state_dict(state["optimizer"])


def train(
    learner: Trainee,
    folder: Path,
    max_seconds: float | None = None,
    on_step: OnStep | None = None,
    fresh: bool = False,
    again: str = "the same command goes on where it stopped",
) -> TrainingOutcome:
    """Train until there is no further step or time is up; continue from a checkpoint, if any.

    Parameters
    ----------
    learner : Trainee
        What to train.
    folder : Path
        The folder for checkpoint, log and weights.
    max_seconds : float, optional
        The most time to spend on training, including earlier calls.
    on_step : callable, optional
        Called with (steps done, total steps if known).
    fresh : bool
        Remove an earlier training from the folder.
    again : str
        What goes on with a training that was stopped.

    Raises
    ------
    InputError
        If the checkpoint is damaged or belongs to another training.
    DivergedError
        If the loss became NaN or infinite.
    ResultError
        If the folder cannot be written, or another training is writing it.

    Notes
    -----
    On a CPU, with the same number of threads, an interrupted and resumed training has the same
    losses, bit for bit, as an uninterrupted one, unless its learning rate follows the time spent.
    """
    with writing_folder(folder, "training", again):
        ended, state, log = _drive(learner, TrainingFolder(folder), max_seconds, on_step, fresh)
        card = Card(
            parameters=count_parameters(learner.network),
            started_from=learner.started_from,
            steps=learner.step,
            seconds=round(state["seconds"], 1),
            ended_by=ended,
            environment=state["environment"],
            **learner.facts(log),
        )
        save_weights(folder / WEIGHTS, learner.kept, card)
    return TrainingOutcome(folder / WEIGHTS, card, log)


def _drive(
    learner: Trainee,
    place: TrainingFolder,
    max_seconds: float | None,
    on_step: OnStep | None,
    fresh: bool,
) -> tuple[str, dict[str, Any], Log]:
    """Train a network, and save it every minute; return why it ended, how long it took, and log."""
    log = Log()
    own: dict[str, Any] = {"seconds": 0.0, "environment": _environment(learner)}

    def save() -> None:
        log.levels = learner.levels()
        place.save(learner.identity, {**learner.state(), **own}, log)

    def ended() -> str:
        late = max_seconds is not None and own["seconds"] >= max_seconds
        return learner.ended or (learner.time_up if late else "")

    if fresh:
        place.clear()
    if place.started:
        state, log = place.load(learner.identity)
        own["seconds"], earlier = state.pop("seconds"), state.pop("environment")
        learner.restore(state)
        if ended():
            own["environment"] = earlier
            save()
    else:
        # Report a folder that cannot be written now, not after the first minute.
        save()
    saved = time.monotonic()
    begin = saved - own["seconds"]
    while not ended():
        rate, loss = learner.learn(own["seconds"] / max_seconds if max_seconds else 0.0)
        log.losses.append({"step": learner.step, "learning_rate": rate, "loss": loss})
        if on_step:
            on_step(learner.step, learner.steps)
        now = time.monotonic()
        own["seconds"] = now - begin
        if scores := learner.scores(bool(ended())):
            log.scores.append({"step": learner.step, **scores})
        if ended() or now - saved >= _SAVE_SECONDS:
            save()
            saved = now
    return ended(), own, log


def _environment(learner: Trainee) -> dict[str, str]:
    environment = describe_environment()
    graphics = None if learner.device.type == "cpu" else environment.gpu
    return {
        "processor": graphics or environment.cpu,
        "threads": str(torch.get_num_threads()),
        "torch": str(torch.__version__),
        "dfdbench": PACKAGE_VERSION,
    }


WEIGHTS = "weights.safetensors"
_CHECKPOINT = "checkpoint.pt"
#: The tables of a `Log`, in the order of its fields.
_TABLES = ("losses.csv", "scores.csv", "depth_levels.csv")
_PATCHES = "patches.csv"
FIGURES = ("training.png", "depth_levels.png", "patches.png")
_CARD = Path(WEIGHTS).with_suffix(".md").name
_OWN = (_CHECKPOINT, WEIGHTS, _CARD, *_TABLES, _PATCHES, *FIGURES)
#: In bytes; a checkpoint of the thesis's network has 170 MB.
_LARGEST = 2**32
_DIGEST_BYTES = hashlib.sha256().digest_size
Row = dict[str, Any]


@dataclass
class Log:
    """The human-readable log of a training: rows for steps, for scorings, and for depth levels."""

    losses: list[Row] = field(default_factory=list)
    scores: list[Row] = field(default_factory=list)
    levels: list[Row] = field(default_factory=list)


@dataclass(frozen=True)
class TrainingFolder:
    """The files of one training.

    Parameters
    ----------
    path : Path
        The folder.
    """

    path: Path

    @property
    def started(self) -> bool:
        """True if there is a checkpoint to continue from."""
        return (self.path / _CHECKPOINT).exists()

    @property
    def foreign(self) -> bool:
        """True if the folder holds files, and none of them is a training's."""
        there = {file.name for file in whole_files(self.path)}
        return bool(there) and there.isdisjoint(_OWN)

    @property
    def holds_files(self) -> bool:
        """True if a training left anything here, even only a log."""
        return any((self.path / name).exists() for name in _OWN)

    def clear(self) -> None:
        """Remove the files of an earlier training, and no others."""
        for name in _OWN:
            (self.path / name).unlink(missing_ok=True)

    def save(self, identity: Mapping[str, Any], state: Mapping[str, Any], log: Log) -> None:
        """Write the log as tables for people, then the checkpoint, which also contains it.

        After a kill in between, the tables are ahead of the checkpoint until the next `save`.
        """
        for name, rows in zip(_TABLES, (log.losses, log.scores, log.levels), strict=True):
            _write(self.path / name, rows)
        content = io.BytesIO()
        saved = {"identity": dict(identity), "log": vars(log), "state": dict(state)}
        torch.save(saved, content)
        body = content.getvalue()
        write_whole(self.path / _CHECKPOINT, body + hashlib.sha256(body).digest())

    def load(self, identity: Mapping[str, Any]) -> tuple[dict[str, Any], Log]:
        """Return the checkpoint's state and log.

        Raises
        ------
        InputError
            If it is damaged, or belongs to another training; every difference is named.
        """
        path = self.path / _CHECKPOINT
        fix = "--fresh starts over"
        content = read_as(InputError, path, "the checkpoint", _LARGEST, fix)
        body, digest = content[:-_DIGEST_BYTES], content[-_DIGEST_BYTES:]
        if hashlib.sha256(body).digest() != digest:
            raise InputError("damaged checkpoint", where=str(path), fix=fix)
        saved = torch.load(io.BytesIO(body), weights_only=True)
        fix = "repeat the earlier command, choose another folder with --out, or --fresh"
        what = "the checkpoint is of another training"
        require_same(saved["identity"], identity, what, str(path), fix)
        return saved["state"], Log(**saved["log"])

    def write_patches(self, rows: list[Row]) -> None:
        """Write how often patches were drawn from each pair."""
        _write(self.path / _PATCHES, rows)


def _write(path: Path, rows: list[Row]) -> None:
    if not rows:
        path.unlink(missing_ok=True)
        return
    names = tuple(dict.fromkeys(name for row in rows for name in row))
    write_whole(path, as_csv(names, [tuple(map(row.get, names)) for row in rows]))
