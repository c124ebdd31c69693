"""Focal stacks made with SciPy alone, and the photographed one among the shared data."""

import json
from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from xarray import DataArray

from tests.methods.made_planes import texture

Array = NDArray[Any]


def stack_of(
    images: Sequence[Array],
    focus: Sequence[float],
    infocus: Array | None = None,
    unit: str = "levels",
    ends: tuple[float, float] = (255.0, 0.0),
) -> DataArray:
    """Put images with their focus depths into a stack, first the one in focus all over."""
    count = 0 if infocus is None else 1
    roles = ["infocus"] * count + ["defocus"] * len(focus)
    values = np.stack([*([] if infocus is None else [infocus]), *images])
    unknown = ("image", np.full(len(values), np.nan))
    coordinates: dict[str, Any] = {"role": ("image", roles), "focus_distance": unknown}
    coordinates |= {"focus_depth": ("image", [np.nan] * count + list(focus)), "f_number": unknown}
    attributes = {"unit": unit, "near": ends[0], "far": ends[1]}
    return DataArray(values, coordinates, ("image", "y", "x", "channel"), attrs=attributes)


def blurred_to(sharp: Array, places: Array, focus: float, slope: float) -> Array:
    """Blur each pixel by a Gaussian whose sigma grows with its distance from the focus.

    Each distinct place is blurred by itself, so that none is wider than its own.
    """
    out = np.empty(sharp.shape)
    for place in np.unique(places):
        sigma, there = slope * abs(float(place) - focus), places == place
        # As far around the pixels as the filter sees.
        reach = int(4 * sigma + 1)
        rows, columns = (np.flatnonzero(there.any(axis)) for axis in (1, 0))
        part = tuple(slice(max(0, at[0] - reach), at[-1] + reach + 1) for at in (rows, columns))
        whole = gaussian_filter(sharp[part].astype(np.float64), (sigma, sigma, 0), mode="nearest")
        out[there] = whole[there[part]]
    return np.rint(out).astype(np.uint8)


def wall(
    place: float, focus: Iterable[float], slope: float, shape: tuple[int, int] = (64, 80)
) -> list[Array]:
    """Return an image for each focus of a wall at a place."""
    sharp, places = texture(3, *shape), np.full(shape, place)
    return [blurred_to(sharp, places, at, slope) for at in focus]


def made_capture(
    seed: int = 0, focus: Sequence[float] = (30, 90, 150, 210), with_infocus: bool = True
) -> Any:
    """Return a capture whose depth rises from left to right, by less than a level a pixel."""
    sharp, levels = _made_slope(seed)
    images = [_made_image(seed, plane).copy() for plane in focus]
    return SimpleNamespace(
        stack=stack_of(images, focus, sharp if with_infocus else None),
        infocus=sharp,
        defocus=images[0],
        depth=levels,
        levels=levels,
        valid=np.ones(levels.shape, bool),
    )


def _made_slope(seed: int) -> tuple[Array, Array]:
    shape = (80, 256)
    levels = np.linspace(20, 235, shape[1]).astype(np.uint8)
    return texture(seed, *shape), np.broadcast_to(levels, shape).copy()


@cache
def _made_image(seed: int, plane: float) -> Array:
    return blurred_to(*_made_slope(seed), plane, 0.03)


def antinous(folder: Path) -> tuple[DataArray, Array]:
    """Read the shared stack: 11 images, in disparity, greater is nearer; and the truth."""
    focus = json.loads((folder / "focus.json").read_text())["focus_disparity_px_per_view"]
    images = [cv2.imread(str(folder / f"focus_{number:02}.png")) for number in range(len(focus))]
    truth = np.load(folder / "disparity.npy")
    ends = (float(truth.max()), float(truth.min()))
    colours = [image[..., ::-1] for image in images if image is not None]
    return stack_of(colours, focus, ends=ends), truth
