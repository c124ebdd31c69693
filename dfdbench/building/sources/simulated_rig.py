"""Simulate the rig and treat the output as its captures: a real-world set without any files."""

import hashlib
import re
from collections.abc import Iterator, Mapping
from dataclasses import astuple
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from dfdbench.building.sources import SceneImages
from dfdbench.building.sources.image_files import average_frames
from dfdbench.building.sources.realworld import in_direction_of
from dfdbench.datasets.manifest import Manifest, Pair
from dfdbench.errors import Problem, SourceError
from dfdbench.optics.lens_table import read_lens_table
from dfdbench.rig import lidar, registration
from dfdbench.rig.geometry import CaptureRig, Pose
from dfdbench.rig.sighting import Rays, Sighting
from dfdbench.simulation.board_scene import SCENES, SimulatedScene, defocus
from dfdbench.simulation.photographs import photograph
from dfdbench.simulation.raycast import View
from dfdbench.tables.table import listed

Floats = NDArray[np.float64]

#: Raised whenever the same manifest would give other images.
_VERSION = 1
# Results are rounded, so that the last bits of a platform's arithmetic change no map: the pose to
# steps in degrees, a third of a pixel at most, and the corners of a stored registration to decimals
# of a pixel.
_ANGLE_STEP, _CORNER_PLACES = 0.02, 1


class SimulatedRig:
    """Scenes as from `dfdbench rig simulate realworld`, registered and read like captures.

    Frames are averaged and cropped, and scans averaged. The ground truth is the LIDAR's depth map,
    aligned with the image by `dfdbench.rig.registration.register` from all scenes of the manifest
    together. The simulation's own truth is not used.

    Parameters
    ----------
    manifest : Manifest
        With a section `capture`, the axis `exposure_ms` and scenes k00 to k63.

    Raises
    ------
    SourceError
        With everything in the manifest that cannot be simulated.
    """

    captures_defocus = True

    def __init__(self, manifest: Manifest) -> None:
        SourceError.raise_if(_problems_of(manifest))
        assert manifest.capture is not None  # otherwise it would be one of the problems
        self._manifest = manifest
        self._capture = manifest.capture
        height, width = self._capture.frame_size
        self._rig = CaptureRig(frame_size=(height, width), crop_size=self._capture.crop_size)
        self._steps = [self._capture.infocus_step, self._capture.defocus_step]
        self.options: Mapping[str, Any] = {"pair": self._steps}

    def available_pairs(self) -> tuple[Pair, ...]:
        """Return the pairs of the scenes that could be registered.

        They are registered here, all together: each scene's result depends on the others.
        """
        matrices, _ = self._registered
        return tuple(pair for pair in self._manifest.pairs() if pair.scene in matrices)

    def signature(self, scene: str) -> str:
        """Return the SHA-256 of photograph, lens, beams, scene, and the simulation's parameters."""
        simulated, manifest = self._scene(scene), self._manifest
        board, capture = simulated.board, self._capture.model_dump()
        facts = (_VERSION, simulated, board, capture, manifest.axes, manifest.scene_names)
        digest = hashlib.sha256(repr(facts).encode())
        shown = photograph(board.texture.photograph)
        for values in (shown, read_lens_table().radius, *astuple(lidar.read_beams())):
            digest.update(np.ascontiguousarray(values).tobytes())
        return digest.hexdigest()

    def missing_help(self, missing: tuple[Pair, ...]) -> str:
        """Say why scenes could not be registered."""
        _, problems = self._registered
        return "; ".join(f"{name}: {found[0]}" for name, found in problems.items())

    def read(self, scene: str) -> SceneImages:
        """Simulate one scene and process it as the real-world pipeline processes captures."""
        matrices, problems = self._registered
        if scene not in matrices:
            raise SourceError.of(problems[scene])
        simulated = self._scene(scene)
        view = simulated.look()
        whole = [self._frames(simulated, view, step) for step in self._steps]
        infocus, blurred = (np.array([*map(self._rig.crop, frames)], np.uint8) for frames in whole)
        size = (self._capture.crop_size,) * 2
        seen = lidar.depth_image(self._ranges(simulated), lidar.read_beams())
        levels, valid = lidar.warp(*seen, matrices[scene], size)
        depth = in_direction_of(levels, valid, self._manifest.depth)
        return SceneImages.of_pairs(infocus, depth, valid, np.ones(len(infocus), bool), blurred)

    @cached_property
    def _registered(self) -> tuple[dict[str, Floats], dict[str, tuple[Problem, ...]]]:
        sightings: dict[str, Sighting] = {}
        for name in self._manifest.scene_names:
            simulated = self._scene(name)
            frames = self._frames(simulated, simulated.look(), self._capture.sharpest_step)
            frame, ranges = frames[len(frames) // 2], self._ranges(simulated)
            sightings[name] = registration.sight(frame, ranges, lidar.read_beams(), self._rig)
        found, problems = registration.register(sightings, self._rig)
        matrices = {
            name: _rounded(sightings[name].rays, one.pose, self._rig) for name, one in found.items()
        }
        return matrices, problems

    def _scene(self, name: str) -> SimulatedScene:
        return SimulatedScene(int(name.removeprefix("k")), self._rig)

    def _frames(self, simulated: SimulatedScene, view: View, step: int) -> list[NDArray[np.uint8]]:
        """Return a voltage step's whole frame at each exposure, averaged."""
        light = defocus(view, read_lens_table(), step)
        numbers = range(self._capture.frames)
        return [
            average_frames([simulated.frame(light, ms, (step, ms, number)) for number in numbers])
            for ms in self._manifest.axes["exposure_ms"]
        ]

    def _ranges(self, simulated: SimulatedScene) -> Floats:
        beams = lidar.read_beams()
        scans = range(self._capture.lidar_scans)
        return lidar.average_scans([simulated.scan(beams, number) for number in scans])


def _rounded(rays: Rays, pose: Pose, rig: CaptureRig) -> Floats:
    turned = Pose(*(round(angle / _ANGLE_STEP) * _ANGLE_STEP for angle in astuple(pose)))
    corners = rays.corners()
    target = cv2.perspectiveTransform(corners[np.newaxis], rays.matrix(turned, rig))[0]
    target = target.round(_CORNER_PLACES)
    found = cv2.getPerspectiveTransform(corners.astype(np.float32), target.astype(np.float32))
    return np.asarray(found, np.float64)


def _problems_of(manifest: Manifest) -> Iterator[Problem]:
    capture = manifest.capture
    if capture is None:
        yield Problem("section is missing", where=f"{manifest.stem}: capture")
    else:
        known = read_lens_table().steps
        steps = (capture.infocus_step, capture.defocus_step, capture.sharpest_step)
        if strange := [step for step in steps if step not in known]:
            what = f"the simulated lens has steps {known[0]} to {known[-1]}, not {listed(strange)}"
            yield Problem(what, where=f"{manifest.stem}: capture")
    axes, depth_axes = list(manifest.axes), manifest.depth.axes
    if axes != ["exposure_ms"] or depth_axes:
        what = f"the simulated rig has one axis, exposure_ms, not {axes + depth_axes}"
        yield Problem(what, where=f"{manifest.stem}: axes")
    numbers = [re.fullmatch(r"k(\d\d)", name) for name in manifest.scene_names]
    if any(found is None or int(found[1]) >= SCENES for found in numbers):
        what = f"the simulated scenes are k00 to k{SCENES - 1}, got {listed(manifest.scene_names)}"
        yield Problem(what, where=f"{manifest.stem}: scenes")
