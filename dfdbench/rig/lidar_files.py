"""Read and write a LIDAR's files: ranges of a scan, and where its beams point."""

from __future__ import annotations

import csv
from importlib import resources
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dfdbench.errors import Problem, SourceError, reason_of
from dfdbench.rig.lidar import Beams
from dfdbench.system.array_files import UNREADABLE, load_array
from dfdbench.system.files import LARGEST_ARRAY, read_text, read_whole

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
    """Read where a LIDAR's beams point.

    Parameters
    ----------
    path : Path, optional
        CSV with columns beam, altitude_deg, azimuth_deg and azimuth_index, the top beam first;
        by default the thesis's OS-1, shipped with manifest realworld-1.

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
    try:
        shipped = resources.files("dfdbench.manifests").joinpath(_OS1)
        text = read_text(path) if path else shipped.read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        got = str(error)
        raise SourceError("cannot read the beam calibration", where=where, got=got) from error
    reader = csv.DictReader(text.splitlines())
    rows = list(reader)
    if not rows or not {*_LIMITS} <= {*(reader.fieldnames or ())}:
        raise SourceError(f"no rows with the columns {', '.join(_LIMITS)}", where=where)
    problems: list[Problem] = []
    found = [_column(rows, name, where, problems) for name in _LIMITS]
    if problems:
        raise SourceError.of(problems)
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
    raise SourceError(
        f"the header of {little[0]} x {little[1]} ranges disagrees with the file's length",
        where=str(path),
        fix="copy the file again",
    )


def _length(shape: tuple[int, ...]) -> int:
    return _HEADER + 4 * shape[0] * shape[1]
