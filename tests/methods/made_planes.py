"""Fronto-parallel planes and slopes of made texture, as pairs to predict and to fit to."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.law import BlurLaw
from dfdbench.blur.occlusion import composite_layers, without_tails
from dfdbench.blur.recipe import RECIPES, BlurRecipe
from dfdbench.blur.synthesis import synthesize
from dfdbench.datasets.captures import Capture
from dfdbench.evaluation.check import made_pair
from dfdbench.methods.measured_law import Calibration

Image = NDArray[np.uint8]
PUBLISHED = RECIPES["published"]


def texture(seed: int, height: int = 64, width: int = 80) -> Image:
    """Return noise in which every octave has about the same contrast, as photographs have."""
    random = np.random.default_rng(seed)
    noise = random.standard_normal((height + 32, width + 32, 3)).astype(np.float32)
    blurs = [noise, *(cv2.GaussianBlur(noise, (0, 0), 2.0**octave) for octave in range(4))]
    bands = [(fine - coarse) / (fine - coarse).std() for fine, coarse in pairwise(blurs)]
    image = 120 + 18 * np.sum(bands, axis=0)[16:-16, 16:-16]
    return np.asarray(np.clip(np.rint(image), 0, 255), np.uint8)


def pair_of(infocus: Image, depth: Image, recipe: BlurRecipe = PUBLISHED) -> Capture:
    return made_pair(infocus, synthesize(infocus, depth, recipe), depth, np.ones(depth.shape, bool))


def with_defocus(pair: Capture, defocus: NDArray[Any]) -> Capture:
    """Return the pair with another defocus image."""
    return replace(pair, images=np.stack([pair.infocus, defocus.astype(np.uint8)]))


def plane(
    level: int, seed: int = 0, height: int = 64, width: int = 80, recipe: BlurRecipe = PUBLISHED
) -> Capture:
    infocus = texture(seed, height, width)
    return pair_of(infocus, np.full(infocus.shape[:2], level, np.uint8), recipe)


def slope(seed: int, height: int = 96, width: int = 256, recipe: BlurRecipe = PUBLISHED) -> Capture:
    """Return a pair whose depth rises by less than a level a pixel, over nearly all levels."""
    levels = np.linspace(4, 251, width).astype(np.uint8)
    depth = np.broadcast_to(levels, (height, width)).copy()
    return pair_of(texture(seed, height, width), depth, recipe)


def in_layers(
    sharp: Image, levels: NDArray[Any], focus: Sequence[float]
) -> tuple[list[BlurLaw], list[Image]]:
    """Return images focused at some levels, whose near surfaces cover the far, and their laws."""
    laws = [
        BlurLaw(tuple(0.1 + 0.02 * np.abs(np.arange(256) - at)), kernel_size=27, noise=(0.29,))
        for at in focus
    ]
    kernels = [without_tails(law.kernels()) for law in laws]
    images = [composite_layers(sharp.astype(float), levels, each) for each in kernels]
    return laws, [np.rint(image).astype(np.uint8) for image in images]


def unmeasured(laws: Sequence[BlurLaw]) -> tuple[Calibration, ...]:
    """Return laws as if fitted, without what they were measured from."""
    nothing = np.full(256, np.nan), np.zeros(256, np.int64), np.full(256, np.nan)
    return tuple(Calibration(law, *nothing) for law in laws)


def inside(depth: NDArray[Any], margin: int = 14) -> NDArray[Any]:
    """Cut off what the image's edge has blurred."""
    return depth[margin:-margin, margin:-margin]
