"""Read the thesis's captures: two voltage steps a pair, or the sharpest step to be blurred."""

import hashlib
from dataclasses import replace
from itertools import chain, product, starmap
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.recipe import LAST_LEVEL
from dfdbench.building.sources import SceneError, SceneImages, gathered, laid_out
from dfdbench.building.sources.image_files import Image, average_frames, read_rgb
from dfdbench.datasets.manifest import Depth, Manifest, Pair, Recording
from dfdbench.errors import Problem, SourceError
from dfdbench.optics.sharpness import sharpest
from dfdbench.rig import geometry, lidar, registration
from dfdbench.tables.table import listed

LevelsAndKnown = tuple[NDArray[np.uint8], NDArray[np.bool_]]


class CapturedScene:
    """What both layouts of a scene have in common.

    Parameters
    ----------
    folder : Path
        The scene's.
    frames : int
        How many files an image has.
    rig : CaptureRig
        Size of a file's image, and what is kept of it.
    """

    #: Where its images are, a folder an exposure, and how their files' names end.
    inside: str
    ending: str

    def __init__(self, folder: Path, frames: int, rig: geometry.CaptureRig) -> None:
        self.folder, self.frames, self.rig = folder, frames, rig

    def exposures(self) -> tuple[int, ...]:
        """Return the exposure times, in ms, of which there are images."""
        places = (self.folder / self.inside).glob("exp_*")
        names = (place.name.removeprefix("exp_") for place in places if place.is_dir())
        return tuple(sorted({int(name) for name in names if name.isdigit()}))

    def images(self, exposure_ms: int, step: int) -> list[Path]:
        """Return the files of one image; none where it is missing."""
        pattern = f"image_{step}_{exposure_ms}.00{self.ending}"
        return sorted(self._place_of(exposure_ms).glob(pattern))

    def frame(self, exposure_ms: int, step: int) -> Image:
        """Return the average of an image's files, RGB, not cropped.

        Raises
        ------
        SourceError
            Where files are missing, damaged or of another size.
        """
        files = self.images(exposure_ms, step)
        if len(files) != self.frames:
            where = f"{self._place_of(exposure_ms)}, step {step}"
            raise SourceError(f"only {len(files)} of {self.frames} frames", where=where)
        return average_frames([read_rgb(path, self.rig.frame_size) for path in files])

    def _place_of(self, exposure_ms: int) -> Path:
        # The thesis's folders are exp_10 to exp_70; a leading zero is as good.
        inside = self.folder / self.inside
        padded = inside / f"exp_{exposure_ms:02d}"
        return padded if padded.is_dir() else inside / f"exp_{exposure_ms}"


class PublishedScene(CapturedScene):
    """A scene as published: ``left/exp_30/image_141_30.00.png``, ``lidar/..._8bit_x6.png``."""

    inside, ending = "left", ".png"

    def __init__(self, folder: Path, capture: Recording) -> None:
        size = capture.crop_size
        super().__init__(folder, 1, geometry.CaptureRig(frame_size=(size, size), crop_size=size))

    @property
    def depth(self) -> LevelsAndKnown:
        """Depth levels in centimetres and where they are known."""
        files = self.depth_files()
        if not files:
            what = "scene has no LIDAR depth map, lidar/lidar_rng_left_00000_8bit_x6.png"
            raise SourceError(what, where=str(self.folder))
        levels = np.ascontiguousarray(read_rgb(files[0], self.rig.frame_size)[..., 0])
        return levels, (levels > 0) & (levels < LAST_LEVEL)

    def depth_files(self) -> list[Path]:
        """Return the LIDAR's depth map."""
        found = sorted((self.folder / "lidar").glob("lidar_rng_*_8bit*.png"))
        return sorted(found, key=lambda path: not path.stem.endswith("_x6"))[:1]


class RawScene(CapturedScene):
    """A scene as captured: ``frames/exp_30/image_141_30.00_0.png``, ``lidar/lidar_rng_00000.bin``.

    Parameters
    ----------
    folder : Path
        The scene's; its ``beams.csv``, or the one beside it, replaces the thesis's calibration.
    capture : Recording
        Of the manifest.
    """

    inside, ending = "frames", "_*.png"

    def __init__(self, folder: Path, capture: Recording) -> None:
        height, width = capture.frame_size
        rig = geometry.CaptureRig(frame_size=(height, width), crop_size=capture.crop_size)
        super().__init__(folder, capture.frames, rig)
        #: Where the transform to the image is kept.
        self.registration = folder / registration.NAME

    def steps(self, exposure_ms: int) -> tuple[int, ...]:
        """Return the voltage steps of which there are frames at an exposure."""
        files = self._place_of(exposure_ms).glob("image_*_*.png")
        names = [path.name.split("_") for path in files]
        return tuple(sorted({int(parts[1]) for parts in names if parts[1].isdigit()}))

    def ranges(self) -> NDArray[np.float64]:
        """Return the average of the LIDAR's scans, in mm.

        Raises
        ------
        SourceError
            Where there are none, or a scan or the calibration is damaged or does not fit.
        """
        files = self.scans()
        if not files:
            raise SourceError("scene has no lidar/lidar_rng_00000.bin", where=str(self.folder))
        scans = [lidar.read_ranges(path) for path in files]
        beams, rows = len(self.beams().altitude), len(scans[0])
        if beams != rows:
            what = f"calibration of {beams} beams for {rows}, as {files[0].name}"
            raise SourceError(what, where=str(self.beams_file() or files[0]))
        return lidar.average_scans(scans)

    def beams(self) -> lidar.Beams:
        """Return where the beams point: the scene's calibration, the folder's, or the thesis's."""
        return lidar.read_beams(self.beams_file())

    @property
    def depth(self) -> LevelsAndKnown:
        """Depth levels in centimetres and where they are known."""
        where = str(self.registration)
        fix = f"dfdbench rig register {self.folder.name} --source {self.folder.parent}"
        seen = lidar.depth_image(self.ranges(), self.beams())
        if not self.registration.exists():
            raise SourceError("scene is not registered", where=where, fix=fix)
        matrix = registration.read_registration(self.registration)
        levels, valid = lidar.warp(*seen, matrix, (self.rig.crop_size,) * 2)
        if not valid.any():
            what = "no LIDAR return falls on the image"
            raise SourceError(what, where=where, fix=f"{fix} --fresh")
        return levels, valid

    def scans(self) -> list[Path]:
        """Return the LIDAR's range files."""
        folder = self.folder / "lidar"
        return sorted([*folder.glob("lidar_rng_*.bin"), *folder.glob("lidar_rng_*.npy")])

    def beams_file(self) -> Path | None:
        """Return the calibration's file, None for the thesis's."""
        places = (self.folder / "beams.csv", self.folder.parent / "beams.csv")
        return next((path for path in places if path.exists()), None)

    def depth_files(self) -> list[Path]:
        """Return those of range files, calibration and registration that are there."""
        others = (self.beams_file(), self.registration)
        return [*self.scans(), *(path for path in others if path and path.exists())]


def find_captured_scene(
    folder: Path, name: str, capture: Recording
) -> PublishedScene | RawScene | None:
    """Return a scene's files in the layout that they are in; None where there is no such folder."""
    place = folder / name
    if (place / "frames").is_dir():
        return RawScene(place, capture)
    return PublishedScene(place, capture) if place.is_dir() else None


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
        #: Which voltage steps make a pair.
        self.options = {"pair": "sharpest" if self._synthetic else list(self._steps)}
        self.captures_defocus = not self._synthetic
        found = {
            name: find_captured_scene(folder, name, self._capture) for name in manifest.scene_names
        }
        self._scenes = {name: files for name, files in found.items() if files}
        if not self._scenes:
            what = "no scene found, such as k33 with left/exp_30 and lidar"
            raise SourceError(what, where=str(folder))

    def available_pairs(self) -> tuple[Pair, ...]:
        """Return the pairs whose images are there."""
        usable = {name: self._exposures(name) for name in self._scenes}
        return tuple(
            pair
            for pair in self._manifest.pairs()
            if pair.at["exposure_ms"] in usable.get(pair.scene, ())
        )

    def signature(self, scene: str) -> str:
        """Return the SHA-256 over the scene's files that a build reads."""
        files = self._scenes[scene]
        digest = hashlib.sha256(type(files).__name__.encode())
        images = starmap(files.images, product(self._exposures(scene), self._steps))
        for path in chain(*images, files.depth_files()):
            digest.update(path.name.encode())
            digest.update(hashlib.sha256(path.read_bytes()).digest())
        return digest.hexdigest()

    def read(self, scene: str) -> SceneImages:
        """Read one scene."""
        files, problems = self._scenes[scene], list[Problem]()
        found: dict[Pair, NDArray[np.uint8]] = {}
        with gathered(problems):
            levels, valid = files.depth
        for exposure in self._exposures(scene):
            frames = []
            for step in self._steps:
                with gathered(problems):
                    frames.append(files.frame(exposure, step))
            if not problems:
                # 3.2.5: the sharpest is found first, in whole frames, and cropped then.
                chosen = [frames[sharpest(frames)]] if self._synthetic else frames
                images = np.stack([np.asarray(files.rig.crop(one), np.uint8) for one in chosen])
                found[Pair(scene, (("exposure_ms", exposure),))] = images
        SceneError.raise_if(replace(p, where=p.where or str(files.folder)) for p in problems)
        laid, available = laid_out(self._manifest, found)
        depth = in_direction_of(levels, valid, self._manifest.depth, whole=self._synthetic)
        defocus = None if self._synthetic else laid[:, -1]
        return SceneImages.of_pairs(laid[:, 0], depth, valid, available, defocus)

    def missing_help(self, missing: tuple[Pair, ...]) -> str:
        """Return what to do about pairs that are missing."""
        steps = listed(self._steps, 3)
        return f"add the images of steps {steps}, or accept what is there: --allow-missing"

    def _exposures(self, scene: str) -> list[int]:
        files = self._scenes[scene]
        return [
            exposure
            for exposure in self._manifest.axes["exposure_ms"]
            if all(files.images(exposure, step) for step in self._steps)
        ]

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
