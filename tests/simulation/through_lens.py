"""Demo scenes through many points of a lens, ray by ray: no tiles, no pyramid, nothing compiled."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from dfdbench.building.sources.demo import SCENES
from dfdbench.simulation.photographs import photograph
from dfdbench.simulation.raycast import Surface, View, directions, reflectance, trace

Floats = NDArray[np.float64]


def demo_scene(name: str) -> tuple[tuple[Surface, ...], dict[str, Floats]]:
    """Return a scene's surfaces, and the photographs on them."""
    surfaces = SCENES[name]
    return surfaces, {s.texture.photograph: photograph(s.texture.photograph) for s in surfaces}


def through_lens(
    name: str,
    shape: tuple[int, int],
    focal: float,
    radius: float,
    focus: float,
    light: Callable[[View], Floats],
) -> Floats:
    """Return the mean light of 256 views: each a point of a round lens and a place in the pixel."""
    surfaces, photographs = demo_scene(name)
    total = np.zeros((*shape, 3))
    for area, angle, y, x in qmc.Sobol(4, seed=1).random(256):
        turn = 2 * np.pi * angle
        point = radius * area**0.5 * np.array([np.cos(turn), np.sin(turn), 0])
        ways = directions(shape, focal, y - 0.5, x - 0.5) - point / focus
        met = trace(surfaces, point, ways)
        total += light(View(met.distance, met.normal, reflectance(surfaces, photographs, met)))
    return total / 256
