"""One captured pair or stack, from its files' bytes: checked, aligned, matched, cropped."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from dfdbench.building.sources.depth_values import depth_of
from dfdbench.building.sources.image_files import read_depth_file, read_photograph
from dfdbench.building.sources.matching import Motion, find_gain, find_placement, place
from dfdbench.datasets.captured_files import CapturedFiles, Crop
from dfdbench.datasets.captures import eight_bits
from dfdbench.datasets.manifest import Depth
from dfdbench.errors import InputError, Problem, SourceError
from dfdbench.methods.view_change import ViewChange
from dfdbench.optics.sharpness import laplacian_energy

Image = NDArray[Any]
Mask = NDArray[np.bool_]
Returned = TypeVar("Returned")
#: The bytes of a file, and its name for messages.
File = tuple[bytes, str]


@dataclass(frozen=True)
class CapturedImages:
    """Photographs on each other and the depth of their pixels.

    Parameters
    ----------
    images : ndarray of uint8 or uint16, shape (image, y, x, 3)
        RGB; those of a pair have 8 bits, the in-focus one first.
    depth : ndarray of float32, shape (y, x)
        In the unit of the set; NaN where it is not known or a photograph does not reach.
    found : tuple of dict
        How each image but the first was aligned and its brightness matched, where it was.
    warnings : tuple of str
        What looks odd.
    """

    images: Image
    depth: NDArray[np.float32]
    found: tuple[dict[str, float], ...]
    warnings: tuple[str, ...]


def captured_images(
    photographs: Sequence[File], depth: File | None, files: CapturedFiles, about: Depth
) -> CapturedImages:
    """Make a capture of its files.

    Parameters
    ----------
    photographs : sequence of (bytes, str)
        Of a pair the in-focus image first.
    depth : (bytes, str) or None
        The depth file; without one no depth is known.
    files, about : CapturedFiles, Depth
        The manifest's sections.

    Raises
    ------
    SourceError
        With everything that is wrong: damaged files, sizes that differ, depth in another unit, an
        alignment that is not found, a crop beyond the image.
    """
    tries = _Tries([])
    is_pair = files.images is None
    read: list[tuple[Image, str]] = []
    for content, where in photographs:
        image = tries.to(
            read_photograph, content, where, files.image_bits, files.exif_rotation, not is_pair
        )
        if image is not None:
            read.append((image, where))
    sized = list(read)
    found = None
    if depth is not None:
        values = tries.to(read_depth_file, *depth, files.exif_rotation)
        if values is not None:
            sized.append((values, depth[1]))
            found = tries.to(depth_of, values, files, about, depth[1])
    for image, where in sized[1:]:
        tries.to(_require_size, image, where, *sized[0], depth is not None and where == depth[1])
    if tries.problems:
        raise SourceError.of(tries.problems)
    if found is None:
        found = np.full(read[0][0].shape[:2], np.nan, np.float32)
    warnings = _swapped(read) if is_pair else ()
    laid, covered, told = _laid_on_the_first(read, files)
    kept = _kept(files.crop, found.shape, read[0][1])
    known = np.where(covered, found, np.float32(np.nan))[kept]
    if depth is not None and not np.isfinite(known).any():
        raise SourceError("no depth is known inside the crop", where=depth[1])
    return CapturedImages(_in_one(laid)[:, *kept], known, told, warnings)


@dataclass(frozen=True)
class _Tries:
    """Calls functions and gathers what they raise."""

    problems: list[Problem]

    def to(self, step: Callable[..., Returned], *arguments: Any) -> Returned | None:
        try:
            return step(*arguments)
        except SourceError as error:
            self.problems.extend(error.problems)
            return None


def _laid_on_the_first(
    read: list[tuple[Image, str]], files: CapturedFiles
) -> tuple[list[Image], Mask, tuple[dict[str, float], ...]]:
    first, where_first = read[0]
    flat_field = files.flat_field or ()
    covered = np.ones(first.shape[:2], bool)
    others: list[Image] = []
    told: list[dict[str, float]] = []
    problems: list[Problem] = []
    for image, where in read[1:]:
        try:
            first, other, both, found = matched(
                read[0][0], image, files.align, files.match_gain, files.moved, flat_field
            )
            others.append(other)
            told.append(found)
            covered &= both
        except InputError as error:
            moved = where if files.moved == "defocus" else where_first
            problems += [
                Problem(p.what, where=moved, expected=p.expected, got=p.got, fix=p.fix)
                for p in error.problems
            ]
    if problems:
        raise SourceError.of(problems)
    return [first, *others], covered, tuple(told)


def matched(
    infocus: Image,
    defocus: Image,
    align: Literal["none"] | Motion,
    match_gain: bool,
    moved: Literal["infocus", "defocus"] = "defocus",
    flat_field: Sequence[Sequence[float]] = (),
) -> tuple[Image, Image, Mask, dict[str, float]]:
    """Lay two photographs, shape (y, x, 3), on each other and match their brightness.

    Parameters
    ----------
    infocus, defocus : ndarray of uint8 or uint16, shape (y, x, 3)
        The photographs.
    align, match_gain, moved, flat_field
        As of `CapturedFiles`.

    Returns
    -------
    infocus, defocus : ndarray of uint8 or uint16, shape (y, x, 3)
    covered : ndarray of bool, shape (y, x)
        Which pixels both cover.
    found : dict of str to float
        How the moved image was placed, and the gain.

    Raises
    ------
    InputError
        If no alignment is found, or the brightness differs too much.
    """
    images = {"infocus": infocus, "defocus": defocus}
    if flat_field:
        white = np.iinfo(defocus.dtype).max / 255
        level = ViewChange(falloff=tuple(map(tuple, flat_field))).undone(defocus / white)
        images["defocus"] = _rounded(level * white, defocus.dtype)
    covered = np.ones(infocus.shape[:2], bool)
    found: dict[str, float] = {}
    if align != "none":
        fixed = infocus if moved == "defocus" else defocus
        at = find_placement(eight_bits(fixed), eight_bits(images[moved]), align)
        images[moved], covered = place(images[moved].astype(np.float64), at)
        found |= asdict(at)
    if match_gain:
        sharp, blurred = (
            images[role] * np.float64(255 / np.iinfo(each.dtype).max)
            for role, each in (("infocus", infocus), ("defocus", defocus))
        )
        found["gain"] = find_gain(sharp, blurred, covered)
        images["defocus"] = images["defocus"] * found["gain"]
    sharp, blurred = (
        _rounded(image, each.dtype)
        for image, each in zip(images.values(), (infocus, defocus), strict=True)
    )
    return sharp, blurred, covered, found


def _rounded(image: Image, dtype: np.dtype[Any]) -> Image:
    if image.dtype == dtype:
        return image
    return np.clip(np.rint(image), 0, np.iinfo(dtype).max).astype(dtype)


def _in_one(images: list[Image]) -> Image:
    # Of mixed depths the deeper: 255 becomes 65535.
    deep = any(image.dtype == np.uint16 for image in images)
    return np.stack(
        [
            image.astype(np.uint16) * np.uint16(257) if deep and image.dtype == np.uint8 else image
            for image in images
        ]
    )


def _swapped(read: list[tuple[Image, str]]) -> tuple[str, ...]:
    (infocus, where), (defocus, _) = read
    if laplacian_energy(defocus) <= laplacian_energy(infocus):
        return ()
    return (f"{where}: the defocus image is the sharper one, are the two swapped?",)


def _require_size(image: Image, where: str, first: Image, named: str, is_depth: bool) -> None:
    if image.shape[:2] != first.shape[:2]:
        raise SourceError(
            "size differs",
            where=where,
            expected=f"{_sides(first)} as {named}",
            got=_sides(image),
            fix="resample the depth map onto the image" if is_depth else "",
        )


def _kept(crop: Crop | None, shape: tuple[int, ...], where: str) -> tuple[slice, slice]:
    if crop is None:
        return slice(None), slice(None)
    bottom, right = crop.y + crop.height, crop.x + crop.width
    if bottom > shape[0] or right > shape[1]:
        raise SourceError(
            "the crop reaches beyond the image",
            where=where,
            expected=f"within {shape[0]} rows, {shape[1]} columns",
            got=f"rows to {bottom}, columns to {right}",
            fix="mend [files.crop]",
        )
    return slice(crop.y, bottom), slice(crop.x, right)


def _sides(image: Image) -> str:
    return f"{image.shape[0]} rows, {image.shape[1]} columns"
