"""Work out once how much light falls on each surface of a scene: lamps, shadows, daylight."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dfdbench.simulation import tracing
from dfdbench.simulation.shapes import Scene, Vector, spans

Floats = NDArray[np.float64]

_LAMP_POINTS = 24
_SKY_RAYS = 48
_FEWEST, _MOST = 3, 160  # steps along a surface's side
_FINE = 2.0**26  # places are whole parts of a metre of this: sines may differ in their last bit
_SHADE_SPACING = 0.02  # metres
_LIGHT_FINE = 2.0**14
_MARGIN = 0.3  # metres past what is seen
_GOLDEN = (math.sqrt(5) - 1) / 2


@dataclass(frozen=True)
class Lamp:
    """A ball that shines.

    Parameters
    ----------
    place : tuple of float
        In metres.
    radius : float
        In metres: the larger, the softer the shadows.
    strength : float
        Light on a surface that faces it from a metre away.
    """

    place: Vector
    radius: float
    strength: float


@dataclass(frozen=True)
class Light:
    """All the light of a scene.

    Parameters
    ----------
    lamps : sequence of Lamp
        Each casts shadows.
    ambient : float
        Light on a surface that nothing stands near.
    reach : float
        In metres: what is nearer than this keeps ambient light away.
    """

    lamps: Sequence[Lamp]
    ambient: float
    reach: float = 1.0


def lit(scene: Scene, light: Light, slope: tuple[float, float], spacing: float = 0.05) -> Scene:
    """Return a scene with the light that falls on its surfaces, on the side that is seen.

    Parameters
    ----------
    scene : Scene
        From `dfdbench.simulation.shapes.pack`.
    light : Light
        The lamps and the daylight.
    slope : tuple of float
        The largest x / z and y / z that are seen; elsewhere the light is not worked out.
    spacing : float
        Distance of the places at which light is worked out, in metres; in between it is
        interpolated.

    Notes
    -----
    Lambert's law: a lamp's light is its strength times the cosine of its angle over the square of
    its distance, times the share of its points that are not hidden. Ambient light is that of an
    even sky, less most of the share that is hidden within `Light.reach`. No light is reflected.
    """
    charts, points, facing = _places(scene, spacing)
    beyond = np.abs(points[:, :2]) - points[:, 2:] * np.array(slope)
    seen = (beyond.max(axis=1) < _MARGIN) & (points[:, 2] > -_MARGIN)
    out = np.zeros(int(seen.sum()))
    tracing.fall(
        scene.kinds,
        scene.rows,
        _balls_around(scene),
        points[seen],
        facing[seen],
        np.array([(*lamp.place, lamp.radius, lamp.strength) for lamp in light.lamps]).reshape(
            -1, 5
        ),
        _ball_points(_LAMP_POINTS),
        light.ambient,
        light.reach,
        _sky(_SKY_RAYS),
        out,
    )
    lightmap = np.full(len(points), light.ambient, np.float32)
    lightmap[seen] = np.rint(out * _LIGHT_FINE) / _LIGHT_FINE
    return scene._replace(charts=charts, lightmap=lightmap)


def shaded(scene: Scene, direction: Vector, ambient: float) -> Scene:
    """Return a scene shaded by a lamp infinitely far away, without shadows, as the demo scenes are.

    Parameters
    ----------
    scene : Scene
        From `dfdbench.simulation.shapes.pack`.
    direction : tuple of float
        Where the light comes from, a unit vector.
    ambient : float
        Share of the light that falls everywhere alike.
    """
    charts, _, normals = _places(scene, _SHADE_SPACING)
    facing = sum(normals[:, axis] * direction[axis] for axis in range(3))
    light = ambient + (1 - ambient) * np.maximum(facing, 0)
    return scene._replace(charts=charts, lightmap=light.astype(np.float32))


def _places(scene: Scene, spacing: float) -> tuple[Floats, Floats, Floats]:
    """Return each surface's chart, and all places and normals that they consist of."""
    charts, places, normals = [], [], []
    first = 0
    for surface in range(len(scene.kinds)):
        (height, width), half, points, normal = _nodes(scene, surface, spacing)
        charts.append((first, width, height, *half))
        places.append(points)
        normals.append(normal)
        first += width * height
    points = np.rint(np.concatenate(places) * _FINE) / _FINE
    facing = np.rint(np.concatenate(normals) * _FINE) / _FINE
    return np.array(charts, np.float64), points, facing


def _balls_around(scene: Scene) -> Floats:
    corners = np.array([scene.hull(surface) for surface in range(len(scene.kinds))])
    middle = corners.mean(axis=1)
    radius = np.sqrt(np.square(corners - middle[:, np.newaxis]).sum(axis=-1).max(axis=1))
    return np.column_stack([middle, radius * 1.001])


Nodes = tuple[tuple[int, int], tuple[float, float], Floats, Floats]


def _nodes(scene: Scene, surface: int, spacing: float) -> Nodes:
    row, kind = scene.rows[surface], scene.kinds[surface]
    across, down, away = spans(row)
    width, height = row[tracing.HALF_WIDTH], row[tracing.HALF_HEIGHT]
    rounded = kind in (tracing.SPHERE, tracing.CYLINDER)
    half = (math.pi * width if rounded else width, height)
    shape = tuple(int(np.clip(2 * side / spacing, _FEWEST, _MOST)) + 1 for side in half[::-1])
    if np.isinf(scene.near[surface]):
        shape = (1, 1)
    v = np.linspace(-half[1], half[1], shape[0])[:, np.newaxis, np.newaxis]
    u = np.linspace(-half[0], half[0], shape[1])[np.newaxis, :, np.newaxis]
    if not rounded:
        points = row[:3] + u * across + v * down
        ahead = (row[:3] * away).sum() > 0
        normals = np.broadcast_to(-away if ahead else away, points.shape)
    else:
        angle = u / width
        level = v / width if kind == tracing.SPHERE else 0 * v
        belt = np.sqrt(np.maximum(1 - level * level, 0))
        normals = belt * (np.sin(angle) * across + np.cos(angle) * away) + level * down
        points = row[:3] + width * normals + (0 if kind == tracing.SPHERE else 1) * v * down
        if _inside(scene, surface):
            normals = -normals
    return (shape[0], shape[1]), half, points.reshape(-1, 3), normals.reshape(-1, 3)


def _inside(scene: Scene, surface: int) -> bool:
    """Whether the lens is inside a round surface, and sees its hollow side."""
    row = scene.rows[surface]
    square = float((row[:3] ** 2).sum())
    if scene.kinds[surface] == tracing.CYLINDER:
        square -= float((row[:3] * row[tracing.DOWN : tracing.DOWN + 3]).sum()) ** 2
    return bool(square < row[tracing.HALF_WIDTH] ** 2)


def _ball_points(count: int) -> Floats:
    """Return points spread over a unit sphere on a spiral."""
    height = 1 - (2 * np.arange(count) + 1) / count
    angle = 2 * math.pi * _GOLDEN * np.arange(count)
    belt = np.sqrt(1 - height * height)
    points = np.stack([belt * np.cos(angle), belt * np.sin(angle), height], axis=-1)
    return np.asarray(np.rint(points * _FINE) / _FINE)


def _sky(count: int) -> Floats:
    """Return directions around (0, 0, 1), as dense as the cosine of their angle to it."""
    radius = np.sqrt((np.arange(count) + 0.5) / count)
    angle = 2 * math.pi * _GOLDEN * np.arange(count)
    z = np.sqrt(1 - radius * radius)
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=-1)
    return np.asarray(np.rint(points * _FINE) / _FINE)
