"""A LIDAR's ranges, averaged, turned and cleaned (thesis, 3.2.5): one pure function a step.

Ranges are in millimetres, shape (beam, column); 0 means that nothing came back. A column is a
measurement ID, 0 to 2047 in a turn, 1024 straight ahead. Arrays of values travel with an array
`valid` of the same shape: values are filled from their neighbours where there was no return, so
that filters have something to work on, and `valid` says where that is so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from dfdbench.errors import InputError

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
Kind = TypeVar("Kind", bound=np.generic)

CENTRE_COLUMN = 1024
HALF_WIDTH = 150
_MEDIAN = 7


@dataclass(frozen=True)
class Beams:
    """Where each laser beam of a LIDAR points.

    Parameters
    ----------
    altitude : ndarray of float, shape (beam,)
        In degrees above the horizon.
    azimuth : ndarray of float, shape (beam,)
        In degrees, ahead of the turning head.
    azimuth_index : ndarray of int, shape (beam,)
        The same in columns, rounded as the maker does.
    """

    altitude: Floats
    azimuth: Floats
    azimuth_index: NDArray[np.int64]


def average_scans(scans: Sequence[NDArray[np.int32]]) -> Floats:
    """Return the mean range over several scans, missing returns left out of it.

    Parameters
    ----------
    scans : sequence of ndarray of int, shape (beam, column)
        Ranges in millimetres, 0 where nothing came back.

    Returns
    -------
    ndarray of float, shape (beam, column)
        0 where no scan had a return.

    Raises
    ------
    InputError
        Where there is no scan, or they differ in shape.

    Examples
    --------
    >>> average_scans([np.array([[1500, 0, 0]]), np.array([[1510, 1600, 0]])]).tolist()
    [[1505.0, 1600.0, 0.0]]
    """
    shapes = {scan.shape for scan in scans}
    if len(shapes) != 1:
        raise InputError(
            "scans differ in shape", where="scans", expected="one shape", got=str(shapes or 0)
        )
    stack = np.stack(scans).astype(np.float64)
    count = (stack > 0).sum(axis=0)
    return np.asarray(stack.sum(axis=0) / np.maximum(count, 1))


def to_cartesian(ranges: Floats, beams: Beams) -> tuple[Floats, Floats, Floats]:
    """Return X ahead, Y to the left and Z up, in the ranges' unit (Eq. 3.5 to 3.9).

    Eq. 3.6 is printed without the division by 360 that turns degrees into turns.

    Parameters
    ----------
    ranges : ndarray, shape (beam, column)
        One full turn.
    beams : Beams
        Where each row points.

    Raises
    ------
    InputError
        Where there is not a beam for each row.

    Examples
    --------
    >>> level = Beams(np.zeros(1), np.zeros(1), np.zeros(1, int))
    >>> x, y, z = to_cartesian(np.full((1, 4), 1000.0), level)
    >>> x.round().tolist(), y.round().tolist(), z.round().tolist()
    ([[-707.0, 707.0, 707.0, -707.0]], [[707.0, 707.0, -707.0, -707.0]], [[0.0, 0.0, 0.0, 0.0]])
    """
    rows, columns = ranges.shape
    if rows != len(beams.altitude):
        raise InputError(
            "not a beam for each row",
            where="beams",
            expected=f"{rows} beams",
            got=f"{len(beams.altitude)}",
        )
    measurement = np.arange(columns) + beams.azimuth_index[:, np.newaxis]
    theta = 2 * np.pi * (measurement % columns - (columns - 1) / 2) / columns
    phi = 2 * np.pi * beams.altitude[:, np.newaxis] / 360
    return (
        np.asarray(ranges * np.cos(theta) * np.cos(phi)),
        np.asarray(-ranges * np.sin(theta) * np.cos(phi)),
        np.asarray(ranges * np.sin(phi)),
    )


def align_columns(values: Floats, beams: Beams) -> Floats:
    """Return the values with each row turned so that a column is one direction in all rows.

    The beams of the head are staggered: neighbouring rows of one column look some degrees apart.

    Parameters
    ----------
    values : ndarray, shape (beam, column)
        One full turn.
    beams : Beams
        Where each row points.

    Examples
    --------
    >>> two = Beams(np.zeros(2), np.zeros(2), np.array([1, -1]))
    >>> align_columns(np.array([[1.0, 2, 3], [1, 2, 3]]), two).tolist()
    [[3.0, 1.0, 2.0], [2.0, 3.0, 1.0]]
    """
    rows = zip(values, beams.azimuth_index.tolist(), strict=True)
    return np.stack([np.roll(row, index) for row, index in rows])


def crop_columns(values: Floats, centre: int = CENTRE_COLUMN, half: int = HALF_WIDTH) -> Floats:
    """Return the columns that look ahead: `half` to each side of `centre`, 300 by default.

    Examples
    --------
    >>> crop_columns(np.zeros((64, 2048))).shape
    (64, 300)
    """
    return values[:, centre - half : centre + half]


def fill_missing(values: Floats, valid: Mask) -> Floats:
    """Return the values with each that is not valid taken from the nearest that is.

    Raises
    ------
    InputError
        Where nothing is valid.

    Examples
    --------
    >>> fill_missing(np.array([[5.0, 0, 0, 9]]), np.array([[True, False, False, True]])).tolist()
    [[5.0, 5.0, 9.0, 9.0]]
    """
    if not valid.any():
        raise InputError(
            "the LIDAR saw nothing ahead", where="ranges", expected="returns", got="all are 0"
        )
    nearest = ndimage.distance_transform_edt(~valid, return_distances=False, return_indices=True)
    return np.asarray(values[tuple(nearest)])


def median_cross(values: Floats, length: int = _MEDIAN) -> Floats:
    """Return the values after a median along columns, then one along rows.

    A square median of that length would round the corners of what the LIDAR sees. Past its edge
    the image goes on as its mirror image.

    Parameters
    ----------
    values : ndarray, shape (y, x)
        What is filtered.
    length : int
        Odd; 7 for what the LIDAR gives, 13 while it is scaled up.
    """
    return _median_rows(_median_rows(values.T, length).T, length)


def _median_rows(values: Floats, length: int) -> Floats:
    # Rows are padded and laid end to end: in one dimension the filter is ten times faster.
    half = length // 2
    padded = np.pad(values, ((0, 0), (half, half)), mode="symmetric")
    flat = ndimage.median_filter(np.ascontiguousarray(padded).ravel(), size=length)
    return np.asarray(flat.reshape(padded.shape)[:, half:-half])
