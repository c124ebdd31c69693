"""Rational filters: a normalised ratio of two images as a polynomial in the blur."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.law import BlurLaw
from dfdbench.blur.point_spread import point_spread_functions
from dfdbench.blur.tracks import DISK
from dfdbench.errors import MethodError
from dfdbench.methods.fitted import Calibrated, Image, channels_of
from dfdbench.methods.readout import read_out

# Side of the filters in pixels: as wide as the widest blur.
_SIZE = 15
# Standard deviation of the inner Gaussian of the pre-filter; that of the outer one beside it.
_FINE, _COARSE = 1.4, 2.24
_DEGREE = 3
# At which the design is held to the blur: frequencies of an axis up to Nyquist's, and widths.
_FREQUENCIES, _WIDTHS = 24, 33
# Of the mean power of an unknown: keeps the filters from growing where the design needs them not.
_RIDGE = 1e-6
# What weights are rounded to, so that a library's threads change none.
_STEP = 2.0**-20

Array = NDArray[Any]


class RationalFilters(Calibrated):
    """Depth from the ratio (infocus - defocus) / (infocus + defocus), for all frequencies at once.

    At a frequency the ratio is a curve over the blur's width, a different one at each. A
    pre-filter g and four small filters p_j are designed such that
    ``g * (infocus - defocus) = sum over j of a^j p_j * (infocus + defocus)`` holds as nearly as
    possible at all frequencies together, where a is the width, 0 for the least and 1 for the
    largest. Five filterings then leave each pixel a polynomial in a; the level that fulfils it
    best in a window is taken.

    Parameters
    ----------
    recipe : BlurRecipe or BlurLaw, optional
        How the defocus images were made; without it the law is fitted. Width and shape of the
        kernels are what counts: gain, shift and noise are not.
    window : int
        Side of the square window in pixels, odd.
    prior : bool
        Where the law is fitted: weigh depths by how often training shows them, if that helps there.

    Raises
    ------
    MethodError
        For a window out of range; at a call without recipe or fit, or with an image
        smaller than the window.

    Notes
    -----
    Watanabe and Nayar 1998. What is adapted: theirs are a near- and a far-focused image, whose
    ratio is odd in the depth, so that they do with the powers 1 and 3; here one image is sharp, and
    the ratio needs powers 0 to 3. They design three filters of 7 x 7 pixels by a search; here the
    pre-filter, a difference of Gaussians, is fixed, which makes the others a linear least squares
    problem, weighted as photographs are (power 1 / frequency^2), and they are 15 x 15 as the blur
    is wider. They smooth the coefficients and solve by Newton's method; here the squared residual
    is summed over a window and compared at all levels.

    Examples
    --------
    >>> from dfdbench.blur import RECIPES, synthesize
    >>> image = np.random.default_rng(0).integers(0, 256, (60, 60, 3)).astype(np.uint8)
    >>> defocus = synthesize(image, np.full((60, 60), 120, np.uint8), RECIPES["published"])
    >>> found = RationalFilters(RECIPES["published"])(image, defocus)
    >>> bool(abs(np.median(found) - 120) < 15)
    True
    """

    paper = "Watanabe and Nayar, Rational filters for passive depth from defocus, IJCV 1998"

    def __call__(self, infocus: Image, defocus: Image) -> NDArray[np.float32]:
        """Return depth levels for two images of uint8, shape (y, x, 3) or, grey, (y, x)."""
        return self._solve(infocus, [defocus])

    def _solve(self, infocus: Image, images: Sequence[Image]) -> NDArray[np.float32]:
        window = self.window_in(infocus)
        blur = self.blur
        sigmas = np.asarray(blur.sigmas, np.float64)
        low, high = float(sigmas.min()), float(sigmas.max())
        if low == high:
            raise MethodError("the blur is the same at every depth", where="rational-filters")
        exponent = blur.exponent if isinstance(blur, BlurLaw) else 2.0
        before, filters = design(low, high, exponent, blur.kernel_size)
        sharp, blurred = channels_of(infocus), channels_of(images[0])
        terms = [_filtered(sharp - blurred, before)]
        terms += [_filtered(sharp + blurred, -kernel) for kernel in filters]
        residuals = _residuals(window, terms, (sigmas - low) / (high - low))
        self.chosen.weigh_in(residuals)
        label = read_out(residuals, self.chosen.sharpness)
        return np.asarray(blur.depth_of_level(label), np.float32)


@lru_cache(maxsize=8)
def design(
    low: float, high: float, exponent: float, kernel_size: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Design the pre-filter and the four filters for a range of blurs.

    Parameters
    ----------
    low, high : float
        The least and the largest width, in pixels.
    exponent : float
        Of the kernels, see `point_spread_functions`.
    kernel_size : int
        Side of the blur's kernels in pixels, odd.

    Returns
    -------
    before : ndarray of float64, shape (15, 15)
    filters : ndarray of float64, shape (4, 15, 15)
        By the power of the width. All are blind to brightness: their sums are 0.
    """
    axis = (np.arange(_FREQUENCIES) + 0.5) / _FREQUENCIES * np.pi
    widths = np.linspace(0, 1, _WIDTHS)
    blurs = point_spread_functions(low + widths * (high - low), kernel_size, min(exponent, DISK))
    kept = _transfer(blurs, axis)
    units = _units()
    passed = _transfer(units, axis)
    before = _gaussian(_FINE) - _gaussian(_COARSE)
    amplitude = 1 / np.sqrt(np.add.outer(axis**2, axis**2)).ravel()
    aim = amplitude * _transfer(before[np.newaxis], axis)[0] * (1 - kept)
    # An unknown is a unit at a power: its column, at each width and frequency.
    columns = np.einsum(
        "wj,wf,uf->juwf", np.power.outer(widths, range(_DEGREE + 1)), amplitude * (1 + kept), passed
    ).reshape((_DEGREE + 1) * len(units), -1)
    # By einsum, whose order of sums does not depend on threads.
    normal = np.einsum("an,bn->ab", columns, columns)
    normal += _RIDGE * np.trace(normal) / len(normal) * np.eye(len(normal))
    factors = np.linalg.solve(normal, np.einsum("an,n->a", columns, aim.ravel()))
    factors = np.rint(factors / _STEP) * _STEP
    filters = np.einsum("ju,uyx->jyx", factors.reshape(_DEGREE + 1, -1), units)
    return before, filters


def _residuals(window: tuple[int, int], terms: list[Array], widths: Array) -> NDArray[np.float32]:
    """Return each level's squared residual, summed over window and channels, (level, y, x)."""
    powers = [0, *range(len(terms) - 1)]
    sums = np.zeros((2 * powers[-1] + 1, *terms[0].shape[:2]), np.float32)
    for first, one in enumerate(terms):
        for second, other in enumerate(terms[: first + 1]):
            product = np.asarray((one * other).sum(2) * (1 if first == second else 2))
            sums[powers[first] + powers[second]] += cv2.boxFilter(
                product, cv2.CV_32F, window, borderType=cv2.BORDER_REPLICATE
            )
    residuals = np.empty((len(widths), *sums.shape[1:]), np.float32)
    for level, width in enumerate(widths):
        residual = residuals[level]
        residual[:] = sums[-1]
        for coefficient in sums[-2::-1]:
            residual *= np.float32(width)
            residual += coefficient
    return residuals


def _units() -> NDArray[np.float64]:
    """Return the ring of pixels of each (row, column) up to symmetry, less the middle pixel."""
    radius = _SIZE // 2
    near = np.abs(np.arange(-radius, radius + 1))
    larger, smaller = np.maximum.outer(near, near), np.minimum.outer(near, near)
    rings = [
        (larger == far) & (smaller == close)
        for far in range(1, radius + 1)
        for close in range(far + 1)
    ]
    units = np.array([ring / ring.sum() for ring in rings])
    units[:, radius, radius] -= 1
    return units


def _gaussian(sigma: float) -> NDArray[np.float64]:
    return np.asarray(point_spread_functions(np.array([sigma]), _SIZE)[0], np.float64)


def _transfer(kernels: Array, axis: Array) -> NDArray[np.float64]:
    """Return what symmetric kernels leave of each frequency, (kernel, frequency)."""
    radius = kernels.shape[1] // 2
    waves = np.cos(np.outer(axis, np.arange(-radius, radius + 1)))
    kept = np.einsum("kyx,vy,hx->kvh", kernels, waves, waves, optimize=True)
    return np.asarray(kept.reshape(len(kernels), -1), np.float64)


def _filtered(image: NDArray[np.float32], kernel: Array) -> NDArray[np.float32]:
    found = cv2.filter2D(image, cv2.CV_32F, kernel, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(found, np.float32).reshape(image.shape)
