"""Train ``volume-net``: crops of examples, its loss and its error."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from dfdbench.blur.recipe import LAST_LEVEL
from dfdbench.methods.networks.volume import MOST, VolumeNet, mean_and_variance
from dfdbench.methods.volume_net import levels_of
from dfdbench.training.cameras import Course, cut, loss_of, side_of, turned
from dfdbench.training.volume_examples import (
    COUNT,
    HELD_OUT,
    ROOMS,
    TOLD_STEPS,
    Example,
    examples_of,
    nats_of,
    room_examples,
)

#: How many crops a step has, and their rows and columns.
CROPS, CROP = 3, 320
#: What the network's levels stand for.
DEPTHS = torch.from_numpy(levels_of(COUNT) - 0.5).float()
# Rows and columns that the network's scales divide.
_MULTIPLE = 32
# Noise is not always what a law says: costs are made as much larger or smaller, as a logarithm.
_STRETCH = 0.5
# A share of crops comes without a prior.
_WITHOUT = 0.15


def draw(examples: Sequence[Example], seed: int, step: int) -> list[Tensor]:
    """Return the crops of a step: they follow from the seed and the step alone.

    Returns
    -------
    list of Tensor
        What the network is given, and levels of float32, shape (n, y, x), -1 unknown.
    """
    random = np.random.default_rng((seed, step))
    side = side_of((example.levels.shape for example in examples), CROP, _MULTIPLE)
    columns = zip(*(_crop(examples, side, random) for _ in range(CROPS)), strict=True)
    return [torch.from_numpy(np.stack(column)) for column in columns]


def _crop(
    examples: Sequence[Example], side: int, random: np.random.Generator
) -> tuple[NDArray[Any], ...]:
    example = examples[int(random.integers(len(examples)))]
    whole = cut(example.levels.shape, side, 2, random)
    half: Any = (..., *(slice(part.start // 2, part.stop // 2) for part in whole))
    turns = int(random.integers(8))
    stretch = np.float32(np.exp(random.uniform(-_STRETCH, _STRETCH)))
    without = random.random() < _WITHOUT
    volume, paths = (
        np.minimum(nats_of(turned(roots[half], turns)) * stretch, np.float32(MOST))
        for roots in (example.roots, example.paths)
    )
    told = turned(example.told[half], turns) / np.float32(TOLD_STEPS) + np.log(stretch)
    return (
        volume,
        paths,
        told[np.newaxis],
        turned(example.guide[whole], turns)[np.newaxis],
        np.zeros_like(example.prior) if without else example.prior,
        turned(example.levels[whole], turns),
    )


def _loss(
    network: VolumeNet, examples: Sequence[Example], seed: int, step: int, bf16: bool
) -> Tensor:
    *given, levels = draw(examples, seed, step)
    with torch.autocast("cpu", torch.bfloat16, enabled=bf16):
        logits, mask = network(*given)
    return loss_of(logits, mask, levels, DEPTHS, levels >= 0)


def error_of(network: VolumeNet, example: Example) -> float:
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
    answer = network(*(torch.from_numpy(each)[np.newaxis] for each in given))
    mean = mean_and_variance(answer[0], answer[1], DEPTHS)[0][0].numpy()
    truth = example.levels[:rows, :columns]
    return float(np.sqrt(np.square(mean - truth)[truth >= 0].mean()) / LAST_LEVEL)


#: How `volume-net` is trained.
VOLUME_NET = Course(
    method="volume-net",
    architecture={"levels": COUNT},
    recipe="of each camera by itself, fitted",
    rooms=ROOMS,
    of_rooms=room_examples,
    of_captures=examples_of,
    held_out=HELD_OUT,
    steps=12_000,
    crops=CROPS,
    crop=CROP,
    multiple=_MULTIPLE,
    shape_of=lambda example: example.levels.shape,
    loss=_loss,
    error=error_of,
)
