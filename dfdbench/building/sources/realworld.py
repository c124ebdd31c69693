"""Read the thesis's captures: two voltage steps a pair, or the sharpest step to be blurred."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.recipe import LAST_LEVEL
from dfdbench.building.sources.interface import SceneImages
from dfdbench.building.sources.rig_scenes import PublishedScene, RawScene, find_captured_scene
from dfdbench.datasets.manifest import Depth, Manifest, Pair
from dfdbench.errors import DfdbenchError, Problem, SourceError
from dfdbench.optics.sharpness import sharpest


class RealworldFolder:
    """Scenes k00 to k63 in a folder, as published or as captured; layouts may be mixed.

    A manifest without a blur recipe pairs two voltage steps; one with a recipe takes the sharpest
    step of each exposure, whose defocus image the build makes.

    Parameters
    ----------
    manifest : Manifest
        With the section `capture`.
    folder : Path
        Holds the scenes.
    pair : tuple of int, optional
        In-focus and defocus voltage step; by default the manifest's.

    Raises
    ------
    SourceError
        Where the folder holds no scene of the manifest, or the pair cannot be had.
    """

    def __init__(
        self, manifest: Manifest, folder: Path, pair: tuple[int, int] | None = None
    ) -> None:
        if manifest.capture is None:
            raise SourceError("section is missing", where=f"{manifest.stem}: capture")
        self._manifest = manifest
        self._capture = manifest.capture
        self._synthetic = manifest.recipe is not None
        self._steps = self._wanted_steps(pair)
        found = {
            name: find_captured_scene(folder, name, self._capture) for name in manifest.scene_names
        }
        self._scenes = {name: files for name, files in found.items() if files}
        if not self._scenes:
            there = "a file" if folder.exists() else "no such folder"
            what = "no scene found, such as k33 with left/exp_30 and lidar"
            raise SourceError(what, where=str(folder), got="none" if folder.is_dir() else there)

    @property
    def options(self) -> Mapping[str, Any]:
        """Which voltage steps make a pair."""
        return {"pair": "sharpest" if self._synthetic else list(self._steps)}

    @property
    def captures_defocus(self) -> bool:
        """Whether the defocus image is a voltage step, not made."""
        return not self._synthetic

    @property
    def problems(self) -> tuple[Problem, ...]:
        """All that keeps pairs from being built, of every scene that is there."""
        # Scenes may share a calibration: what is wrong with it is one problem.
        found = (problem for _, problems in self._checked.values() for problem in problems)
        return tuple(dict.fromkeys(found))

    def available_pairs(self) -> tuple[Pair, ...]:
        """Return the pairs whose images and depth map are there and whole."""
        return tuple(
            pair
            for pair in self._manifest.pairs()
            if pair.scene in self._scenes and pair.at["exposure_ms"] in self._checked[pair.scene][0]
        )

    def signature(self, scene: str) -> str:
        """Return the SHA-256 over the scene's files that a build reads."""
        files = self._scenes[scene]
        digest = hashlib.sha256(type(files).__name__.encode())
        paths = [
            path
            for exposure in self._checked[scene][0]
            for step in self._steps
            for path in files.images(exposure, step)
        ]
        for path in [*paths, *files.depth_files()]:
            digest.update(path.name.encode())
            digest.update(hashlib.sha256(path.read_bytes()).digest())
        return digest.hexdigest()

    def read(self, scene: str) -> SceneImages:
        """Read one scene."""
        files = self._scenes[scene]
        try:
            levels, valid = files.depth()
        except DfdbenchError as error:
            raise SourceError.of(error.problems) from error
        exposures = self._manifest.axes["exposure_ms"]
        shape = (len(exposures), *levels.shape, 3)
        infocus, defocus = np.zeros(shape, np.uint8), np.zeros(shape, np.uint8)
        available = np.zeros(len(exposures), bool)
        for exposure in self._checked[scene][0]:
            place = exposures.index(exposure)
            steps = self._steps
            if self._synthetic:
                # 3.2.5: the sharpest is found first, in whole frames, and cropped then.
                steps = (steps[sharpest([files.frame(exposure, step) for step in steps])],)
            images = [files.image(exposure, step) for step in steps]
            infocus[place], defocus[place] = images[0], images[-1]
            available[place] = True
        depth = in_direction_of(levels, valid, self._manifest.depth, whole=self._synthetic)
        return SceneImages.of_pairs(
            infocus, depth, valid, available, None if self._synthetic else defocus
        )

    def missing_help(self, missing: tuple[Pair, ...]) -> str:
        """Return what is wrong with the scenes that are there, and how to go on."""
        if not self.problems:
            return "add the scenes that are missing; --allow-missing accepts what is there"
        whole = sum(bool(exposures) for exposures, _ in self._checked.values())
        accepted = f"; --allow-missing builds the {whole} scenes that can be" if whole else ""
        lines = [f"mend what is named below{accepted}"]
        for number, problem in enumerate(self.problems, start=1):
            lines.append(f"{number}. {problem}")
        return "\n".join(lines)

    @cached_property
    def _checked(self) -> dict[str, tuple[tuple[int, ...], list[Problem]]]:
        # Every file is looked at before any is used: all that is wrong is reported together.
        return {name: self._check(files) for name, files in self._scenes.items()}

    def _check(self, files: PublishedScene | RawScene) -> tuple[tuple[int, ...], list[Problem]]:
        without_depth = files.depth_problems()
        problems, usable = list(without_depth), []
        for exposure in self._manifest.axes["exposure_ms"]:
            if exposure not in files.exposures():
                continue
            there = [step for step in self._steps if files.images(exposure, step)]
            lacking = [step for step in self._steps if step not in there]
            wrong = [p for step in there for p in files.image_problems(exposure, step)]
            if lacking:
                what = f"no image at voltage step {', '.join(map(str, lacking))}"
                wrong.append(Problem(what, where=f"{files.folder}, exposure {exposure} ms"))
            if not wrong:
                usable.append(exposure)
            problems += wrong
        return ((), problems) if without_depth else (tuple(usable), problems)

    def _wanted_steps(self, pair: tuple[int, int] | None) -> tuple[int, ...]:
        known = self._capture.voltage_step
        if self._synthetic:
            if pair:
                what = f"{self._manifest.short} takes the sharpest voltage step"
                raise SourceError(what, where="--pair", fix="leave out --pair, or build realworld")
            return tuple(known)
        steps = pair or (self._capture.infocus_step, self._capture.defocus_step)
        if steps[0] == steps[1] or not set(steps) <= set(known):
            what = f"{steps[0]},{steps[1]} are not two steps of {known[0]} to {known[-1]}"
            raise SourceError(what, where="--pair")
        return steps


def in_direction_of(
    levels: NDArray[np.uint8], valid: NDArray[np.bool_], depth: Depth, whole: bool = False
) -> NDArray[np.uint8]:
    """Return the rig's levels, which are distances, in the direction that a manifest states.

    By Eq. 7.1 what is near is bright, as in Middlebury's maps.

    Parameters
    ----------
    levels : ndarray of uint8, shape (y, x)
        Centimetres.
    valid : ndarray of bool, shape (y, x)
        True where the distance is known.
    depth : Depth
        The manifest's.
    whole : bool
        Whether pixels without a return are turned as well, as the thesis did of what it blurred.

    Examples
    --------
    >>> from dfdbench.datasets.catalog import find_manifest
    >>> levels = np.array([[150, 0]], np.uint8)
    >>> in_direction_of(levels, levels > 0, find_manifest("realworld").depth).tolist()
    [[105, 0]]
    """
    if depth.grows_with == "distance":
        return levels
    turned = LAST_LEVEL - levels
    return turned if whole else np.where(valid, turned, np.uint8(depth.unknown))
