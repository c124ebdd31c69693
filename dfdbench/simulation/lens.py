"""Photograph a scene through a thin lens, with rays through many points of its aperture.

A ray leaves the lens's plane, z = 0, at a point a. It meets the plane in focus, z = s, at the same
point as the ray through the lens's middle. Per unit of z it runs along ``p / F - a / s``, where p
is the pixel's place and ``F = f s / (s - f)`` the distance of the sensor, both in the same unit.
This gives breathing (F grows as s shrinks), the circle of confusion and occlusion by near surfaces.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.light import Floats, Image, encode
from dfdbench.optics.thin_lens import ThinLens
from dfdbench.simulation import tracing
from dfdbench.simulation.photographs import near_normal_numbers
from dfdbench.simulation.shapes import CLOSEST, Scene
from dfdbench.system.parallel import Threads

Colour = tuple[float, float, float]

_TILE = 8  # pixels
_SETS = 256  # sets of lens points; each pixel draws one
_BAND = 32  # rows that a thread traces at a time
_FINE = 2.0**24  # lens points are multiples of 1 / _FINE: sines may differ in their last bit
_STEPS = 4095  # of the converter: 12 bits


@dataclass(frozen=True)
class Camera:
    """A lens and a sensor.

    Parameters
    ----------
    lens : ThinLens
        Focal length, f-number, focus distance, pixel pitch.
    shape : tuple of int
        Height and width in pixels.
    view_focus : float, optional
        Show as much of the scene as if focused at this distance, in metres, as aligning a focal
        stack does; by default the lens breathes.
    blades : int
        Straight edges of the aperture, at least 3; 0 for a round one. The area stays the same.
    cos4 : bool
        Darken an image point by the fourth power of the cosine of its angle to the axis.
    ring : tuple of float, optional
        Mechanical vignetting: distance before the lens and radius of a second stop, in metres.
    lateral : tuple of float
        Lateral colour error: how much larger red, green and blue appear, 0.001 for 0.1 %.
    longitudinal : tuple of float
        Longitudinal colour error: dioptres (1/m) to add to the focus, 1 / s, of each channel.
    full_well : float
        Electrons at light 1, for shot noise; 0 for none.
    read_noise : float
        Standard deviation in units of light, in which 1 is white.
    encoding : {"srgb", "linear"}
        Tone curve of the file.
    jpeg : int
        JPEG quality, 1 to 100; 0 for no compression.
    """

    lens: ThinLens
    shape: tuple[int, int] = (480, 640)
    view_focus: float | None = None
    blades: int = 0
    cos4: bool = False
    ring: tuple[float, float] | None = None
    lateral: Colour = (0.0, 0.0, 0.0)
    longitudinal: Colour = (0.0, 0.0, 0.0)
    full_well: float = 0.0
    read_noise: float = 0.0
    encoding: Literal["srgb", "linear"] = "srgb"
    jpeg: int = 0

    @property
    def focal_pixels(self) -> float:
        """The sensor's distance from the lens, F = f s / (s - f), in pixels."""
        focus = self.view_focus or self.lens.focus_distance
        focal = self.lens.focal_length
        return focal * focus / (focus - focal) / self.lens.pixel_size

    @property
    def lens_radius(self) -> float:
        """Half the focal length over the f-number, in metres."""
        return self.lens.focal_length / self.lens.f_number / 2


def render(
    scene: Scene, camera: Camera, samples: int, key: tuple[int, ...], threads: int = 1
) -> Floats:
    """Return the light that reaches the sensor, linear, shape (y, x, 3).

    Parameters
    ----------
    scene : Scene
        The scene in front of the lens.
    camera : Camera
        The lens; `develop` applies noise, curve and file.
    samples : int
        Rays per pixel, a power of two.
    key : tuple of int
        Key of the rays' positions: each pixel draws its own, from a counter-based generator.
    threads : int
        How many threads to use; the light does not depend on it.
    """
    height, width = camera.shape
    points = _points(samples, camera.blades)
    reach = camera.lens_radius * float(np.abs(points[..., :2]).max())
    draws = np.random.PCG64(np.random.SeedSequence(key)).random_raw(height * width)
    picks = (draws >> np.uint64(56)).astype(np.uint8).reshape(height, width)
    out = np.empty((height, width, 3))
    plain = camera.lateral == camera.longitudinal == (0.0, 0.0, 0.0)
    for channel in (-1,) if plain else (0, 1, 2):
        larger, nearer = camera.lateral[channel], camera.longitudinal[channel]
        focus = 1 / (1 / camera.lens.focus_distance + nearer)
        view = (camera.focal_pixels * (1 + larger), camera.lens_radius, focus)
        tiles = _tiles(scene, camera.shape, view, reach)
        ring = camera.ring or (0.0, 0.0)

        given = (tuple(scene), tiles, _TILE, points, picks, view, ring, channel)

        def band(begin: int, given: tuple[Any, ...] = given) -> None:
            tracing.gather(*given, begin, min(begin + _BAND, height), out)

        Threads(threads).map(band, range(0, height, _BAND))
    if camera.cos4:
        y = (np.arange(height) - (height - 1) / 2)[:, np.newaxis] / camera.focal_pixels
        x = (np.arange(width) - (width - 1) / 2) / camera.focal_pixels
        out /= np.square(1 + x * x + y * y)[:, :, np.newaxis]
    return out


def depth(scene: Scene, camera: Camera) -> NDArray[np.float32]:
    """Return the distance of each pixel's centre from the lens along its axis (z), in metres.

    It is what a pinhole in the middle of the lens sees; infinity if there is no surface.
    """
    view = (camera.focal_pixels, 0.0, 1.0)
    out = np.empty(camera.shape)
    tracing.distances(tuple(scene), _tiles(scene, camera.shape, view, 0.0), _TILE, view[0], out)
    return out.astype(np.float32)


def develop(light: Floats, camera: Camera, key: tuple[int, ...]) -> Image:
    """Simulate the file that a camera makes from light: noise, 12 bits, curve, 8 bits, JPEG.

    Parameters
    ----------
    light : ndarray of float, shape (y, x, 3)
        Linear; 1 fills the sensor.
    camera : Camera
        The camera, for noise, curve and file.
    key : tuple of int
        Key of the noise.

    Notes
    -----
    The variance of the noise at light L is ``read_noise^2 + L / full_well``.
    """
    variance = np.full(light.shape, camera.read_noise**2)
    if camera.full_well:
        variance += np.maximum(light, 0) / camera.full_well
    if variance.any():
        light = light + np.sqrt(variance) * near_normal_numbers(light.shape, key)
    steps = np.rint(np.clip(light, 0, 1) * _STEPS).astype(np.int64)
    curve = np.arange(_STEPS + 1) / _STEPS
    curve = encode(curve) if camera.encoding == "srgb" else 255 * curve
    image = np.rint(curve).astype(np.uint8)[steps]
    if camera.jpeg:
        _, content = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, camera.jpeg])
        image = np.ascontiguousarray(np.asarray(cv2.imdecode(content, 1), np.uint8)[..., ::-1])
    return image


@lru_cache(maxsize=8)
def _points(samples: int, blades: int) -> Floats:
    # Imported here because it takes half a second.
    from scipy.stats import qmc

    whole = qmc.Sobol(4, scramble=False, bits=32).random(samples) * 2.0**32
    draws = np.random.PCG64(np.random.SeedSequence((samples,))).random_raw(_SETS * 4)
    shifts = (draws >> np.uint64(32)).reshape(_SETS, 1, 4)
    # Flipping the same bits of all points keeps them evenly spread.
    square = ((whole.astype(np.uint64) ^ shifts) + 0.5) / 2.0**32
    lens = _polygon(square[..., :2], blades) if blades else _disc(square[..., :2])
    return np.concatenate([np.rint(lens * _FINE) / _FINE, square[..., 2:] - 0.5], axis=-1)


def _disc(square: Floats) -> Floats:
    """Map the unit square to the unit disc: squares around the middle become circles."""
    a, b = 2 * square[..., 0] - 1, 2 * square[..., 1] - 1
    wide = np.abs(a) > np.abs(b)
    radius = np.where(wide, a, b)
    share = np.where(wide, b, a) / np.where(radius == 0, 1, radius)
    angle = np.where(wide, math.pi / 4 * share, math.pi / 2 - math.pi / 4 * share)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)


def _polygon(square: Floats, blades: int) -> Floats:
    """Map the unit square to a regular polygon of the unit disc's area, one triangle per blade."""
    turn = 2 * math.pi / blades
    blade = np.floor(square[..., 0] * blades)
    along, out = square[..., 0] * blades - blade, np.sqrt(square[..., 1])
    corner = math.sqrt(turn / math.sin(turn))
    first, second = corner * out * (1 - along), corner * out * along
    one, other = turn * blade, turn * (blade + 1)
    x = first * np.cos(one) + second * np.cos(other)
    y = first * np.sin(one) + second * np.sin(other)
    return np.stack([x, y], axis=-1)


Tiles = tuple[NDArray[np.int64], NDArray[np.int64], Floats]


def _tiles(
    scene: Scene, shape: tuple[int, int], view: tuple[float, float, float], reach: float
) -> Tiles:
    """Return the surfaces that the rays of each tile may meet, as `tracing.list_tiles` lists them.

    `reach` is half the side of a square around the lens.
    """
    focal, _, focus = view
    bounds = np.empty((len(scene.kinds), 8))
    for surface, near in enumerate(scene.near):
        bounds[surface] = np.inf if np.isinf(near) else _bounds(scene, surface, reach, focus)
    count = -(-shape[0] // _TILE) * -(-shape[1] // _TILE)
    items, nears = np.empty(count * len(bounds), np.int64), np.empty(count * len(bounds))
    about = (bounds, _TILE, shape, (focal, reach, focus))
    ends = tracing.list_tiles(scene.kinds, scene.rows, scene.near, *about, items, nears)
    return ends, items[: ends[-1]].copy(), nears[: ends[-1]].copy()


def _bounds(scene: Scene, surface: int, reach: float, focus: float) -> Floats:
    """Return the range of x / z and y / z of rays that can meet a surface, and along its axis."""
    hull = scene.hull(surface)
    ahead = hull[:, 2] >= CLOSEST
    if not ahead.any():
        return np.full(8, np.inf)
    visible = [hull[ahead]]
    if not ahead.all():
        # Add the points at which the hull leaves the space in front of the lens.
        near, far = hull[~ahead, np.newaxis], hull[np.newaxis, ahead]
        share = (CLOSEST - near[..., 2:]) / (far[..., 2:] - near[..., 2:])
        visible.append((near + share * (far - near)).reshape(-1, 3))
    points = np.concatenate(visible)
    slopes = points[:, :2] / points[:, 2:]
    ends = np.array([points[:, 2].min(), points[:, 2].max()])
    # The plane in focus looks the same from all over the lens; others move with the lens point.
    blur = reach * np.abs(1 / ends - 1 / focus).max()
    row = scene.rows[surface]
    x, y = row[tracing.DOWN : tracing.DOWN + 2]
    # Across a slanted rod.
    part = slopes[:, 0] * -y + slopes[:, 1] * x
    wide = (abs(x) + abs(y)) * blur
    return np.array(
        [*(slopes.min(axis=0) - blur), *(slopes.max(axis=0) + blur), -y, x,
         part.min() - wide, part.max() + wide]
    )  # fmt: skip
