"""Cast rays at textured planes, spheres and cylinders: just enough for a small scene."""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Texture:
    """A surface's photograph, its scale and tint.

    `texels` are photograph pixels per metre; `tint` multiplies red, green and blue.
    """

    photograph: str
    texels: float
    tint: tuple[float, float, float] = (1.0, 1.0, 1.0)


@dataclass(frozen=True)
class Hits:
    """Where rays meet one surface: distance (infinite for a miss), normal, texture place."""

    distance: Floats
    normal: Floats
    place: Floats


@dataclass(frozen=True)
class Board:
    """A flat rectangle or disc.

    Parameters
    ----------
    centre : tuple of float
        x (right), y (down), z (away from the camera), in metres.
    size : tuple of float
        Width and height, in metres.
    texture : Texture
        Its texture.
    slant, tilt : float
        dz/dx and dz/dy: how the surface recedes to the right and downwards.
    shape : {"rectangle", "disc"}
        A disc has the axes of the rectangle around it.
    """

    centre: tuple[float, float, float]
    size: tuple[float, float]
    texture: Texture
    slant: float = 0.0
    tilt: float = 0.0
    shape: Literal["rectangle", "disc"] = "rectangle"

    def meet(self, origin: Floats, directions: Floats) -> Hits:
        """Return where rays from `origin` along `directions`, shape (..., 3), meet it.

        The surface is ``z = z0 + slant (x - x0) + tilt (y - y0)`` inside the outline.
        """
        x0, y0, z0 = self.centre
        normal = np.array([self.slant, self.tilt, -1.0])
        reach = np.array([x0, y0, z0]) - origin
        falling = dot(directions, normal)
        distance = np.where(falling < 0, float(reach @ normal) / np.minimum(falling, -1e-12), -1.0)
        u = origin[0] + distance * directions[..., 0] - x0
        v = origin[1] + distance * directions[..., 1] - y0
        across, down = 2 * u / self.size[0], 2 * v / self.size[1]
        if self.shape == "disc":
            inside = across * across + down * down <= 1
        else:
            inside = (np.abs(across) <= 1) & (np.abs(down) <= 1)
        return Hits(
            np.where(inside & (distance > 0), distance, np.inf),
            np.broadcast_to(normal / np.sqrt(normal @ normal), directions.shape),
            np.stack([u, v], axis=-1),
        )


@dataclass(frozen=True)
class Floor:
    """A horizontal plane below the camera; `height` is its y, counted downwards, in metres."""

    height: float
    texture: Texture

    def meet(self, origin: Floats, directions: Floats) -> Hits:
        """Return where rays meet ``y = height`` ahead of the camera."""
        down = directions[..., 1]
        below = self.height - origin[1]
        distance = np.where(down > 1e-6, below / np.maximum(down, 1e-6), np.inf)
        reach = np.where(np.isfinite(distance), distance, 0.0)
        place = np.stack([origin[0] + reach * directions[..., 0], reach], axis=-1)
        return Hits(distance, np.broadcast_to([0.0, -1.0, 0.0], directions.shape), place)


@dataclass(frozen=True)
class Ball:
    """A sphere or, with `upright`, a vertical cylinder of that half height, in metres."""

    centre: tuple[float, float, float]
    radius: float
    texture: Texture
    upright: float | None = None

    def meet(self, origin: Floats, directions: Floats) -> Hits:
        """Return where rays meet the near side."""
        axes = np.array([1.0, 0.0 if self.upright else 1.0, 1.0])
        reach = origin - np.array(self.centre)
        a = dot(directions, directions * axes)
        b = dot(directions, reach * axes)
        c = float(reach @ (reach * axes)) - self.radius**2
        root = b * b - a * c
        distance = np.where(root >= 0, (-b - np.sqrt(np.maximum(root, 0))) / a, -1.0)
        offset = reach + distance[..., np.newaxis] * directions
        inside = (root >= 0) & (distance > 0)
        if self.upright:
            inside &= np.abs(offset[..., 1]) <= self.upright
        normal = offset * axes / self.radius
        turn = np.arctan2(normal[..., 0], -normal[..., 2]) * self.radius
        return Hits(
            np.where(inside, distance, np.inf), normal, np.stack([turn, offset[..., 1]], axis=-1)
        )


#: Something that rays can meet.
Surface = Board | Floor | Ball
_KINDS = {"board": Board, "floor": Floor, "ball": Ball}


def read_scenes(text: str) -> dict[str, tuple[Surface, ...]]:
    """Return the surfaces of scenes by name, from TOML such as the demo set's."""
    content = tomllib.loads(text)
    textures = {name: Texture(**fields_of(each)) for name, each in content["textures"].items()}
    scenes: dict[str, tuple[Surface, ...]] = {}
    for name, surfaces in content["scenes"].items():
        made = [fields_of(each) | {"texture": textures[each["texture"]]} for each in surfaces]
        scenes[name] = tuple(_KINDS[fields.pop("kind")](**fields) for fields in made)
    return scenes


def fields_of(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of a texture or surface from TOML, with lists converted to tuples."""
    return {key: tuple(v) if isinstance(v, list) else v for key, v in given.items()}


@dataclass(frozen=True)
class View:
    """What a camera sees: the distance z, the surface's normal, and its reflectance.

    `distance` has shape (y, x) and is infinite without a surface; `normal` and `reflectance` have
    shape (y, x, 3). Reflectance is linear, 0 to 1.
    """

    distance: Floats
    normal: Floats
    reflectance: Floats


@dataclass(frozen=True)
class Trace(Hits):
    """Where rays meet the nearest surface, and that surface's number or -1."""

    number: NDArray[np.int64]


def look(
    surfaces: Sequence[Surface],
    photographs: Mapping[str, Floats],
    offset: float,
    shape: tuple[int, int],
    focal_length: float,
) -> View:
    """Return what a camera at ``(offset, 0, 0)``, looking along z, sees through a pinhole.

    Distance and normal are those of each pixel's centre; colour is the mean of four rays.

    Parameters
    ----------
    surfaces : sequence of Surface
        The scene; a ray sees the nearest surface.
    photographs : mapping of str to ndarray, shape (y, x, 3)
        Linear reflectance of each texture's photograph.
    offset : float
        The camera's x in metres.
    shape : tuple of int
        Height and width in pixels.
    focal_length : float
        In pixels.
    """
    origin, rays = np.array([offset, 0.0, 0.0]), partial(directions, shape, focal_length)
    centre = trace(surfaces, origin, rays(0.0, 0.0))
    a, b, c, d = (
        reflectance(surfaces, photographs, trace(surfaces, origin, rays(y, x)))
        for y in (-0.25, 0.25)
        for x in (-0.25, 0.25)
    )
    return View(centre.distance, centre.normal, (a + b + c + d) / 4)


def directions(shape: tuple[int, int], focal_length: float, down: float, right: float) -> Floats:
    """Return the directions of a pinhole's rays, shape (y, x, 3), per unit of z.

    `down` and `right` are their offsets from the middle of the pixels, in pixels.
    """
    height, width = shape
    rays = np.ones((height, width, 3))
    rays[..., 0] = (np.arange(width) - (width - 1) / 2 + right) / focal_length
    rays[..., 1] = ((np.arange(height) - (height - 1) / 2 + down) / focal_length)[:, np.newaxis]
    return rays


def trace(surfaces: Sequence[Surface], origin: Floats, directions: Floats) -> Trace:
    """Return what rays from `origin` along `directions`, shape (y, x, 3), meet first."""
    shape = directions.shape[:2]
    far, nothing = np.full(shape, np.inf), np.full(shape, -1)
    found = Trace(far, np.zeros((*shape, 3)), np.zeros((*shape, 2)), nothing)
    for number, surface in enumerate(surfaces):
        hits = surface.meet(origin, directions)
        ahead = hits.distance < found.distance
        found.distance[ahead] = hits.distance[ahead]
        found.normal[ahead] = hits.normal[ahead]
        found.place[ahead] = hits.place[ahead]
        found.number[ahead] = number
    return found


def reflectance(
    surfaces: Sequence[Surface], photographs: Mapping[str, Floats], trace: Trace
) -> Floats:
    """Return the colour of what rays met, shape (y, x, 3), computing only visible surfaces.

    All arguments are as in `look` and `trace`.
    """
    colour = np.zeros(trace.normal.shape)
    for number, surface in enumerate(surfaces):
        here = trace.number == number
        texture = surface.texture
        seen = _sample(photographs[texture.photograph], trace.place[here] * texture.texels)
        colour[here] = seen * np.array(texture.tint)
    return colour


def dot(left: Floats, right: Floats) -> Floats:
    """Return the dot products over the last axis, which has length three."""
    # Written out, because BLAS may sum in another order on another machine.
    return np.asarray(
        left[..., 0] * right[..., 0] + left[..., 1] * right[..., 1] + left[..., 2] * right[..., 2]
    )


def _sample(photograph: Floats, place: Floats) -> Floats:
    # Bilinear; beyond its edge the photograph is mirrored, without a seam.
    height, width = photograph.shape[:2]
    x, x_fraction = _mirrored(place[:, 0] + width / 2, width)
    y, y_fraction = _mirrored(place[:, 1] + height / 2, height)
    right, below = np.minimum(x + 1, width - 1), np.minimum(y + 1, height - 1)
    top = photograph[y, x] * (1 - x_fraction) + photograph[y, right] * x_fraction
    bottom = photograph[below, x] * (1 - x_fraction) + photograph[below, right] * x_fraction
    return np.asarray(top * (1 - y_fraction) + bottom * y_fraction)


def _mirrored(position: Floats, extent: int) -> tuple[NDArray[np.int64], Floats]:
    last = extent - 1
    folded = np.abs((position + last) % (2 * last) - last)
    whole = np.minimum(folded.astype(np.int64), last)
    return whole, (folded - whole)[:, np.newaxis]
