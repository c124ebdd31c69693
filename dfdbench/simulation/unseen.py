"""Draw cameras and photograph rooms by seed: pairs and focal stacks that nobody has seen."""

import math
from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.light import Floats, Image
from dfdbench.datasets.rendered import FAR, GENERATOR, NEAR
from dfdbench.optics.thin_lens import ThinLens
from dfdbench.simulation.lens import Camera, depth, develop, render
from dfdbench.simulation.rooms import draw_room
from dfdbench.simulation.shapes import Scene
from dfdbench.simulation.textures import Draws

#: The ranges from which a camera is drawn; all values in a range are equally likely.
RANGES = {
    "field_of_view": (40.0, 58.0),  # degrees, across
    "focal_length": (0.020, 0.035),  # metres
    "f_number": (1.8, 2.8),  # of the defocus image and of stacks
    # Metres: half of the cameras focus at the near end. The others focus inside, but only as far as
    # blur still determines the depth of most pixels: at 0.88 m 9 % are nearer than the focus, in
    # 200 rooms; at 1.2 m 28 %, with the same blur as pixels beyond it.
    "focus_near": (0.6, 0.75),
    "focus_inside": (0.75, 0.88),
    "full_well": (8_000.0, 40_000.0),  # electrons
    "read_noise": (0.0003, 0.0015),  # of white
    "lateral": (-0.0006, 0.0006),  # a third of the cameras have both colour errors
    "longitudinal": (-0.03, 0.03),  # dioptres
    "jpeg": (90.0, 98.0),  # half of the cameras; the others do not compress
    "white": (0.7, 0.95),  # light of the brightest fiftieth of the in-focus image
}
_INFOCUS_F_NUMBER = 8.0
_SHAPE = (480, 640)
_STACK_ENDS = (0.65, 5.0)  # metres
# Rays per pixel; a small aperture needs fewer.
_RAYS, _INFOCUS_RAYS, _STACK_RAYS = 128, 64, 64
_BRIGHTEST = 0.98
_TEXTURE_WINDOW, _TEXTURE_LEVELS = 9, 4.0


class Photographs(NamedTuple):
    """Photographs of a room, its depth and what is known of the camera.

    `images` are RGB, shape (image, y, x, 3): the first at f/8, then one with the wide aperture at
    each of `focus_distances`, in metres, ascending. `depth` is in metres along the axis, shape (y,
    x), as seen in the first image; `facts` are JSON data.
    """

    images: Image
    focus_distances: tuple[float, ...]
    depth: NDArray[np.float32]
    facts: dict[str, Any]


def draw_camera(seed: int, scene: int | None = None) -> Camera:
    """Draw the camera that takes the defocus images of a seed.

    Parameters
    ----------
    seed : int
        0 or more.
    scene : int, optional
        Draw a different camera for each scene; by default a seed has only one.

    Examples
    --------
    >>> camera = draw_camera(7)
    >>> 1.8 <= camera.lens.f_number <= 2.8
    True
    """
    d = Draws("camera", seed, -1 if scene is None else scene)
    focal_length = d.between(*RANGES["focal_length"])
    focus = d.between(*RANGES["focus_near" if d.chance(0.5) else "focus_inside"])
    angle = math.radians(d.between(*RANGES["field_of_view"]))
    sensor = focal_length * focus / (focus - focal_length)
    pitch = 2 * sensor * math.tan(angle / 2) / _SHAPE[1]
    f_number = d.between(*RANGES["f_number"])
    radius = focal_length / f_number / 2
    coloured, compressed = d.chance(1 / 3), d.chance(0.5)
    red, blue = d.between(*RANGES["lateral"]), d.between(*RANGES["lateral"])
    warm, cold = d.between(*RANGES["longitudinal"]), d.between(*RANGES["longitudinal"])
    # A fact sheet gives five significant digits, and they are the same on every machine.
    return Camera(
        ThinLens(_short(f_number), _short(focal_length), _short(focus), _short(pitch)),
        _SHAPE,
        blades=d.one_of((0, 0, 5, 6, 7, 9)),
        cos4=True,
        ring=(0.03, _short(radius * d.between(1.0, 1.6) + 0.01)) if d.chance(0.5) else None,
        lateral=(_short(red), 0.0, _short(blue)) if coloured else (0.0, 0.0, 0.0),
        longitudinal=(_short(warm), 0.0, _short(cold)) if coloured else (0.0, 0.0, 0.0),
        full_well=_short(d.between(*RANGES["full_well"])),
        read_noise=_short(d.between(*RANGES["read_noise"])),
        jpeg=d.whole(*map(int, RANGES["jpeg"])) if compressed else 0,
    )


def render_pair(
    seed: int,
    scene: int,
    camera: Camera | None = None,
    rays: int = _RAYS,
    threads: int = 1,
    sharp_focus: float | None = None,
) -> Photographs:
    """Photograph a room twice: at f/8, and with the wide aperture of a camera.

    Parameters
    ----------
    seed : int
        Seed of the camera, the room and the noise.
    scene : int
        The room's number.
    camera : Camera, optional
        Replaces the seed's camera, for the same rooms in the same light.
    rays : int
        Rays per pixel of the defocus image; half as many at f/8.
    threads : int
        How many threads to use; the images do not depend on it.
    sharp_focus : float, optional
        A different focus at f/8, in metres, so that the lens breathes between the images.
    """
    wide = camera or draw_camera(seed)
    small = _stopped_down(wide, sharp_focus)
    room = draw_room(seed, scene)
    sharp = render(room, small, max(rays // 2, 1), (seed, scene, 0), threads)
    blurred = render(room, wide, rays, (seed, scene, 1), threads)
    gain = _gain(sharp, seed, scene)
    infocus = develop(gain * sharp, small, (seed, scene, 2))
    images = np.stack([infocus, develop(gain * blurred, wide, (seed, scene, 3))])
    focus = (wide.lens.focus_distance,)
    return Photographs(images, focus, depth(room, small), _facts(wide, room, infocus))


def render_stack(
    seed: int,
    scene: int,
    planes: int | Sequence[float] = 9,
    rays: int = _STACK_RAYS,
    threads: int = 1,
    camera: Camera | None = None,
) -> Photographs:
    """Photograph a room at several focus distances with one aperture, and once at f/8.

    Parameters
    ----------
    seed, scene, rays, threads, camera
        As in `render_pair`.
    planes : int or sequence of float
        How many focus distances, evenly spaced in dioptres; or the distances in metres, ascending.
    """
    wide = camera or draw_camera(seed)
    near, far = (1 / end for end in _STACK_ENDS)
    metres = (1 / np.linspace(near, far, planes)).tolist() if isinstance(planes, int) else planes
    distances = [_short(distance) for distance in metres]
    small = _stopped_down(wide)
    room = draw_room(seed, scene)
    sharp = render(room, small, _INFOCUS_RAYS, (seed, scene, 0), threads)
    gain = _gain(sharp, seed, scene)
    images = [develop(gain * sharp, small, (seed, scene, 2))]
    for plane, distance in enumerate(distances):
        lens = replace(wide.lens, focus_distance=distance)
        # In register, as after an alignment.
        seen = replace(wide, lens=lens, view_focus=wide.lens.focus_distance)
        light = render(room, seen, rays, (seed, scene, 4, plane), threads)
        images.append(develop(gain * light, seen, (seed, scene, 5, plane)))
    facts = _facts(wide, room, images[0])
    return Photographs(np.stack(images), tuple(distances), depth(room, small), facts)


def textured(image: Image) -> NDArray[np.bool_]:
    """Return where an image has texture, shape (y, x).

    A pixel has texture if the grey levels of the 9 x 9 pixels around it have a standard deviation
    of at least 4. The mean of the map measures a scene's difficulty.
    """
    grey = image.astype(np.float64).mean(axis=2)
    window = (_TEXTURE_WINDOW, _TEXTURE_WINDOW)
    variance = cv2.blur(grey * grey, window) - np.square(cv2.blur(grey, window))
    return np.asarray(variance >= _TEXTURE_LEVELS**2)


def _stopped_down(camera: Camera, focus: float | None = None) -> Camera:
    focus = focus or camera.lens.focus_distance
    lens = replace(camera.lens, f_number=_INFOCUS_F_NUMBER, focus_distance=focus)
    return replace(camera, lens=lens)


def _gain(light: Floats, seed: int, scene: int) -> float:
    white = Draws("white", seed, scene).between(*RANGES["white"])
    return float(white / np.quantile(light, _BRIGHTEST))


def _facts(camera: Camera, room: Scene, infocus: Image) -> dict[str, Any]:
    known = asdict(camera)
    lens = known.pop("lens")
    return {
        "focal_length": lens["focal_length"],
        "f_number": lens["f_number"],
        "focus_distance": lens["focus_distance"],
        "pixel_pitch": lens["pixel_size"],
        "near": NEAR,
        "far": FAR,
        "camera": known,
        "surfaces": len(room.kinds),
        "textured": round(float(textured(infocus).mean()), 4),
        "generator": GENERATOR,
        "infocus_f_number": _INFOCUS_F_NUMBER,
    }


def _short(number: float) -> float:
    return float(f"{number:.5g}")
