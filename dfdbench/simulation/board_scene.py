"""Simulate the capture rig: boards with photographs on them, seen by camera and LIDAR.

It produces what the rig would write, and the truth that the pipeline must recover.
"""

import json
import shutil
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from statistics import NormalDist

import cv2
import numpy as np
from numpy.typing import NDArray

from dfdbench.datasets.manifest import Recording
from dfdbench.errors import InputError, Problem
from dfdbench.optics.lens_table import LensTable, read_lens_table
from dfdbench.rig.geometry import CaptureRig, Pose, beam_directions
from dfdbench.rig.lidar import Beams, average_scans, read_beams, write_ranges
from dfdbench.rig.registration import NAME, write_registration
from dfdbench.rig.sighting import board_rays
from dfdbench.simulation.photographs import near_normal_numbers, photograph
from dfdbench.simulation.raycast import Board, Floats, Texture, View, fields_of, look
from dfdbench.system.files import write_whole, writing_folder
from dfdbench.system.parallel import Threads

RIG = CaptureRig()
#: The simulated LIDAR's rotation on its mount, which registration has to find.
MOUNTED = Pose(yaw=0.55, pitch=-0.35, roll=0.9)

_SEED = 20190806
_WALL = 3.2  # metres
_WALL_GREY = 0.16
_WHITE_AT = 55.0  # ms: exposure at which a white surface fills the sensor
_READ_NOISE = 1.0  # levels of 255
_NOISE_AT_GREY = 3.1  # levels of 255, standard deviation at half signal
_CONVERTER_STEPS = 1023  # 10 bit
_RADIUS_STEP = 0.25  # pixels: blur radii are rounded to this
# Light and discs are whole multiples of 1 / _PARTS, so that float64 holds their sums exactly: they
# are the same in whatever order a processor adds them.
_PARTS = 2.0**20
_RANGE_NOISE = 15.0  # mm, one scan
_LOST_ABOVE = NormalDist().inv_cdf(1 - 0.02)  # one scan misses a fiftieth of the returns
_TURN = 2048
_ROOM = (3.0, 1.4, _WALL)  # metres from the LIDAR to the walls: aside, up and down, fore and aft

_BOARDS = resources.files("dfdbench.simulation").joinpath("boards.toml").read_text("utf-8")
_TEXTURES = tuple(Texture(**fields_of(each)) for each in tomllib.loads(_BOARDS)["textures"])

#: k00 to k63: each texture on four geometries.
SCENES = 4 * len(_TEXTURES)
_WIDTH, _HEIGHT = 672, 654  # pixels that a board covers: more than the crop, less than a frame
_FLAT_NEAR, _FLAT_FAR = 1.5, 2.5  # metres
_OBLIQUE_NEAR, _OBLIQUE_FAR = 1.5, 2.2
_OBLIQUE_HEIGHT = 0.6
# Rays that never come back: a strip of mirror on the board, in the board's own metres.
_MIRROR = (0.06, 0.11, -0.02, 0.04)


@dataclass(frozen=True)
class SimulatedScene:
    """One board in front of a wall.

    Parameters
    ----------
    number : int
        0 to 63: 16 textures of 4 geometries each, as k00 to k63 (thesis, 3.2.4).
    rig : CaptureRig
        Camera and mount.
    pose : Pose
        The LIDAR's rotation.
    """

    number: int
    rig: CaptureRig = RIG
    pose: Pose = MOUNTED

    @property
    def board(self) -> Board:
        """The board: flat at 2.5 m, oblique with its near side left or right, flat at 1.5 m."""
        texture = _TEXTURES[self.number // 4 % len(_TEXTURES)]
        geometry = self.number % 4
        if geometry in (0, 3):
            distance = _FLAT_FAR if geometry == 0 else _FLAT_NEAR
            metre = distance / self.rig.focal_length
            return Board((0.0, 0.0, distance), (_WIDTH * metre, _HEIGHT * metre), texture)
        half = _WIDTH / 2 / self.rig.focal_length
        near, far = half * _OBLIQUE_NEAR, half * _OBLIQUE_FAR
        width, middle = near + far, (far - near) / 2
        slant = (_OBLIQUE_FAR - _OBLIQUE_NEAR) / width
        side = 1 if geometry == 1 else -1
        centre = (side * middle, 0.0, (_OBLIQUE_NEAR + _OBLIQUE_FAR) / 2)
        return Board(centre, (width, _OBLIQUE_HEIGHT), texture, slant=side * slant)

    def look(self) -> View:
        """Return what the camera sees before its lens blurs it; four rays per pixel for colour."""
        wall = Board((0.0, 0.0, _WALL), (40.0, 40.0), Texture("wall", 1.0))
        name = self.board.texture.photograph
        photographs = {name: photograph(name), "wall": np.full((2, 2, 3), _WALL_GREY)}
        surfaces, rig = (self.board, wall), self.rig
        return look(surfaces, photographs, 0.0, rig.frame_size, rig.focal_length)

    def frame(self, light: Floats, exposure_ms: int, seed: tuple[int, ...]) -> NDArray[np.uint8]:
        """Return one captured frame: exposure, noise, saturation, 10-bit converter, 8-bit file.

        Parameters
        ----------
        light : ndarray of float, shape (y, x, 3)
            The light that reaches the sensor; 1 is a white surface.
        exposure_ms : int
            In milliseconds.
        seed : tuple of int
            Seed of the noise, together with the scene's number.
        """
        signal = light * (exposure_ms / _WHITE_AT)
        shot = (_NOISE_AT_GREY**2 - _READ_NOISE**2) / 0.5
        spread = np.sqrt(_READ_NOISE**2 + shot * np.clip(signal, 0, 1)) / 255
        noisy = signal + spread * near_normal_numbers(light.shape, (_SEED, self.number, *seed))
        steps = np.rint(np.clip(noisy, 0, 1) * _CONVERTER_STEPS)
        return (steps.astype(np.int64) >> 2).astype(np.uint8)

    def scan(self, beams: Beams, number: int) -> NDArray[np.int32]:
        """Return one LIDAR scan: ranges in mm with noise, 0 if nothing came back.

        Parameters
        ----------
        beams : Beams
            The beams' directions.
        number : int
            The number of the scan; each has its own noise.
        """
        directions = self.pose.turn(beam_directions(beams, np.arange(_TURN)))
        origin = np.array([0.0, -self.rig.baseline, 0.0])
        reach = 1 / np.maximum(np.abs(directions), 1e-9) * np.array(_ROOM)
        # Only rays that look ahead can meet the board.
        hits = self.board.meet(origin, directions)
        distance = np.minimum(reach.min(axis=-1), hits.distance)
        left, right, top, bottom = _MIRROR
        across, down = hits.place[..., 0], hits.place[..., 1]
        mirror = np.isfinite(hits.distance) & (left < across) & (across < right)
        mirror &= (top < down) & (down < bottom)
        seed = (_SEED, self.number, 10_000 + number)
        noisy = distance * 1000 + _RANGE_NOISE * near_normal_numbers(distance.shape, (*seed, 0))
        lost = near_normal_numbers(distance.shape, (*seed, 1)) > _LOST_ABOVE
        return np.where(mirror | lost, 0, np.rint(noisy)).astype(np.int32)

    def truth(self, view: View) -> NDArray[np.uint16]:
        """Return the distance from the camera in mm, cropped like the images."""
        millimetres = np.rint(view.distance * 1000).astype(np.uint16)
        return np.asarray(self.rig.crop(millimetres), np.uint16)


def defocus(view: View, table: LensTable, step: int) -> Floats:
    """Return the light that reaches the sensor at a voltage step: each point spread to a disc.

    Parameters
    ----------
    view : View
        The view in front of the lens.
    table : LensTable
        The lens's blur radius by distance.
    step : int
        The voltage step.

    Returns
    -------
    ndarray of float, shape (y, x, 3)
        Each pixel gathers light with the disc of its own distance.
    """
    radius = np.round(table.radius_at(step, view.distance) / _RADIUS_STEP) * _RADIUS_STEP
    light = np.zeros_like(view.reflectance)
    whole = np.rint(view.reflectance * _PARTS)
    for value in np.unique(radius):
        disc = _disc(float(value))
        blurred = cv2.filter2D(whole, -1, disc, borderType=cv2.BORDER_REPLICATE)
        # OpenCV filters large discs by Fourier transform; rounding gives the exact whole number.
        light[radius == value] = np.rint(blurred[radius == value]) / _PARTS**2
    return light


@cache
def _disc(radius: float) -> Floats:
    reach = int(np.ceil(radius + 0.5))
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    disc = np.clip(radius + 0.5 - np.hypot(x, y), 0, 1)
    parts = np.rint(disc / disc.sum() * _PARTS)
    parts[reach, reach] += _PARTS - parts.sum()
    return np.asarray(parts)


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
    """What to simulate of each scene.

    Parameters
    ----------
    steps : tuple of int
        Voltage steps.
    exposures : tuple of int
        In milliseconds.
    frames, scans : int
        Frames per image, scans of the LIDAR.
    pose : Pose
        The LIDAR's rotation on its mount.
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
        The folder to write to.
    scenes : sequence of str
        k00 to k63.
    capture : Recording
        The manifest's section, for the sizes.
    settings : CaptureSettings
        What to simulate.
    workers : int
        How many scenes to make at once; the files do not depend on it.
    on_scene : callable, optional
        Called with (scenes done, scenes to make).

    Returns
    -------
    tuple of str
        The scenes written now.

    Raises
    ------
    InputError
        If a scene's folder holds something else; then nothing is written.
    ResultError
        If another process is writing the folder, or it cannot be written.
    """
    wanted = json.dumps({"version": _VERSION, **asdict(settings)}, indent=1) + "\n"
    InputError.raise_if([p for name in scenes if (p := _foreign(folder / name, wanted))])
    table = read_lens_table()

    height, width = capture.frame_size
    rig = CaptureRig(frame_size=(height, width), crop_size=capture.crop_size)

    def write(name: str) -> None:
        scene = SimulatedScene(int(name.removeprefix("k")), rig, settings.pose)
        partial = folder / f".{name}.partial"
        shutil.rmtree(partial, ignore_errors=True)
        _write_scene(scene, partial, folder / TRUTH / name, table, settings)
        write_whole(partial / _SETTINGS, wanted)
        partial.rename(folder / name)

    with writing_folder(folder, "simulation"):
        left = [name for name in scenes if not (folder / name).exists()]
        Threads(workers).map(write, left, on_done=on_scene)
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
    # Noise hardly compresses: the fastest compression is as good as the best.
    _, content = cv2.imencode(".png", stored, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    path.write_bytes(content.tobytes())


def _foreign(place: Path, wanted: str) -> Problem | None:
    settings = place / _SETTINGS
    if not place.exists() or (settings.exists() and settings.read_text("utf-8") == wanted):
        return None
    what = "the folder holds a simulation with other settings, or captures of another kind"
    return Problem(what, where=str(place), fix="choose another with --out DIR")


def write_lens_test(folder: Path) -> int:
    """Write a lens test's captures; return the number of images.

    Parameters
    ----------
    folder : Path
        It gets ``temperature``, ``up`` and ``down``, as `dfdbench.optics.sharpness` reads them.
    """
    table = read_lens_table()
    images: dict[str, NDArray[np.uint8]] = {}
    radii = {step: float(table.radius_at(step, _DISTANCE)) for step in table.steps}
    for number, degrees in enumerate(np.linspace(_COLD, _WARM, _TEMPERATURES)):
        cold = (_WARM - degrees) / (_WARM - _COLD)
        noise = _WARM_NOISE + cold * (_COLD_NOISE - _WARM_NOISE)
        name = f"temperature/image_{_WARMED_STEP}_40.00_{degrees:.2f}.png"
        blur = radii[_WARMED_STEP] + cold * _COLD_BLUR
        images[name] = _dot(blur, noise, (_DOT_SEED, 0, number))
    for way, (direction, lag) in enumerate((("up", -_LAG), ("down", _LAG)), start=1):
        for step in table.steps:
            blur = float(np.interp(step + lag, table.steps, list(radii.values())))
            dot = _dot(blur, _WARM_NOISE, (_DOT_SEED, way, step))
            images[f"{direction}/image_{step}_30.00.png"] = dot
    for name, image in images.items():
        write_png(folder / name, image)
    return len(images)


def _dot(blur: float, noise: float, seed: tuple[int, ...]) -> NDArray[np.uint8]:
    # A dot seen through a disc: its rim fades over the disc's width, and so does its middle.
    y, x = np.mgrid[:_DOT_SIZE, :_DOT_SIZE] - (_DOT_SIZE - 1) / 2
    share = np.clip((_DOT + blur - np.hypot(x, y)) / (2 * blur), 0, 1)
    share *= min(1.0, _DOT**2 / max(blur, 1e-9) ** 2)
    levels = _BLACK + (_WHITE - _BLACK) * share
    noisy = levels + noise * near_normal_numbers(levels.shape, seed)
    return np.asarray(np.clip(np.rint(noisy), 0, 255), np.uint8)
