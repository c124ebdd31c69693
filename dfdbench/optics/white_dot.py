"""Measure a lens from captures of a white dot: sharpness over temperature and voltage (7.2.1)."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from dfdbench.errors import Problem, SourceError, reason_of
from dfdbench.optics.sharpness import dct_sharpness, to_grey
from dfdbench.system.files import LARGEST_ARRAY, read_whole

Image = NDArray[np.uint8]

FOLDERS = ("temperature", "up", "down")
_NAME = re.compile(r"image_(\d+)_(\d+(?:\.\d+)?)(?:_(\d+(?:\.\d+)?))?\.png")
_MARGIN = 3  # pixels around the dot that its blur reaches
_LEAST_CONTRAST = 10  # levels


@dataclass(frozen=True, order=True)
class Measurement:
    """One image of the dot.

    Parameters
    ----------
    step : int
        Voltage step.
    temperature : float
        Of the camera, in °C; NaN where the file's name does not tell.
    sharpness, background : float
        Discrete cosine sharpness of the image, and of its background alone.
    """

    step: int
    temperature: float
    sharpness: float
    background: float


def read_lens_captures(folder: Path) -> dict[str, tuple[Measurement, ...]]:
    """Measure every image of a lens test.

    Parameters
    ----------
    folder : Path
        Holds any of ``temperature/image_135_40.00_27.25.png`` (step, exposure in ms, °C), and
        ``up/image_127_30.00.png``, ``down/image_127_30.00.png`` (step, exposure).

    Returns
    -------
    dict of str to tuple of Measurement
        By folder: `temperature` ascending in it, `up` and `down` in voltage step.

    Raises
    ------
    SourceError
        With every file that cannot be used, or where there is none at all.
    """
    problems: list[Problem] = []
    found = {}
    for name in FOLDERS:
        paths = sorted((folder / name).glob("*.png"))
        measured = [_measure(path, name == "temperature", problems) for path in paths]
        whole = [item for item in measured if item is not None]
        if whole:
            by_temperature = name == "temperature"
            found[name] = tuple(
                sorted(whole, key=lambda m: m.temperature if by_temperature else m.step)
            )
    if not found and not problems:
        problems.append(
            Problem(
                "no captures of a lens test",
                where=str(folder),
                expected="temperature/image_135_40.00_27.25.png, up/image_127_30.00.png, down/...",
                fix="to see the layout: dfdbench rig simulate lens --out DIR",
            )
        )
    if problems:
        raise SourceError.of(problems)
    return found


def without_dot(image: Image) -> Image:
    """Return an image with its bright dot replaced by the mean of the background, rounded down.

    Parameters
    ----------
    image : ndarray of uint8, shape (y, x)
        Grey.

    Examples
    --------
    >>> dotted = np.full((32, 32), 20, np.uint8)
    >>> dotted[14:18, 14:18] = 250
    >>> int(without_dot(dotted).max())
    20
    """
    split, _ = cv2.threshold(image, 0, 255, cv2.THRESH_OTSU)
    dot = ndimage.binary_dilation(image > split, iterations=_MARGIN)
    return np.where(dot, int(image[~dot].mean()), image).astype(np.uint8)


def _measure(path: Path, warms: bool, problems: list[Problem]) -> Measurement | None:
    match = _NAME.fullmatch(path.name)
    if not match or (warms and match[3] is None):
        expected = "image_STEP_EXPOSURE_TEMPERATURE.png" if warms else "image_STEP_EXPOSURE.png"
        problems.append(Problem("name tells no voltage step", where=str(path), expected=expected))
        return None
    try:
        content = read_whole(path, LARGEST_ARRAY)
    except OSError as error:
        problems.append(Problem("cannot read the file", where=str(path), got=reason_of(error)))
        return None
    image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR_RGB)
    if image is None:
        problems.append(Problem("not an image", where=str(path), expected="a PNG file"))
        return None
    grey = to_grey(np.asarray(image, np.uint8))
    if int(grey.max()) - int(grey.min()) < _LEAST_CONTRAST:
        problems.append(
            Problem("no dot in the image", where=str(path), expected="a white dot on black")
        )
        return None
    return Measurement(
        int(match[1]),
        float(match[3] or "nan"),
        dct_sharpness(grey),
        dct_sharpness(without_dot(grey)),
    )
