"""The rim of near surfaces, against a lens: the demo scenes' rays through many points of it."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, maximum_filter, minimum_filter
from scipy.stats import qmc

from dfdbench.blur.formation import encode
from dfdbench.blur.layers import GAP, composite_layers
from dfdbench.blur.synthesis import blur_by_level
from dfdbench.building.sources.demo_scenes import SCENES
from dfdbench.simulation.photographs import photograph
from dfdbench.simulation.raycast import View, cast, look

Floats = NDArray[np.float64]
SHAPE, FOCAL_LENGTH, LEVEL_AT_ONE_METRE = (240, 320), 330.0, 247.5
# The published recipe's disk: a radius of 0.0225 pixels a level, and level 255 in focus.
RADIUS_PER_LEVEL = 0.0225
FOCUS = LEVEL_AT_ONE_METRE / 255
LENS = RADIUS_PER_LEVEL * LEVEL_AT_ONE_METRE / FOCAL_LENGTH
BORDER = 12


def by_lens(scene: str, rays: int) -> Floats:
    """Return linear light: each ray a point of a round lens and a place in the pixel."""
    surfaces = SCENES[scene]
    photographs = {s.texture.photograph: photograph(s.texture.photograph) for s in surfaces}
    total = np.zeros((*SHAPE, 3))
    for area, angle, y, x in qmc.Sobol(4, seed=1).random(rays):
        radius, turn = LENS * area**0.5, 2 * np.pi * angle
        point = (radius * np.sin(turn), radius * np.cos(turn))
        place = (y - 0.5, x - 0.5)
        view = cast(surfaces, photographs, 0.0, SHAPE, FOCAL_LENGTH, place, point, FOCUS)
        total += lit(view)
    return total / rays


def lit(view: View) -> Floats:
    """Return the light of a lamp above the camera."""
    facing = np.maximum(view.normal @ np.array([0.0, -0.6, -0.8]), 0)
    return np.asarray(view.reflectance * (0.5 + 0.5 * facing)[..., np.newaxis])


def by_pinhole(scene: str) -> tuple[Floats, NDArray[np.intp]]:
    """Return linear light and depth levels of a scene."""
    surfaces = SCENES[scene]
    photographs = {s.texture.photograph: photograph(s.texture.photograph) for s in surfaces}
    view = look(surfaces, photographs, 0.0, SHAPE, FOCAL_LENGTH)
    return lit(view), np.rint(LEVEL_AT_ONE_METRE / view.distance).astype(np.intp)


def disks() -> Floats:
    """Return round kernels, their rims by the share of each pixel that lies inside."""
    fine = np.linspace(-7.5, 7.5, 15 * 15 + 1)[:-1] + 1 / 30
    distance = np.hypot(fine[:, np.newaxis], fine)
    kernels = np.empty((256, 15, 15))
    for level in range(256):
        inside = distance <= max(RADIUS_PER_LEVEL * (255 - level), 0.5)
        kernels[level] = inside.reshape(15, 15, 15, 15).mean(axis=(1, 3))
    return np.asarray(kernels / kernels.sum(axis=(1, 2), keepdims=True))


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["Market", "Kitchen", "Attic", "Library"])
def test_jumps_of_depth_look_as_a_lens_shows_them(scene: str) -> None:
    lens = by_lens(scene, 256)
    pinhole, levels = by_pinhole(scene)
    kernels = disks()
    layered = np.abs(encode(composite_layers(pinhole, levels, kernels)) - encode(lens))
    plain = np.abs(encode(blur_by_level(pinhole, levels, kernels)) - encode(lens))
    jumps = maximum_filter(levels, 3) - minimum_filter(levels, 3) > GAP
    near_jumps = binary_dilation(jumps, iterations=5)
    inner = np.s_[BORDER:-BORDER, BORDER:-BORDER]
    at, away = near_jumps[inner], ~near_jumps[inner]

    def rms(errors: Floats, where: NDArray[np.bool_]) -> float:
        return float(np.sqrt(np.mean(errors[inner][where] ** 2)))

    assert at.mean() > 0.05
    assert rms(layered, at) < 2.0
    assert rms(layered, at) < rms(plain, at)
    assert rms(layered, away) < 1.2
