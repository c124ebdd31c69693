"""Train ``volume-net`` on cost volumes of rendered rooms or of a data set's pairs.

Each camera that sees the rooms is drawn: some trace rays through a lens, some blur by a drawn law,
some take focal stacks. Each camera's blur is fitted to its own rooms, as for any other camera.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from dfdbench.blur.formation import form_pair
from dfdbench.blur.recipe import LAST_LEVEL, RECIPES
from dfdbench.blur.tracks import Degradation, Formation, Track
from dfdbench.datasets.captures import PAIR, Capture, ImageFacts, Role
from dfdbench.datasets.depth_scale import DepthScale
from dfdbench.datasets.manifest import Pair
from dfdbench.datasets.rendered import FAR, FIRST_TRAIN, NEAR, PUBLIC_TRAIN
from dfdbench.methods.calibration import calibrate_images
from dfdbench.methods.choices import energy_of, shares_of
from dfdbench.methods.method import TrainingPair
from dfdbench.methods.networks.volume import MOST, VolumeNet, mean_and_variance
from dfdbench.methods.stacks import sharp_and_blurred
from dfdbench.methods.volume_costs import along_paths, guide_of, halved_costs, levels_of
from dfdbench.system.parallel import OnDone
from dfdbench.training.cameras import MULTIPLE, Course, cut, kept_examples, loss_of, side_of, turned

Array = NDArray[Any]

#: The card's name for rendered rooms.
ROOMS = "rooms of unseen-0 from 1000 on, seen by random lenses"
#: Levels of the volumes.
COUNT = 32
#: The information of a pixel is stored in this many steps per nat.
TOLD_STEPS = 20
#: For each way to make images, the number of cameras and the rooms that each sees.
LENSES, MADE, STACKS = (32, 12), (72, 8), (8, 6)
#: Cameras that only test, in rooms that no training camera sees.
HELD_OUT = ("lens-03", "lens-08", "lens-14", "lens-19", "stack-02", "law-05", "law-13")
# Rays per pixel: the law is fitted to the noise that they leave.
_RAYS = 32
# Every n-th lens focuses far inside the room, so that two depths have the same blur; in metres.
_FAR_FOCUS, _FOCUS = 5, (1.0, 2.0)
# The number of the first camera; no scene's camera has these numbers.
_FIRST_LENS, _FIRST_LAW = 5000, 77
_PLANES = (5, 9, 3, 7)
_SCALE = DepthScale(near=NEAR, far=FAR)


class Example(NamedTuple):
    """One capture as the network sees it, and the truth.

    Parameters
    ----------
    roots : ndarray of uint8, shape (level, y / 2, x / 2)
        Roots of the costs, 255 for the largest.
    paths : ndarray of uint8, shape (level, y / 2, x / 2)
        Roots of the costs along paths.
    told : ndarray of uint8, shape (y / 2, x / 2)
        `TOLD_STEPS` times log(1 + the pixel's information).
    guide : ndarray of float16, shape (y, x)
    levels : ndarray of int16, shape (y, x)
        -1 if the depth is unknown.
    prior : ndarray of float32, shape (level,)
        From the other captures of the same camera.
    """

    roots: NDArray[np.uint8]
    paths: NDArray[np.uint8]
    told: NDArray[np.uint8]
    guide: NDArray[np.float16]
    levels: NDArray[np.int16]
    prior: NDArray[np.float32]


def nats_of(roots: Array) -> NDArray[np.float32]:
    """Return the costs whose roots an example keeps."""
    return np.asarray(np.square(roots * np.float32(MOST**0.5 / 255)), np.float32)


def roots_of(nats: Array) -> NDArray[np.uint8]:
    """Return the roots of costs, as an example keeps them."""
    return np.asarray(np.rint(np.sqrt(nats) * (255 / MOST**0.5)), np.uint8)


def examples_of(captures: Sequence[TrainingPair]) -> list[Example]:
    """Fit one camera's blur to its captures, and return each as an example.

    Raises
    ------
    MethodError
        If the blur cannot be fitted to them.
    """
    found = calibrate_images(captures)
    laws, changes = [each.law for each in found], [each.change for each in found]
    shares = np.stack([shares_of(capture) for capture in captures])
    examples = []
    for number, capture in enumerate(captures):
        sharp, blurred = sharp_and_blurred(capture.stack, changes)
        volume, told = halved_costs(laws, sharp, blurred, COUNT)
        others = np.delete(shares, number, axis=0) if len(shares) > 1 else shares
        costs = roots_of(volume), roots_of(along_paths(volume))
        steps = np.rint(np.minimum(TOLD_STEPS * np.log1p(told), 255)).astype(np.uint8)
        guide = guide_of(sharp).astype(np.float16)
        levels = np.where(capture.valid, capture.levels.astype(np.int16), np.int16(-1))
        prior = -energy_of(others)[levels_of(COUNT)].astype(np.float32)
        examples.append(Example(*costs, steps, guide, levels, prior))
    return examples


def room_examples(folder: Path, on_camera: OnDone | None = None) -> dict[str, Sequence[Example]]:
    """Return examples of rendered rooms by camera; those already in the folder are reused.

    Parameters
    ----------
    folder : Path
        The folder of each camera's examples.
    on_camera : callable, optional
        Called with (cameras done, total cameras).
    """
    kinds: list[tuple[str, Callable[[int], list[Capture]], int]] = [
        ("lens", _through_lens, LENSES[0]),
        ("stack", _stacks, STACKS[0]),
        ("law", partial(_by_law, folder), MADE[0]),
    ]
    makers = {
        f"{kind}-{number:02}": partial(_arrays, make, number)
        for kind, make, count in kinds
        for number in range(count)
    }
    return kept_examples(folder, makers, _examples, on_camera)


def _through_lens(number: int) -> list[Capture]:
    from dfdbench.simulation.unseen import draw_camera, render_pair  # they compile

    camera = draw_camera(0, _FIRST_LENS + number)
    if number % _FAR_FOCUS == _FAR_FOCUS - 1:
        distance = round(float(np.random.default_rng(number).uniform(*_FOCUS)), 3)
        camera = replace(camera, lens=replace(camera.lens, focus_distance=distance))
    captures = []
    for room in rooms_of("lens", number, LENSES[1]):
        pair = render_pair(0, room, camera, _RAYS)
        captures.append(_capture([*pair.images], _SCALE.to_levels(pair.depth)))
    return captures


def _stacks(number: int) -> list[Capture]:
    from dfdbench.simulation.unseen import render_stack

    captures = []
    for room in rooms_of("stack", number, STACKS[1]):
        stack = render_stack(number + 1, room, _PLANES[number % len(_PLANES)], rays=_RAYS)
        focus = [np.nan, *stack.focus_distances]
        captures.append(_capture([*stack.images], _SCALE.to_levels(stack.depth), focus))
    return captures


def rooms_of(kind: str, number: int, count: int) -> list[int]:
    """Return the rooms that a camera sees, by its kind and its number.

    Examples
    --------
    >>> rooms_of("lens", 2, 3), rooms_of("lens", 3, 3)
    ([1006, 1007, 1008], [1209, 1210, 1211])
    """
    first = FIRST_TRAIN + (PUBLIC_TRAIN if _only_tests(kind, number) else 0)
    return [first + (number * count + place) % PUBLIC_TRAIN for place in range(count)]


def sources_of(law: int) -> list[tuple[int, int]]:
    """Return what a law blurs: the numbers of lenses, and the indices of their rooms."""
    tests = _only_tests("law", law)
    lenses = [lens for lens in range(LENSES[0]) if _only_tests("lens", lens) == tests]
    places = (law * MADE[1] * 3 + place * 11 + law for place in range(MADE[1]))
    return [(lenses[at // LENSES[1] % len(lenses)], at % LENSES[1]) for at in places]


def _only_tests(kind: str, number: int) -> bool:
    return f"{kind}-{number:02}" in HELD_OUT


def _by_law(folder: Path, number: int) -> list[Capture]:
    """Blur in-focus photographs of the lenses' rooms by a drawn law, at stretched depths."""
    random = np.random.default_rng(_FIRST_LAW + number)
    how = Degradation(Track("random", 1, "", ("",), (_drawn(random),)), 1)
    captures = []
    for place, (camera, room) in enumerate(sources_of(number)):
        with np.load(folder / f"lens-{camera:02}.npz") as lens:
            infocus, levels = lens["infocus"][room], lens["depth"][room].astype(float)
        low = random.uniform(1, 90)
        high = random.uniform(max(low + 80, 150), 255)
        share = (levels - levels.min()) / np.ptp(levels)
        depth = np.rint(low + share * (high - low)).astype(np.uint8)
        if random.random() < 0.5:  # in steps, as in disparities
            step = random.integers(1, 4)
            depth = np.maximum(depth // step * step, 1).astype(np.uint8)
        name = f"training/{number}/{place}"
        captures.append(_capture(form_pair(infocus, depth, RECIPES["published"], how, name), depth))
    return captures


def _drawn(random: np.random.Generator) -> Formation:
    """Draw how images are formed; half of the time a camera with linear light and noise."""
    camera = random.random() < 0.5
    formation = Formation(
        sigma_min=float(random.uniform(0.8, 1.3)),
        sigma_step=float(np.exp(random.uniform(np.log(0.6), np.log(1.8)))),
        exponent=float(random.choice([8, 32] if camera else [2, 2, 3, 4, 8, 32])),
        layers=bool(random.random() < 0.7) or camera,
        shift=float(random.choice([0, 0, 0, 0.25, 0.5, 1.0])),
        gain=float(random.choice([0, 0, 0, 0.02, 0.05, 0.1])),
        noise=0.0 if camera else float(random.choice([0, 0, 1, 2, 3, 5, 8])),
        linear=camera,
        read_noise=float(np.exp(random.uniform(np.log(0.0007), np.log(0.012)))) if camera else 0.0,
        magnification=float(random.choice([0, 0, 0, 0.002, 0.006, 0.012])),
        lateral=float(random.choice([0, 0, 0.0004, 0.0008, 0.0016])),
        longitudinal=float(random.choice([0, 0, 4.0, 8.0, 16.0])),
    )
    if camera:
        formation = replace(formation, full_well=10 / formation.read_noise)
        if random.random() < 0.4:
            falloffs = ((0.0169, 0.0831), (0.0411, 0.1589), (0.2271, 0.1229))
            formation = replace(formation, falloff=falloffs[int(random.integers(3))])
    return formation


def _capture(images: Sequence[Array], levels: Array, focus: Sequence[float] = ()) -> Capture:
    roles: tuple[Role, ...] = ("infocus", *(PAIR[1] for _ in images[1:]))
    facts = ImageFacts(roles, focus_depth=np.array(focus)) if focus else ImageFacts(roles)
    return Capture(Pair("room", ()), np.stack(images), levels.astype(np.float32), facts)


def _arrays(make: Callable[[int], list[Capture]], number: int) -> dict[str, Array]:
    captures = make(number)
    columns = map(np.stack, zip(*examples_of(captures), strict=True))
    arrays = dict(zip(Example._fields, columns, strict=True))
    infocus = np.stack([capture.infocus for capture in captures])
    return {**arrays, "infocus": infocus, "depth": np.stack([each.levels for each in captures])}


def _examples(arrays: Mapping[str, Array]) -> list[Example]:
    columns = (arrays[name] for name in Example._fields)
    return [Example(*row) for row in zip(*columns, strict=True)]


#: Crops per step, and their rows and columns.
CROPS, CROP = 3, 320
#: The depths of the network's levels.
DEPTHS = torch.from_numpy(levels_of(COUNT) - 0.5).float()
# Real noise differs from the law's, so costs are scaled at random, up to this on a log scale.
_STRETCH = 0.5
# This share of crops has no prior.
_WITHOUT = 0.15


def draw(examples: Sequence[Example], seed: int, step: int) -> list[Tensor]:
    """Return the crops of a step, which depend only on the seed and the step.

    Returns
    -------
    list of Tensor
        The network's inputs, and levels of float32, shape (n, y, x), -1 if unknown.
    """
    random = np.random.default_rng((seed, step))
    side = side_of((example.levels.shape for example in examples), CROP)
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
    guide, levels = (turned(each[whole], turns) for each in (example.guide, example.levels))
    prior = np.zeros_like(example.prior) if without else example.prior
    return volume, paths, told[np.newaxis], guide[np.newaxis], prior, levels


def _loss(
    network: VolumeNet, examples: Sequence[Example], seed: int, step: int, bf16: bool
) -> Tensor:
    *given, levels = draw(examples, seed, step)
    with torch.autocast("cpu", torch.bfloat16, enabled=bf16):
        logits, mask = network(*given)
    return loss_of(logits, mask, levels, DEPTHS, levels >= 0)


def error_of(network: VolumeNet, example: Example) -> float:
    """Return the root mean square error over the known pixels, as a fraction of the scale."""
    rows, columns = (size // MULTIPLE * MULTIPLE for size in example.levels.shape)
    half = np.s_[..., : rows // 2, : columns // 2]
    costs = nats_of(example.roots[half]), nats_of(example.paths[half])
    told = example.told[half][np.newaxis] / np.float32(TOLD_STEPS)
    guide = example.guide[np.newaxis, :rows, :columns].astype(np.float32)
    given = (*costs, told, guide, example.prior)
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
    shape_of=lambda example: example.levels.shape,
    loss=_loss,
    error=error_of,
)
