"""Make the demo set: small scenes with photographs on their surfaces, seen by a camera."""

import hashlib
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.recipe import LAST_LEVEL
from dfdbench.building.sources import SceneImages, Whole
from dfdbench.datasets.manifest import Manifest
from dfdbench.errors import SourceError
from dfdbench.simulation.photographs import GAMMA, near_normal_numbers, photograph
from dfdbench.simulation.raycast import Ball, Board, Floor, Surface, Texture, View, dot, look
from dfdbench.tables.table import listed

_WARM, _COOL = (1.0, 0.85, 0.7), (0.75, 0.88, 1.0)
_GREEN, _ROSE = (0.8, 1.0, 0.75), (1.0, 0.8, 0.85)

_ASTRONAUT = Texture("astronaut", 260)
_BRICK = Texture("brick", 200, _WARM)
_CAMERA = Texture("camera", 280, _COOL)
_GRASS = Texture("grass", 240, _GREEN)
_IHC = Texture("ihc", 300)
_MOON = Texture("moon", 260, _WARM)
_PAGE = Texture("page", 260)
_MOTORCYCLE = Texture("motorcycle_left", 280)
_CELL = Texture("cell", 260, _ROSE)

_CHELSEA = Texture("chelsea", 260)
_COFFEE = Texture("coffee", 280)
_COINS = Texture("coins", 240, _WARM)
_GRAVEL = Texture("gravel", 240, _COOL)
_TEXT = Texture("text", 220)

#: Each scene's surfaces. x to the right, y downwards, z away from the cameras, in metres.
SCENES: Mapping[str, tuple[Surface, ...]] = {
    # Training.
    "Attic": (
        Board((0, 0, 4.8), (14, 9), _BRICK, slant=0.45),
        Floor(0.95, _GRASS),
        Board((-0.55, 0.1, 2.2), (0.8, 1.3), _ASTRONAUT, slant=0.5),
        Ball((0.55, 0.3, 1.9), 0.33, _MOON),
        Board((1.0, -0.5, 3.1), (1.1, 0.9), _PAGE, slant=-0.3, tilt=0.2),
        Board((0.2, -0.4, 1.95), (0.5, 0.4), _IHC, slant=0.25),
    ),
    "Barn": (
        Board((0, 0, 4.0), (14, 9), _GRASS, slant=-0.25, tilt=-0.1),
        Floor(0.8, _BRICK),
        Ball((-0.75, 0.2, 2.6), 0.4, _IHC, upright=0.9),
        Board((0.25, -0.2, 1.65), (0.6, 0.7), _CAMERA, slant=0.35),
        Ball((0.9, 0.45, 2.2), 0.35, _MOTORCYCLE),
    ),
    "Cabin": (
        Board((0, 0, 3.2), (14, 9), _MOTORCYCLE, slant=0.4),
        Floor(0.7, _MOON),
        Board((-0.2, 0.25, 1.5), (0.5, 0.6), _BRICK, slant=-0.5, shape="disc"),
        Ball((0.55, -0.15, 1.9), 0.28, _CELL, upright=0.9),
        Board((-0.75, -0.35, 2.2), (0.7, 0.6), _PAGE, tilt=0.4),
    ),
    "Depot": (
        Board((0, 0, 4.9), (20, 12), _CAMERA, slant=-0.6),
        Floor(1.1, _CELL),
        Board((0.7, 0.15, 2.8), (1.2, 1.7), _GRASS, slant=-0.7),
        Board((-0.8, -0.1, 3.6), (1.2, 1.6), _ASTRONAUT, slant=0.6, tilt=0.1),
        Ball((-0.1, 0.45, 1.55), 0.2, _PAGE),
        Board((0.0, -0.5, 2.5), (0.9, 0.6), _BRICK, slant=0.3, shape="disc"),
    ),
    "Forge": (
        Board((0, 0, 2.9), (12, 8), _IHC, slant=-0.35, tilt=0.15),
        Floor(0.62, _CAMERA),
        Ball((-0.4, 0.1, 1.55), 0.27, _ASTRONAUT),
        Ball((0.45, 0.2, 2.1), 0.3, _BRICK, upright=0.7),
        Board((0.2, -0.45, 1.35), (0.5, 0.3), _MOON, slant=0.3),
    ),
    "Garage": (
        Board((0, 0, 4.6), (14, 9), _ASTRONAUT, slant=0.3, tilt=-0.2),
        Floor(0.85, _MOTORCYCLE),
        Board((-0.6, 0.2, 1.75), (0.55, 0.9), _IHC, slant=-0.4),
        Board((0.1, -0.1, 3.35), (1.3, 1.2), _GRASS, slant=0.3, shape="disc"),
        Ball((0.7, 0.25, 1.45), 0.22, _CAMERA, upright=0.4),
    ),
    # Test.
    "Kitchen": (
        Board((0, 0, 4.2), (14, 9), _GRAVEL, slant=0.5),
        Floor(0.85, _COFFEE),
        Ball((-0.5, 0.2, 2.0), 0.34, _CHELSEA),
        Board((0.6, -0.05, 2.6), (0.9, 1.2), _COINS, slant=-0.4),
        Board((0.1, 0.25, 1.65), (0.36, 0.4), _TEXT, slant=0.8),
    ),
    "Library": (
        Board((0, 0, 3.4), (12, 8), _COFFEE, slant=-0.28, tilt=0.1),
        Floor(0.72, _COINS),
        Ball((0.6, 0.1, 2.3), 0.4, _TEXT),
        Board((-0.45, 0.1, 1.8), (0.6, 0.75), _GRAVEL, slant=0.9),
        Board((-0.1, -0.4, 2.5), (0.8, 0.5), _CHELSEA, slant=0.5, tilt=0.5, shape="disc"),
    ),
    "Market": (
        Board((0, 0, 4.7), (16, 10), _CHELSEA, slant=-0.45, tilt=-0.1),
        Floor(0.95, _GRAVEL),
        Board((-0.9, 0.0, 3.0), (1.1, 1.5), _COFFEE, slant=0.5),
        Board((0.75, 0.1, 2.3), (0.8, 1.1), _TEXT, slant=-0.35, tilt=0.15),
        Ball((-0.1, 0.35, 1.9), 0.28, _COINS),
    ),
}


Floats = NDArray[np.float64]

_SEED = 20191206
_SHAPE = (240, 320)
_FOCAL_LENGTH = 330.0  # pixels
_BASELINE = 0.25  # metres between the views
_VIEWS = {1: -_BASELINE / 2, 5: _BASELINE / 2}  # left and right, in metres
_LEVEL_AT_ONE_METRE = 3 * _FOCAL_LENGTH * _BASELINE  # level = 3 x disparity, as Middlebury's
_OCCLUSION = 0.02  # relative difference in distance above which a point is hidden

# Light of each illumination: direction it comes from, red-green-blue colour, ambient share.
_LIGHTS = {
    1: ((-0.6, -0.5, -0.6), (1.0, 0.92, 0.80), 0.30),
    2: ((0.0, -0.6, -0.8), (1.0, 1.0, 1.0), 0.50),
    3: ((0.7, -0.3, -0.6), (0.82, 0.92, 1.0), 0.25),
}
# Exposure: a white surface that faces the light fills the sensor at 1.
_GAINS = {0: 1.6 / 36, 1: 1.6 / 6, 2: 1.6}
_FULL_WELL = 60_000.0  # electrons; four frames of 15,000 averaged
_READ_NOISE = 12.0  # electrons
_CONVERTER_STEPS = 1023  # 10 bit


class DemoScenes(Whole):
    """The demo set's generator; the same manifest gives the same images everywhere.

    Parameters
    ----------
    manifest : Manifest
        The demo manifest, or one with some of its scenes, views, illuminations and exposures.

    Raises
    ------
    SourceError
        For another scene, axis, or value of one.
    """

    captures_defocus = False

    def __init__(self, manifest: Manifest) -> None:
        _require_made_here(manifest)
        super().__init__(manifest)

    def signature(self, scene: str) -> str:
        """Return the SHA-256 of the photographs, the scene and this generator's numbers."""
        surfaces = SCENES[scene]
        names = sorted({surface.texture.photograph for surface in surfaces})
        digest = hashlib.sha256(repr((surfaces, _LIGHTS, _GAINS, _SEED, _SHAPE)).encode())
        for name in names:
            digest.update(photograph(name).tobytes())
        return digest.hexdigest()

    def read(self, scene: str) -> SceneImages:
        """Render one scene from both views under every light and exposure."""
        axes = self._manifest.axes
        surfaces = SCENES[scene]
        photographs = {s.texture.photograph: photograph(s.texture.photograph) for s in surfaces}
        views = {
            view: look(surfaces, photographs, offset, _SHAPE, _FOCAL_LENGTH)
            for view, offset in _VIEWS.items()
        }
        extent = tuple(len(values) for values in axes.values())
        infocus = np.zeros((*extent, *_SHAPE, 3), np.uint8)
        depth = np.zeros((extent[0], *_SHAPE), np.uint8)
        number = self._manifest.scene_names.index(scene)
        for v, view in enumerate(axes["view"]):
            other = views[next(name for name in _VIEWS if name != view)]
            shift = 1 if _VIEWS[view] < 0 else -1
            depth[v] = _depth_levels(views[view].distance, other.distance, shift)
            for i, illumination in enumerate(axes["illumination"]):
                light = _lit(views[view], illumination)
                for e, exposure in enumerate(axes["exposure"]):
                    seed = (_SEED, number, view, illumination, exposure)
                    infocus[v, i, e] = photograph_light(light * _GAINS[exposure], seed)
        unknown = self._manifest.depth.unknown
        return SceneImages.of_pairs(infocus, depth, depth != unknown, np.ones(extent, bool))


def _require_made_here(manifest: Manifest) -> None:
    made = {"view": [*_VIEWS], "illumination": [*_LIGHTS], "exposure": [*_GAINS]}
    strange = [
        f"{axis} {value}"
        for axis, values in manifest.axes.items()
        for value in values
        if value not in made.get(axis, ())
    ]
    strange += [f"scene {name}" for name in manifest.scene_names if name not in SCENES]
    if strange or list(manifest.axes) != list(made) or manifest.depth.axes != ["view"]:
        what = f"the demo scenes are others than these: {listed(strange) or 'axes'}"
        raise SourceError(what, where=manifest.stem, expected=f"{listed(SCENES)}; axes {made}")


def photograph_light(light: Floats, seed: tuple[int, ...]) -> NDArray[np.uint8]:
    """Return what a camera makes of light: shot and read noise, saturation, 10 bit, gamma, 8 bit.

    Parameters
    ----------
    light : ndarray of float, shape (y, x, 3)
        1 just fills the sensor.
    seed : tuple of int
        Of the noise.

    Examples
    --------
    >>> photograph_light(np.full((1, 1, 3), 2.0), seed=(1,)).tolist()
    [[[255, 255, 255]]]
    """
    electrons = np.minimum(light, 1.2) * _FULL_WELL
    noise = np.sqrt(electrons + _READ_NOISE**2) * near_normal_numbers(light.shape, seed)
    steps = np.rint((electrons + noise) / _FULL_WELL * _CONVERTER_STEPS)
    signal = np.clip(steps, 0, _CONVERTER_STEPS) / _CONVERTER_STEPS
    return np.rint(255 * signal ** (1 / GAMMA)).astype(np.uint8)


def _lit(view: View, illumination: int) -> Floats:
    direction, colour, ambient = _LIGHTS[illumination]
    facing = dot(view.normal, np.array(direction))
    shade = ambient + (1 - ambient) * np.maximum(facing, 0)
    return np.asarray(view.reflectance * shade[..., np.newaxis] * np.array(colour))


def _depth_levels(distance: Floats, other: Floats, shift: int) -> NDArray[np.uint8]:
    # As in Middlebury's structured-light maps, what only one of the views sees is unknown.
    level = _LEVEL_AT_ONE_METRE / distance
    columns = np.arange(distance.shape[1]) - shift * level / 3
    seen = np.rint(columns).astype(np.int64)
    inside = (seen >= 0) & (seen < distance.shape[1])
    rows = np.arange(distance.shape[0])[:, np.newaxis]
    there = other[rows, np.clip(seen, 0, distance.shape[1] - 1)]
    hidden = inside & (there < distance * (1 - _OCCLUSION))
    return np.where(hidden, 0, np.clip(np.rint(level), 1, LAST_LEVEL)).astype(np.uint8)
