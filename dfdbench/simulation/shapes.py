"""Flat and round surfaces in any direction, packed into a scene for `tracing`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dfdbench.simulation import tracing
from dfdbench.simulation.raycast import Floats, Texture

Vector = tuple[float, float, float]
Outline = Literal["rectangle", "disc", "lattice"]
#: The directions of a surface's right, of its bottom and away from the viewer: unit vectors at
#: right angles.
Frame = tuple[Vector, Vector, Vector]

UPRIGHT: Frame = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))

#: Anything nearer to the lens than this is invisible, in metres.
CLOSEST = 0.05
_WIDEST = 0.05  # metres: no lens has a larger radius
_COARSEST = 2  # pixels: a pyramid ends before its shorter side gets smaller
_KINDS = {"rectangle": tracing.RECTANGLE, "disc": tracing.DISC, "lattice": tracing.LATTICE}
_CORNERS = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T.astype(np.float64)


@dataclass(frozen=True)
class Panel:
    """A flat rectangle, disc or lattice that faces any direction.

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
        A disc has the axes of the rectangle around it; a lattice is made of crossing bars.
    pitch, bar : float
        For a lattice: the distance of its bars in metres, and the share of it that a bar covers.
    closed : bool
        The space behind cannot be seen past it, as behind the face of a box: if its back faces the
        lens, rays from the lens are not tested against it.
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
    """A sphere or, with `half_height`, the side of a cylinder around the frame's second axis.

    Parameters
    ----------
    centre, frame, texture
        As in `Panel`. The texture's middle is in front, on the side from which the third axis
        points.
    radius, half_height : float
        In metres.
    """

    centre: Vector
    frame: Frame
    radius: float
    texture: Texture
    half_height: float | None = None


#: What can be packed.
Shape = Panel | Round


class Scene(NamedTuple):
    """A scene's surfaces, textures and light as arrays: the input of `tracing`.

    `kinds`, `rows`, `near` and `textures` have one entry per surface; `near` is the smallest z, or
    infinity if the surface is invisible. `starts`, `levels` and `atlas` hold the textures'
    pyramids; `charts` and `lightmap` hold the light that falls on each surface.
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
        """Return points, shape (point, 3), whose convex hull contains a surface."""
        row = self.rows[surface]
        across, down, away = spans(row)
        width, height = row[tracing.HALF_WIDTH], row[tracing.HALF_HEIGHT]
        thick = width if self.kinds[surface] >= tracing.SPHERE else 0.0
        edges = np.stack([across * width, down * height, away * thick])
        steps = _CORNERS[:, :, np.newaxis] * edges
        return np.asarray(row[:3] + steps[:, 0] + steps[:, 1] + steps[:, 2])


def spans(row: Floats) -> tuple[Floats, Floats, Floats]:
    """Return a surface's vectors of one metre across, down and away in space."""
    u, v, n = row[tracing.ACROSS : tracing.AWAY + 3].reshape(3, 3).tolist()
    across, down, away = np.array([cross(v, n), cross(n, u), cross(u, v)])
    volume = float((u * across).sum())
    return across / volume, down / volume, away / volume


def cross(a: Sequence[float], b: Sequence[float]) -> Vector:
    """Return the cross product, in a tenth of NumPy's time."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def pack(shapes: Sequence[Shape], photographs: Mapping[str, Floats]) -> Scene:
    """Pack surfaces and their textures, all lit by light 1.

    Parameters
    ----------
    shapes : sequence of Panel or Round
        The surfaces.
    photographs : mapping of str to ndarray, shape (y, x, 3)
        Linear reflectance of each texture's photograph.
    """
    names = sorted({shape.texture.photograph for shape in shapes})
    pyramids = [_pyramid(photographs[name]) for name in names]
    flat = [level for pyramid in pyramids for level in pyramid]
    firsts = np.cumsum([0] + [level.shape[0] * level.shape[1] for level in flat])
    levels = [(first, image.shape[1], image.shape[0]) for first, image in zip(firsts, flat)]  # noqa: B905
    kinds, rows = zip(*map(_row, shapes), strict=True)
    count = len(shapes)
    scene = Scene(
        kinds=np.array(kinds),
        rows=np.array(rows),
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


def _row(shape: Shape) -> tuple[int, Floats]:
    row = np.zeros(tracing.COLUMNS)
    across, down, away = shape.frame
    if isinstance(shape, Panel):
        kind, half = _KINDS[shape.shape], (shape.size[0] / 2, shape.size[1] / 2)
        row[tracing.PITCH : tracing.BAR + 1] = shape.pitch, shape.bar
    else:
        kind = tracing.SPHERE if shape.half_height is None else tracing.CYLINDER
        half = (shape.radius, shape.half_height or shape.radius)
        away = (-away[0], -away[1], -away[2])
        row[tracing.PITCH : tracing.BAR + 1] = 1.0
    row[:12] = np.concatenate([shape.centre, across, down, away])
    row[tracing.HALF_WIDTH : tracing.HALF_HEIGHT + 1] = half
    row[tracing.TEXELS] = shape.texture.texels
    row[tracing.TINT : tracing.TINT + 3] = shape.texture.tint
    return kind, row
