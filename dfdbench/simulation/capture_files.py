"""Write simulated captures as the rig would: scenes with a LIDAR, and the lens test (7.2.1)."""

import json
import shutil
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from dfdbench.datasets.manifest import Recording
from dfdbench.errors import InputError, Problem
from dfdbench.optics.lens_table import LensTable, read_lens_table
from dfdbench.rig.geometry import CaptureRig, Pose
from dfdbench.rig.lidar import average_scans, read_beams, write_ranges
from dfdbench.rig.registration import NAME, write_registration
from dfdbench.rig.sighting import board_rays
from dfdbench.simulation.board_scene import MOUNTED, SimulatedScene, defocus
from dfdbench.simulation.photographs import near_normal_numbers
from dfdbench.system.files import write_whole
from dfdbench.system.parallel import Threads

TRUTH = "truth"
_SETTINGS = "simulated.json"
_VERSION = 1

# The lens test: a white dot, over temperature and voltage.
_DOT_SEED = 20190807
_DOT_SIZE = 96
_DOT = 5.0  # pixels: 5 mm across at 1 m
_DISTANCE = 1.0  # metres
_BLACK, _WHITE = 12.0, 230.0  # levels
_COLD, _WARM, _TEMPERATURES = 27.25, 54.75, 12  # °C
_WARMED_STEP = 135
_LAG = 0.6  # voltage steps by which the lens trails on its way up and down
_COLD_BLUR = 1.5  # pixels more when cold
_COLD_NOISE, _WARM_NOISE = 0.6, 1.2  # levels


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
    capture: Recording,
    settings: CaptureSettings,
    workers: int = 1,
    on_scene: Callable[[int, int], None] | None = None,
) -> tuple[str, ...]:
    """Write scenes into ``folder/kNN`` and their truth into ``folder/truth/kNN``.

    A complete scene with the same settings is kept, so that a stopped call resumes.

    Parameters
    ----------
    folder : Path
        Where to.
    scenes : sequence of str
        k00 to k63.
    capture : Recording
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
        If a scene's folder holds something else; then nothing is changed.
    """
    wanted = json.dumps({"version": _VERSION, **asdict(settings)}, indent=1) + "\n"
    InputError.raise_if([p for name in scenes if (p := _foreign(folder / name, wanted))])
    left = [name for name in scenes if not (folder / name).exists()]
    table = read_lens_table()

    def progress(done: int, _: int) -> None:
        if on_scene:
            on_scene(len(scenes) - len(left) + done, len(scenes))

    height, width = capture.frame_size
    rig = CaptureRig(frame_size=(height, width), crop_size=capture.crop_size)

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
    matrix = rays.matrix(scene.pose, scene.rig)
    write_registration(truth / NAME, matrix, rays.corners(), "the truth of the simulation")


def write_png(path: Path, image: NDArray[np.uint8] | NDArray[np.uint16]) -> None:
    """Write an image, RGB or grey, 8 or 16 bit, as PNG."""
    path.parent.mkdir(parents=True, exist_ok=True)
    stored = image[:, :, ::-1] if image.ndim == 3 else image
    # Noise hardly shrinks: the fastest compression is as good as the best.
    done, content = cv2.imencode(".png", stored, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    if not done:
        raise InputError("cannot encode the image", where=str(path), got=str(image.dtype))
    path.write_bytes(content.tobytes())


def _foreign(place: Path, wanted: str) -> Problem | None:
    settings = place / _SETTINGS
    if not place.exists() or (settings.exists() and settings.read_text("utf-8") == wanted):
        return None
    what = "a simulation with other settings" if settings.exists() else "captures of another kind"
    fix = "choose another with --out DIR"
    return Problem(f"the folder holds {what}", where=str(place), fix=fix)


def write_lens_test(folder: Path) -> int:
    """Write a lens test's captures; return how many images that is.

    Parameters
    ----------
    folder : Path
        Gets ``temperature``, ``up`` and ``down``, as `dfdbench.optics.sharpness` reads them.
    """
    table = read_lens_table()
    images: dict[str, NDArray[np.uint8]] = {}
    radius = float(table.radius_at(_WARMED_STEP, _DISTANCE))
    for number, degrees in enumerate(np.linspace(_COLD, _WARM, _TEMPERATURES)):
        cold = (_WARM - degrees) / (_WARM - _COLD)
        noise = _WARM_NOISE + cold * (_COLD_NOISE - _WARM_NOISE)
        name = f"temperature/image_{_WARMED_STEP}_40.00_{degrees:.2f}.png"
        images[name] = _dot(radius + cold * _COLD_BLUR, noise, (_DOT_SEED, 0, number))
    for way, (direction, lag) in enumerate((("up", -_LAG), ("down", _LAG)), start=1):
        for step in table.steps:
            dot = _dot(_radius_between(table, step + lag), _WARM_NOISE, (_DOT_SEED, way, step))
            images[f"{direction}/image_{step}_30.00.png"] = dot
    for name, image in images.items():
        write_png(folder / name, image)
    return len(images)


def _radius_between(table: LensTable, step: float) -> float:
    radii = [float(table.radius_at(known, _DISTANCE)) for known in table.steps]
    return float(np.interp(step, table.steps, radii))


def _dot(blur: float, noise: float, seed: tuple[int, ...]) -> NDArray[np.uint8]:
    # A dot seen through a disc: its rim fades over the disc's width, and its middle with it.
    y, x = np.mgrid[:_DOT_SIZE, :_DOT_SIZE] - (_DOT_SIZE - 1) / 2
    share = np.clip((_DOT + blur - np.hypot(x, y)) / (2 * blur), 0, 1)
    share *= min(1.0, _DOT**2 / max(blur, 1e-9) ** 2)
    levels = _BLACK + (_WHITE - _BLACK) * share
    noisy = levels + noise * near_normal_numbers(levels.shape, seed)
    return np.asarray(np.clip(np.rint(noisy), 0, 255), np.uint8)
