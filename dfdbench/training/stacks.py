"""Train ``stack-net`` on focal stacks of any length, rendered or from a data set."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from dfdbench.blur.recipe import LAST_LEVEL
from dfdbench.datasets.captures import Capture, eight_bits
from dfdbench.datasets.rendered import FIRST_TRAIN
from dfdbench.methods.networks.stack import StackNet, places_of
from dfdbench.methods.networks.volume import mean_and_variance
from dfdbench.methods.shape_from_focus import focus_places
from dfdbench.methods.stack_net import greys_of
from dfdbench.system.parallel import OnDone
from dfdbench.training.cameras import MULTIPLE, Course, cut, kept_examples, loss_of, side_of, turned

#: The card's name for rendered stacks.
STACKS = "rooms of unseen-0 from 1000 on, focused through random lenses"
#: How many cameras there are, each with a room of its own; every EVERY-th only tests.
CAMERAS, EVERY = 27, 8
# Photographs per stack, rays per pixel, and the size, at most 480 x 640, because rays take time.
_PLANES, _RAYS, _SHAPE = 10, 32, (288, 384)
# The number of the first camera; no scene's camera has these numbers.
_FIRST = 7000
# The ranges of the nearest and the farthest focus in dioptres, how far a distance may deviate from
# even spacing, in steps, the factor of the drawn f-number, and the share of the view that is seen.
_NEAR, _FAR, _JITTER, _STOPS, _VIEW = (1.1, 1.9), (0.1, 0.5), 0.3, (0.5, 1.2), (0.6, 1.0)
# This many of five cameras have no colour error: three colours take three times as long.
_PLAIN = 4


@dataclass(frozen=True)
class Stack:
    """One stack as the network sees it, and the truth.

    Parameters
    ----------
    images : ndarray of uint8, shape (image, y, x, 3)
    places : ndarray of float32, shape (image,)
        Each image's focus, rising, on a scale on which blur grows evenly.
    truth : ndarray of float32, shape (y, x)
        Depth on that scale; NaN if unknown.
    """

    images: NDArray[np.uint8]
    places: NDArray[np.float32]
    truth: NDArray[np.float32]


def room_stacks(folder: Path, on_camera: OnDone | None = None) -> dict[str, Sequence[Stack]]:
    """Return stacks of rendered rooms by camera; those already in the folder are reused.

    Parameters
    ----------
    folder : Path
        The folder of the stacks.
    on_camera : callable, optional
        Called with (cameras done, total cameras).
    """
    names = {f"stack-{number:02}": partial(_rendered, number) for number in range(CAMERAS)}
    return kept_examples(folder, names, lambda arrays: [Stack(**arrays)], on_camera)


def stack_of(capture: Capture) -> Stack:
    """Return a capture as the network sees it.

    Raises
    ------
    MethodError
        If it is not a stack of at least three images with known focus.
    """
    places, where = focus_places(capture.stack, "stack-net")
    truth = 1 / capture.depth if capture.about.kind == "metres" else capture.depth
    images = eight_bits(capture.images[where])
    return Stack(images, places.astype(np.float32), truth.astype(np.float32))


def _rendered(number: int) -> dict[str, NDArray[Any]]:
    from dfdbench.simulation.unseen import draw_camera, render_stack  # they compile

    random = np.random.default_rng(number)
    camera = draw_camera(0, _FIRST + number)
    lens, wider = camera.lens, random.uniform(*_VIEW) * camera.shape[1] / _SHAPE[1]
    f_number = round(lens.f_number * random.uniform(*_STOPS), 3)
    lens = replace(lens, f_number=f_number, pixel_size=lens.pixel_size * wider)
    camera = replace(camera, lens=lens, shape=_SHAPE)
    if number % (_PLAIN + 1):
        camera = replace(camera, lateral=(0.0, 0.0, 0.0), longitudinal=(0.0, 0.0, 0.0))
    near, far = random.uniform(*_NEAR), random.uniform(*_FAR)
    places = np.linspace(far, near, _PLANES)
    places[1:-1] += random.uniform(-_JITTER, _JITTER, _PLANES - 2) * (near - far) / (_PLANES - 1)
    stack = render_stack(0, FIRST_TRAIN + number, (1 / places[::-1]).tolist(), _RAYS, 1, camera)
    found = 1 / np.array(stack.focus_distances[::-1])
    truth = 1 / stack.depth.astype(np.float64)
    places, depths = found.astype(np.float32), truth.astype(np.float32)
    return {"images": stack.images[:0:-1], "places": places, "truth": depths}


#: Crops per step, their rows and columns, and the fewest images.
CROPS, CROP, FEWEST = 4, 160, 3
#: Cameras that only test, by name.
HELD_OUT = tuple(f"stack-{number:02}" for number in range(EVERY - 1, CAMERAS, EVERY))
# The spread of an image's light, as between exposures; the most noise, relative to the images'
# mean.
_GAIN, _NOISE = 0.02, 0.06


def draw(stacks: Sequence[Stack], seed: int, step: int) -> list[Tensor]:
    """Return the crops of a step, which depend only on the seed and the step.

    Returns
    -------
    images : Tensor, shape (n, image, y, x)
    focus : Tensor, shape (n, image)
        From 0 to 255.
    truth : Tensor, shape (n, y, x)
        On the same scale; NaN if unknown.
    """
    random = np.random.default_rng((seed, step))
    chosen = [stacks[int(random.integers(len(stacks)))] for _ in range(CROPS)]
    most = min(len(stack.images) for stack in chosen)
    count = int(random.integers(min(FEWEST, most), most + 1))
    side = side_of((stack.truth.shape for stack in stacks), CROP)
    columns = zip(*(_crop(stack, count, side, random) for stack in chosen), strict=True)
    return [torch.from_numpy(np.stack(column)) for column in columns]


def _crop(
    stack: Stack, count: int, side: int, random: np.random.Generator
) -> tuple[NDArray[Any], ...]:
    there = len(stack.images)
    if random.random() < 0.5:  # evenly spaced, as in most stacks
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
    """Rescale places and truth so that the places go from 0 to 255."""
    factor = np.float32(LAST_LEVEL / np.ptp(places))
    return (places - places[0]) * factor, (truth - places[0]) * factor


def _loss(network: StackNet, stacks: Sequence[Stack], seed: int, step: int, bf16: bool) -> Tensor:
    images, focus, truth = draw(stacks, seed, step)
    with torch.autocast("cpu", torch.bfloat16, enabled=bf16):
        logits, mask = network(images, focus)
    depths, known = places_of(focus), truth.isfinite()
    # The best answer for a truth beyond all places is the outermost place.
    told = truth.nan_to_num(0).clamp(depths[:, :1, None], depths[:, -1:, None])
    return loss_of(logits, mask, told, depths, known)


def error_of(network: StackNet, stack: Stack) -> float:
    """Return the root mean square error over the known pixels, as a fraction of the focus range."""
    rows, columns = (size // MULTIPLE * MULTIPLE for size in stack.truth.shape)
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
    shape_of=lambda stack: stack.truth.shape,
    loss=_loss,
    error=error_of,
)
