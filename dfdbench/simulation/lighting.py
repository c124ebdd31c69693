"""Precompute how much light falls on each surface of a scene: lamps, shadows, daylight."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dfdbench.blur.light import Floats
from dfdbench.simulation import tracing
from dfdbench.simulation.shapes import Scene, Vector, spans

_LAMP_POINTS = 24
_SKY_RAYS = 48
_FEWEST, _MOST = 3, 160  # steps along a surface's side
_FINE = 2.0**26  # places are multiples of 1 m / _FINE: sines may differ in their last bit
_LIGHT_SPACING = 0.05  # metres
_REACH = 1.0  # metres: surfaces nearer than this block ambient light
_LIGHT_FINE = 2.0**14
_MARGIN = 0.3  # metres beyond the visible part
_GOLDEN = (math.sqrt(5) - 1) / 2


@dataclass(frozen=True)
class Lamp:
    """A ball that shines.

    Parameters
    ----------
    place : tuple of float
        In metres.
    radius : float
        In metres; the larger, the softer the shadows.
    strength : float
        Light on a surface that faces it from a metre away.
    """

    place: Vector
    radius: float
    strength: float


def lit(scene: Scene, lamps: Sequence[Lamp], ambient: float, slope: tuple[float, float]) -> Scene:
    """Return a scene with the light that falls on the visible side of its surfaces.

    Parameters
    ----------
    scene : Scene
        From `dfdbench.simulation.shapes.pack`.
    lamps : sequence of Lamp
        Each casts shadows.
    ambient : float
        Daylight on a surface with nothing nearby.
    slope : tuple of float
        The largest visible x / z and y / z; elsewhere the light is not computed.

    Notes
    -----
    Lambert's law: a lamp's light is its strength times the cosine of its angle over the square of
    its distance, times the share of its points that are not hidden. Ambient light is that of an
    even sky, minus most of the share that is hidden within a metre. No light is reflected. Light is
    interpolated between the places at which it is computed.
    """
    charts, points, facing = places_on(scene, _LIGHT_SPACING)
    beyond = np.abs(points[:, :2]) - points[:, 2:] * np.array(slope)
    seen = (beyond.max(axis=1) < _MARGIN) & (points[:, 2] > -_MARGIN)
    out = np.zeros(int(seen.sum()))
    shining = np.array([(*lamp.place, lamp.radius, lamp.strength) for lamp in lamps])
    places = (_balls_around(scene), points[seen], facing[seen])
    # Points spread over a unit sphere, and directions around (0, 0, 1) with a density that follows
    # the cosine of their angle to it.
    ball = _spiral(1 - (2 * np.arange(_LAMP_POINTS) + 1) / _LAMP_POINTS)
    sky = _spiral(np.sqrt(1 - (np.arange(_SKY_RAYS) + 0.5) / _SKY_RAYS))
    sources = (shining.reshape(-1, 5), ball, ambient, _REACH, sky)
    tracing.fall(scene.kinds, scene.rows, *places, *sources, out)
    lightmap = np.full(len(points), ambient, np.float32)
    lightmap[seen] = np.rint(out * _LIGHT_FINE) / _LIGHT_FINE
    return scene._replace(charts=charts, lightmap=lightmap)


def places_on(scene: Scene, spacing: float) -> tuple[Floats, Floats, Floats]:
    """Return each surface's chart, and all the places and normals in the charts."""
    charts, places, normals = [], [], []
    first = 0
    for surface in range(len(scene.kinds)):
        (width, height), half, points, normal = _nodes(scene, surface, spacing)
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


def _nodes(
    scene: Scene, surface: int, spacing: float
) -> tuple[tuple[int, int], tuple[float, float], Floats, Floats]:
    row, kind = scene.rows[surface], scene.kinds[surface]
    across, down, away = spans(row)
    width, height = row[tracing.HALF_WIDTH], row[tracing.HALF_HEIGHT]
    rounded = kind in (tracing.SPHERE, tracing.CYLINDER)
    half = (math.pi * width if rounded else width, height)
    columns, rows = (int(np.clip(2 * side / spacing, _FEWEST, _MOST)) + 1 for side in half)
    if np.isinf(scene.near[surface]):
        columns = rows = 1
    v = np.linspace(-half[1], half[1], rows)[:, np.newaxis, np.newaxis]
    u = np.linspace(-half[0], half[0], columns)[np.newaxis, :, np.newaxis]
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
    return (columns, rows), half, points.reshape(-1, 3), normals.reshape(-1, 3)


def _inside(scene: Scene, surface: int) -> bool:
    """Return whether the lens is inside a round surface, and sees its hollow side."""
    row = scene.rows[surface]
    square = float((row[:3] ** 2).sum())
    if scene.kinds[surface] == tracing.CYLINDER:
        square -= float((row[:3] * row[tracing.DOWN : tracing.DOWN + 3]).sum()) ** 2
    return bool(square < row[tracing.HALF_WIDTH] ** 2)


def _spiral(height: Floats) -> Floats:
    """Return points of a unit sphere at these heights, on a spiral."""
    angle = 2 * math.pi * _GOLDEN * np.arange(len(height))
    belt = np.sqrt(1 - height * height)
    points = np.stack([belt * np.cos(angle), belt * np.sin(angle), height], axis=-1)
    return np.asarray(np.rint(points * _FINE) / _FINE)
