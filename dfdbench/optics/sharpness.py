"""How sharp an image is, and how sharp a lens is over temperature and voltage (7.2.1)."""

import re
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path

import cv2
import numpy as np
import scipy
from numpy.typing import NDArray

from dfdbench.errors import Problem, SourceError
from dfdbench.system.files import LARGEST_ARRAY, read_as

Image = NDArray[np.uint8]

FOLDERS = ("temperature", "up", "down")
_NAME = re.compile(r"image_(\d+)_(\d+(?:\.\d+)?)(?:_(\d+(?:\.\d+)?))?\.png")
_MARGIN = 3  # pixels around the dot that its blur reaches
_LEAST_CONTRAST = 10  # levels
_STEP, _TEMPERATURE = attrgetter("step"), attrgetter("temperature")


def spectrum_sum(image: Image) -> float:
    """Return the sum of the magnitudes of the 2-D Fourier transform, over the pixels (3.2.5).

    The thesis uses the image with the largest sum at an exposure as its in-focus image.

    Parameters
    ----------
    image : ndarray of uint8, shape (y, x) or (y, x, 3)
        Grey or RGB.

    Examples
    --------
    >>> spectrum_sum(np.full((8, 8), 100, np.uint8))
    100.0
    """
    grey = to_grey(image).astype(np.float64)
    return float(np.abs(scipy.fft.fft2(grey)).sum() / grey.size)


def dct_sharpness(image: Image) -> float:
    """Return the discrete cosine sharpness measure of De and Masilamani (7.2.1): 0 to 1.

    The share of coefficients of the orthonormal 2-D cosine transform that reach 1, as the program
    published with the thesis computes it.

    Parameters
    ----------
    image : ndarray of uint8, shape (y, x) or (y, x, 3)
        Grey or RGB.

    Examples
    --------
    >>> dct_sharpness(np.full((8, 8), 100, np.uint8))
    0.015625
    """
    coefficients = np.abs(scipy.fft.dctn(to_grey(image).astype(np.float64), norm="ortho"))
    return float((coefficients >= 1).mean())


def laplacian_energy(image: Image) -> float:
    """Return the variance of the Laplacian over the squared mean, which no gain changes.

    This is the focus measure LAP4 of Pertuz, Puig and Garcia (2013), made independent of brightness
    so that two exposures of a scene can be compared; 0 for a black image.

    Parameters
    ----------
    image : ndarray of uint8, shape (y, x) or (y, x, 3)
        Grey or RGB.

    Examples
    --------
    >>> checks = np.indices((8, 8)).sum(axis=0) % 2
    >>> laplacian_energy(np.uint8(100 * checks)) == laplacian_energy(np.uint8(200 * checks))
    True
    """
    grey = to_grey(image).astype(np.float64)
    mean = float(grey.mean())
    return float(cv2.Laplacian(grey, cv2.CV_64F).var()) / mean**2 if mean else 0.0


def sharpest(images: list[Image]) -> int:
    """Return the index of the image with the largest `spectrum_sum`; of equals, the first."""
    return int(np.argmax([spectrum_sum(image) for image in images]))


def to_grey(image: Image) -> Image:
    """Return an image's luma, shape (y, x); a grey image is returned unchanged."""
    return image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY))


@dataclass(frozen=True, order=True)
class Measurement:
    """One image of the dot.

    Parameters
    ----------
    step : int
        Voltage step.
    temperature : float
        The camera's temperature, in °C; NaN if the file's name lacks it.
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
        By folder: `temperature` sorted by temperature, `up` and `down` by voltage step.

    Raises
    ------
    SourceError
        If files cannot be used (it names all of them), or there are none.
    """
    problems: list[Problem] = []
    found: dict[str, tuple[Measurement, ...]] = {}
    for name in FOLDERS:
        warms, measured = name == "temperature", []
        for path in sorted((folder / name).glob("*.png")):
            try:
                measured.append(_measure(path, warms))
            except SourceError as error:
                problems += error.problems
        if measured:
            found[name] = tuple(sorted(measured, key=_TEMPERATURE if warms else _STEP))
    SourceError.raise_if(problems)
    if not found:
        fix = "to see the layout: dfdbench rig simulate lens --out DIR"
        raise SourceError("no captures of a lens test", where=str(folder), fix=fix)
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
    dot = scipy.ndimage.binary_dilation(image > split, iterations=_MARGIN)
    return np.where(dot, int(image[~dot].mean()), image).astype(np.uint8)


def _measure(path: Path, warms: bool) -> Measurement:
    where = str(path)
    match = _NAME.fullmatch(path.name)
    if not match or (warms and match[3] is None):
        shape = "image_STEP_EXPOSURE_TEMPERATURE.png" if warms else "image_STEP_EXPOSURE.png"
        raise SourceError(f"the name is not {shape}", where=where)
    content = read_as(SourceError, path, "the file", LARGEST_ARRAY)
    image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR_RGB)
    if image is None:
        raise SourceError("not a PNG image", where=where)
    grey = to_grey(np.asarray(image, np.uint8))
    if int(grey.max()) - int(grey.min()) < _LEAST_CONTRAST:
        raise SourceError("no white dot on black in the image", where=where)
    sharpness, background = dct_sharpness(grey), dct_sharpness(without_dot(grey))
    return Measurement(int(match[1]), float(match[3] or "nan"), sharpness, background)
