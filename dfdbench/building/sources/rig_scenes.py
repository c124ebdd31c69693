"""One scene of the capture rig on disk, raw or as published: what is there, and what is wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.recipe import LAST_LEVEL
from dfdbench.building.sources.image_files import Image, average_frames, image_problems, read_rgb
from dfdbench.building.sources.interface import gathered
from dfdbench.datasets.manifest import Recording
from dfdbench.errors import Problem
from dfdbench.rig.geometry import CaptureRig
from dfdbench.rig.lidar import Beams, average_scans, depth_image, read_beams, read_ranges, warp
from dfdbench.rig.registration import NAME as REGISTRATION
from dfdbench.rig.registration import read_registration

Depth = tuple[NDArray[np.uint8], NDArray[np.bool_]]


class PublishedScene:
    """A scene as published: ``left/exp_30/image_141_30.00.png``, ``lidar/..._8bit_x6.png``.

    Parameters
    ----------
    folder : Path
        The scene's.
    capture : Recording
        Of the manifest.
    """

    def __init__(self, folder: Path, capture: Recording) -> None:
        self.folder = folder
        self._capture = capture

    def exposures(self) -> tuple[int, ...]:
        """Return the exposure times, in ms, of which there are images."""
        return _exposures(self.folder / "left")

    def images(self, exposure_ms: int, step: int) -> list[Path]:
        """Return the one file of an image; none where it is missing."""
        path = _exposure_folder(self.folder / "left", exposure_ms)
        return [file for file in [path / f"{_image_name(exposure_ms, step)}.png"] if file.exists()]

    def image(self, exposure_ms: int, step: int) -> Image:
        """Return one image, RGB."""
        return read_rgb(self.images(exposure_ms, step)[0])

    def frame(self, exposure_ms: int, step: int) -> Image:
        """Return all that is published of an image's frame: what was left of it by the crop."""
        return self.image(exposure_ms, step)

    def depth(self) -> Depth:
        """Return depth levels in centimetres and where they are known."""
        levels = np.ascontiguousarray(read_rgb(self.depth_files()[0])[..., 0])
        return levels, (levels > 0) & (levels < LAST_LEVEL)

    def depth_files(self) -> list[Path]:
        """Return the LIDAR's depth map."""
        found = sorted((self.folder / "lidar").glob("lidar_rng_*_8bit*.png"))
        return sorted(found, key=lambda path: not path.stem.endswith("_x6"))[:1]

    def image_problems(self, exposure_ms: int, step: int) -> list[Problem]:
        """Return what is wrong with an image's file, found without decoding it."""
        return image_problems(self.images(exposure_ms, step), (self._capture.crop_size,) * 2)

    def depth_problems(self) -> list[Problem]:
        """Return what is wrong with the depth map's file."""
        files = self.depth_files()
        if not files:
            what = "scene has no LIDAR depth map, lidar/lidar_rng_left_00000_8bit_x6.png"
            return [Problem(what, where=str(self.folder))]
        return image_problems(files, (self._capture.crop_size,) * 2)


class RawScene:
    """A scene as captured: ``frames/exp_30/image_141_30.00_0.png``, ``lidar/lidar_rng_00000.bin``.

    Parameters
    ----------
    folder : Path
        The scene's; its ``beams.csv``, or the one beside it, replaces the thesis's calibration.
    capture : Recording
        Of the manifest.
    """

    def __init__(self, folder: Path, capture: Recording) -> None:
        self.folder = folder
        self._capture = capture
        height, width = capture.frame_size
        self.rig = CaptureRig(frame_size=(height, width), crop_size=capture.crop_size)
        self._depth: Depth | None = None

    def exposures(self) -> tuple[int, ...]:
        """Return the exposure times, in ms, of which there are frames."""
        return _exposures(self.folder / "frames")

    def images(self, exposure_ms: int, step: int) -> list[Path]:
        """Return the frames of one image."""
        folder = _exposure_folder(self.folder / "frames", exposure_ms)
        return sorted(folder.glob(f"{_image_name(exposure_ms, step)}_*.png"))

    def steps(self, exposure_ms: int) -> tuple[int, ...]:
        """Return the voltage steps of which there are frames at an exposure."""
        folder = _exposure_folder(self.folder / "frames", exposure_ms)
        names = [path.name.split("_") for path in folder.glob("image_*_*.png")]
        return tuple(sorted({int(parts[1]) for parts in names if parts[1].isdigit()}))

    def frame(self, exposure_ms: int, step: int) -> Image:
        """Return the average of an image's frames, not cropped."""
        frames = [read_rgb(path) for path in self.images(exposure_ms, step)]
        return average_frames(frames)

    def image(self, exposure_ms: int, step: int) -> Image:
        """Return the average of an image's frames, cropped."""
        return np.asarray(self.rig.crop(self.frame(exposure_ms, step)), np.uint8)

    def ranges(self) -> NDArray[np.float64]:
        """Return the average of the LIDAR's scans, in mm."""
        return average_scans([read_ranges(path) for path in self.scans()])

    def beams(self) -> Beams:
        """Return where the beams point: the scene's calibration, the folder's, or the thesis's."""
        return read_beams(self.beams_file())

    def depth(self) -> Depth:
        """Return depth levels in centimetres and where they are known; worked out once."""
        if self._depth is None:
            levels, valid = depth_image(self.ranges(), self.beams())
            size = self._capture.crop_size
            matrix = read_registration(self.registration)
            self._depth = warp(levels, valid, matrix, (size, size))
        return self._depth

    def scans(self) -> list[Path]:
        """Return the LIDAR's range files."""
        folder = self.folder / "lidar"
        return sorted([*folder.glob("lidar_rng_*.bin"), *folder.glob("lidar_rng_*.npy")])

    def beams_file(self) -> Path | None:
        """Return the calibration's file, None for the thesis's."""
        places = (self.folder / "beams.csv", self.folder.parent / "beams.csv")
        return next((path for path in places if path.exists()), None)

    @property
    def registration(self) -> Path:
        """Where the transform to the image is kept."""
        return self.folder / REGISTRATION

    def depth_files(self) -> list[Path]:
        """Return range files, calibration and registration."""
        beams = self.beams_file()
        return [*self.scans(), *([beams] if beams else []), self.registration]

    def image_problems(self, exposure_ms: int, step: int) -> list[Problem]:
        """Return what is wrong with an image's frames, found without decoding them."""
        files = self.images(exposure_ms, step)
        problems = image_problems(files, tuple(self._capture.frame_size))
        if len(files) != self._capture.frames:
            name = _image_name(exposure_ms, step)
            place = _exposure_folder(self.folder / "frames", exposure_ms) / f"{name}_*.png"
            what = f"only {len(files)} of {self._capture.frames} frames"
            problems.append(Problem(what, where=str(place)))
        return problems

    def scan_problems(self) -> list[Problem]:
        """Return what is wrong with the range files and the calibration."""
        if not self.scans():
            return [Problem("scene has no lidar/lidar_rng_00000.bin", where=str(self.folder))]
        problems: list[Problem] = []
        beams: int | None = None
        with gathered(problems):
            beams = len(self.beams().altitude)
        misfits = []
        for path in self.scans():
            with gathered(problems):
                rows = len(read_ranges(path))
                if beams not in (None, rows):
                    what = f"calibration of {beams} beams for {rows}, as {path.name}"
                    misfits.append(Problem(what, where=str(self.beams_file() or path)))
        # The scans of a scene are of one LIDAR: one misfit says it all.
        return problems + misfits[:1]

    def depth_problems(self) -> list[Problem]:
        """Return what is wrong with range files, calibration and registration."""
        problems = self.scan_problems()
        where = str(self.registration)
        fix = f"dfdbench rig register {self.folder.name} --source {self.folder.parent}"
        if not self.registration.exists():
            problems.append(Problem("scene is not registered", where=where, fix=fix))
        else:
            with gathered(problems):
                read_registration(self.registration)
        if not problems and not self.depth()[1].any():
            what = "no LIDAR return falls on the image"
            problems.append(Problem(what, where=where, fix=f"{fix} --fresh"))
        return problems


def find_captured_scene(
    folder: Path, name: str, capture: Recording
) -> PublishedScene | RawScene | None:
    """Return a scene's files in the layout that they are in; None where there is no such folder."""
    place = folder / name
    if (place / "frames").is_dir():
        return RawScene(place, capture)
    return PublishedScene(place, capture) if place.is_dir() else None


def _exposures(folder: Path) -> tuple[int, ...]:
    names = (place.name.removeprefix("exp_") for place in folder.glob("exp_*") if place.is_dir())
    return tuple(sorted({int(name) for name in names if name.isdigit()}))


def _exposure_folder(folder: Path, exposure_ms: int) -> Path:
    # The thesis's folders are exp_10 to exp_70; a leading zero is as good.
    padded = folder / f"exp_{exposure_ms:02d}"
    return padded if padded.is_dir() else folder / f"exp_{exposure_ms}"


def _image_name(exposure_ms: int, step: int) -> str:
    return f"image_{step}_{exposure_ms}.00"
