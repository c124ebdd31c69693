"""Simulate the lens test of the thesis (7.2.1): a white dot, over temperature and voltage."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dfdbench.optics.lens_table import LensTable, read_lens_table
from dfdbench.simulation.captures import write_png
from dfdbench.simulation.photographs import near_normal_numbers

_SEED = 20190807
_SIZE = 96
_DOT = 5.0  # pixels: 5 mm across at 1 m
_DISTANCE = 1.0  # metres
_BLACK, _WHITE = 12.0, 230.0  # levels
_COLD, _WARM, _TEMPERATURES = 27.25, 54.75, 12  # °C
_STEP = 135
_LAG = 0.6  # voltage steps by which the lens trails on its way up and down
_COLD_BLUR = 1.5  # pixels more when cold
_COLD_NOISE, _WARM_NOISE = 0.6, 1.2  # levels


def write_lens_test(folder: Path) -> int:
    """Write a lens test's captures; return how many images that is.

    Parameters
    ----------
    folder : Path
        Gets ``temperature``, ``up`` and ``down``, as `dfdbench.optics.white_dot` reads them.
    """
    table = read_lens_table()
    images: dict[str, NDArray[np.uint8]] = {}
    radius = float(table.radius_at(_STEP, _DISTANCE))
    for number, degrees in enumerate(np.linspace(_COLD, _WARM, _TEMPERATURES)):
        cold = (_WARM - degrees) / (_WARM - _COLD)
        noise = _WARM_NOISE + cold * (_COLD_NOISE - _WARM_NOISE)
        name = f"temperature/image_{_STEP}_40.00_{degrees:.2f}.png"
        images[name] = _dot(radius + cold * _COLD_BLUR, noise, (_SEED, 0, number))
    for way, (direction, lag) in enumerate((("up", -_LAG), ("down", _LAG)), start=1):
        for step in table.steps:
            dot = _dot(_radius_between(table, step + lag), _WARM_NOISE, (_SEED, way, step))
            images[f"{direction}/image_{step}_30.00.png"] = dot
    for name, image in images.items():
        write_png(folder / name, image)
    return len(images)


def _radius_between(table: LensTable, step: float) -> float:
    radii = [float(table.radius_at(known, _DISTANCE)) for known in table.steps]
    return float(np.interp(step, table.steps, radii))


def _dot(blur: float, noise: float, seed: tuple[int, ...]) -> NDArray[np.uint8]:
    # A dot seen through a disc: its rim fades over the disc's width, and its middle with it.
    y, x = np.mgrid[:_SIZE, :_SIZE] - (_SIZE - 1) / 2
    share = np.clip((_DOT + blur - np.hypot(x, y)) / (2 * blur), 0, 1)
    share *= min(1.0, _DOT**2 / max(blur, 1e-9) ** 2)
    levels = _BLACK + (_WHITE - _BLACK) * share
    noisy = levels + noise * near_normal_numbers(levels.shape, seed)
    return np.asarray(np.clip(np.rint(noisy), 0, 255), np.uint8)
