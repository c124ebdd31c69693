"""Read and write a registration, in a small file that a person can correct."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from pydantic import FiniteFloat, ValidationError

from dfdbench.errors import SourceError, reason_of
from dfdbench.rig.lidar import Floats
from dfdbench.system.files import read_text, write_whole
from dfdbench.system.record import Record, problems_of
from dfdbench.system.toml_text import parse_toml

NAME = "registration.toml"
#: The earlier registration, perhaps corrected by hand.
PREVIOUS = "registration.previous.toml"
_LEAST_PAIRS = 4
_HEAD = """\
# Where the LIDAR's depth map is on the image. Each pair is one point of the scene: its place
# in the depth map, scaled up, and its place in the cropped image, both x, y in pixels from the
# middle of the top left one. Move a point to correct the fit; add more, and all are fitted.
# Instead of pairs there may be: matrix = [[...], [...], [...]], projective, 3 x 3.
"""

_Row = tuple[FiniteFloat, FiniteFloat, FiniteFloat]


class _Pair(Record):
    lidar: tuple[FiniteFloat, FiniteFloat]
    image: tuple[FiniteFloat, FiniteFloat]


class _File(Record):
    matrix: tuple[_Row, _Row, _Row] | None = None
    pairs: tuple[_Pair, ...] = ()


def read_registration(path: Path) -> Floats:
    """Return the projective matrix that a file gives, outright or by pairs of points.

    Parameters
    ----------
    path : Path
        TOML with `matrix`, or with four or more `[[pairs]]` of `lidar` and `image`.

    Returns
    -------
    ndarray of float, shape (3, 3)
        From the scaled-up depth map to the cropped image, (x, y) in pixels.

    Raises
    ------
    SourceError
        If the file gives no such matrix.
    """
    where = str(path)
    try:
        content = _File.model_validate(parse_toml(read_text(path)))
    except ValidationError as error:
        raise SourceError.of(problems_of(error, "not a registration", file=path)) from error
    except (OSError, ValueError) as error:
        got = reason_of(error)
        raise SourceError("cannot read the registration", where=where, got=got) from error
    if content.matrix is not None:
        if content.pairs:
            fix = "leave out one"
            raise SourceError("the file has both a matrix and pairs", where=where, fix=fix)
        matrix = np.array(content.matrix, np.float64)
        if not np.linalg.det(matrix):
            raise SourceError("not a projective matrix", where=where, got=str(matrix.tolist()))
        return matrix
    if len(content.pairs) < _LEAST_PAIRS:
        what = f"too few pairs of points: {_LEAST_PAIRS} or more [[pairs]] are needed, or a matrix"
        raise SourceError(what, where=where)
    source, target = np.array([(pair.lidar, pair.image) for pair in content.pairs]).swapaxes(0, 1)
    for key, points in (("lidar", source), ("image", target)):
        if len(np.unique(points, axis=0)) < len(points):
            raise SourceError("two pairs share a point", where=f"{where}: {key}")
    fitted, _ = cv2.findHomography(source, target, 0)
    flat = any(np.linalg.matrix_rank(p - p[0], tol=1e-6) < 2 for p in (source, target))
    if flat or fitted is None or not np.isfinite(fitted).all():
        raise SourceError("the points lie on one line: no surface has them", where=where)
    return np.asarray(fitted, np.float64)


def write_registration(path: Path, matrix: Floats, corners: Floats, note: str) -> None:
    """Write a registration as the pairs of four corners; an older file is kept as `PREVIOUS`.

    Parameters
    ----------
    path : Path
        Where to.
    matrix : ndarray of float, shape (3, 3)
        From the scaled-up depth map to the cropped image.
    corners : ndarray of float, shape (4, 2)
        Places (x, y) in the depth map to write down.
    note : str
        How it was found: a comment in the file.

    Raises
    ------
    SourceError
        If the file cannot be written.
    """
    target = cv2.perspectiveTransform(corners[np.newaxis].astype(np.float64), matrix)[0]
    pairs = [
        f"[[pairs]]\nlidar = [{u:.2f}, {v:.2f}]\nimage = [{x:.2f}, {y:.2f}]\n"
        for (u, v), (x, y) in zip(corners, target, strict=True)
    ]
    try:
        if path.exists():
            write_whole(path.with_name(PREVIOUS), path.read_bytes())
        write_whole(path, "\n".join([f"{_HEAD}# {note}\n", *pairs]))
    except OSError as error:
        got = reason_of(error)
        raise SourceError("cannot write the registration", where=str(path), got=got) from error
