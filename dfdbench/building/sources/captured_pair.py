"""One captured pair, from the bytes of its three files: checked, aligned, matched, cropped."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from dfdbench.building.sources.depth_values import depth_levels
from dfdbench.building.sources.image_files import read_depth_file, read_photograph
from dfdbench.building.sources.matching import find_gain, find_placement, place
from dfdbench.datasets.captured_files import CapturedFiles, Crop
from dfdbench.datasets.manifest import Depth
from dfdbench.errors import InputError, Problem, SourceError
from dfdbench.optics.sharpness import laplacian_energy

Image = NDArray[np.uint8]
Mask = NDArray[np.bool_]
Returned = TypeVar("Returned")


@dataclass(frozen=True)
class CapturedPair:
    """Two photographs on each other and the depth of their pixels.

    Parameters
    ----------
    infocus, defocus : ndarray of uint8, shape (y, x, 3)
        RGB.
    levels : ndarray of uint8, shape (y, x)
        Depth levels.
    known : ndarray of bool, shape (y, x)
        True where the depth is known and both photographs reach.
    found : dict
        How the pair was aligned and its brightness matched, where it was.
    warnings : tuple of str
        What looks odd.
    """

    infocus: Image
    defocus: Image
    levels: Image
    known: Mask
    found: dict[str, float]
    warnings: tuple[str, ...]


def captured_pair(
    contents: Mapping[str, bytes], where: Mapping[str, str], files: CapturedFiles, depth: Depth
) -> CapturedPair:
    """Make a pair of its files.

    Parameters
    ----------
    contents : mapping of str to bytes
        The files ``infocus``, ``defocus`` and ``depth``.
    where : mapping of str to str
        Their names, for messages.
    files, depth : CapturedFiles, Depth
        The manifest's sections.

    Raises
    ------
    SourceError
        With everything that is wrong: damaged files, sizes that differ, depth in another unit, an
        alignment that is not found, a crop beyond the image.
    """
    tries = _Tries([])
    bits, rotation = files.image_bits, files.exif_rotation
    read: dict[str, NDArray[Any] | None] = {}
    for role in ("infocus", "defocus"):
        read[role] = tries.to(read_photograph, contents[role], where[role], bits, rotation)
    values = read["depth"] = tries.to(read_depth_file, contents["depth"], where["depth"], rotation)
    found = None if values is None else tries.to(depth_levels, values, files, depth, where["depth"])
    tries.problems.extend(_other_sizes(read, where))
    infocus, defocus = read["infocus"], read["defocus"]
    if tries.problems or infocus is None or defocus is None or found is None:
        raise SourceError.of(tries.problems)
    return _laid_out(infocus, defocus, *found, files, where)


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


def _laid_out(
    infocus: Image, defocus: Image, levels: Image, known: Mask, files: CapturedFiles, where: Any
) -> CapturedPair:
    warnings = _swapped(infocus, defocus, where["infocus"])
    try:
        infocus, defocus, covered, found = matched(
            infocus, defocus, files.align, files.match_gain, files.moved
        )
    except InputError as error:
        raise SourceError.of(
            Problem(p.what, where=where[files.moved], expected=p.expected, got=p.got, fix=p.fix)
            for p in error.problems
        ) from error
    kept = _kept(files.crop, levels.shape, where["infocus"])
    known = (known & covered)[kept]
    if not known.any():
        raise SourceError("no depth is known inside the crop", where=where["depth"])
    return CapturedPair(infocus[kept], defocus[kept], levels[kept], known, found, warnings)


def matched(
    infocus: Image,
    defocus: Image,
    align: Literal["none", "translation", "euclidean"],
    match_gain: bool,
    moved: Literal["infocus", "defocus"] = "defocus",
) -> tuple[Image, Image, Mask, dict[str, float]]:
    """Lay two photographs, uint8 of shape (y, x, 3), on each other and match their brightness.

    Returns
    -------
    infocus, defocus : ndarray of uint8, shape (y, x, 3)
    covered : ndarray of bool, shape (y, x)
        Which pixels both cover.
    found : dict of str to float
        How the moved image was placed, and the gain.

    Raises
    ------
    InputError
        If no alignment is found, or the brightness differs too much.
    """
    images = {"infocus": infocus.astype(np.float64), "defocus": defocus.astype(np.float64)}
    covered = np.ones(infocus.shape[:2], bool)
    found: dict[str, float] = {}
    if align != "none":
        pair = (infocus, defocus) if moved == "defocus" else (defocus, infocus)
        at = find_placement(*pair, align)
        images[moved], covered = place(images[moved], at)
        found |= asdict(at)
    if match_gain:
        found["gain"] = find_gain(images["infocus"], images["defocus"], covered)
        images["defocus"] = images["defocus"] * found["gain"]
    sharp, blurred = (np.clip(np.rint(image), 0, 255).astype(np.uint8) for image in images.values())
    return sharp, blurred, covered, found


def _swapped(infocus: Image, defocus: Image, where: str) -> tuple[str, ...]:
    sharp, blurred = laplacian_energy(infocus), laplacian_energy(defocus)
    if blurred <= sharp:
        return ()
    return (f"{where}: the defocus image is the sharper one, are the two swapped?",)


def _other_sizes(
    read: Mapping[str, NDArray[Any] | None], where: Mapping[str, str]
) -> Iterator[Problem]:
    there = {role: image for role, image in read.items() if image is not None}
    first = next(iter(there), "")
    for role, image in there.items():
        if image.shape[:2] != there[first].shape[:2]:
            yield Problem(
                "size differs",
                where=where[role],
                expected=f"{_sides(there[first])} as {where[first]}",
                got=_sides(image),
                fix="resample the depth map onto the image" if role == "depth" else "",
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


def _sides(image: NDArray[Any]) -> str:
    return f"{image.shape[0]} rows, {image.shape[1]} columns"
