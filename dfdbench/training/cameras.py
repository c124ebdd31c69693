"""Train a network on the captures of many cameras, some of which only test.

Crops of them, a learning rate along a cosine, and weights that are the mean over the last steps.
"""

from __future__ import annotations

import copy
import io
import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from typing import Any, Generic, TypeVar

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from dfdbench.datasets.captures import Capture
from dfdbench.datasets.dataset import Dataset
from dfdbench.errors import InputError, Problem
from dfdbench.methods.networks.volume import mean_and_variance
from dfdbench.methods.networks.weights import (
    Card,
    described,
    load_weights,
    save_weights,
    weights_sha256,
)
from dfdbench.system.files import write_whole
from dfdbench.system.packages import PACKAGE_VERSION
from dfdbench.system.parallel import OnDone
from dfdbench.training.configuration import precision_for
from dfdbench.training.learner import EndedBy
from dfdbench.training.task import descend, seeded_network
from dfdbench.training.trainer import WEIGHTS, Log, OnStep, Row, card_of, drive

E = TypeVar("E")
#: The largest learning rate, and the steps that lead to it.
RATE, WARM_UP = 2e-3, 100
_DECAY, _CLIP = 1e-4, 1.0
# What the mean's error counts beside cross-entropy, from how many levels on it grows but linearly.
_OF_MEAN, _LINEAR = 2.0, 8.0
# The weights that are kept are a mean over about so many steps.
_AVERAGED = 500
# How often, in steps, the cameras held out are scored.
_SCORED = 500


@dataclass(frozen=True)
class Course(Generic[E]):
    """How a network is trained on examples of many cameras.

    Parameters
    ----------
    method : str
        The network's name.
    architecture : mapping
        Its constructor arguments.
    recipe : str
        How the blur of the examples is known, for the card.
    rooms : str
        What its rendered rooms are called on a card.
    of_rooms : callable
        Make examples of them by camera, kept in a folder.
    of_captures : callable
        Make examples of a data set's captures.
    held_out : collection of str
        Cameras that only test.
    steps : int
        After which the learning rate is 0, if no other number is asked for.
    crops, crop, multiple : int
        Crops of a step, their side at most, and what divides it.
    shape_of : callable
        Return an example's rows and columns.
    loss : callable
        Of the network, all examples, the seed, the step, and whether to compute in bf16.
    error : callable
        Of the network on an example, as a part of the scale.
    """

    method: str
    architecture: Mapping[str, Any]
    recipe: str
    rooms: str
    of_rooms: Callable[[Path, OnDone | None], Mapping[str, Sequence[E]]]
    of_captures: Callable[[Sequence[Capture]], Sequence[E]]
    held_out: Collection[str]
    steps: int
    crops: int
    crop: int
    multiple: int
    shape_of: Callable[[E], tuple[int, ...]]
    loss: Callable[[Any, Sequence[E], int, int, bool], Tensor]
    error: Callable[[Any, E], float]


def set_examples(
    course: Course[E], store: Dataset, split: str
) -> tuple[Mapping[str, Sequence[E]], str]:
    """Return a split's captures as examples of one camera, and what they are in words.

    Raises
    ------
    MethodError
        If the course cannot make examples of them.
    UnknownNameError
        If there is no such split.
    """
    stem = store.manifest.stem
    return {stem: course.of_captures(store.captures(split))}, f"{stem}, split {split}"


def keep_arrays(path: Path, arrays: Mapping[str, Any]) -> None:
    """Write arrays by name into an ``.npz`` file, whole or not at all."""
    content = io.BytesIO()
    np.savez(content, allow_pickle=False, **arrays)
    write_whole(path, content.getvalue())


def steps_of(course: Course[Any], changes: Mapping[str, Any]) -> int:
    """Return how many steps a training has, by what a user changed.

    Raises
    ------
    InputError
        For another choice than ``steps``, or no whole number from 1 on.
    """
    steps = changes.get("steps", course.steps)
    right = isinstance(steps, int) and not isinstance(steps, bool) and steps > 0
    problems = [
        Problem(f"{course.method} has no such choice", where=f"--set {name}", expected="steps")
        for name in changes
        if name != "steps"
    ]
    if not right:
        problems.append(Problem("no number of steps", where="--set steps", got=str(steps)))
    InputError.raise_if(problems)
    return int(steps)


def side_of(shapes: Iterable[tuple[int, ...]], crop: int, multiple: int) -> int:
    """Return the side of the largest squares that all images hold: `crop` at most, a multiple.

    Examples
    --------
    >>> side_of([(480, 640), (100, 120)], 160, 32)
    96
    """
    return min(crop, *map(min, shapes)) // multiple * multiple


def cut(
    shape: Sequence[int], side: int, cell: int, random: np.random.Generator
) -> tuple[slice, ...]:
    """Draw which rows and columns are a square crop; it begins with a whole cell of pixels."""
    begins = [cell * int(random.integers((size - side) // cell + 1)) for size in shape]
    return tuple(slice(begin, begin + side) for begin in begins)


def turned(image: Any, turns: int) -> np.ndarray[Any, np.dtype[np.float32]]:
    """Return the last two axes in one of eight ways: turned by right angles, mirrored if odd."""
    found = np.rot90(image, turns // 2, (-2, -1))
    return np.ascontiguousarray(found[..., ::-1] if turns % 2 else found, np.float32)


def loss_of(logits: Tensor, mask: Tensor, levels: Tensor, depths: Tensor, known: Tensor) -> Tensor:
    """Return cross-entropy with the true depth, and how far the mean is off.

    The depth of a larger pixel, that of one of its pixels, is shared by the two levels that it lies
    between.

    Parameters
    ----------
    logits, mask, depths
        As of `mean_and_variance`; depths rise.
    levels : Tensor, shape (n, y, x)
        The truth.
    known : Tensor of bool, of that shape
        Pixels that count.
    """
    step = levels.shape[1] // logits.shape[2]
    middle = (slice(None), *(slice((step - 1) // 2, None, step),) * 2)
    coarse = levels[middle].contiguous()
    depths = depths.expand(len(logits), -1).contiguous()
    count = depths.shape[1]
    flat = coarse.flatten(1)
    lower = (torch.searchsorted(depths, flat, right=True) - 1).clamp(0, count - 2)
    begin = depths.gather(1, lower)
    share = ((flat - begin) / (depths.gather(1, lower + 1) - begin)).clamp(0, 1 - 1e-3)
    lower, share = lower.view_as(coarse), share.view_as(coarse)
    logarithms = logits.log_softmax(1)
    told = (1 - share) * logarithms.gather(1, lower[:, None])[:, 0]
    told = told + share * logarithms.gather(1, lower[:, None] + 1)[:, 0]
    mean, _ = mean_and_variance(logits, mask, depths)
    off = functional.smooth_l1_loss(mean, levels, reduction="none", beta=_LINEAR) / _LINEAR
    return _OF_MEAN * _known_mean(off, known) - _known_mean(told, known[middle])


def _known_mean(values: Tensor, known: Tensor) -> Tensor:
    return (values * known).sum() / known.sum().clamp_min(1)


def train_on_cameras(
    course: Course[E],
    examples: Mapping[str, Sequence[E]],
    trained_on: str,
    folder: Path,
    seed: int = 0,
    steps: int | None = None,
    max_seconds: float | None = None,
    start: Path | None = None,
    on_step: OnStep | None = None,
    fresh: bool = False,
) -> tuple[Path, Card, Log]:
    """Train on a CPU until the steps are done or time is up; go on from a checkpoint if there is.

    Parameters
    ----------
    course : Course
        What is trained, and how.
    examples : mapping of str to sequence
        By camera; those that the course holds out only test.
    trained_on : str
        What they are, for the card.
    folder : Path
        Where checkpoint, log and weights go.
    seed : int
        Of the first weights and the crops.
    steps : int, optional
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
        If the checkpoint is damaged or of another training, or another training writes there.
    DivergedError
        If the loss became NaN or infinite.
    """
    steps = steps or course.steps
    identity = {
        "dfdbench": PACKAGE_VERSION,
        "method": course.method,
        "trained_on": trained_on,
        "seed": seed,
        "steps": steps,
        "start": weights_sha256(start) if start else None,
    }
    learner = _Learner(course, examples, seed, steps, start)
    ended, seconds, log = drive(learner, folder, identity, max_seconds, on_step, fresh)
    chosen = {"crop": course.crop, "crops_per_step": course.crops, "learning_rate": RATE}
    last = (log.scores or [{}])[-1]
    scores = [value for name, value in last.items() if name != "step"]
    card = card_of(
        learner,
        seconds,
        ended,
        torch.device("cpu"),
        method=course.method,
        architecture=dict(course.architecture),
        trained_on=trained_on,
        dataset=trained_on,
        fingerprint="",
        recipe=course.recipe,
        configuration={**chosen, "steps": steps},
        seed=seed,
        scored_on=f"cameras held out: {', '.join(learner.held)}" if learner.held else "nothing",
        scores={},
        further_scores={"valid": {"nrmse": fmean(scores)}} if scores else {},
    )
    save_weights(folder / WEIGHTS, learner.averaged, card)
    return folder / WEIGHTS, card, log


class _Learner(Generic[E]):
    """A network in training, and the mean of its last weights."""

    def __init__(
        self,
        course: Course[E],
        examples: Mapping[str, Sequence[E]],
        seed: int,
        steps: int,
        start: Path | None,
    ) -> None:
        self.held = {name: part for name, part in examples.items() if name in course.held_out}
        self._course, self._seed = course, seed
        self._examples = [
            example for name, part in examples.items() if name not in self.held for example in part
        ]
        smallest = min(min(course.shape_of(example)) for example in self._examples)
        if smallest < course.multiple:
            what = f"images of {smallest} pixels are too small to train on"
            expected = f"{course.multiple} pixels or more"
            raise InputError(what, where=course.method, expected=expected)
        self.started_from = ""
        self.network = seeded_network(course.method, course.architecture, seed)
        if start is not None:
            network, card = load_weights(start, course.method)
            self.network.load_state_dict(network.state_dict())
            self.started_from = described(start, card)
        self.averaged = copy.deepcopy(self.network)
        self.network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self._optimizer = torch.optim.AdamW(
            self.network.parameters(), RATE, weight_decay=_DECAY, fused=True
        )
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
        loss = self._course.loss(self.network, self._examples, self._seed, self.step, self._bf16)
        self.step += 1
        warm = rate * min(1.0, self.step / WARM_UP)
        value = descend(self._optimizer, loss, warm, self.step, _CLIP)
        # The first weights are soon forgotten.
        part = 1 / min(self.step / 20 + 1, _AVERAGED)
        with torch.no_grad():
            for kept, now in zip(
                self.averaged.parameters(), self.network.parameters(), strict=True
            ):
                kept.lerp_(now, part)
        return rate, value

    def levels(self) -> list[Row]:
        """Return nothing: levels are not counted."""
        return []

    def scores(self, last: bool) -> dict[str, float]:
        """Return the error of the mean weights for each camera held out, by its name."""
        if not last and self.step % _SCORED:
            return {}
        with torch.inference_mode():
            return {
                name: fmean(self._course.error(self.averaged, example) for example in part[::3])
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
