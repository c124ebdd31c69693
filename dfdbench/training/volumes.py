"""Train ``volume-net``: crops of examples, its loss, and a learning rate along a cosine."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from dfdbench.blur.recipe import LAST_LEVEL
from dfdbench.errors import InputError, Problem
from dfdbench.methods.networks.volume import MOST, VolumeNet, mean_and_variance
from dfdbench.methods.networks.weights import Card, load_weights, save_weights, weights_sha256
from dfdbench.methods.volume_net import levels_of
from dfdbench.system.packages import PACKAGE_VERSION
from dfdbench.training.configuration import precision_for
from dfdbench.training.learner import DivergedError, EndedBy
from dfdbench.training.trainer import WEIGHTS, Log, Row, TrainingFolder, card_of, drive
from dfdbench.training.volume_examples import COUNT, TOLD_STEPS, Example, nats_of

#: Cameras of rendered rooms that only test, by name.
HELD_OUT = ("lens-03", "lens-08", "lens-14", "lens-19", "stack-02", "law-05", "law-13")
#: How many crops a step has, and their rows and columns.
CROPS, CROP = 8, 192
#: Steps of a training, and the largest learning rate, which the first steps lead to.
STEPS, RATE, WARM_UP = 12_000, 2e-3, 100
_DECAY, _CLIP = 1e-4, 1.0
# Rows and columns that the network's scales divide.
_MULTIPLE = 32
# What the mean's error counts beside cross-entropy, from how many levels on it grows but linearly.
_OF_MEAN, _LINEAR = 2.0, 8.0
# Noise is not always what a law says: costs are made as much larger or smaller, as a logarithm.
_STRETCH = 0.5
# A share of crops comes without a prior.
_WITHOUT = 0.15
# The weights that are kept are a mean over about so many steps.
_AVERAGED = 500
# How often, in steps, the cameras held out are scored.
_SCORED = 500


def steps_of(changes: Mapping[str, Any]) -> int:
    """Return how many steps a training has, by what a user changed.

    Raises
    ------
    InputError
        For another choice than ``steps``, or no whole number from 1 on.

    Examples
    --------
    >>> steps_of({}), steps_of({"steps": 50})
    (12000, 50)
    """
    steps = changes.get("steps", STEPS)
    right = isinstance(steps, int) and not isinstance(steps, bool) and steps > 0
    problems = [
        Problem("volume-net has no such choice", where=f"--set {name}", expected="steps")
        for name in changes
        if name != "steps"
    ]
    if not right:
        problems.append(Problem("no number of steps", where="--set steps", got=str(steps)))
    InputError.raise_if(problems)
    return int(steps)


@dataclass(frozen=True)
class Batch:
    """Crops: what the network is given, and levels of float32, shape (n, y, x), -1 unknown."""

    volume: Tensor
    paths: Tensor
    told: Tensor
    guide: Tensor
    prior: Tensor
    levels: Tensor


def draw(examples: Sequence[Example], seed: int, step: int) -> Batch:
    """Return the crops of a step: they follow from the seed and the step alone."""
    random = np.random.default_rng((seed, step))
    columns = zip(*(_crop(examples, random) for _ in range(CROPS)), strict=True)
    return Batch(*(torch.from_numpy(np.stack(column)) for column in columns))


def _crop(examples: Sequence[Example], random: np.random.Generator) -> tuple[NDArray[Any], ...]:
    example = examples[int(random.integers(len(examples)))]
    side = [min(CROP, size // _MULTIPLE * _MULTIPLE) for size in example.levels.shape]
    top, left = (
        2 * int(random.integers((size - part) // 2 + 1))
        for size, part in zip(example.levels.shape, side, strict=True)
    )
    half = np.s_[..., top // 2 : (top + side[0]) // 2, left // 2 : (left + side[1]) // 2]
    whole = np.s_[top : top + side[0], left : left + side[1]]
    turns, mirrored = divmod(int(random.integers(8)), 2)

    def turned(image: NDArray[Any]) -> NDArray[np.float32]:
        found = np.rot90(image, turns, (-2, -1))
        return np.ascontiguousarray(found[..., ::-1] if mirrored else found, np.float32)

    stretch = np.float32(np.exp(random.uniform(-_STRETCH, _STRETCH)))
    without = random.random() < _WITHOUT
    volume, paths = (
        np.minimum(nats_of(turned(roots[half])) * stretch, np.float32(MOST))
        for roots in (example.roots, example.paths)
    )
    told = turned(example.told[half]) / np.float32(TOLD_STEPS) + np.log(stretch)
    return (
        volume,
        paths,
        told[np.newaxis],
        turned(example.guide[whole])[np.newaxis],
        np.zeros_like(example.prior) if without else example.prior,
        turned(example.levels[whole]),
    )


def loss_of(logits: Tensor, mask: Tensor, levels: Tensor, depths: Tensor) -> Tensor:
    """Return cross-entropy with the true depth, and how far the mean is off.

    The depth of a larger pixel, that of its first row and column, is shared by the two levels that
    it lies between. Pixels with a level below 0 do not count.
    """
    coarse = levels[:, ::2, ::2]
    place = (coarse - depths[0]) / (depths[1] - depths[0])
    place = place.clamp(0, len(depths) - 1 - 1e-3)
    lower = place.long()
    share, logarithms = place - lower, logits.log_softmax(1)
    told = (1 - share) * logarithms.gather(1, lower[:, None])[:, 0]
    told = told + share * logarithms.gather(1, lower[:, None] + 1)[:, 0]
    mean, _ = mean_and_variance(logits, mask, depths)
    off = functional.smooth_l1_loss(mean, levels, reduction="none", beta=_LINEAR) / _LINEAR
    return _OF_MEAN * _known_mean(off, levels) - _known_mean(told, coarse)


def _known_mean(values: Tensor, levels: Tensor) -> Tensor:
    known = levels >= 0
    return (values * known).sum() / known.sum().clamp_min(1)


def error_of(network: VolumeNet, example: Example, depths: Tensor) -> float:
    """Return the root mean square error over the known pixels, as a part of the scale."""
    rows, columns = (size // _MULTIPLE * _MULTIPLE for size in example.levels.shape)
    half = np.s_[..., : rows // 2, : columns // 2]
    given = (
        nats_of(example.roots[half]),
        nats_of(example.paths[half]),
        example.told[half][np.newaxis] / np.float32(TOLD_STEPS),
        example.guide[np.newaxis, :rows, :columns].astype(np.float32),
        example.prior,
    )
    with torch.inference_mode():
        answer = network(*(torch.from_numpy(each)[np.newaxis] for each in given))
        mean = mean_and_variance(answer[0], answer[1], depths)[0][0].numpy()
    truth = example.levels[:rows, :columns]
    return float(np.sqrt(np.square(mean - truth)[truth >= 0].mean()) / LAST_LEVEL)


def train_volume_net(
    examples: Mapping[str, Sequence[Example]],
    trained_on: str,
    folder: Path,
    seed: int = 0,
    steps: int = STEPS,
    max_seconds: float | None = None,
    start: Path | None = None,
    on_step: Callable[[int, int | None], None] | None = None,
    fresh: bool = False,
) -> tuple[Path, Card, Log]:
    """Train on a CPU until the steps are done or time is up; go on from a checkpoint if there is.

    Parameters
    ----------
    examples : mapping of str to sequence of Example
        By camera; those of `HELD_OUT` only test.
    trained_on : str
        What they are, for the card.
    folder : Path
        Where checkpoint, log and weights go.
    seed : int
        Of the first weights and the crops.
    steps : int
        After which the learning rate is 0.
    max_seconds : float, optional
        The most time to spend, earlier calls included; the learning rate falls with it.
    start : Path, optional
        Weights to begin with instead of random ones.
    on_step : callable, optional
        Called with (steps done, steps in all).
    fresh : bool
        Remove an earlier training from the folder.

    Returns
    -------
    Path, Card, Log
        The file of weights, its card, and what people read of the training.

    Raises
    ------
    InputError
        If the checkpoint is damaged or of another training.
    """
    identity = {
        "dfdbench": PACKAGE_VERSION,
        "method": "volume-net",
        "trained_on": trained_on,
        "seed": seed,
        "steps": steps,
        "start": weights_sha256(start) if start else None,
    }
    learner = _Learner(examples, seed, steps, start)
    ended, seconds, log = drive(
        learner, TrainingFolder(folder), identity, max_seconds, on_step, fresh
    )
    last = (log.scores or [{}])[-1]
    scores = [value for name, value in last.items() if name != "step"]
    card = card_of(
        learner,
        seconds,
        ended,
        torch.device("cpu"),
        method="volume-net",
        architecture={"levels": COUNT},
        trained_on=trained_on,
        dataset=trained_on,
        fingerprint="",
        recipe="of each camera by itself, fitted",
        configuration={
            "crop": CROP,
            "crops_per_step": CROPS,
            "learning_rate": RATE,
            "steps": steps,
        },
        seed=seed,
        scored_on=f"cameras held out: {', '.join(learner.held)}" if learner.held else "nothing",
        scores={},
        further_scores={"valid": {"nrmse": fmean(scores)}} if scores else {},
    )
    save_weights(folder / WEIGHTS, learner.averaged, card)
    return folder / WEIGHTS, card, log


class _Learner:
    """A network in training, and the mean of its last weights."""

    def __init__(
        self, examples: Mapping[str, Sequence[Example]], seed: int, steps: int, start: Path | None
    ) -> None:
        self.held = {name: part for name, part in examples.items() if name in HELD_OUT}
        self._examples = [
            example for name, part in examples.items() if name not in HELD_OUT for example in part
        ]
        smallest = min(min(example.levels.shape) for example in self._examples)
        if smallest < _MULTIPLE:
            what = f"images of {smallest} pixels are too small to train on"
            raise InputError(what, where="volume-net", expected=f"{_MULTIPLE} pixels or more")
        self._seed = seed
        self.started_from = ""
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.network, self.averaged = VolumeNet(COUNT), VolumeNet(COUNT)
        if start is not None:
            network, card = load_weights(start, "volume-net")
            self.network.load_state_dict(network.state_dict())
            self.started_from = f"{card.trained_on}, {card.steps:,} steps"
        self.averaged.load_state_dict(self.network.state_dict())
        self.network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self._optimizer = torch.optim.AdamW(
            self.network.parameters(), RATE, weight_decay=_DECAY, fused=True
        )
        self._depths = torch.from_numpy(levels_of(COUNT) - 0.5).float()
        self._bf16 = precision_for(torch.device("cpu"))[0] == "bf16"
        self.step, self.steps = 0, steps

    @property
    def ended(self) -> str:
        """Why there is no further step."""
        return EndedBy.STEPS if self.step >= self.steps else ""

    def learn(self, spent: float) -> tuple[float, float]:
        """Do one step, of so much of the time; return its learning rate and its loss."""
        part = max(self.step / self.steps, spent)
        rate = RATE * (1 + math.cos(math.pi * min(part, 1.0))) / 2
        for group in self._optimizer.param_groups:
            group["lr"] = rate * min(1.0, (self.step + 1) / WARM_UP)
        batch = draw(self._examples, self._seed, self.step)
        with torch.autocast("cpu", torch.bfloat16, enabled=self._bf16):
            answer = self.network(batch.volume, batch.paths, batch.told, batch.guide, batch.prior)
        loss = loss_of(answer[0], answer[1], batch.levels, self._depths)
        self._optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), _CLIP)
        self._optimizer.step()
        self.step += 1
        # The first weights are soon forgotten.
        part = 1 / min(self.step / 20 + 1, _AVERAGED)
        with torch.no_grad():
            for kept, now in zip(
                self.averaged.parameters(), self.network.parameters(), strict=True
            ):
                kept.lerp_(now, part)
        value = float(loss.detach())
        if not np.isfinite(value):
            raise DivergedError(f"the loss became {value}", where=f"step {self.step}")
        return rate, value

    def levels(self) -> list[Row]:
        """Return nothing: levels are not counted."""
        return []

    def scores(self, last: bool) -> dict[str, float]:
        """Return the error of the mean weights for each camera held out, by its name."""
        if not last and self.step % _SCORED:
            return {}
        return {
            name: fmean(error_of(self.averaged, example, self._depths) for example in part[::3])
            for name, part in self.held.items()
        }

    def state(self) -> dict[str, Any]:
        """Return what a checkpoint keeps."""
        return {
            "step": self.step,
            "network": self.network.state_dict(),
            "averaged": self.averaged.state_dict(),
            "optimizer": self._optimizer.state_dict(),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from what `state` returned."""
        self.step = state["step"]
        self.network.load_state_dict(state["network"])
        self.averaged.load_state_dict(state["averaged"])
        self._optimizer.load_state_dict(state["optimizer"])
