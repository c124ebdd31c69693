"""Convert LIDAR ranges to depth maps, and read and write their files."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from dfdbench.blur.recipe import LAST_LEVEL
from dfdbench.errors import InputError, Problem, SourceError, reason_of
from dfdbench.system.array_files import UNREADABLE, load_array
from dfdbench.system.files import LARGEST_ARRAY, read_text_as, read_whole, shipped

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
Kind = TypeVar("Kind", bound=np.generic)
CENTRE_COLUMN = 1024
HALF_WIDTH = 150
_MEDIAN = 7
MILLIMETRES_PER_LEVEL = 10
_UPSAMPLED_MEDIAN = 13
#: Total scale after each of the six steps: (height, width).
UPSAMPLING = ((3, 2), (6, 2), (9, 4), (12, 4), (15, 6), (18, 6))


@dataclass(frozen=True)
class Beams:
    """The direction of each laser beam of a LIDAR.

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
    """Return the mean range over several scans, ignoring missing returns.

    Parameters
    ----------
    scans : sequence of ndarray of int, shape (beam, column)
        Ranges in millimetres, 0 if nothing came back.

    Returns
    -------
    ndarray of float, shape (beam, column)
        0 if no scan had a return.

    Raises
    ------
    InputError
        If there is no scan, or they differ in shape.

    Examples
    --------
    >>> average_scans([np.array([[1500, 0, 0]]), np.array([[1510, 1600, 0]])]).tolist()
    [[1505.0, 1600.0, 0.0]]
    """
    if len({scan.shape for scan in scans}) != 1:
        raise InputError("there are no scans, or they differ in shape")
    stack = np.stack(scans).astype(np.float64)
    count = (stack > 0).sum(axis=0)
    return np.asarray(stack.sum(axis=0) / np.maximum(count, 1))


def to_cartesian(ranges: Floats, beams: Beams) -> tuple[Floats, Floats, Floats]:
    """Return X ahead, Y to the left and Z up, in the ranges' unit (Eq. 3.5 to 3.9).

    The printed Eq. 3.6 lacks the division by 360 that turns degrees into turns.

    Parameters
    ----------
    ranges : ndarray, shape (beam, column)
        One full turn.
    beams : Beams
        The direction of each row.

    Raises
    ------
    InputError
        If the number of beams is not the number of rows.

    Examples
    --------
    >>> level = Beams(np.zeros(1), np.zeros(1), np.zeros(1, int))
    >>> x, y, z = to_cartesian(np.full((1, 4), 1000.0), level)
    >>> x.round().tolist(), y.round().tolist(), z.round().tolist()
    ([[-707.0, 707.0, 707.0, -707.0]], [[707.0, 707.0, -707.0, -707.0]], [[0.0, 0.0, 0.0, 0.0]])
    """
    rows, columns = ranges.shape
    if rows != len(beams.altitude):
        raise InputError(f"{rows} rows of ranges need as many beams, not {len(beams.altitude)}")
    measurement = np.arange(columns) + beams.azimuth_index[:, np.newaxis]
    theta = 2 * np.pi * (measurement % columns - (columns - 1) / 2) / columns
    phi = 2 * np.pi * beams.altitude[:, np.newaxis] / 360
    return (
        np.asarray(ranges * np.cos(theta) * np.cos(phi)),
        np.asarray(-ranges * np.sin(theta) * np.cos(phi)),
        np.asarray(ranges * np.sin(phi)),
    )


def align_columns(values: Floats, beams: Beams) -> Floats:
    """Shift each row so that a column is the same direction in all rows.

    The beams of the head are staggered: neighbouring rows of a column differ by some degrees.

    Parameters
    ----------
    values : ndarray, shape (beam, column) or (beam, column, 3)
        One full turn.
    beams : Beams
        The direction of each row.

    Examples
    --------
    >>> two = Beams(np.zeros(2), np.zeros(2), np.array([1, -1]))
    >>> align_columns(np.array([[1.0, 2, 3], [1, 2, 3]]), two).tolist()
    [[3.0, 1.0, 2.0], [2.0, 3.0, 1.0]]
    """
    rows = zip(values, beams.azimuth_index.tolist(), strict=True)
    return np.stack([np.roll(row, index, axis=0) for row, index in rows])


def crop_columns(values: Floats) -> Floats:
    """Return the 300 columns that look ahead.

    Examples
    --------
    >>> crop_columns(np.zeros((64, 2048))).shape
    (64, 300)
    """
    return values[:, CENTRE_COLUMN - HALF_WIDTH : CENTRE_COLUMN + HALF_WIDTH]


def fill_missing(values: Floats, valid: Mask) -> Floats:
    """Replace each invalid value by the nearest valid one.

    Raises
    ------
    InputError
        If nothing is valid.

    Examples
    --------
    >>> fill_missing(np.array([[5.0, 0, 0, 9]]), np.array([[True, False, False, True]])).tolist()
    [[5.0, 5.0, 9.0, 9.0]]
    """
    if not valid.any():
        raise InputError("the LIDAR saw nothing ahead: all ranges are 0")
    nearest = ndimage.distance_transform_edt(~valid, return_distances=False, return_indices=True)
    return np.asarray(values[tuple(nearest)])


def median_cross(values: Floats, length: int = _MEDIAN) -> Floats:
    """Apply a median along columns, then one along rows.

    A square median of that length would round corners. The image is mirrored beyond its edge.

    Parameters
    ----------
    values : ndarray, shape (y, x)
        The values to filter.
    length : int
        Odd; 7 for the LIDAR's values, 13 while they are scaled up.
    """
    return _median_rows(_median_rows(values.T, length).T, length)


def _median_rows(values: Floats, length: int) -> Floats:
    # Rows are padded and laid end to end: in one dimension the filter is ten times faster.
    half = length // 2
    padded = np.pad(values, ((0, 0), (half, half)), mode="symmetric")
    flat = ndimage.median_filter(np.ascontiguousarray(padded).ravel(), size=length)
    return np.asarray(flat.reshape(padded.shape)[:, half:-half])


def to_levels(distance: Floats) -> Floats:
    """Convert distances in millimetres to whole centimetres, clipped to the levels 0 to 255.

    Examples
    --------
    >>> to_levels(np.array([1509.9, 2550.0, 4000.0])).tolist()
    [150.0, 255.0, 255.0]
    """
    return np.clip(np.floor(distance / MILLIMETRES_PER_LEVEL), 0, LAST_LEVEL)


def in_range(distance: Floats) -> Mask:
    """Return where a distance in millimetres has its own level: below 2.55 m.

    Level 255 also represents everything farther away.

    Examples
    --------
    >>> in_range(np.array([0.0, 1500.0, 2549.0, 2550.0])).tolist()
    [False, True, True, False]
    """
    return (distance >= MILLIMETRES_PER_LEVEL) & (distance < LAST_LEVEL * MILLIMETRES_PER_LEVEL)


def upsample(levels: Floats, valid: Mask) -> tuple[Floats, Mask]:
    """Scale levels and validity to 18 times the height and 6 times the width, in six steps.

    Each step scales to the nearest neighbour, then takes the medians 13 x 1 and 1 x 13, which round
    off the stairs that scaling leaves. Invalid pixels stay invalid, and so do those whose median
    comes from beyond the range.

    Examples
    --------
    >>> levels, valid = upsample(np.full((64, 300), 150.0), np.ones((64, 300), bool))
    >>> levels.shape, float(levels.min()), bool(valid.all())
    ((1152, 1800), 150.0, True)
    """
    height, width = levels.shape
    scaled = levels
    for down, across in UPSAMPLING:
        scaled = median_cross(_nearest(scaled, height * down, width * across), _UPSAMPLED_MEDIAN)
    return scaled, np.asarray(_nearest(valid, *scaled.shape) & (scaled < LAST_LEVEL))


def warp(
    levels: Floats, valid: Mask, matrix: Floats, shape: tuple[int, int]
) -> tuple[NDArray[np.uint8], Mask]:
    """Return levels and validity as the camera sees them.

    Parameters
    ----------
    levels, valid : ndarray, shape (y, x)
        As returned by `upsample`.
    matrix : ndarray of float, shape (3, 3)
        Projective, from (x, y) in `levels` to (x, y) in the image, in pixels.
    shape : tuple of int
        Height and width of the image.

    Returns
    -------
    levels : ndarray of uint8, shape `shape`
        0 if not valid.
    valid : ndarray of bool, shape `shape`
        Also False if only the camera sees the place.
    """
    warped, seen = (
        cv2.warpPerspective(part.astype(np.uint8), matrix, shape[::-1], flags=cv2.INTER_NEAREST)
        for part in (levels, valid)
    )
    return np.where(seen, warped, 0).astype(np.uint8), seen.astype(bool)


def depth_image(ranges: Floats, beams: Beams) -> tuple[Floats, Mask]:
    """Return the LIDAR's view ahead as levels, before registration: every step up to `upsample`.

    Parameters
    ----------
    ranges : ndarray of float, shape (beam, column)
        Averaged, in millimetres.
    beams : Beams
        The direction of each row.

    Returns
    -------
    levels : ndarray of float, shape (18 * beam, 1800)
        Depth levels.
    valid : ndarray of bool
        False if nothing came back, or if the return is from farther than the levels reach.
    """
    distance = crop_columns(align_columns(to_cartesian(ranges, beams)[0], beams))
    returned = crop_columns(align_columns(ranges, beams)) > 0
    filtered = median_cross(fill_missing(distance, returned))
    return upsample(to_levels(filtered), returned & in_range(filtered))


def _nearest(values: NDArray[Kind], height: int, width: int) -> NDArray[Kind]:
    rows = (2 * np.arange(height) + 1) * values.shape[0] // (2 * height)
    columns = (2 * np.arange(width) + 1) * values.shape[1] // (2 * width)
    return np.asarray(values[rows[:, np.newaxis], columns])


_OS1 = "realworld-1/os1_beams.csv"
#: The columns that are read, and how large their numbers may be; no scan has more columns.
_LIMITS = {"altitude_deg": 90, "azimuth_deg": 360, "azimuth_index": 2**16}
_HEADER = 8
_FARTHEST = np.iinfo(np.int32).max


def read_ranges(path: Path) -> NDArray[np.int32]:
    """Read one scan: the rig's binary file, or an array in NumPy's ``.npy``.

    The binary file is little-endian: rows and columns as uint32, then the ranges row by row as
    int32.

    Parameters
    ----------
    path : Path
        ``*.bin`` or ``*.npy``.

    Returns
    -------
    ndarray of int32, shape (beam, column)
        Millimetres; 0 if nothing came back.

    Raises
    ------
    SourceError
        If the header disagrees with the length, the bytes are big-endian, or the values are not
        ranges.
    """
    try:
        array = load_array(path) if path.suffix == ".npy" else _decode(path)
    except OSError as error:
        got = reason_of(error)
        raise SourceError("cannot read the range file", where=str(path), got=got) from error
    except UNREADABLE as error:
        raise SourceError("not a NumPy array", where=str(path), got=str(error)) from error
    if array.ndim != 2 or not array.size or not np.issubdtype(array.dtype, np.integer):
        what = "not ranges: whole numbers of shape (beam, column)"
        raise SourceError(what, where=str(path), got=f"{array.dtype}, shape {array.shape}")
    if array.min() < 0 or array.max() > _FARTHEST:
        what = f"not ranges: 0 to {_FARTHEST} mm in each cell"
        raise SourceError(what, where=str(path), got=f"{array.min()} to {array.max()}")
    return np.array(array, np.int32)


def write_ranges(path: Path, ranges: NDArray[np.int32]) -> None:
    """Write one scan as the rig's binary file.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "lidar_rng_00000.bin"
    ...     write_ranges(path, np.array([[1500, 0]], np.int32))
    ...     read_ranges(path).tolist()
    [[1500, 0]]
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    header = np.array(ranges.shape, "<u4").tobytes()
    path.write_bytes(header + np.ascontiguousarray(ranges, "<i4").tobytes())


def read_beams(path: Path | None = None) -> Beams:
    """Read the directions of a LIDAR's beams.

    Parameters
    ----------
    path : Path, optional
        CSV with columns beam, altitude_deg, azimuth_deg and azimuth_index, the top beam first; by
        default the thesis's OS-1, shipped with manifest realworld-1.

    Raises
    ------
    SourceError
        With every problem of the file.

    Examples
    --------
    >>> beams = read_beams()
    >>> len(beams.altitude), int(beams.azimuth_index.min()), int(beams.azimuth_index.max())
    (64, -19, 19)
    """
    where = str(path or _OS1)
    file = path or shipped("manifests") / _OS1
    text = read_text_as(SourceError, file, "the beam calibration")
    reader = csv.DictReader(text.splitlines())
    rows = list(reader)
    if not rows or not {*_LIMITS} <= {*(reader.fieldnames or ())}:
        raise SourceError(f"no rows with the columns {', '.join(_LIMITS)}", where=where)
    problems: list[Problem] = []
    found = [_column(rows, name, where, problems) for name in _LIMITS]
    SourceError.raise_if(problems)
    return Beams(np.array(found[0]), np.array(found[1]), np.array(found[2], np.int64))


def _column(
    rows: list[dict[str, str]], name: str, where: str, problems: list[Problem]
) -> list[float]:
    """Return a column's numbers within its limit; one problem covers all that are not."""
    numbers, wrong = [], []
    for line, row in enumerate(rows, start=2):
        try:
            numbers.append(float(row[name]) if name.endswith("_deg") else int(row[name]))
            if not abs(numbers[-1]) <= _LIMITS[name]:
                raise ValueError
        except (TypeError, ValueError):
            wrong.append(line)
    if wrong:
        more = f", and {len(wrong) - 1} more lines" if len(wrong) > 1 else ""
        kind = "degrees" if name.endswith("_deg") else "whole numbers"
        what = f"{name} is not {kind} up to {_LIMITS[name]}"
        got = rows[wrong[0] - 2][name] or "nothing"
        problems.append(Problem(what, where=f"{where}: line {wrong[0]}{more}", got=got))
    return numbers


def _decode(path: Path) -> NDArray[np.int32]:
    content = read_whole(path, LARGEST_ARRAY)
    if len(content) < _HEADER:
        raise SourceError("the range file has no header of 8 bytes", where=str(path))
    little, big = (tuple(map(int, np.frombuffer(content, f"{order}u4", 2))) for order in "<>")
    if _length(little) == len(content):
        return np.frombuffer(content, "<i4", offset=_HEADER).reshape(little)
    if _length(big) == len(content):
        fix = "write it again as uint32 rows, uint32 columns, int32 ranges, little-endian"
        raise SourceError("the range file is big-endian", where=str(path), fix=fix)
    what = f"the header of {little[0]} x {little[1]} ranges disagrees with the file's length"
    raise SourceError(what, where=str(path), fix="copy the file again")


def _length(shape: tuple[int, ...]) -> int:
    return _HEADER + 4 * shape[0] * shape[1]
