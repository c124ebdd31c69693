"""Decode the PNG files of a data set, and refuse what cannot be one of its images."""

from __future__ import annotations

import struct
import zlib

import cv2
import numpy as np
from numpy.typing import NDArray

from dfdbench.errors import SourceError

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_COLOUR_TYPES = {0: "grey", 2: "RGB", 3: "palette", 4: "grey with alpha", 6: "RGB with alpha"}
_GREY, _RGB = 0, 2
_MOST_PIXELS = 64_000_000  # more than any camera of these sets; a small file can claim anything
_FETCH_AGAIN = "fetch it again"


def decode_image(
    content: bytes, where: str, size: tuple[int, int] | None = None
) -> NDArray[np.uint8]:
    """Return an image from a PNG file's bytes.

    Parameters
    ----------
    content : bytes
        The file.
    where : str
        Its name, for messages.
    size : tuple of int, optional
        The rows and columns that it must have.

    Returns
    -------
    ndarray of uint8, shape (y, x, 3)
        RGB.

    Raises
    ------
    SourceError
        Where it is no PNG file, is damaged, is not 8 bit RGB or grey, has another size, or is
        black all over.

    Examples
    --------
    >>> content = cv2.imencode(".png", np.full((2, 3), 7, np.uint8))[1].tobytes()
    >>> decode_image(content, "view1.png").shape
    (2, 3, 3)
    """
    image = _decode(content, where, cv2.IMREAD_COLOR_RGB)
    if size is not None and image.shape[:2] != size:
        raise _refused("size differs from the depth map's", where, _sides(size), _sides(image))
    if not image.any():
        raise _refused("the image is black all over", where)
    return image


def decode_depth(content: bytes, where: str, unknown: int) -> NDArray[np.uint8]:
    """Return a depth map from a PNG file's bytes.

    Parameters
    ----------
    content, where
        As for `decode_image`.
    unknown : int
        The level that marks pixels without ground truth.

    Returns
    -------
    ndarray of uint8, shape (y, x)
        Depth levels.

    Raises
    ------
    SourceError
        As `decode_image` does, and where the file is in colour or no pixel's depth is known.
    """
    image = _decode(content, where, cv2.IMREAD_COLOR_RGB)
    if not (image == image[..., :1]).all():
        raise _refused("a depth map in colour", where, "grey levels", "channels that differ")
    if (image[..., 0] == unknown).all():
        raise _refused(
            "the depth map tells no depths", where, got=f"level {unknown} all over, unknown"
        )
    return np.ascontiguousarray(image[..., 0])


def png_size(content: bytes, where: str) -> tuple[int, int]:
    """Return the rows and columns that a PNG file's first bytes state, without decoding it.

    Raises
    ------
    SourceError
        Where it is no PNG file of 8 bit RGB or grey, or claims to be larger than any image here.
    """
    if not content.startswith(_SIGNATURE):
        got = "an empty file" if not content else f"bytes {content[:8]!r}"
        raise _refused("not a PNG file", where, got=got)
    if content[12:16] != b"IHDR" or len(content) < 33:
        raise _refused("the PNG file is damaged", where, got="no size in it")
    columns, rows, bits, colour_type = struct.unpack(">IIBB", content[16:26])
    if bits != 8:
        raise _refused("wrong depth of colour", where, "8 bit", f"{bits} bit")
    if colour_type not in (_GREY, _RGB):
        kind = _COLOUR_TYPES.get(colour_type, f"type {colour_type}")
        raise _refused("wrong kind of colour", where, "RGB or grey", kind)
    if not 0 < rows * columns <= _MOST_PIXELS:
        raise _refused(
            "no plausible size", where, f"up to {_MOST_PIXELS} pixels", _sides((rows, columns))
        )
    return rows, columns


def _decode(content: bytes, where: str, mode: int) -> NDArray[np.uint8]:
    png_size(content, where)
    damage = _damage(content)
    # OpenCV gives an image for files cut short or with flipped bits: the checksums tell.
    image = None if damage else cv2.imdecode(np.frombuffer(content, np.uint8), mode)
    if image is None:
        got = damage or f"{len(content)} bytes that do not decode"
        raise _refused("the PNG file is damaged", where, got=got)
    return np.asarray(image, np.uint8)


def _damage(content: bytes) -> str:
    place = len(_SIGNATURE)
    while place < len(content):
        length, kind = struct.unpack(">I4s", content[place : place + 8].ljust(8, b"\0"))
        end = place + 12 + length
        if end > len(content):
            break
        stated = struct.unpack(">I", content[end - 4 : end])[0]
        if zlib.crc32(content[place + 4 : end - 4]) != stated:
            return f"a wrong checksum at byte {place} of {len(content)}"
        if kind == b"IEND":
            return ""
        place = end
    return f"{len(content)} bytes, cut short"


def _sides(of: NDArray[np.uint8] | tuple[int, int]) -> str:
    rows, columns = of if isinstance(of, tuple) else of.shape[:2]
    return f"{rows} rows, {columns} columns"


def _refused(
    what: str, where: str, expected: str = "", got: str = "", fix: str = _FETCH_AGAIN
) -> SourceError:
    return SourceError(what, where=where, expected=expected, got=got, fix=fix)
