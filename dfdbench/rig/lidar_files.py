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
_COLUMNS = ("beam", "altitude_deg", "azimuth_deg", "azimuth_index")
_HEADER = 8
#: More columns no LIDAR's scan has.
_MOST_COLUMNS = 2**16


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
        Millimetres; 0 where nothing came back.

    Raises
    ------
    SourceError
        Where the header disagrees with the length, the bytes are in big-endian order, or the
        values are no ranges.
    """
    try:
        ranges = (
            _load_array(path)
            if path.suffix == ".npy"
            else _decode(read_whole(path, LARGEST_ARRAY), path)
        )
    except OSError as error:
        raise SourceError(
            "cannot read the range file", where=str(path), got=reason_of(error)
        ) from error
    if ranges.size == 0 or ranges.min() < 0:
        raise SourceError(
            "not ranges",
            where=str(path),
            expected="0 or more millimetres in each cell",
            got=f"shape {ranges.shape}" if ranges.size == 0 else f"a range of {ranges.min()}",
        )
    return ranges


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
        raise SourceError(
            "cannot read the beam calibration", where=where, got=str(error)
        ) from error
    reader = csv.DictReader(text.splitlines())
    missing = [name for name in _COLUMNS if name not in (reader.fieldnames or ())]
    if missing:
        raise SourceError(
            "column is missing",
            where=where,
            expected=",".join(_COLUMNS),
            got=", ".join(missing) + " absent",
        )
    rows = list(reader)
    if not rows:
        raise SourceError("no beam", where=where, expected="a line a beam")
    problems: list[Problem] = []
    altitudes = _column(rows, "altitude_deg", 90, where, problems)
    azimuths = _column(rows, "azimuth_deg", 360, where, problems)
    indices = _column(rows, "azimuth_index", _MOST_COLUMNS, where, problems, whole=True)
    if problems:
        raise SourceError.of(problems)
    return Beams(np.array(altitudes), np.array(azimuths), np.array(indices, np.int64))


def _column(
    rows: list[dict[str, str]],
    name: str,
    limit: int,
    where: str,
    problems: list[Problem],
    whole: bool = False,
) -> list[float]:
    """Return a column's numbers: whole ones, or degrees, within a limit; one problem tells all."""
    numbers: list[float] = []
    wrong: list[tuple[int, str | None]] = []
    for line, row in enumerate(rows, start=2):
        try:
            number = int(row[name]) if whole else float(row[name])
            if not abs(number) <= limit:
                raise ValueError
        except (TypeError, ValueError):
            wrong.append((line, row[name]))
        else:
            numbers.append(number)
    if wrong:
        line, first = wrong[0]
        more = f", and {len(wrong) - 1} more lines" if len(wrong) > 1 else ""
        expected = f"{'whole numbers' if whole else 'degrees'}, {limit} at most"
        got = "nothing" if first is None else first
        problems.append(
            Problem(
                f"not the {name} of a beam",
                where=f"{where}: line {line}{more}",
                expected=expected,
                got=got,
            )
        )
    return numbers


def _load_array(path: Path) -> NDArray[np.int32]:
    try:
        array = load_array(path)
    except UNREADABLE as error:
        if isinstance(error, OSError):
            raise
        raise SourceError("not a NumPy array", where=str(path), got=str(error)) from error
    if array.ndim != 2 or not np.issubdtype(array.dtype, np.integer):
        raise SourceError(
            "not an array of ranges",
            where=str(path),
            expected="whole numbers, shape (beam, column)",
            got=f"{array.dtype}, shape {array.shape}",
        )
    most = np.iinfo(np.int32).max
    if array.size and array.max() > most:
        # As int32 they would turn into other ranges.
        raise SourceError(
            "not ranges",
            where=str(path),
            expected=f"{most} mm at most",
            got=f"a range of {array.max()}",
        )
    return np.array(array, np.int32)


def _decode(content: bytes, path: Path) -> NDArray[np.int32]:
    if len(content) < _HEADER:
        raise SourceError(
            "range file is cut short",
            where=str(path),
            expected="a header of 8 bytes",
            got=f"{len(content)}",
        )
    little, big = (tuple(map(int, np.frombuffer(content, f"{order}u4", 2))) for order in "<>")
    if _length(little) != len(content) and _length(big) == len(content):
        raise SourceError(
            "range file is big-endian",
            where=str(path),
            expected="little-endian numbers",
            got=f"a header that reads {big[0]} x {big[1]} only with its bytes swapped",
            fix="write it again as uint32 rows, uint32 columns, int32 ranges, little-endian",
        )
    if _length(little) != len(content):
        raise SourceError(
            "header disagrees with the file's length",
            where=str(path),
            expected=f"{_length(little)} bytes for {little[0]} x {little[1]} ranges",
            got=f"{len(content)} bytes",
            fix="copy the file again",
        )
    return np.frombuffer(content, "<i4", offset=_HEADER).reshape(little).astype(np.int32)


def _length(shape: tuple[int, ...]) -> int:
    return _HEADER + 4 * shape[0] * shape[1]
