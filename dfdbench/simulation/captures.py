"""Write simulated captures as the rig would: frames and range files, a folder a scene."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from dfdbench.datasets.manifest import Capture
from dfdbench.errors import InputError, Problem
from dfdbench.optics.lens_table import LensTable, read_lens_table
from dfdbench.rig.board_rays import board_rays
from dfdbench.rig.geometry import Pose, Rig
from dfdbench.rig.lidar import average_scans
from dfdbench.rig.lidar_files import read_beams, write_ranges
from dfdbench.rig.registration_file import NAME, write_registration
from dfdbench.simulation.board_scene import MOUNTED, SimulatedScene, defocus
from dfdbench.system.files import write_whole
from dfdbench.system.parallel import Threads

TRUTH = "truth"
_SETTINGS = "simulated.json"
_VERSION = 1


@dataclass(frozen=True)
class CaptureSettings:
    """What is simulated of each scene.

    Parameters
    ----------
    steps : tuple of int
        Voltage steps.
    exposures : tuple of int
        In milliseconds.
    frames, scans : int
        Frames of an image, scans of the LIDAR.
    pose : Pose
        How the LIDAR is turned on its mount.
    """

    steps: tuple[int, ...]
    exposures: tuple[int, ...]
    frames: int = 4
    scans: int = 5
    pose: Pose = MOUNTED


def write_captures(
    folder: Path,
    scenes: Sequence[str],
    capture: Capture,
    settings: CaptureSettings,
    workers: int = 1,
    on_scene: Callable[[int, int], None] | None = None,
) -> tuple[str, ...]:
    """Write scenes into ``folder/kNN`` and their truth into ``folder/truth/kNN``.

    A scene that lies there whole with the same settings is kept, so that a stopped call goes on.

    Parameters
    ----------
    folder : Path
        Where to.
    scenes : sequence of str
        k00 to k63.
    capture : Capture
        Sizes, of the manifest.
    settings : CaptureSettings
        What is simulated.
    workers : int
        Scenes made at once; the files do not depend on it.
    on_scene : callable, optional
        Called with (scenes done, scenes in all).

    Returns
    -------
    tuple of str
        The scenes written now.

    Raises
    ------
    InputError
        Where a scene's folder holds something else; nothing is changed then.
    """
    wanted = json.dumps({"version": _VERSION, **asdict(settings)}, indent=1) + "\n"
    problems = [problem for name in scenes for problem in _foreign(folder / name, wanted)]
    if problems:
        raise InputError.of(problems)
    left = [name for name in scenes if not (folder / name).exists()]
    table = read_lens_table()

    def progress(done: int, _: int) -> None:
        if on_scene:
            on_scene(len(scenes) - len(left) + done, len(scenes))

    height, width = capture.frame_size
    rig = Rig(frame_size=(height, width), crop_size=capture.crop_size)

    def write(name: str) -> None:
        scene = SimulatedScene(int(name.removeprefix("k")), rig, settings.pose)
        partial = folder / f".{name}.partial"
        shutil.rmtree(partial, ignore_errors=True)
        _write_scene(scene, partial, folder / TRUTH / name, table, settings)
        write_whole(partial / _SETTINGS, wanted)
        partial.rename(folder / name)

    Threads(workers).map(write, left, on_done=progress)
    return tuple(left)


def _write_scene(
    scene: SimulatedScene, place: Path, truth: Path, table: LensTable, settings: CaptureSettings
) -> None:
    beams = read_beams()
    scans = [scene.scan(beams, number) for number in range(settings.scans)]
    for number, ranges in enumerate(scans):
        write_ranges(place / "lidar" / f"lidar_rng_{number:05d}.bin", ranges)
    view = scene.look()
    for step in settings.steps:
        light = defocus(view, table, step)
        for exposure in settings.exposures:
            for number in range(settings.frames):
                frame = scene.frame(light, exposure, (step, exposure, number))
                name = f"image_{step}_{exposure}.00_{number}.png"
                write_png(place / "frames" / f"exp_{exposure}" / name, frame)
    write_png(truth / "distance_mm.png", scene.truth(view))
    rays = board_rays(average_scans(scans), beams)
    write_registration(
        truth / NAME,
        rays.matrix(scene.pose, scene.rig),
        rays.corners(),
        "the truth of the simulation",
    )


def write_png(path: Path, image: NDArray[np.uint8] | NDArray[np.uint16]) -> None:
    """Write an image, RGB or grey, 8 or 16 bit, as PNG."""
    path.parent.mkdir(parents=True, exist_ok=True)
    stored = image[:, :, ::-1] if image.ndim == 3 else image
    # Noise hardly shrinks: the fastest compression is as good as the best.
    done, content = cv2.imencode(".png", stored, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    if not done:
        raise InputError("cannot encode the image", where=str(path), got=str(image.dtype))
    path.write_bytes(content.tobytes())


def _foreign(place: Path, wanted: str) -> list[Problem]:
    if not place.exists():
        return []
    settings = place / _SETTINGS
    if settings.exists() and settings.read_text("utf-8") == wanted:
        return []
    what = "a simulation with other settings" if settings.exists() else "captures of another kind"
    return [
        Problem(f"the folder holds {what}", where=str(place), fix="choose another with --out DIR")
    ]
