"""A network that learns: each step draws patches and changes its weights."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import nn

from dfdbench.blur.recipe import LEVELS
from dfdbench.errors import InputError, Problem
from dfdbench.methods.networks.preparation import start_from_differences
from dfdbench.methods.networks.weights import build_network, load_weights, weights_sha256
from dfdbench.training.crops import Cropper, Redraw, TrainingImages, count_levels
from dfdbench.training.loss import LevelLoss
from dfdbench.training.saved_numbers import whole_number
from dfdbench.training.saved_tensors import counts, moments_of
from dfdbench.training.schedule import schedule_of
from dfdbench.training.task import Task, require_trainable, tracks_of


class DivergedError(InputError):
    """A training whose loss is no number any more."""


class Learner:
    """A network, what draws its patches, and what changes its weights.

    Parameters
    ----------
    task : Task
        What is trained.
    device : torch.device
        Where.

    Attributes
    ----------
    network : torch.nn.Module
        What learns.
    architecture : dict
        The network's constructor arguments.
    started_from : str
        What the card says of the weights it began with; empty for random ones.
    cropper : Cropper
        What draws the patches.
    schedule : Schedule
        The learning rate of the step to come, and whether there is one.
    step : int
        Steps done.
    present, trained : ndarray of int64, shape (256,)
        How often each depth level occurs in the training pairs, and how often it was trained.

    Raises
    ------
    InputError
        Where the network cannot be trained so, or the weights to begin with are of another.
    """

    def __init__(self, task: Task, device: torch.device) -> None:
        self._choices = choices = task.configuration
        self._device = device
        self.architecture = require_trainable(task)
        images = TrainingImages.read(task.store, task.train, choices.unknown == "ignore")
        self.architecture["channel_means"] = images.channel_means()
        network, self.started_from = _beginning(task, self.architecture)
        self.network = network.to(device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        self._optimizer = torch.optim.Adam(
            _parameter_groups(self.network, choices.weight_decay, choices.decay_prelu),
            choices.learning_rate,
            betas=choices.betas,
            fused=True,
        )
        self.schedule = schedule_of(choices)
        self.cropper = _cropper(task, images)
        if choices.initial_filters == "differences" and task.start is None:
            first_patches, _ = self.cropper.draw(0)
            start_from_differences(self.network, first_patches)
        self._loss = LevelLoss(choices.label_width, device)
        self.present = images.count_levels()
        self.trained = np.zeros(LEVELS, np.int64)
        self.step = 0

    def learn(self) -> float:
        """Do one step and return its loss.

        Raises
        ------
        DivergedError
            Where the loss is no number any more.
        """
        pixels, levels = self.cropper.draw(self.step)
        self.trained += count_levels(levels)
        pixels = pixels.to(self._device, memory_format=torch.channels_last)
        for group in self._optimizer.param_groups:
            group["lr"] = self.schedule.rate
        self.network.train(self._choices.normalization == "batch")
        bf16 = self._choices.precision == "bf16"
        with torch.autocast(self._device.type, torch.bfloat16, enabled=bf16):
            logits = self.network(pixels)
        loss = self._loss(logits, levels.to(self._device))
        self._optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        self._optimizer.step()
        value = float(loss.detach())
        if not np.isfinite(value):
            raise DivergedError(
                "the loss is no number any more",
                where=f"step {self.step + 1}",
                got=str(value),
                fix="a lower learning_rate; --fresh starts anew",
            )
        self.step += 1
        self.schedule.after(self.step, value)
        return value

    def state(self) -> dict[str, Any]:
        """Return what a checkpoint keeps."""
        return {
            "step": self.step,
            "network": self.network.state_dict(),
            "optimizer": self._optimizer.state_dict(),
            "schedule": self.schedule.state(),
            "trained": torch.from_numpy(self.trained),
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from a checkpoint.

        Raises
        ------
        ValueError, TypeError, LookupError, RuntimeError
            Where it holds what this training cannot have left.
        """
        self.step = whole_number(state, "step", self._choices.steps)
        self.network.load_state_dict(state["network"])
        # Of the optimizer what it has summed up, not how it is set: that is the configuration's.
        own = self._optimizer.state_dict()["param_groups"]
        parameters = [each for group in self._optimizer.param_groups for each in group["params"]]
        kept = moments_of(state["optimizer"], parameters)
        if bool(kept) != bool(self.step):
            raise ValueError("the optimizer's state is of another step")
        self._optimizer.load_state_dict({"state": kept, "param_groups": own})
        self.schedule.restore(state["schedule"], self.step)
        self.trained = counts(state, "trained", LEVELS).numpy()


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
            expected=str(architecture.get(name)),
            got=str(card.architecture.get(name)),
        )
        # What is usual is left out: a choice may stand on either side alone.
        for name in dict.fromkeys([*architecture, *card.architecture])
        if name != "channel_means" and card.architecture.get(name) != architecture.get(name)
    ]
    if problems:
        raise InputError.of(problems)
    architecture["channel_means"] = card.architecture["channel_means"]
    earlier = f"; that from {card.started_from}" if card.started_from else ""
    digest = weights_sha256(task.start)
    minutes = f"{card.seconds / 60:.1f} minutes"
    said = f"{card.trained_on}, {card.steps:,} steps in {minutes}, SHA-256 {digest[:16]}{earlier}"
    return network, said


def _cropper(task: Task, images: TrainingImages) -> Cropper:
    choices = task.configuration
    return Cropper(
        images,
        choices.crop,
        choices.crops_per_step,
        choices.expansion,
        choices.noise,
        task.seed,
        _redraw(task, images),
        tracks_of(task),
    )


def _redraw(task: Task, images: TrainingImages) -> Redraw | None:
    if not task.configuration.redraw_depth:
        return None
    recipe = task.store.recipe
    assert recipe is not None, "require_trainable refuses this"
    unknown = task.store.manifest.depth.unknown
    there = torch.unique(torch.cat([levels.flatten() for levels in images.levels]))
    known = there[(there >= 0) & (there != unknown)]
    return Redraw(recipe, int(known.min()), int(known.max()), task.configuration.tilt, unknown)


def _parameter_groups(
    network: nn.Module, weight_decay: float, decay_prelu: bool
) -> list[dict[str, Any]]:
    # As in dlib: filters decay and, where asked for, PReLUs; biases and batch normalization never.
    slopes = [module.weight for module in network.modules() if isinstance(module, nn.PReLU)]
    decayed = {id(parameter) for parameter in network.parameters() if parameter.dim() > 1}
    decayed |= {id(slope) for slope in slopes if decay_prelu}
    parameters = list(network.parameters())
    return [
        {"params": [p for p in parameters if id(p) in decayed], "weight_decay": weight_decay},
        {"params": [p for p in parameters if id(p) not in decayed], "weight_decay": 0.0},
    ]
