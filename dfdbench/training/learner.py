"""A network in training, and its loss."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.special import ndtr
from torch import Tensor, nn
from torch.nn import functional

from dfdbench.blur.recipe import LEVELS
from dfdbench.datasets.manifest import Pair
from dfdbench.methods.networks.architectures import start_from_differences
from dfdbench.methods.networks.inference import find_device
from dfdbench.training import task as tasks
from dfdbench.training.configuration import TrainingConfiguration, settled
from dfdbench.training.crops import IGNORED, Cropper, TrainingImages, count_levels
from dfdbench.training.trainer import EndedBy, Log, Row, Trainee

#: From dlib's trainer: each step's addition to the budget of checks, the minimum of dropped losses.
_BUDGET_A_STEP, _DROPPED = 200, 400
#: The probability above which a loss counts as fallen.
_SURE = 0.51


class DlibSchedule:
    """Lower the learning rate when dlib's trainer would (5.2.2).

    It keeps the last `patience` losses. Once it has that many, it fits a line to them every
    ``patience // 200 + 1`` steps (13 for 2,500). If that line does not fall with a probability of
    0.51, neither over all of them nor without the largest 10 %, it lowers the rate and drops the
    oldest ``400 + patience // 10`` losses. This follows dlib's ``dnn_trainer`` and
    ``running_gradient``, except that dlib also returns to its last file if the loss rises.

    Parameters
    ----------
    configuration : TrainingConfiguration
        Its `learning_rate`, `patience`, `shrink` and `minimum_learning_rate`.

    Examples
    --------
    >>> choices = TrainingConfiguration(patience=600, learning_rate=0.1)
    >>> schedule = DlibSchedule(choices)
    >>> lowered = []
    >>> for step in range(1, 1201):
    ...     before = schedule.rate
    ...     schedule.after(step, 1.0)
    ...     if schedule.rate < before:
    ...         lowered.append(step)
    >>> lowered  # 460 are dropped, and 460 more have to come
    [600, 1060]
    """

    def __init__(self, configuration: TrainingConfiguration) -> None:
        self._choices = configuration
        self._losses: list[float] = []
        #: The learning rate of the next step.
        self.rate = configuration.learning_rate

    def after(self, step: int, loss: float) -> None:
        """Record the loss of a finished step; lower the rate if dlib would."""
        patience = self._choices.patience
        self._losses = [*self._losses[-patience + 1 :], loss]
        due = step % (patience // _BUDGET_A_STEP + 1) == 0
        if not due or len(self._losses) < patience:
            return
        kept = without_largest(self._losses)
        if max(probability_of_fall(self._losses), probability_of_fall(kept)) < _SURE:
            self.rate *= self._choices.shrink
            del self._losses[: _DROPPED + patience // 10]

    @property
    def ended(self) -> str:
        """Why there is no further step; empty if the rate is not yet at its minimum."""
        # Ten reductions by 0.1 leave a rounding error above 1e-10.
        least = self._choices.minimum_learning_rate
        return f"{EndedBy.LEARNING_RATE} {least:g}" if self.rate <= least * (1 + 1e-6) else ""

    def state(self) -> dict[str, Any]:
        """Return the state for a checkpoint."""
        return {"rate": self.rate, "losses": list(self._losses)}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from what `state` returned."""
        self.rate, self._losses = state["rate"], state["losses"]


def cosine_rate(configuration: TrainingConfiguration, step: int) -> float:
    """Return a learning rate that rises over `warm_up` steps, then falls along a cosine to 0.

    Parameters
    ----------
    configuration : TrainingConfiguration
        Its `learning_rate`, `warm_up` and `steps`.
    step : int
        Steps done.

    Examples
    --------
    >>> choices = TrainingConfiguration(schedule="cosine", steps=4)
    >>> cosine_rate(choices, 0), round(cosine_rate(choices, 2), 9)
    (0.0001, 5e-05)
    """
    assert configuration.steps is not None, "the configuration has checked that"
    rising = min(1.0, (step + 1) / (configuration.warm_up + 1))
    falling = (1 + math.cos(math.pi * step / configuration.steps)) / 2
    return configuration.learning_rate * rising * falling


def probability_of_fall(losses: Sequence[float] | NDArray[np.float64]) -> float:
    """Return the probability that the loss has fallen, by the line through all losses.

    Parameters
    ----------
    losses : array_like of float, shape (n,)
        One per step, oldest first; at least 3.

    Examples
    --------
    >>> probability_of_fall([5.0, 4.0, 3.0]), probability_of_fall([1.0, 1.0, 1.0])
    (1.0, 0.5)
    >>> round(probability_of_fall([2.0, 1.0, 3.0, 2.0]), 3)
    0.319
    """
    values = np.asarray(losses, np.float64)
    steps = np.arange(values.size) - (values.size - 1) / 2
    centred = values - values.mean()
    slope = float(steps @ centred / (steps @ steps))
    residual = centred - slope * steps
    error = float(np.sqrt(residual @ residual / (values.size - 2) / (steps @ steps)))
    # Below this, slopes and their errors are mere rounding errors of the sums.
    least = float(1e-12 * max(1.0, np.abs(values).max()))
    if error > least:
        return float(ndtr(-slope / error))
    return 0.5 if abs(slope) <= least else float(slope < 0)


def without_largest(losses: Sequence[float] | NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the losses without the largest tenth, in their order, as dlib does.

    Examples
    --------
    >>> without_largest([3, 9, 1, 2, 5, 4, 6, 7, 8, 2, 1]).tolist()
    [3.0, 1.0, 2.0, 5.0, 4.0, 6.0, 7.0, 8.0, 2.0, 1.0]
    """
    values = np.asarray(losses, np.float64)
    highest = int((values.size - 1) * 0.9 + 0.5)
    return np.asarray(values[values <= np.partition(values, highest)[highest]])


class Learner(Trainee):
    """A network trained on patches: each step draws some and changes the weights.

    Parameters
    ----------
    task : Task
        What to train.
    device : str
        As for the methods: ``auto``, ``cpu``, ``cuda``, ``mps``.

    Attributes
    ----------
    architecture : dict
        The network's constructor arguments.
    cropper : Cropper
        Draws the patches.
    pairs : tuple of str
        The training pairs' names.
    present, trained : ndarray of int64, shape (256,)
        How often each depth level occurs in the training pairs, and how often it was trained on.

    Raises
    ------
    InputError
        If choices do not fit the network or data, or the initial weights are another network's.
    """

    def __init__(self, task: tasks.Task, device: str = "auto") -> None:
        found = find_device(device)
        # Checkpoint and card keep the settled precision: on another machine `auto` may differ.
        choices = settled(task.configuration, found)
        self._task = task = replace(task, configuration=choices)
        self._choices = choices
        self.pairs = tuple(pair.id for pair in task.train)
        self.architecture = tasks.require_trainable(task)
        images = TrainingImages.read(task.store, task.train, choices.unknown == "ignore")
        self.architecture["channel_means"] = images.channel_means()
        beginning = task.method, self.architecture, task.seed, task.start
        network, started_from = tasks.begun_network(*beginning)
        network = network.to(found, memory_format=torch.channels_last)  # type: ignore[call-overload]
        groups = _parameter_groups(network, choices.weight_decay, choices.decay_prelu)
        rate, betas = choices.learning_rate, choices.betas
        optimizer = torch.optim.Adam(groups, rate, betas=betas, fused=True)
        super().__init__(network, optimizer, choices.steps, task.identity, started_from, found)
        self.warm_up = choices.warm_up if choices.schedule == "cosine" else 0
        self._dlib = DlibSchedule(choices) if choices.schedule == "dlib" else None
        drawn = choices.crop, choices.crops_per_step, choices.expansion, choices.noise
        self.cropper = Cropper(images, *drawn, task.seed, tasks.redraw_of(task, images))
        if choices.initial_filters == "differences" and task.start is None:
            first_patches, _ = self.cropper.draw(0)
            start_from_differences(network, first_patches)
        self._loss = LevelLoss(choices.label_width, found)
        self.present = images.count_levels()
        self.trained = np.zeros(LEVELS, np.int64)

    @property
    def ended(self) -> str:
        """Why there is no further step: the number of steps, or the learning rate."""
        return (self._dlib.ended if self._dlib else "") or super().ended

    def learn(self, spent: float = 0.0) -> tuple[float, float]:
        """Do one step and return its learning rate and its loss."""
        pixels, levels = self.cropper.draw(self.step)
        self.trained += count_levels(levels)
        pixels = pixels.to(self.device, memory_format=torch.channels_last)
        rate = self._dlib.rate if self._dlib else cosine_rate(self._choices, self.step)
        self.network.train(self._choices.normalization == "batch")
        bf16 = self._choices.precision == "bf16"
        with torch.autocast(self.device.type, torch.bfloat16, enabled=bf16):
            logits = self.network(pixels)
        loss = self._loss(logits, levels.to(self.device))
        fix = "lower learning_rate and start over with --fresh"
        value = self.descend(loss, rate, fix=fix)
        if self._dlib:
            self._dlib.after(self.step, value)
        return rate, value

    def scores(self, last: bool) -> dict[str, float]:
        """Return the scores on some training and test pairs, at the steps that are scored."""
        row: dict[str, float] = {}
        if self.step % self._choices.evaluate_every:
            return row
        for name, pairs in (("train", self._task.train), ("test", self._task.test)):
            chosen = tasks.evenly_spaced(pairs, self._choices.evaluate_pairs)
            for protocol, scores in self.mean_scores(chosen).items():
                kind = name if protocol == tasks.PROTOCOL else f"{name}_{protocol}"
                row |= {f"{kind}_{metric}": value for metric, value in scores.items()}
        return row

    def mean_scores(self, pairs: Sequence[Pair]) -> dict[str, dict[str, float]]:
        """Return the mean scores on pairs, by protocol."""
        store, readout = self._task.store, self._choices.readout
        return tasks.mean_scores(self.network, store, pairs, self.device, readout=readout)

    def levels(self) -> list[Row]:
        """Return how often each depth level was trained on, and occurs in the training pairs."""
        counts = zip(self.trained.tolist(), self.present.tolist(), strict=True)
        return [
            {"level": level, "trained": trained, "present": present}
            for level, (trained, present) in enumerate(counts)
        ]

    def facts(self, log: Log) -> dict[str, Any]:
        """Return the card's facts about task, configuration and scores."""
        task, choices = self._task, self._choices
        scores = self.mean_scores(task.test)
        return {
            "method": task.method,
            "architecture": self.architecture,
            "trained_on": task.trained_on,
            "dataset": task.store.manifest.stem,
            "fingerprint": task.store.fingerprint,
            "recipe": choices.recipe or task.store.recipe_name,
            "configuration": choices.model_dump(mode="json"),
            "seed": task.seed,
            "scored_on": f"{task.tested_on}, {len(task.test)} pairs" if task.test else "nothing",
            "scores": scores.pop(tasks.PROTOCOL),
            "further_scores": scores,
        }

    def state(self) -> dict[str, Any]:
        """Return the state for a checkpoint."""
        schedule = self._dlib.state() if self._dlib else {}
        trained = torch.from_numpy(self.trained)
        return {**super().state(), "schedule": schedule, "trained": trained}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from what `state` returned."""
        super().restore(state)
        if self._dlib:
            self._dlib.restore(state["schedule"])
        self.trained = state["trained"].numpy()


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
        The device of its arguments.

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
        """Return the loss for logits, float (n, 256, y, x), and levels, int64 (n, y, x).

        It is 0 if no pixel is known.
        """
        # One row per pixel: channels are last in memory already, so this copies nothing.
        rows = logits.float().permute(0, 2, 3, 1).reshape(-1, LEVELS)
        flat = levels.flatten()
        known = flat != IGNORED
        if not bool(known.any()):
            return 0 * rows.sum()  # a mean over no pixel is NaN, and would end the training
        if self._targets is None:
            loss: Tensor = functional.cross_entropy(rows, flat, ignore_index=IGNORED)
            return loss
        if not bool(known.all()):
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
