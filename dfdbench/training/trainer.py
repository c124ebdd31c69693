"""Train a network: step by step, with checkpoints that go on as if nothing had happened."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

import dfdbench
from dfdbench.blur.recipe import LEVELS
from dfdbench.errors import InputError, Problem, ResultError, reason_of
from dfdbench.methods.networks.inference import find_device
from dfdbench.methods.networks.preparation import start_from_differences
from dfdbench.methods.networks.weights import (
    Card,
    build_network,
    count_parameters,
    load_weights,
    save_weights,
    weights_sha256,
)
from dfdbench.results.environment import describe_environment
from dfdbench.training.checkpoint import WEIGHTS, Log, TrainingFolder
from dfdbench.training.crops import Cropper, Redraw, TrainingImages, count_levels
from dfdbench.training.ending import EndedBy
from dfdbench.training.loss import LevelLoss
from dfdbench.training.schedule import schedule_of
from dfdbench.training.scoring import evenly_spaced, mean_scores, same_threads
from dfdbench.training.task import Task, require_trainable

_SAVE_SECONDS = 60.0


@dataclass(frozen=True)
class TrainingOutcome:
    """What a call of `train` came to.

    Parameters
    ----------
    weights : Path
        The file that was written.
    card : Card
        What it says.
    cropper : Cropper
        What drew its patches.
    """

    weights: Path
    card: Card
    cropper: Cropper

    @property
    def within_warm_up(self) -> bool:
        """True where time was up before the learning rate had reached its height."""
        return EndedBy.of(self.card.ended_by) is EndedBy.TIME_LIMIT_IN_WARM_UP


def train(
    task: Task,
    folder: Path,
    max_seconds: float | None = None,
    device: str = "auto",
    on_step: Callable[[int, int | None, float], None] | None = None,
    fresh: bool = False,
) -> TrainingOutcome:
    """Train until the schedule ends or time is up; go on from the folder's checkpoint.

    Parameters
    ----------
    task : Task
        What is trained.
    folder : Path
        Where checkpoint, log and weights go.
    max_seconds : float, optional
        Time spent training at most, that of earlier calls included.
    device : str
        As for the methods: ``auto``, ``cpu``, ``cuda``, ``mps``.
    on_step : callable, optional
        Called with (steps done, steps in all where known, loss).
    fresh : bool
        Remove what an earlier training left in the folder, once all is checked.

    Raises
    ------
    InputError
        Where choices do not fit each other, or the checkpoint is of another training.
    ResultError
        Where the folder cannot be written.

    Notes
    -----
    On a CPU, with the same number of threads, a training that was stopped and gone on with has
    the same losses, bit for bit, as one that was not.
    """
    session = _Session(task, TrainingFolder(folder), find_device(device), fresh)
    try:
        return session.run(max_seconds, on_step)
    except OSError as error:
        raise ResultError(
            "cannot write the training",
            where=str(folder),
            got=reason_of(error),
            fix="make room, or choose another place with --out DIR; --resume goes on",
        ) from error


class _Session:
    def __init__(
        self, task: Task, folder: TrainingFolder, device: torch.device, fresh: bool
    ) -> None:
        choices = task.configuration
        architecture = require_trainable(task)
        images = TrainingImages.read(task.store, task.train, choices.unknown == "ignore")
        architecture["channel_means"] = images.channel_means()
        self._task = task
        self._folder = folder
        self._device = device
        self._architecture = architecture
        network, self._started_from = _beginning(task, architecture)
        self._network = network.to(device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        self._optimizer = torch.optim.Adam(
            _parameter_groups(self._network, choices.weight_decay),
            choices.learning_rate,
            betas=choices.betas,
            fused=True,
        )
        self._schedule = schedule_of(choices)
        self._cropper = Cropper(
            images,
            choices.crop,
            choices.crops_per_step,
            choices.expansion == "eight",
            choices.noise,
            task.seed,
            _redraw(task, images),
        )
        if choices.initial_filters == "differences" and task.start is None:
            first_patches, _ = self._cropper.draw(0)
            start_from_differences(self._network, first_patches)
        self._loss = LevelLoss(choices.label_width, device)
        self._present = images.count_levels()
        self._trained = np.zeros(LEVELS, np.int64)
        self._step = 0
        self._seconds = 0.0
        self._new = Log()
        self._fresh = fresh
        if folder.started and not fresh:
            self._restore(folder.load(task.identity))

    def run(
        self, max_seconds: float | None, on_step: Callable[[int, int | None, float], None] | None
    ) -> TrainingOutcome:
        choices = self._task.configuration
        begin = time.monotonic() - self._seconds
        saved = time.monotonic()
        if self._fresh:
            self._folder.clear()
        if self._step == 0:
            # A place that cannot be written is told now, not after the first minute.
            self._save()
        ended = self._schedule.ended
        if not ended and max_seconds is not None and self._seconds >= max_seconds:
            ended = self._time_is_up()
        while not ended:
            loss = self._one_step()
            if on_step:
                on_step(self._step, choices.steps, loss)
            if self._step % choices.evaluate_every == 0:
                self._note_scores()
            now = time.monotonic()
            self._seconds = now - begin
            ended = self._schedule.ended
            if not ended and max_seconds is not None and self._seconds >= max_seconds:
                ended = self._time_is_up()
            if ended or now - saved >= _SAVE_SECONDS:
                self._save()
                saved = now
        return self._finish(ended)

    def _time_is_up(self) -> str:
        choices = self._task.configuration
        if choices.schedule != "cosine" or self._step >= choices.warm_up:
            return EndedBy.TIME_LIMIT
        return f"{EndedBy.TIME_LIMIT_IN_WARM_UP}, at step {self._step:,} of {choices.warm_up:,}"

    def _one_step(self) -> float:
        pixels, levels = self._cropper.draw(self._step)
        self._trained += count_levels(levels)
        pixels = pixels.to(self._device, memory_format=torch.channels_last)
        for group in self._optimizer.param_groups:
            group["lr"] = self._schedule.rate
        rate = self._schedule.rate
        self._network.train(self._task.configuration.normalization == "batch")
        bf16 = self._task.configuration.precision == "bf16"
        with torch.autocast(self._device.type, torch.bfloat16, enabled=bf16):
            logits = self._network(pixels)
        loss = self._loss(logits, levels.to(self._device))
        self._optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        self._optimizer.step()
        value = float(loss.detach())
        if not np.isfinite(value):
            raise InputError(
                "the loss is no number any more",
                where=f"step {self._step + 1}",
                got=str(value),
                fix="a lower learning_rate; --fresh starts anew",
            )
        self._step += 1
        self._schedule.after(self._step, value)
        self._new.losses.append({"step": self._step, "learning_rate": rate, "loss": value})
        return value

    def _note_scores(self) -> None:
        row: dict[str, Any] = {"step": self._step}
        for name, pairs in (("train", self._task.train), ("test", self._task.test)):
            chosen = evenly_spaced(pairs, self._task.configuration.evaluate_pairs)
            scores = mean_scores(self._network, self._task.store, chosen, self._device)
            row |= {f"{name}_{metric}": value for metric, value in scores.items()}
        self._new.scores.append(row)

    def _save(self) -> None:
        state = {
            "step": self._step,
            "seconds": self._seconds,
            "network": self._network.state_dict(),
            "optimizer": self._optimizer.state_dict(),
            "schedule": self._schedule.state(),
            "trained": torch.from_numpy(self._trained),
        }
        self._folder.save(self._task.identity, state, self._new)
        self._folder.write_levels(self._trained, self._present)
        self._new = Log()

    def _restore(self, state: dict[str, Any]) -> None:
        self._step = state["step"]
        self._seconds = state["seconds"]
        self._network.load_state_dict(state["network"])
        self._optimizer.load_state_dict(state["optimizer"])
        self._schedule.restore(state["schedule"])
        self._trained = state["trained"].numpy()

    def _finish(self, ended: str) -> TrainingOutcome:
        task = self._task
        scores = mean_scores(self._network, task.store, task.test, self._device)
        with same_threads():
            environment = describe_environment()
        card = Card(
            method=task.method,  # type: ignore[arg-type]
            architecture=self._architecture,
            parameters=count_parameters(self._network),
            trained_on=task.trained_on,
            started_from=self._started_from,
            dataset=task.store.manifest.stem,
            fingerprint=task.store.fingerprint,
            recipe=task.store.recipe_name,
            configuration=task.configuration.model_dump(mode="json"),
            seed=task.seed,
            steps=self._step,
            seconds=round(self._seconds, 1),
            ended_by=ended,
            scored_on=f"{task.tested_on}, {len(task.test)} pairs" if task.test else "nothing",
            scores=scores,
            environment={
                "processor": environment.gpu or environment.cpu,
                "threads": str(torch.get_num_threads()),
                "torch": str(torch.__version__),
                "dfdbench": dfdbench.__version__,
            },
        )
        path = self._folder.path / WEIGHTS
        save_weights(path, self._network, card)
        return TrainingOutcome(path, card, self._cropper)


def _beginning(task: Task, architecture: dict[str, Any]) -> tuple[nn.Module, str]:
    if task.start is None:
        # PyTorch's own initial values; its global generator is left as it was.
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(task.seed)
            network = build_network(task.method, architecture)
        return network, ""
    network, card = load_weights(task.start, task.method)
    problems = [
        Problem(
            "the weights are of another network",
            where=f"{task.start}: {name}",
            expected=str(value),
            got=str(card.architecture.get(name)),
        )
        for name, value in architecture.items()
        if name != "channel_means" and card.architecture.get(name) != value
    ]
    if problems:
        raise InputError.of(problems)
    architecture["channel_means"] = card.architecture["channel_means"]
    earlier = f"; that from {card.started_from}" if card.started_from else ""
    digest = weights_sha256(task.start)
    minutes = f"{card.seconds / 60:.1f} minutes"
    said = f"{card.trained_on}, {card.steps:,} steps in {minutes}, SHA-256 {digest[:16]}{earlier}"
    return network, said


def _redraw(task: Task, images: TrainingImages) -> Redraw | None:
    if not task.configuration.redraw_depth:
        return None
    recipe = task.store.recipe
    assert recipe is not None, "require_trainable refuses this"
    unknown = task.store.manifest.depth.unknown
    there = torch.unique(torch.cat([levels.flatten() for levels in images.levels]))
    known = there[(there >= 0) & (there != unknown)]
    return Redraw(recipe, int(known.min()), int(known.max()), task.configuration.tilt, unknown)


def _parameter_groups(network: nn.Module, weight_decay: float) -> list[dict[str, Any]]:
    # As in dlib, decay is for the filters: not for biases, batch normalization, activations.
    filters = [parameter for parameter in network.parameters() if parameter.dim() > 1]
    others = [parameter for parameter in network.parameters() if parameter.dim() <= 1]
    return [
        {"params": filters, "weight_decay": weight_decay},
        {"params": others, "weight_decay": 0.0},
    ]
