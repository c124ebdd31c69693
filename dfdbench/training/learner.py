"""A network in training, and its loss."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from dfdbench.blur.recipe import LEVELS
from dfdbench.errors import InputError
from dfdbench.methods.networks.architectures import start_from_differences
from dfdbench.methods.networks.weights import build_network, load_weights, weights_sha256
from dfdbench.system.text import require_same
from dfdbench.training.crops import IGNORED, Cropper, Redraw, TrainingImages, count_levels
from dfdbench.training.schedule import schedule_of
from dfdbench.training.task import Task, require_trainable, training_tracks


class DivergedError(InputError):
    """A training whose loss became NaN or infinite."""


class Learner:
    """A network in training: each call of `learn` draws patches and changes the weights.

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
        If the initial weights come from, for the card; empty for random ones.
    cropper : Cropper
        What draws the patches.
    schedule : Schedule
        The learning rate of the next step, and whether there is one.
    step : int
        Steps done.
    present, trained : ndarray of int64, shape (256,)
        How often each depth level occurs in the training pairs, and how often it was trained.

    Raises
    ------
    InputError
        If the choices do not fit, or the weights to begin with are of another network.
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
            If the loss became NaN or infinite.
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
            fix = "lower learning_rate and start over with --fresh"
            raise DivergedError(f"the loss became {value}", where=f"step {self.step + 1}", fix=fix)
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
        """Continue from what `state` returned."""
        self.step = state["step"]
        self.network.load_state_dict(state["network"])
        self._optimizer.load_state_dict(state["optimizer"])
        self.schedule.restore(state["schedule"])
        self.trained = state["trained"].numpy()


def _beginning(task: Task, architecture: dict[str, Any]) -> tuple[nn.Module, str]:
    if task.start is None:
        # PyTorch's own initial values; its global generator is left as it was.
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(task.seed)
            network = build_network(task.method, architecture)
        return network, ""
    network, card = load_weights(task.start, task.method)
    architecture["channel_means"] = card.architecture["channel_means"]
    what = "the weights are of another network"
    require_same(card.architecture, architecture, what, str(task.start))
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
        training_tracks(task),
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
    # As in dlib: filters decay, PReLUs only on request, biases and batch normalization never.
    slopes = [module.weight for module in network.modules() if isinstance(module, nn.PReLU)]
    decayed = {id(parameter) for parameter in network.parameters() if parameter.dim() > 1}
    decayed |= {id(slope) for slope in slopes if decay_prelu}
    parameters = list(network.parameters())
    return [
        {"params": [p for p in parameters if id(p) in decayed], "weight_decay": weight_decay},
        {"params": [p for p in parameters if id(p) not in decayed], "weight_decay": 0.0},
    ]


class LevelLoss:
    """Mean cross-entropy over the pixels, with the true depth level or those around it.

    Parameters
    ----------
    width : float
        0: all weight on the true level, the published loss. Above 0: a Gaussian of this standard
        deviation in levels, whose own entropy is subtracted, so that a perfect answer has loss 0.
    device : torch.device
        Of the tensors that it is called with.

    Examples
    --------
    >>> logits = torch.zeros(1, 256, 1, 1)
    >>> round(float(LevelLoss(0, torch.device("cpu"))(logits, torch.tensor([[[7]]]))), 4)
    5.5452
    """

    def __init__(self, width: float, device: torch.device) -> None:
        self._targets: Tensor | None = None
        if width:
            levels = torch.arange(LEVELS, dtype=torch.float32, device=device)
            weights = torch.exp(-(((levels[:, None] - levels) / width) ** 2) / 2)
            self._targets = weights / weights.sum(1, keepdim=True)
            self._entropy = torch.special.entr(self._targets).sum(1)

    def __call__(self, logits: Tensor, levels: Tensor) -> Tensor:
        """Return the loss for logits, float (n, 256, y, x), and levels, int64 (n, y, x)."""
        # A row a pixel: channels come last in memory already, so that this copies nothing.
        rows = logits.float().permute(0, 2, 3, 1).reshape(-1, LEVELS)
        flat = levels.flatten()
        if self._targets is None:
            loss: Tensor = functional.cross_entropy(rows, flat, ignore_index=IGNORED)
            return loss
        if bool((flat == IGNORED).any()):
            known = flat != IGNORED
            rows, flat = rows[known], flat[known]
        crossed: Tensor = _CrossEntropy.apply(rows, self._targets, flat)  # type: ignore[no-untyped-call]
        level_loss: Tensor = crossed - self._entropy[flat].mean()
        return level_loss


class _CrossEntropy(torch.autograd.Function):
    # The gradient is softmax minus target: computing it directly takes a third of autograd's time.
    @staticmethod
    def forward(ctx: Any, rows: Tensor, targets: Tensor, levels: Tensor) -> Tensor:
        chosen = targets.index_select(0, levels)
        logarithms = functional.log_softmax(rows, 1)
        loss = -torch.dot(logarithms.flatten(), chosen.flatten()) / len(rows)
        ctx.save_for_backward(logarithms.exp_().sub_(chosen).div_(len(rows)))
        return loss

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None, None]:
        (gradient,) = ctx.saved_tensors
        return gradient * gradients[0], None, None
