"""What ``stack-net`` is trained on: focal stacks of rendered rooms, or of a data set."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dfdbench.datasets.captures import Capture, eight_bits
from dfdbench.datasets.rendered import FIRST_TRAIN
from dfdbench.methods.shape_from_focus import focus_places
from dfdbench.system.files import write_whole
from dfdbench.system.parallel import one_by_one

#: What rendered stacks are called on a card.
STACKS = "rooms of unseen-0 from 1000 on, focused through random lenses"
#: Cameras, each with a room of its own; those whose number leaves the last of the remainders only
#: test.
CAMERAS, EVERY = 27, 8
# Photographs of a stack, rays a pixel, and the size, of 480 x 640 at most: rays take time.
_PLANES, _RAYS, _SHAPE = 10, 32, (288, 384)
# The first of the cameras, whose numbers no scene's camera has.
_FIRST = 7000
# Ends of the focus in dioptres, how much a distance may leave its place among the others, in
# steps, what the drawn f-number is multiplied by, and how much of the view is seen.
_NEAR, _FAR, _JITTER, _STOPS, _VIEW = (1.1, 1.9), (0.1, 0.5), 0.3, (0.5, 1.2), (0.6, 1.0)
# So many cameras of five have no colour error: three colours take three times as long.
_PLAIN = 4


@dataclass(frozen=True)
class Stack:
    """One stack as the network sees it, and the truth.

    Parameters
    ----------
    images : ndarray of uint8, shape (image, y, x, 3)
    places : ndarray of float32, shape (image,)
        Where each image's focus lies, rising, on a scale that blur grows along.
    truth : ndarray of float32, shape (y, x)
        Depth on that scale; NaN where it is not known.
    """

    images: NDArray[np.uint8]
    places: NDArray[np.float32]
    truth: NDArray[np.float32]


def room_stacks(
    folder: Path, on_camera: Callable[[int, int], None] | None = None
) -> dict[str, list[Stack]]:
    """Return stacks of rendered rooms by camera; what the folder holds is not made again.

    Parameters
    ----------
    folder : Path
        Where they are kept.
    on_camera : callable, optional
        Called with (cameras done, cameras in all).
    """
    found = {}
    for number in one_by_one(range(CAMERAS), on_camera):
        path = folder / f"stack-{number:02}.npz"
        if not path.exists():
            content = io.BytesIO()
            np.savez(content, allow_pickle=False, **vars(_rendered(number)))
            write_whole(path, content.getvalue())
        with np.load(path) as arrays:
            found[path.stem] = [Stack(**arrays)]
    return found


def stack_of(capture: Capture) -> Stack:
    """Return a capture as the network sees it.

    Raises
    ------
    MethodError
        If it is no stack of three images or more with known focus.
    """
    places, where = focus_places(capture.stack, "stack-net")
    truth = 1 / capture.depth if capture.about.kind == "metres" else capture.depth
    images = eight_bits(capture.images[where])
    return Stack(images, places.astype(np.float32), truth.astype(np.float32))


def _rendered(number: int) -> Stack:
    from dfdbench.simulation.unseen import draw_camera, render_stack  # they compile

    random = np.random.default_rng(number)
    camera = draw_camera(0, _FIRST + number)
    lens, wider = camera.lens, random.uniform(*_VIEW) * camera.shape[1] / _SHAPE[1]
    f_number = round(lens.f_number * random.uniform(*_STOPS), 3)
    lens = replace(lens, f_number=f_number, pixel_size=lens.pixel_size * wider)
    camera = replace(camera, lens=lens, shape=_SHAPE)
    if number % (_PLAIN + 1):
        camera = replace(camera, lateral=(0.0, 0.0, 0.0), longitudinal=(0.0, 0.0, 0.0))
    near, far = random.uniform(*_NEAR), random.uniform(*_FAR)
    places = np.linspace(far, near, _PLANES)
    places[1:-1] += random.uniform(-_JITTER, _JITTER, _PLANES - 2) * (near - far) / (_PLANES - 1)
    stack = render_stack(0, FIRST_TRAIN + number, (1 / places[::-1]).tolist(), _RAYS, 1, camera)
    found = 1 / np.array(stack.focus_distances[::-1])
    truth = 1 / stack.depth.astype(np.float64)
    return Stack(stack.images[::-1], found.astype(np.float32), truth.astype(np.float32))
