"""How sharp an image is: by the sum of its spectrum, and by its discrete cosine transform."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import fft

Image = NDArray[np.uint8]


def spectrum_sum(image: Image) -> float:
    """Return the sum of the magnitudes of the 2-D Fourier transform, over the pixels (3.2.5).

    The thesis takes the image of an exposure with the largest sum for its in-focus image.

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
    return float(np.abs(fft.fft2(grey)).sum() / grey.size)


def dct_sharpness(image: Image, threshold: float = 0.0) -> float:
    """Return the discrete cosine sharpness measure of De and Masilamani (7.2.1): 0 to 1.

    The share of coefficients of the orthonormal 2-D cosine transform whose logarithm reaches
    `threshold`, as the program published with the thesis computes it.

    Parameters
    ----------
    image : ndarray of uint8, shape (y, x) or (y, x, 3)
        Grey or RGB.
    threshold : float
        Of the natural logarithm of a coefficient's magnitude.

    Examples
    --------
    >>> dct_sharpness(np.full((8, 8), 100, np.uint8))
    0.015625
    """
    coefficients = np.abs(fft.dctn(to_grey(image).astype(np.float64), norm="ortho"))
    return float((coefficients >= np.exp(threshold)).mean())


def laplacian_energy(image: Image) -> float:
    """Return the variance of the Laplacian over the squared mean: no gain changes it.

    A focus measure, LAP4 of Pertuz, Puig and Garcia (2013), here made free of brightness so that
    two exposures of one scene can be compared; 0 for a black image.

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
    """Return which image has the largest `spectrum_sum`, the first of equals."""
    return int(np.argmax([spectrum_sum(image) for image in images]))


def to_grey(image: Image) -> Image:
    """Return an image's luma, shape (y, x); a grey image is returned as it is."""
    return image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY))
