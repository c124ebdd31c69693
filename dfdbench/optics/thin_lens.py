"""Thin-lens optics (thesis, ch. 2): the size of a point's blur, and what it says about depth.

Lengths are in metres throughout. What the thesis calls the blur radius, Eq. 2.11 to 2.16, is the
full width D (d_f - d_o) / d_f projected onto the sensor; its figures and tables use that number,
and so does this module.
"""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from dfdbench.errors import InputError
from dfdbench.system.strict import check_fields

Floats = NDArray[np.float64]


# Beyond these limits, products of two of a lens's numbers become 0 or infinity.
_Number = Annotated[float, Field(ge=1e-12, le=1e12)]


@dataclass(frozen=True)
class ThinLens:
    """A lens focused at one distance, in front of a sensor.

    Parameters
    ----------
    f_number : float
        n, the focal length over the aperture's diameter.
    focal_length : float
        f, in metres.
    focus_distance : float
        d_o, the distance that is in focus, in metres.
    pixel_size : float
        In metres.

    Raises
    ------
    InputError
        If a number is impossible for a lens, or the focus is within the focal length.

    Examples
    --------
    >>> lens = ThinLens(3.7, 9.6e-3, 0.5, 4.8e-6)  # Table 2.1
    >>> round(lens.max_blur_radius() / lens.pixel_size, 2)
    10.58
    """

    f_number: _Number
    focal_length: _Number
    focus_distance: _Number
    pixel_size: _Number

    def __post_init__(self) -> None:
        check_fields(self, "lens")
        if self.focus_distance <= self.focal_length:
            what = f"no real image: the focus is within the focal length of {self.focal_length:g} m"
            got, fix = (
                f"{self.focus_distance:g} m",
                "focus beyond it; a lens file has lengths in metres, 0.05 for 50 mm",
            )
            raise InputError(what, where="focus_distance", got=got, fix=fix)

    def blur_radius_far(self, distance: ArrayLike) -> Floats:
        """Return the blur of points beyond the focus, in metres on the sensor (Eq. 2.8 to 2.11).

        Parameters
        ----------
        distance : array_like of float
            d_f in metres, at least the focus distance; infinity is allowed.
        """
        return self._scale() * (1 / self.focus_distance - 1 / _distances(distance))

    def blur_radius(self, distance: ArrayLike) -> Floats:
        """Return the blur at any distance, in metres on the sensor (Fig. 2.5, blue line).

        Examples
        --------
        >>> lens = ThinLens(3.7, 9.6e-3, 0.5, 4.8e-6)
        >>> (lens.blur_radius([0.4, 0.5, 1.0]) * 1e6).round(2).tolist()
        [12.7, 0.0, 25.4]
        """
        return np.abs(self.blur_radius_far(distance))

    def blur_sigma(self, distance: ArrayLike, infocus_f_number: float | None = None) -> Floats:
        """Return the sigma of the Gaussian that blurs as much as the lens, in pixels.

        Parameters
        ----------
        distance : array_like of float
            In metres.
        infocus_f_number : float, optional
            The f-number of the image to blur, if the same lens took it with a smaller aperture;
            by default that image has no blur of its own.

        Raises
        ------
        InputError
            If that aperture is not smaller.

        Notes
        -----
        The blur of a point is a disk of width c, see `blur_radius`. Its standard deviation along
        each axis is c / 4. Variances of blurs add up, so an image that already has the blur c_0
        needs a further ``sqrt(c^2 - c_0^2) / 4``; c is proportional to 1 / n (Eq. 2.11).

        Examples
        --------
        >>> lens = ThinLens(2.8, 0.025, 1.6, 3e-5)
        >>> lens.blur_sigma([0.8, 1.6, 3.2]).round(3).tolist()
        [1.181, 0.0, 0.591]
        """
        sigmas = self.blur_radius(distance) / (4 * self.pixel_size)
        if infocus_f_number is None:
            return np.asarray(sigmas)
        if not infocus_f_number > self.f_number:
            what = f"the in-focus image has no smaller aperture than f/{self.f_number:g}"
            raise InputError(what, where="infocus_f_number", got=f"{infocus_f_number:g}")
        return np.asarray(sigmas * np.sqrt(1 - (self.f_number / infocus_f_number) ** 2))

    def max_blur_radius(self) -> float:
        """Return the blur of a point at infinity, in metres on the sensor (Eq. 2.12)."""
        return float(self.focal_length**2 / (self.f_number * self._reach()))

    def quantised_blur_radius(self, distance: ArrayLike) -> NDArray[np.int64]:
        """Return the blur in whole pixels, rounded up (Fig. 2.5, black line).

        Examples
        --------
        >>> lens = ThinLens(3.7, 9.6e-3, 0.5, 4.8e-6)
        >>> lens.quantised_blur_radius([0.4, 0.5, 1.0, np.inf]).tolist()
        [3, 0, 6, 11]
        """
        # Round to twelve digits first: 6.000000000001 pixels are six.
        pixels = np.round(self.blur_radius(distance) / self.pixel_size, 12)
        return np.ceil(pixels).astype(np.int64)

    def depth_of_field(self) -> tuple[float, float]:
        """Return the nearest and the farthest distance that look sharp (Eq. 2.17, 2.18).

        Their difference is the depth of field (Eq. 2.19). A blur of one pixel counts as sharp.

        Returns
        -------
        near, far : float
            In metres; `far` is infinite from the hyperfocal distance on.

        Examples
        --------
        >>> near, far = ThinLens(3.7, 9.6e-3, 0.5, 4.8e-6).depth_of_field()
        >>> round(near, 4), round(far, 4)
        (0.4568, 0.5522)
        """
        square, loss = self.focal_length**2, self.f_number * self.pixel_size * self._reach()
        near = self.focus_distance * square / (square + loss)
        far = self.focus_distance * square / (square - loss) if loss < square else np.inf
        return float(near), float(far)

    def hyperfocal_distance(self) -> float:
        """Return the nearest focus that keeps infinity sharp, in metres (from Eq. 2.17).

        It is the focus distance at which ``n c (d_o - f) = f^2``, with a blur c of one pixel.
        """
        return float(self.focal_length**2 / (self.f_number * self.pixel_size) + self.focal_length)

    def depth_resolution(self, distance: ArrayLike) -> Floats:
        """Return how much farther a point must be for its blur to grow by a pixel, in metres.

        Eq. 2.21 as an equality, solved for d_2 - d_1; infinite if no distance is far enough.

        Parameters
        ----------
        distance : array_like of float
            d_1 in metres, at least the focus distance.

        Examples
        --------
        >>> lens = ThinLens(3.7, 9.6e-3, 0.5, 4.8e-6)
        >>> lens.depth_resolution([0.5, 1.0, 8.0]).round(3).tolist()
        [0.052, 0.233, inf]
        """
        start = _distances(distance)
        inverse = 1 / start - self.pixel_size / self._scale()
        with np.errstate(divide="ignore"):
            return np.where(inverse > 1e-12, 1 / np.maximum(inverse, 1e-12) - start, np.inf)

    def _reach(self) -> float:
        return self.focus_distance - self.focal_length

    def _scale(self) -> float:
        return self.focus_distance * self.focal_length**2 / (self.f_number * self._reach())


def _distances(distance: ArrayLike) -> Floats:
    metres = np.asarray(distance, np.float64)
    if not (metres > 0).all():
        raise InputError("a distance is not positive", where="distance", got=str(metres.min()))
    return metres
