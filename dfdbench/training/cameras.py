"""Train a network on the captures of many cameras; some cameras only test.

It trains on crops, its learning rate follows a cosine, and its weights are averaged over the last
steps.
"""

import copy
import io
import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from typing import Any, Generic, TypeVar
from zipfile import BadZipFile

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from dfdbench.datasets.captures import Capture
from dfdbench.datasets.dataset import Dataset
from dfdbench.errors import InputError, Problem, reason_of
from dfdbench.methods.networks.volume import mean_and_variance
from dfdbench.methods.networks.weights import weights_sha256
from dfdbench.system.files import write_whole
from dfdbench.system.parallel import OnDone, one_by_one
from dfdbench.training.configuration import precision_for
from dfdbench.training.task import begun_network
from dfdbench.training.trainer import Log, Trainee

E = TypeVar("E")
#: The networks' scales require crops with multiples of this many rows and columns.
MULTIPLE = 32
#: The largest learning rate, and the number of steps to reach it.
RATE, WARM_UP = 2e-3, 100
_DECAY, _CLIP = 1e-4, 1.0
# The weight of the mean's error beside cross-entropy; from this error on, in levels, it is linear.
_OF_MEAN, _LINEAR = 0.5, 64.0
# The final weights are a mean over about this many steps.
_AVERAGED = 500
# How often, in steps, the held-out cameras are scored.
_SCORED = 500


@dataclass(frozen=True)
class Course(Generic[E]):
    """How a network is trained on examples from many cameras.

    Parameters
    ----------
    method : str
        The network's name.
    architecture : mapping
        Its constructor arguments.
    recipe : str
        How the blur of the examples is known, for the card.
    rooms : str
        The card's name for its rendered rooms.
    of_rooms : callable
        Make examples from the rooms, by camera, kept in a folder.
    of_captures : callable
        Make examples from a data set's captures.
    held_out : collection of str
        Cameras that only test.
    steps : int
        The steps until the learning rate is 0, if no other number is given.
    crops, crop : int
        Crops per step, and the largest side of a crop.
    shape_of : callable
        Return an example's rows and columns.
    loss : callable
        Called with the network, all examples, the seed, the step, and whether to compute in bf16.
    error : callable
        Called with the network and an example; the error as a fraction of the scale.
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
    shape_of: Callable[[E], tuple[int, ...]]
    loss: Callable[[Any, Sequence[E], int, int, bool], Tensor]
    error: Callable[[Any, E], float]


def kept_examples(
    folder: Path,
    makers: Mapping[str, Callable[[], Mapping[str, Any]]],
    read: Callable[[Mapping[str, Any]], Sequence[E]],
    on_camera: OnDone | None,
) -> dict[str, Sequence[E]]:
    """Return examples by camera; those already in the folder, one ``.npz`` file each, are reused.

    Parameters
    ----------
    folder : Path
        The folder of the files.
    makers : mapping of str to callable
        Make the arrays of a camera, by name.
    read : callable
        Turn arrays into examples.
    on_camera : callable, optional
        Called with (cameras done, total cameras).

    Raises
    ------
    InputError
        If a file is damaged.
    """
    found = {}
    for name, make in one_by_one(makers.items(), on_camera):
        path = folder / f"{name}.npz"
        if not path.exists():
            content = io.BytesIO()
            np.savez(content, allow_pickle=False, **make())
            write_whole(path, content.getvalue())
        try:
            with np.load(path) as arrays:
                found[name] = read(arrays)
        except (OSError, EOFError, ValueError, KeyError, RuntimeError, BadZipFile) as error:
            what, fix = f"damaged examples: {reason_of(error)}", "remove the file: it is made anew"
            raise InputError(what, where=str(path), fix=fix) from error
    return found


def steps_of(course: Course[Any], changes: Mapping[str, Any]) -> int:
    """Return a training's number of steps, given the user's changes.

    Raises
    ------
    InputError
        If anything but ``steps`` is changed, or it is not a whole number of at least 1.
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


def side_of(shapes: Iterable[tuple[int, ...]], crop: int) -> int:
    """Return the side of the largest square that fits into all images, at most `crop`.

    Examples
    --------
    >>> side_of([(480, 640), (100, 120)], 160)
    96
    """
    return min(crop, *map(min, shapes)) // MULTIPLE * MULTIPLE


def cut(
    shape: Sequence[int], side: int, cell: int, random: np.random.Generator
) -> tuple[slice, ...]:
    """Draw the rows and columns of a square crop that starts at a whole cell of pixels."""
    begins = [cell * int(random.integers((size - side) // cell + 1)) for size in shape]
    return tuple(slice(begin, begin + side) for begin in begins)


def turned(image: Any, turns: int) -> np.ndarray[Any, np.dtype[np.float32]]:
    """Turn the last two axes to one of eight orientations: right-angle turns, odd ones mirrored."""
    found = np.rot90(image, turns // 2, (-2, -1))
    return np.ascontiguousarray(found[..., ::-1] if turns % 2 else found, np.float32)


def loss_of(logits: Tensor, mask: Tensor, levels: Tensor, depths: Tensor, known: Tensor) -> Tensor:
    """Return the cross-entropy with the true depth plus the error of the mean.

    The depth of a larger pixel is that of one of its pixels, and is shared by the two levels around
    it.

    Parameters
    ----------
    logits, mask, depths
        As in `mean_and_variance`; depths rise.
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
    off = functional.smooth_l1_loss(mean, levels, reduction="none", beta=_LINEAR)
    return _OF_MEAN * _known_mean(off, known) - _known_mean(told, known[middle])


def _known_mean(values: Tensor, known: Tensor) -> Tensor:
    return (values * known).sum() / known.sum().clamp_min(1)


class CameraLearner(Trainee, Generic[E]):
    """A network trained on crops of many cameras' captures, and the mean of its last weights.

    Parameters
    ----------
    course : Course
        What to train, and how.
    examples : mapping of str to sequence
        By camera; those that the course holds out only test.
    trained_on : str
        What the examples are, for the card.
    seed : int
        Seed of the first weights and the crops.
    steps : int, optional
        The steps until the learning rate is 0; it also falls with the time spent.
    start : Path, optional
        Weights to start from, in place of random ones.
    store : Dataset, optional
        The data set of the examples, where they are no rendered rooms.

    Raises
    ------
    InputError
        If the images are too small.
    MethodError
        If the weights belong to another network.
    """

    def __init__(
        self,
        course: Course[E],
        examples: Mapping[str, Sequence[E]],
        trained_on: str,
        seed: int = 0,
        steps: int | None = None,
        start: Path | None = None,
        store: Dataset | None = None,
    ) -> None:
        self._held = {name: part for name, part in examples.items() if name in course.held_out}
        self._course, self._trained_on, self._seed = course, trained_on, seed
        self._examples = [
            example for name, part in examples.items() if name not in self._held for example in part
        ]
        smallest = min(min(course.shape_of(example)) for example in self._examples)
        if smallest < MULTIPLE:
            what = f"images of {smallest} pixels are too small to train on"
            expected = f"{MULTIPLE} pixels or more"
            raise InputError(what, where=course.method, expected=expected)
        architecture = dict(course.architecture)
        network, started_from = begun_network(course.method, architecture, seed, start)
        averaged = copy.deepcopy(network)
        network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        optimizer = torch.optim.AdamW(network.parameters(), RATE, weight_decay=_DECAY, fused=True)
        self._total, self._fingerprint = steps or course.steps, store.fingerprint if store else ""
        identity = {
            "method": course.method,
            "manifest_sha256": store.manifest.sha256 if store else "",
            "fingerprint": self._fingerprint,
            "trained_on": trained_on,
            "seed": seed,
            "steps": self._total,
            "start": weights_sha256(start) if start else None,
        }
        cpu = torch.device("cpu")
        super().__init__(network, optimizer, self._total, identity, started_from, cpu)
        self.warm_up = WARM_UP
        self.kept = averaged
        self._bf16 = precision_for(cpu)[0] == "bf16"

    def learn(self, spent: float = 0.0) -> tuple[float, float]:
        """Do one step, given the share of time spent; return its learning rate and its loss."""
        part = max(self.step / self._total, spent)
        rate = RATE * (1 + math.cos(math.pi * min(part, 1.0))) / 2
        rate *= min(1.0, (self.step + 1) / WARM_UP)
        loss = self._course.loss(self.network, self._examples, self._seed, self.step, self._bf16)
        value = self.descend(loss, rate, _CLIP)
        # The first weights are soon forgotten.
        part = 1 / min(self.step / 20 + 1, _AVERAGED)
        with torch.no_grad():
            for kept, now in zip(self.kept.parameters(), self.network.parameters(), strict=True):
                kept.lerp_(now, part)
        return rate, value

    def scores(self, last: bool) -> dict[str, float]:
        """Return the error of the mean weights for each held-out camera, by its name."""
        if not last and self.step % _SCORED:
            return {}
        with torch.inference_mode():
            return {
                name: fmean(self._course.error(self.kept, example) for example in part[::3])
                for name, part in self._held.items()
            }

    def facts(self, log: Log) -> dict[str, Any]:
        """Return the card's facts about the course and the latest errors."""
        course = self._course
        side = side_of(map(course.shape_of, self._examples), course.crop)
        chosen = {"crop": side, "crops_per_step": course.crops, "learning_rate": RATE}
        last = (log.scores or [{}])[-1]
        scores = [value for name, value in last.items() if name != "step"]
        return {
            "method": course.method,
            "architecture": dict(course.architecture),
            "trained_on": self._trained_on,
            "dataset": self._trained_on,
            "fingerprint": self._fingerprint,
            "recipe": course.recipe,
            "configuration": {**chosen, "steps": self._total},
            "seed": self._seed,
            "scored_on": f"cameras held out: {', '.join(self._held)}" if self._held else "nothing",
            "scores": {},
            "further_scores": {"valid": {"nrmse": fmean(scores)}} if scores else {},
        }

    def state(self) -> dict[str, Any]:
        """Return the state for a checkpoint."""
        return {**super().state(), "averaged": self.kept.state_dict()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from what `state` returned."""
        super().restore(state)
        self.kept.load_state_dict(state["averaged"])
