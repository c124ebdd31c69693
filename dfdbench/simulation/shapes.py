"""Flat and round surfaces in any direction, and a scene packed from them for `tracing`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import singledispatch
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dfdbench.simulation import tracing
from dfdbench.simulation.raycast import Ball, Board, Floor, Surface, Texture

Floats = NDArray[np.float64]
Vector = tuple[float, float, float]
Outline = Literal["rectangle", "disc", "lattice"]
#: The directions of a surface's right, of its bottom and of what lies behind it; unit vectors at
#: right angles.
Frame = tuple[Vector, Vector, Vector]

UPRIGHT: Frame = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))

#: Half the side of what has no end, in metres.
_ENDLESS = 50.0
#: What is nearer to the lens than this cannot be seen, in metres.
CLOSEST = 0.05
_WIDEST = 0.05  # metres: no lens has a larger radius
_COARSEST = 2  # pixels: a pyramid ends before its shorter side is less
_CORNERS = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T.astype(np.float64)


@dataclass(frozen=True)
class Panel:
    """A flat rectangle, disc or lattice that faces any way.

    Parameters
    ----------
    centre : tuple of float
        In metres, as in `dfdbench.simulation.raycast.Board`.
    frame : tuple of tuple of float
        Its right, its bottom, and its normal away from the viewer.
    size : tuple of float
        Width and height in metres.
    texture : Texture
        Its texture.
    shape : {"rectangle", "disc", "lattice"}
        A disc has the axes of the rectangle around it; a lattice is bars that cross.
    pitch, bar : float
        Of a lattice: distance of its bars in metres, and the share of it that a bar covers.
    closed : bool
        What lies behind cannot be seen past it, as behind a face of a box: if its back is turned
        to the lens, no ray from the lens is tried on it.
    """

    centre: Vector
    frame: Frame
    size: tuple[float, float]
    texture: Texture
    shape: Outline = "rectangle"
    pitch: float = 1.0
    bar: float = 1.0
    closed: bool = False


@dataclass(frozen=True)
class Round:
    """A sphere, or with `half_height` the side of a cylinder around the frame's second axis.

    Parameters
    ----------
    centre, frame, texture
        As of `Panel`. The texture's middle is in front, on the side the third axis points from.
    radius, half_height : float
        In metres.
    """

    centre: Vector
    frame: Frame
    radius: float
    texture: Texture
    half_height: float | None = None


#: What can be packed; of other surfaces those of `dfdbench.simulation.raycast`.
Shape = Panel | Round | Surface


class Scene(NamedTuple):
    """A scene's surfaces, textures and light as arrays: what `tracing` takes.

    `kinds`, `rows`, `near` and `textures` have an entry a surface; `near` is the smallest z, and
    infinite if the surface cannot be seen. `starts`, `levels` and `atlas`
    hold the textures' pyramids; `charts` and `lightmap` the light that falls on each surface.
    """

    kinds: NDArray[np.int64]
    rows: Floats
    near: Floats
    textures: NDArray[np.int64]
    starts: NDArray[np.int64]
    levels: NDArray[np.int64]
    atlas: NDArray[np.float32]
    charts: Floats
    lightmap: NDArray[np.float32]

    def hull(self, surface: int) -> Floats:
        """Return points, shape (point, 3), whose convex hull holds a surface."""
        row = self.rows[surface]
        across, down, away = spans(row)
        width, height = row[tracing.HALF_WIDTH], row[tracing.HALF_HEIGHT]
        if self.kinds[surface] == tracing.SPHERE:
            sizes = (width, width, width)
        elif self.kinds[surface] == tracing.CYLINDER:
            sizes = (width, height, width)
        else:
            sizes = (width, height, 0.0)
        edges = np.stack([across * sizes[0], down * sizes[1], away * sizes[2]])
        steps = _CORNERS[:, :, np.newaxis] * edges
        return np.asarray(row[:3] + steps[:, 0] + steps[:, 1] + steps[:, 2])


def spans(row: Floats) -> tuple[Floats, Floats, Floats]:
    """Return what a metre across, down and away is on a surface, as vectors in space."""
    u, v, n = (row[first : first + 3] for first in (tracing.ACROSS, tracing.DOWN, tracing.AWAY))
    across, down, away = _cross(v, n), _cross(n, u), _cross(u, v)
    volume = float((u * across).sum())
    return across / volume, down / volume, away / volume


def _cross(a: Floats, b: Floats) -> Floats:
    # A tenth of the time that NumPy's takes.
    (p, q, r), (x, y, z) = a.tolist(), b.tolist()
    return np.array([q * z - r * y, r * x - p * z, p * y - q * x])


def pack(shapes: Sequence[Shape], photographs: Mapping[str, Floats]) -> Scene:
    """Pack surfaces and their textures; light 1 falls on all of them.

    Parameters
    ----------
    shapes : sequence of Panel, Round, Board, Floor or Ball
        The surfaces.
    photographs : mapping of str to ndarray, shape (y, x, 3)
        Linear reflectance of each texture's photograph.
    """
    names = sorted({shape.texture.photograph for shape in shapes})
    pyramids = [_pyramid(photographs[name]) for name in names]
    flat = [level for pyramid in pyramids for level in pyramid]
    firsts = np.cumsum([0] + [level.shape[0] * level.shape[1] for level in flat])
    levels = [(first, image.shape[1], image.shape[0]) for first, image in zip(firsts, flat)]  # noqa: B905
    packed = [_row(shape) for shape in shapes]
    rows = np.array([row for _, row in packed])
    count = len(shapes)
    scene = Scene(
        kinds=np.array([kind for kind, _ in packed]),
        rows=rows,
        near=np.zeros(count),
        textures=np.array([names.index(shape.texture.photograph) for shape in shapes]),
        starts=np.cumsum([0] + [len(pyramid) for pyramid in pyramids]),
        levels=np.array(levels, np.int64),
        atlas=np.concatenate([level.reshape(-1, 3) for level in flat]).astype(np.float32),
        charts=np.stack([np.arange(count) * 0.0, *np.ones((4, count))], axis=1),
        lightmap=np.ones(1, np.float32),
    )
    near = [max(float(scene.hull(surface)[:, 2].min()), CLOSEST) for surface in range(count)]
    away = [_turned_away(shape) for shape in shapes]
    return scene._replace(near=np.where(away, np.inf, near))


def _turned_away(shape: Shape) -> bool:
    if not isinstance(shape, Panel) or not shape.closed:
        return False
    ahead = sum(place * way for place, way in zip(shape.centre, shape.frame[2], strict=True))
    return ahead < -_WIDEST


def _pyramid(photograph: Floats) -> list[Floats]:
    levels = [np.asarray(photograph, np.float64)]
    while min(levels[-1].shape[:2]) >= 2 * _COARSEST:
        fine = levels[-1]
        fine = np.pad(fine, ((0, fine.shape[0] % 2), (0, fine.shape[1] % 2), (0, 0)), mode="edge")
        total = fine[::2, ::2] + fine[1::2, ::2] + fine[::2, 1::2] + fine[1::2, 1::2]
        levels.append(total / 4)
    return levels


Packed = tuple[int, Floats]


@singledispatch
def _row(shape: Shape) -> Packed:
    raise TypeError(type(shape).__name__)


def _packed(
    kind: int, centre: Vector, frame: Frame, half: tuple[float, float], texture: Texture
) -> Packed:
    row = np.zeros(tracing.COLUMNS)
    row[:12] = np.concatenate([centre, *frame])
    row[tracing.HALF_WIDTH : tracing.HALF_HEIGHT + 1] = half
    row[tracing.PITCH : tracing.BAR + 1] = 1.0
    row[tracing.TEXELS] = texture.texels
    row[tracing.TINT : tracing.TINT + 3] = texture.tint
    return kind, row


@_row.register
def _(shape: Panel) -> Packed:
    half = (shape.size[0] / 2, shape.size[1] / 2)
    kinds = {"rectangle": tracing.RECTANGLE, "disc": tracing.DISC, "lattice": tracing.LATTICE}
    kind, row = _packed(kinds[shape.shape], shape.centre, shape.frame, half, shape.texture)
    row[tracing.PITCH : tracing.BAR + 1] = shape.pitch, shape.bar
    return kind, row


@_row.register
def _(shape: Round) -> Packed:
    across, down, (x, y, z) = shape.frame
    frame = (across, down, (-x, -y, -z))
    kind = tracing.SPHERE if shape.half_height is None else tracing.CYLINDER
    half = (shape.radius, shape.half_height or shape.radius)
    return _packed(kind, shape.centre, frame, half, shape.texture)


@_row.register
def _(shape: Board) -> Packed:
    normal = np.array([-shape.slant, -shape.tilt, 1.0])
    x, y, z = normal / np.sqrt((normal * normal).sum())
    # What is measured across and down is measured along x and y, not along the slope.
    frame = (UPRIGHT[0], UPRIGHT[1], (float(x), float(y), float(z)))
    kind = tracing.DISC if shape.shape == "disc" else tracing.RECTANGLE
    return _packed(kind, shape.centre, frame, (shape.size[0] / 2, shape.size[1] / 2), shape.texture)


@_row.register
def _(shape: Floor) -> Packed:
    frame = (UPRIGHT[0], UPRIGHT[2], UPRIGHT[1])
    centre = (0.0, shape.height, 0.0)
    return _packed(tracing.RECTANGLE, centre, frame, (_ENDLESS, _ENDLESS), shape.texture)


@_row.register
def _(shape: Ball) -> Packed:
    return _row(Round(shape.centre, UPRIGHT, shape.radius, shape.texture, shape.upright))
