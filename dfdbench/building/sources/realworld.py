"""Read the thesis's captures: two voltage steps per pair, or the sharpest step to be blurred."""

import hashlib
from collections.abc import Mapping
from functools import cached_property
from itertools import chain, product, starmap
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.recipe import LAST_LEVEL
from dfdbench.building.sources import SceneImages, gathered, laid_out
from dfdbench.building.sources.image_files import Image, average_frames, image_problems, read_rgb
from dfdbench.datasets.manifest import Depth, Manifest, Pair, Recording
from dfdbench.errors import Problem, SourceError
from dfdbench.optics.sharpness import sharpest
from dfdbench.rig import geometry, lidar, registration

LevelsAndKnown = tuple[NDArray[np.uint8], NDArray[np.bool_]]


class CapturedScene:
    """What both layouts of a scene have in common.

    Parameters
    ----------
    folder : Path
        The scene's folder.
    capture : Recording
        The manifest's section.
    """

    #: Where its images are, in one folder per exposure.
    inside: str

    def __init__(self, folder: Path, capture: Recording) -> None:
        self.folder = folder
        self._capture = capture

    def exposures(self) -> tuple[int, ...]:
        """Return the exposure times, in ms, that have images."""
        places = (self.folder / self.inside).glob("exp_*")
        names = (place.name.removeprefix("exp_") for place in places if place.is_dir())
        return tuple(sorted({int(name) for name in names if name.isdigit()}))

    def _place_of(self, exposure_ms: int) -> Path:
        # The thesis's folders are exp_10 to exp_70; we also accept a leading zero.
        inside = self.folder / self.inside
        padded = inside / f"exp_{exposure_ms:02d}"
        return padded if padded.is_dir() else inside / f"exp_{exposure_ms}"


class PublishedScene(CapturedScene):
    """A scene as published: ``left/exp_30/image_141_30.00.png``, ``lidar/..._8bit_x6.png``."""

    inside = "left"

    def images(self, exposure_ms: int, step: int) -> list[Path]:
        """Return the one file of an image, or none if it is missing."""
        file = self._place_of(exposure_ms) / f"{_image_name(exposure_ms, step)}.png"
        return [file] if file.exists() else []

    def image(self, exposure_ms: int, step: int) -> Image:
        """Return one image, RGB."""
        return read_rgb(self.images(exposure_ms, step)[0])

    def frame(self, exposure_ms: int, step: int) -> Image:
        """Return the published part of an image's frame: what the crop left of it."""
        return self.image(exposure_ms, step)

    @property
    def depth(self) -> LevelsAndKnown:
        """Depth levels in centimetres and where they are known."""
        levels = np.ascontiguousarray(read_rgb(self.depth_files()[0])[..., 0])
        return levels, (levels > 0) & (levels < LAST_LEVEL)

    def depth_files(self) -> list[Path]:
        """Return the LIDAR's depth map."""
        found = sorted((self.folder / "lidar").glob("lidar_rng_*_8bit*.png"))
        return sorted(found, key=lambda path: not path.stem.endswith("_x6"))[:1]

    def image_problems(self, exposure_ms: int, step: int) -> list[Problem]:
        """Return the problems of an image's file, found without decoding it."""
        return image_problems(self.images(exposure_ms, step), (self._capture.crop_size,) * 2)

    def depth_problems(self) -> list[Problem]:
        """Return the problems of the depth map's file."""
        files = self.depth_files()
        if not files:
            what = "scene has no LIDAR depth map, lidar/lidar_rng_left_00000_8bit_x6.png"
            return [Problem(what, where=str(self.folder))]
        return image_problems(files, (self._capture.crop_size,) * 2)


class RawScene(CapturedScene):
    """A scene as captured: ``frames/exp_30/image_141_30.00_0.png``, ``lidar/lidar_rng_00000.bin``.

    Parameters
    ----------
    folder : Path
        The scene's folder; its ``beams.csv``, or the one beside it, replaces the thesis's
        calibration.
    capture : Recording
        The manifest's section.
    """

    inside = "frames"

    def __init__(self, folder: Path, capture: Recording) -> None:
        super().__init__(folder, capture)
        height, width = capture.frame_size
        self.rig = geometry.CaptureRig(frame_size=(height, width), crop_size=capture.crop_size)

    def images(self, exposure_ms: int, step: int) -> list[Path]:
        """Return the frames of one image."""
        return sorted(self._place_of(exposure_ms).glob(f"{_image_name(exposure_ms, step)}_*.png"))

    def steps(self, exposure_ms: int) -> tuple[int, ...]:
        """Return the voltage steps that have frames at an exposure."""
        files = self._place_of(exposure_ms).glob("image_*_*.png")
        names = [path.name.split("_") for path in files]
        return tuple(sorted({int(parts[1]) for parts in names if parts[1].isdigit()}))

    def frame(self, exposure_ms: int, step: int) -> Image:
        """Return the average of an image's frames, not cropped."""
        return average_frames([read_rgb(path) for path in self.images(exposure_ms, step)])

    def image(self, exposure_ms: int, step: int) -> Image:
        """Return the average of an image's frames, cropped."""
        return np.asarray(self.rig.crop(self.frame(exposure_ms, step)), np.uint8)

    def ranges(self) -> NDArray[np.float64]:
        """Return the average of the LIDAR's scans, in mm."""
        return lidar.average_scans([lidar.read_ranges(path) for path in self.scans()])

    def beams(self) -> lidar.Beams:
        """Return the beams' directions: the scene's calibration, the folder's, or the thesis's."""
        return lidar.read_beams(self.beams_file())

    @cached_property
    def depth(self) -> LevelsAndKnown:
        """Depth levels in centimetres and where they are known; computed only once."""
        levels, valid = lidar.depth_image(self.ranges(), self.beams())
        matrix = registration.read_registration(self.registration)
        return lidar.warp(levels, valid, matrix, (self._capture.crop_size,) * 2)

    def scans(self) -> list[Path]:
        """Return the LIDAR's range files."""
        folder = self.folder / "lidar"
        return sorted([*folder.glob("lidar_rng_*.bin"), *folder.glob("lidar_rng_*.npy")])

    def beams_file(self) -> Path | None:
        """Return the calibration's file, or None for the thesis's."""
        places = (self.folder / "beams.csv", self.folder.parent / "beams.csv")
        return next((path for path in places if path.exists()), None)

    @property
    def registration(self) -> Path:
        """The file with the transform to the image."""
        return self.folder / registration.NAME

    def depth_files(self) -> list[Path]:
        """Return range files, calibration and registration."""
        beams = self.beams_file()
        return [*self.scans(), *([beams] if beams else []), self.registration]

    def image_problems(self, exposure_ms: int, step: int) -> list[Problem]:
        """Return the problems of an image's frames, found without decoding them."""
        files = self.images(exposure_ms, step)
        problems = image_problems(files, tuple(self._capture.frame_size))
        if len(files) != self._capture.frames:
            place = self._place_of(exposure_ms) / f"{_image_name(exposure_ms, step)}_*.png"
            what = f"only {len(files)} of {self._capture.frames} frames"
            problems.append(Problem(what, where=str(place)))
        return problems

    def scan_problems(self) -> list[Problem]:
        """Return the problems of the range files and the calibration."""
        if not self.scans():
            return [Problem("scene has no lidar/lidar_rng_00000.bin", where=str(self.folder))]
        problems: list[Problem] = []
        beams: int | None = None
        with gathered(problems):
            beams = len(self.beams().altitude)
        misfits = []
        for path in self.scans():
            with gathered(problems):
                rows = len(lidar.read_ranges(path))
                if beams not in (None, rows):
                    what = f"calibration of {beams} beams for {rows}, as {path.name}"
                    misfits.append(Problem(what, where=str(self.beams_file() or path)))
        # A scene's scans are all from one LIDAR, so one misfit is enough to report.
        return problems + misfits[:1]

    def depth_problems(self) -> list[Problem]:
        """Return the problems of range files, calibration and registration."""
        problems = self.scan_problems()
        where = str(self.registration)
        fix = f"dfdbench rig register {self.folder.name} --source {self.folder.parent}"
        if not self.registration.exists():
            problems.append(Problem("scene is not registered", where=where, fix=fix))
        else:
            with gathered(problems):
                registration.read_registration(self.registration)
        if not problems and not self.depth[1].any():
            what = "no LIDAR return falls on the image"
            problems.append(Problem(what, where=where, fix=f"{fix} --fresh"))
        return problems


def find_captured_scene(
    folder: Path, name: str, capture: Recording
) -> PublishedScene | RawScene | None:
    """Return a scene's files in whichever layout they are in; None if there is no such folder."""
    place = folder / name
    if (place / "frames").is_dir():
        return RawScene(place, capture)
    return PublishedScene(place, capture) if place.is_dir() else None


def _image_name(exposure_ms: int, step: int) -> str:
    return f"image_{step}_{exposure_ms}.00"


class RealworldFolder:
    """Scenes k00 to k63 in a folder, as published or as captured; layouts may be mixed.

    A manifest without a blur recipe pairs two voltage steps. One with a recipe takes the sharpest
    step of each exposure, and the build makes its defocus image.

    Parameters
    ----------
    manifest : Manifest
        With a section `capture`.
    folder : Path
        The folder with the scenes.
    pair : tuple of int, optional
        In-focus and defocus voltage step; by default the manifest's.

    Raises
    ------
    SourceError
        If the folder holds no scene of the manifest, or the pair is not available.
    """

    def __init__(
        self, manifest: Manifest, folder: Path, pair: tuple[int, int] | None = None
    ) -> None:
        if manifest.capture is None:
            raise SourceError("section is missing", where=f"{manifest.stem}: capture")
        self._manifest = manifest
        self._capture = manifest.capture
        self.captures_defocus = manifest.recipe is None
        self._steps = self._wanted_steps(pair)
        asked = list(self._steps) if self.captures_defocus else "sharpest"
        self.options: Mapping[str, Any] = {"pair": asked}
        found = {
            name: find_captured_scene(folder, name, self._capture) for name in manifest.scene_names
        }
        self._scenes = {name: files for name, files in found.items() if files}
        if not self._scenes:
            there = "a file" if folder.exists() else "no such folder"
            what = "no scene found, such as k33 with left/exp_30 and lidar"
            raise SourceError(what, where=str(folder), got="none" if folder.is_dir() else there)

    @property
    def problems(self) -> tuple[Problem, ...]:
        """Everything that keeps pairs from being built, for every scene that is there."""
        # Scenes may share a calibration, whose problem is reported once.
        found = (problem for _, problems in self._checked.values() for problem in problems)
        return tuple(dict.fromkeys(found))

    def available_pairs(self) -> tuple[Pair, ...]:
        """Return the pairs whose images and depth map are there and intact."""
        return tuple(
            pair
            for pair in self._manifest.pairs()
            if pair.scene in self._scenes and pair.at["exposure_ms"] in self._checked[pair.scene][0]
        )

    def signature(self, scene: str) -> str:
        """Return the SHA-256 over the scene's files that a build reads."""
        files = self._scenes[scene]
        digest = hashlib.sha256(type(files).__name__.encode())
        images = starmap(files.images, product(self._checked[scene][0], self._steps))
        for path in chain(*images, files.depth_files()):
            digest.update(path.name.encode())
            digest.update(hashlib.sha256(path.read_bytes()).digest())
        return digest.hexdigest()

    def read(self, scene: str) -> SceneImages:
        """Read one scene."""
        files = self._scenes[scene]
        levels, valid = files.depth
        found: dict[Pair, NDArray[np.uint8]] = {}
        for exposure in self._checked[scene][0]:
            steps = self._steps
            if not self.captures_defocus:
                # 3.2.5: find the sharpest in whole frames first, then crop.
                steps = (steps[sharpest([files.frame(exposure, step) for step in steps])],)
            images = np.stack([files.image(exposure, step) for step in steps])
            found[Pair(scene, (("exposure_ms", exposure),))] = images
        laid, available = laid_out(self._manifest, found)
        whole = not self.captures_defocus
        depth = in_direction_of(levels, valid, self._manifest.depth, whole)
        defocus = laid[:, -1] if self.captures_defocus else None
        return SceneImages.of_pairs(laid[:, 0], depth, valid, available, defocus)

    def missing_help(self, missing: tuple[Pair, ...]) -> str:
        """Return what is wrong with the scenes that are there, and how to continue."""
        if not self.problems:
            return "add the scenes that are missing; --allow-missing accepts what is there"
        whole = sum(bool(exposures) for exposures, _ in self._checked.values())
        accepted = f"; --allow-missing builds the {whole} scenes that can be" if whole else ""
        numbered = (f"{number}. {problem}" for number, problem in enumerate(self.problems, 1))
        return "\n".join((f"mend what is named below{accepted}", *numbered))

    @cached_property
    def _checked(self) -> dict[str, tuple[tuple[int, ...], list[Problem]]]:
        # Check every file before using any, so that all problems are reported together.
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
        if not self.captures_defocus:
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
    """Convert the rig's levels, which are distances, to the direction that a manifest states.

    By Eq. 7.1, near is bright, as in Middlebury's maps.

    Parameters
    ----------
    levels : ndarray of uint8, shape (y, x)
        Centimetres.
    valid : ndarray of bool, shape (y, x)
        True where the distance is known.
    depth : Depth
        The manifest's section.
    whole : bool
        Whether to invert pixels without a return too, as the thesis did for what it blurred.

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
