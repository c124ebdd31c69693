"""Simulate the rig and treat what it gives as its captures: a real-world set from no file."""

import hashlib
import re
from dataclasses import astuple
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from dfdbench.building.sources import SceneError, SceneImages, Whole
from dfdbench.building.sources.image_files import average_frames
from dfdbench.building.sources.realworld import in_direction_of
from dfdbench.datasets.manifest import Manifest, Recording
from dfdbench.errors import Problem, SourceError
from dfdbench.optics.lens_table import read_lens_table
from dfdbench.rig import lidar, registration
from dfdbench.rig.geometry import CaptureRig, Pose
from dfdbench.rig.sighting import Rays, Sighting
from dfdbench.simulation.board_scene import SCENES, SimulatedScene, defocus
from dfdbench.simulation.photographs import photograph
from dfdbench.simulation.raycast import View

Floats = NDArray[np.float64]

#: Raised whenever the same manifest would give other images.
_VERSION = 1
# What is found is rounded, so that the last bits of a platform's arithmetic change no map: the pose
# to steps in degrees, a third of a pixel at most, and to decimals of a pixel the corners that a
# registration is kept as.
_ANGLE_STEP, _CORNER_PLACES = 0.02, 1


class SimulatedRig(Whole):
    """Scenes as `dfdbench rig simulate realworld` writes them, registered and read as captures are.

    Frames are averaged and cropped, scans averaged, and the LIDAR's depth map, laid on the image by
    `dfdbench.rig.registration.register` from all scenes of the manifest together, is the ground
    truth. The simulation's own truth is not used.

    Parameters
    ----------
    manifest : Manifest
        With the section `capture`, the axis `exposure_ms` and scenes k00 to k63.

    Raises
    ------
    SourceError
        Where the manifest asks for what cannot be simulated.
    """

    captures_defocus = True

    def __init__(self, manifest: Manifest) -> None:
        super().__init__(manifest)
        self._capture = _capture_of(manifest)
        #: Which voltage steps make a pair.
        self.options = {"pair": [self._capture.infocus_step, self._capture.defocus_step]}
        height, width = self._capture.frame_size
        self._rig = CaptureRig(frame_size=(height, width), crop_size=self._capture.crop_size)

    def signature(self, scene: str) -> str:
        """Return the SHA-256 of photograph, lens, beams, scene, and what is simulated of them."""
        simulated, manifest = self._scene(scene), self._manifest
        board, capture = simulated.board, self._capture.model_dump()
        facts = (_VERSION, simulated, board, capture, manifest.axes, manifest.scene_names)
        digest = hashlib.sha256(repr(facts).encode())
        shown = photograph(board.texture.photograph)
        for values in (shown, read_lens_table().radius, *astuple(lidar.read_beams())):
            digest.update(np.ascontiguousarray(values).tobytes())
        return digest.hexdigest()

    def read(self, scene: str) -> SceneImages:
        """Simulate one scene and make of it what the real-world pipeline makes of captures."""
        matrices, problems = self._registered
        if scene not in matrices:
            raise SceneError.of(problems[scene])
        simulated = self._scene(scene)
        view = simulated.look()
        steps = (self._capture.infocus_step, self._capture.defocus_step)
        whole = [self._frames(simulated, view, step) for step in steps]
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


def _capture_of(manifest: Manifest) -> Recording:
    """Return how a manifest records; refuse what cannot be simulated."""
    capture, known = manifest.capture, read_lens_table().steps
    numbers = [re.fullmatch(r"k(\d\d)", name) for name in manifest.scene_names]
    if (
        capture is None
        or not {capture.infocus_step, capture.defocus_step, capture.sharpest_step} <= set(known)
        or (list(manifest.axes), manifest.depth.axes) != (["exposure_ms"], [])
        or any(found is None or int(found[1]) >= SCENES for found in numbers)
    ):
        what = f"the simulated rig makes scenes k00 to k{SCENES - 1}, with the one axis exposure_ms"
        what += f" and the lens's steps {known[0]} to {known[-1]} under [capture]"
        raise SourceError(what, where=manifest.stem, fix="change a copy of realworld-sim-1.toml")
    return capture
