"""Read photographs (PNG, JPEG, TIFF) and depth files (also npy, npz, pfm); reject damaged ones."""

import io
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pillow
from PIL import UnidentifiedImageError

from dfdbench.building.sources import gathered
from dfdbench.errors import Problem, SourceError
from dfdbench.system.array_files import UNREADABLE, UNREADABLE_IMAGE, load_arrays
from dfdbench.system.files import LARGEST_ARRAY, read_as

Image = NDArray[np.uint8]

#: Endings of readable image files, in upper or lower case.
SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff")
#: Endings of array files that are read as depth.
ARRAYS = (".npy", ".npz", ".pfm")

_ARRAY_HEADS = {b"\x93NUMPY": "npy", b"PK\x03\x04": "npz", b"Pf": "pfm"}
# In an npz with several arrays, the one of this name is the depth.
_DEPTH_NAME = "depth"
_FORMATS = {b"\x89PNG": "PNG", b"\xff\xd8\xff": "JPEG", b"II*\0": "TIFF", b"MM\0*": "TIFF"}
_ORIENTATION = 0x0112
_FULL = 16
# Red, green, blue and opacity: an array with more channels is not a picture.
_MOST_CHANNELS = 4
# If all values fit into this many bits, the camera likely has no more; dark scenes are rarer.
_CONVERTERS = (8, 10, 12)
# By EXIF orientation: whether the image is mirrored left to right, and the quarter turns
# anticlockwise that then make it upright.
_UPRIGHT = {
    2: (True, 0),
    3: (False, 2),
    4: (True, 2),
    5: (True, 1),
    6: (False, -1),
    7: (True, -1),
    8: (False, 1),
}


def read_photograph(
    content: bytes,
    where: str,
    bits: int | None = None,
    rotation: Literal["apply", "ignore"] | None = None,
    deep: bool = False,
) -> NDArray[Any]:
    """Decode a photograph from a file's bytes, as RGB.

    Parameters
    ----------
    content : bytes
        A PNG, JPEG or TIFF file.
    where : str
        Its name, for messages.
    bits : int, optional
        How many bits of a 16-bit file are used; see `CapturedFiles`.
    rotation : {"apply", "ignore"}, optional
        What to do about EXIF rotation; see `CapturedFiles`.
    deep : bool
        Keep 16 bits; otherwise they are scaled to 8.

    Returns
    -------
    ndarray of uint8 or uint16, shape (y, x, 3)
        A grey image gets three equal channels.

    Raises
    ------
    SourceError
        If it is not such a file, is damaged, has an EXIF rotation and `rotation` is not given, or
        its number of bits differs from the stated one.

    Examples
    --------
    >>> grey = np.full((2, 3), 4095, np.uint16)
    >>> content = cv2.imencode(".png", grey)[1].tobytes()
    >>> read_photograph(content, "a.png", bits=12)[0, 0].tolist()
    [255, 255, 255]
    """
    upright = _upright(decode_file(content, where), content, where, rotation)
    image = _in_full(upright, where, bits, deep)
    if image.shape[2:] == (4,) and not (image[..., 3] == np.iinfo(image.dtype).max).all():
        what = "the photograph has transparent pixels"
        raise SourceError(what, where=where, fix="write it without alpha channel")
    return _as_rgb(image)


def read_depth_file(
    content: bytes, where: str, rotation: Literal["apply", "ignore"] | None = None
) -> NDArray[Any]:
    """Return the contents of a depth file, unchanged, shape (y, x).

    The parameters are those of `read_photograph`.

    Raises
    ------
    SourceError
        If it is not such a file, is damaged, or is in colour.
    """
    values = _upright(decode_depth(content, where), content, where, rotation)
    if values.ndim == 3:
        colours, grey = values[..., :3], values[..., :1]
        if not ((colours == grey) | (np.isnan(colours) & np.isnan(grey))).all():
            what = "a depth map in colour"
            raise SourceError(what, where=where, expected="one value a pixel", got="channels")
        values = values[..., 0]
    return values


def decode_depth(content: bytes, where: str) -> NDArray[Any]:
    """Return the contents of an npy, npz or pfm file; decode others by `decode_file`.

    Raises
    ------
    SourceError
        If the file is damaged, or has no array of numbers of shape (y, x) or (y, x, channel).
    """
    kind = next((name for head, name in _ARRAY_HEADS.items() if content.startswith(head)), None)
    if kind is None:
        return decode_file(content, where)
    try:
        file = io.BytesIO(content)
        values: Any
        if kind == "pfm":
            values = np.array(Pillow.open(file))
        elif kind == "npy":
            values = np.load(file, allow_pickle=False)
        else:
            values = load_arrays(file)
            names = [_DEPTH_NAME] if _DEPTH_NAME in values.files else values.files
            if len(names) != 1:
                got = ", ".join(names) or "no array"
                raise SourceError("several arrays, and none is called depth", where=where, got=got)
            values = values[names[0]]
    except UNREADABLE as error:
        what = f"the {kind} file is damaged: {error}"
        raise SourceError(what, where=where, fix="copy it again") from error
    flat = values.ndim == 2 or (values.ndim == 3 and values.shape[2] <= _MOST_CHANNELS)
    if not flat or values.dtype.kind not in "iuf" or not values.size:
        what = f"{values.dtype} of shape {values.shape} is not a depth map: numbers of shape (y, x)"
        raise SourceError(what, where=where)
    return np.asarray(values)


def decode_file(content: bytes, where: str) -> NDArray[Any]:
    """Return the contents of a PNG, JPEG or TIFF file, unchanged: channels as BGR, EXIF ignored.

    Raises
    ------
    SourceError
        If it is not such a file or is damaged.
    """
    kind = next((name for head, name in _FORMATS.items() if content.startswith(head)), None)
    if kind is None:
        got = f"bytes {content[:8]!r}" if content else "an empty file"
        expected, fix = "PNG, JPEG or TIFF", "fetch it again; or save it as PNG, raw depths as .npy"
        raise SourceError("not an image file", where=where, expected=expected, got=got, fix=fix)
    damage = _damage(content)
    found = None if damage else cv2.imdecode(np.frombuffer(content, np.uint8), -1)
    if found is None:
        got = damage or f"{len(content)} bytes that do not decode"
        fix = "fetch or copy it again"
        raise SourceError(f"the {kind} file is damaged", where=where, got=got, fix=fix)
    if kind == "TIFF":
        # OpenCV turns a TIFF upright even if it is to leave the file unchanged.
        mirrored, turns = _UPRIGHT.get(orientation_of(content), (False, 0))
        found = np.rot90(found, -turns)
        found = np.fliplr(found) if mirrored else found
    return np.ascontiguousarray(found)


def _damage(content: bytes) -> str:
    # OpenCV returns an image even if a file is cut short or has flipped bits. Pillow checks a PNG's
    # checksums, which is faster than decoding it.
    try:
        with Pillow.open(io.BytesIO(content)) as file:
            file.verify() if file.format == "PNG" else file.load()
    except UnidentifiedImageError:
        # A kind of TIFF that Pillow does not know but OpenCV may.
        return "" if content.startswith((b"II", b"MM")) else f"{len(content)} bytes, no header"
    except UNREADABLE_IMAGE as error:
        return str(error) or type(error).__name__
    return ""


def decode_rgb(content: bytes, where: str, size: tuple[int, ...] | None = None) -> Image:
    """Decode an opaque 8-bit PNG as RGB, shape (y, x, 3); repeat a grey channel three times.

    Parameters
    ----------
    content : bytes
        The file.
    where : str
        Its name, for messages.
    size : tuple of int, optional
        The rows and columns that it must have.

    Raises
    ------
    SourceError
        As in `decode_file`, for other kinds of files and pixels, and if the size differs.
    """
    if not content.startswith(b"\x89PNG"):
        got = f"bytes {content[:8]!r}" if content else "an empty file"
        raise SourceError("not a PNG file", where=where, got=got, fix="fetch it again")
    image = decode_file(content, where)
    if image.dtype != np.uint8 or (image.ndim == 3 and image.shape[2] != 3):
        channels = 1 if image.ndim == 2 else image.shape[2]
        got, expected = f"{image.dtype}, {channels} channels", "8-bit RGB or grey"
        raise SourceError("wrong kind of pixels", where=where, expected=expected, got=got)
    require_size(image.shape, size or image.shape, where)
    return _as_rgb(image)


def _as_rgb(image: NDArray[Any]) -> NDArray[Any]:
    """Convert an image from OpenCV, grey or with blue first, to RGB."""
    if image.ndim == 2:
        return np.repeat(image[..., np.newaxis], 3, axis=2)
    return np.ascontiguousarray(image[..., 2::-1])


def decode_image(content: bytes, where: str, size: tuple[int, ...] | None = None) -> Image:
    """Decode an image as `decode_rgb` does; refuse an all-black image.

    The parameters are those of `decode_rgb`.

    Raises
    ------
    SourceError
        As in `decode_rgb`, or if the image is all black.

    Examples
    --------
    >>> content = cv2.imencode(".png", np.full((2, 3), 7, np.uint8))[1].tobytes()
    >>> decode_image(content, "view1.png").shape
    (2, 3, 3)
    """
    image = decode_rgb(content, where, size)
    if not image.any():
        raise SourceError("the image is black all over", where=where, fix="fetch it again")
    return image


def decode_levels(
    content: bytes, where: str, unknown: int, size: tuple[int, ...] | None = None
) -> Image:
    """Decode a grey image's depth levels, shape (y, x); `unknown` marks pixels without truth.

    Raises
    ------
    SourceError
        As in `decode_rgb`; if the file is in colour or no pixel's depth is known.
    """
    image = decode_rgb(content, where, size)
    if not (image == image[..., :1]).all():
        raise SourceError("a depth map in colour", where=where, fix="fetch it again")
    if (image[..., 0] == unknown).all():
        raise SourceError(f"no depth is known: level {unknown} all over", where=where)
    return np.ascontiguousarray(image[..., 0])


def read_rgb(path: Path) -> Image:
    """Read an image file as `decode_rgb` does."""
    return decode_rgb(read_as(SourceError, path, "the file", LARGEST_ARRAY), str(path))


def image_problems(files: list[Path], size: tuple[int, ...]) -> list[Problem]:
    """Return a problem for each image file that is damaged or not of `size` (y, x)."""
    problems: list[Problem] = []
    for path in files:
        with gathered(problems):
            content = read_as(SourceError, path, "the file", LARGEST_ARRAY)
            if damage := _damage(content):
                raise SourceError("the image file is damaged", where=str(path), got=damage)
            with Pillow.open(io.BytesIO(content)) as file:
                require_size(file.size[::-1], size, str(path))
    return problems


def require_size(
    found: tuple[int, ...], size: tuple[int, ...], where: str, like: str = "", fix: str = ""
) -> None:
    """Refuse an image whose rows and columns are not `size`, the size of the file `like`.

    Raises
    ------
    SourceError
        If they differ; `where` is the image's file.
    """
    if found[:2] != size[:2]:
        got, expected = (f"{shape[0]} rows, {shape[1]} columns" for shape in (found, size))
        expected += f" as {like}" * bool(like)
        raise SourceError("size differs", where=where, expected=expected, got=got, fix=fix)


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


def orientation_of(content: bytes) -> int:
    """Return the EXIF orientation of an image file; 1 if it is upright or has none."""
    try:
        with Pillow.open(io.BytesIO(content)) as file:
            return int(file.getexif().get(_ORIENTATION, 1))
    except UNREADABLE_IMAGE:
        return 1


def _upright(image: NDArray[Any], content: bytes, where: str, rotation: str | None) -> NDArray[Any]:
    orientation = orientation_of(content)
    if orientation not in _UPRIGHT or rotation == "ignore":
        return image
    if rotation is None:
        what = f"the image's EXIF data say that it is to be turned, orientation {orientation}"
        fix = 'exif_rotation = "apply" or "ignore" under [files]: compare with the depth map'
        raise SourceError(what, where=where, fix=fix)
    mirrored, turns = _UPRIGHT[orientation]
    return np.rot90(np.fliplr(image) if mirrored else image, turns)


# More distinct positive values than this are measurements.
_LAYERS = 16


def stand_for_none(values: NDArray[np.float64], kind: np.dtype[Any]) -> list[float]:
    """Return the values that mark unknown depth: 0, the largest, or a negative one.

    Examples
    --------
    >>> stand_for_none(np.array([0, 900, 65535]), np.dtype("uint16"))
    [0, 65535]
    """
    last = np.iinfo(kind).max if kind.kind == "u" else None
    stand: list[float] = [0] if (values == 0).any() else []
    stand += [last] if last and last > 255 and (values == last).any() else []
    below = values[np.isfinite(values) & (values < 0)]
    # A value that is always the same is not a measurement.
    measured = np.unique(values[values > 0]).size > _LAYERS
    is_mark = below.size > 1 and np.ptp(below) == 0 and measured
    return [*below[:1].tolist(), *stand] if is_mark else stand


def likely_bits(greatest: int) -> int | None:
    """Guess the bits used by a 16-bit image from its greatest value; None means all.

    Examples
    --------
    >>> likely_bits(4080), likely_bits(5000)
    (12, None)
    """
    return next((few for few in _CONVERTERS if greatest < 2**few), None)


def _in_full(image: NDArray[Any], where: str, bits: int | None, deep: bool) -> NDArray[Any]:
    if image.dtype == np.uint8:
        return np.asarray(image)
    if image.dtype != np.uint16:
        what = "wrong kind of pixels"
        raise SourceError(what, where=where, expected="8 or 16 bit", got=str(image.dtype))
    greatest = int(image.max())
    likely = likely_bits(greatest)
    if bits is None and likely:
        what = f"a 16-bit image that seems to hold {likely} bits: its greatest value is {greatest}"
        # A dark photograph fits into fewer bits than its camera has.
        camera = f"{_CONVERTERS[-1]} for most cameras, " if likely > 8 else ""
        said = f"image_bits: {camera}{_FULL} if it is only dark"
        fix = f"write it as 8 bit; or say in a manifest, under [files], {said}"
        raise SourceError(what, where=where, fix=fix)
    if greatest >= 2 ** (bits or _FULL):
        what = f"the image holds {greatest}, more than {bits} bits"
        raise SourceError(what, where=where, fix="mend image_bits under [files]")
    full = np.iinfo(np.uint16 if deep else np.uint8)
    return np.asarray(np.rint(image * (full.max / (2 ** (bits or _FULL) - 1))), full.dtype)
