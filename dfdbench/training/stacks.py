"""Train ``stack-net``: crops of stacks, of few images or many, and its error."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from dfdbench.blur.recipe import LAST_LEVEL
from dfdbench.methods.networks.stack import StackNet, places_of
from dfdbench.methods.networks.volume import mean_and_variance
from dfdbench.methods.stack_net import greys_of
from dfdbench.training.cameras import Course, cut, loss_of, side_of, turned
from dfdbench.training.stack_examples import CAMERAS, EVERY, STACKS, Stack, room_stacks, stack_of

#: How many crops a step has, their rows and columns, and the fewest images.
CROPS, CROP, FEWEST = 4, 160, 3
#: Cameras that only test, by name.
HELD_OUT = tuple(f"stack-{number:02}" for number in range(EVERY - 1, CAMERAS, EVERY))
# Rows and columns that the network's scales divide.
_MULTIPLE = 32
# Spread of an image's light, as other exposures have; and the most noise, of the images' mean.
_GAIN, _NOISE = 0.02, 0.06


def draw(stacks: Sequence[Stack], seed: int, step: int) -> list[Tensor]:
    """Return the crops of a step: they follow from the seed and the step alone.

    Returns
    -------
    images : Tensor, shape (n, image, y, x)
    focus : Tensor, shape (n, image)
        From 0 to 255.
    truth : Tensor, shape (n, y, x)
        On the same scale; NaN unknown.
    """
    random = np.random.default_rng((seed, step))
    chosen = [stacks[int(random.integers(len(stacks)))] for _ in range(CROPS)]
    most = min(len(stack.images) for stack in chosen)
    count = int(random.integers(min(FEWEST, most), most + 1))
    side = side_of((stack.truth.shape for stack in stacks), CROP, _MULTIPLE)
    columns = zip(*(_crop(stack, count, side, random) for stack in chosen), strict=True)
    return [torch.from_numpy(np.stack(column)) for column in columns]


def _crop(
    stack: Stack, count: int, side: int, random: np.random.Generator
) -> tuple[NDArray[Any], ...]:
    there = len(stack.images)
    if random.random() < 0.5:  # evenly from end to end, as most stacks are
        which = np.rint(np.linspace(0, there - 1, count)).astype(int)
    else:
        which = np.sort(random.choice(there, count, replace=False))
    rows, columns = cut(stack.truth.shape, side, 1, random)
    turns = int(random.integers(8))
    colours = random.dirichlet((3.0, 3.0, 3.0)).astype(np.float32)
    images = turned(stack.images[:, rows, columns][which] @ colours, turns)
    images /= images.mean()
    images *= np.exp(random.normal(0, _GAIN, (count, 1, 1))).astype(np.float32)
    noise = np.float32(_NOISE * random.random() ** 3)
    images += noise * random.standard_normal(images.shape, np.float32)
    focus, truth = scaled(stack.places[which], stack.truth[rows, columns])
    return images, focus, turned(truth, turns)


def scaled(
    places: NDArray[np.float32], truth: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return places and truth on a scale on which the places go from 0 to 255."""
    factor = np.float32(LAST_LEVEL / np.ptp(places))
    return (places - places[0]) * factor, (truth - places[0]) * factor


def _loss(network: StackNet, stacks: Sequence[Stack], seed: int, step: int, bf16: bool) -> Tensor:
    images, focus, truth = draw(stacks, seed, step)
    with torch.autocast("cpu", torch.bfloat16, enabled=bf16):
        logits, mask = network(images, focus)
    depths, known = places_of(focus), truth.isfinite()
    # What lies beyond all places can be told as the outermost at best.
    told = truth.nan_to_num(0).clamp(depths[:, :1, None], depths[:, -1:, None])
    return loss_of(logits, mask, told, depths, known)


def error_of(network: StackNet, stack: Stack) -> float:
    """Return the root mean square error over the known pixels, as a part of the focus's range."""
    rows, columns = (size // _MULTIPLE * _MULTIPLE for size in stack.truth.shape)
    places, truth = scaled(stack.places, stack.truth[:rows, :columns])
    focus = torch.from_numpy(places)[np.newaxis]
    images = torch.from_numpy(greys_of(stack.images)[np.newaxis, :, :rows, :columns])
    logits, mask = network(images, focus)
    mean, _ = mean_and_variance(logits, mask, places_of(focus))
    off = mean[0].numpy() - truth
    return float(np.sqrt(np.nanmean(np.square(off))) / LAST_LEVEL)


#: How `stack-net` is trained.
STACK_NET = Course(
    method="stack-net",
    architecture={"filters": 16, "widths": [24, 40, 64, 64]},
    recipe="rendered by rays",
    rooms=STACKS,
    of_rooms=room_stacks,
    of_captures=lambda captures: [stack_of(capture) for capture in captures],
    held_out=HELD_OUT,
    steps=3000,
    crops=CROPS,
    crop=CROP,
    multiple=_MULTIPLE,
    shape_of=lambda stack: stack.truth.shape,
    loss=_loss,
    error=error_of,
)
