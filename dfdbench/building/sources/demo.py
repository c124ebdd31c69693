"""Make the demo set: small scenes with photographs on their surfaces, seen by a camera."""

import hashlib
from collections.abc import Mapping
from importlib import resources

import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.recipe import LAST_LEVEL
from dfdbench.building.sources import SceneImages, Whole
from dfdbench.datasets.manifest import Manifest
from dfdbench.errors import SourceError
from dfdbench.simulation.photographs import GAMMA, near_normal_numbers, photograph
from dfdbench.simulation.raycast import Surface, View, dot, look, read_scenes
from dfdbench.tables.table import listed

_TEXT = resources.files("dfdbench.building.sources").joinpath("demo.toml").read_text("utf-8")
#: Each scene's surfaces; the last three scenes are the test.
SCENES: Mapping[str, tuple[Surface, ...]] = read_scenes(_TEXT)

Floats = NDArray[np.float64]

_SEED = 20191206
_SHAPE = (240, 320)
_FOCAL_LENGTH = 330.0  # pixels
_BASELINE = 0.25  # metres between the views
_VIEWS = {1: -_BASELINE / 2, 5: _BASELINE / 2}  # left and right, in metres
_LEVEL_AT_ONE_METRE = 3 * _FOCAL_LENGTH * _BASELINE  # level = 3 x disparity, as Middlebury's
_OCCLUSION = 0.02  # relative difference in distance above which a point is hidden

# The light of each illumination: its direction, its red-green-blue colour, its ambient share.
_LIGHTS = {
    1: ((-0.6, -0.5, -0.6), (1.0, 0.92, 0.80), 0.30),
    2: ((0.0, -0.6, -0.8), (1.0, 1.0, 1.0), 0.50),
    3: ((0.7, -0.3, -0.6), (0.82, 0.92, 1.0), 0.25),
}
# Exposure: at 1, a white surface that faces the light fills the sensor.
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
        If it has another scene, axis or axis value.
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
    if (
        list(manifest.axes) != list(made)
        or any(not set(values) <= set(made[axis]) for axis, values in manifest.axes.items())
        or manifest.depth.axes != ["view"]
        or not set(manifest.scene_names) <= set(SCENES)
    ):
        what = "other scenes or axes than the demo set's"
        raise SourceError(what, where=manifest.stem, expected=f"{listed(SCENES)}; axes {made}")


def photograph_light(light: Floats, seed: tuple[int, ...]) -> NDArray[np.uint8]:
    """Simulate a camera: shot and read noise, saturation, 10 bit, gamma, 8 bit.

    Parameters
    ----------
    light : ndarray of float, shape (y, x, 3)
        The value 1 just fills the sensor.
    seed : tuple of int
        Seed of the noise.

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
