"""The rig's image files: looked at without decoding, decoded, averaged."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from dfdbench.errors import Problem, SourceError, reason_of
from dfdbench.system.files import LARGEST_ARRAY, read_whole, require_file

Image = NDArray[np.uint8]


def average_frames(frames: list[Image]) -> Image:
    """Return the mean of several frames, pixel by pixel, rounded half up (thesis, 3.2.3).

    Examples
    --------
    >>> average_frames([np.array([[7, 0]], np.uint8), np.array([[8, 0]], np.uint8)]).tolist()
    [[8, 0]]
    """
    total = np.sum([frame.astype(np.uint32) for frame in frames], axis=0)
    count = len(frames)
    return np.asarray((2 * total + count) // (2 * count), np.uint8)


def png_problems(files: list[Path], size: tuple[int, ...]) -> list[Problem]:
    """Return what is wrong with PNG files, found without decoding them; `size` in (y, x)."""
    return [problem for path in files for problem in _png_problem(path, size)]


def _png_problem(path: Path, size: tuple[int, ...]) -> Iterator[Problem]:
    try:
        require_file(path)
        with path.open("rb") as file:
            head = file.read(24)
            file.seek(0, 2)
            length = file.tell()
            file.seek(max(length - 16, 0))
            tail = file.read()
    except OSError as error:
        yield Problem("cannot read the file", where=str(path), got=reason_of(error))
        return
    if not head.startswith(b"\x89PNG\r\n\x1a\n") or len(head) < 24:
        yield Problem("not a PNG file", where=str(path), got=f"bytes {head[:8]!r}")
        return
    # A truncated PNG decodes to an image whose end is missing: the end mark tells.
    if b"IEND" not in tail:
        yield Problem("PNG file is damaged", where=str(path), got=f"{length} bytes, cut short")
    width, height = struct.unpack(">II", head[16:24])
    if (height, width) != size:
        expected = " x ".join(map(str, size))
        yield Problem(
            "size differs",
            where=str(path),
            expected=f"{expected} (height x width)",
            got=f"{height} x {width}",
        )


def decode(path: Path, mode: int) -> Image:
    """Return a PNG file's image, in an OpenCV mode of reading.

    Raises
    ------
    SourceError
        Where it does not decode.
    """
    try:
        content = read_whole(path, LARGEST_ARRAY)
    except OSError as error:
        raise SourceError("cannot read the file", where=str(path), got=reason_of(error)) from error
    image = cv2.imdecode(np.frombuffer(content, np.uint8), mode)
    if image is None:
        raise SourceError("PNG file is damaged", where=str(path), fix="fetch it again")
    return np.asarray(image, np.uint8)
