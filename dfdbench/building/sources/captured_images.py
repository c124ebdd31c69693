"""Check, align, match and crop one captured pair or stack from its files' bytes."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.law import BlurLaw
from dfdbench.blur.recipe import LAST_LEVEL
from dfdbench.building.sources import gathered
from dfdbench.building.sources.image_files import read_depth_file, read_photograph, require_size
from dfdbench.building.sources.matching import find_gain, find_placement, matching_of, place
from dfdbench.datasets.captured_files import CapturedFiles, Crop
from dfdbench.datasets.captures import eight_bits
from dfdbench.datasets.depth_scale import DepthScale
from dfdbench.datasets.manifest import Depth
from dfdbench.errors import InputError, Problem, SourceError
from dfdbench.methods.view_change import Images, ViewChange, find_falloff
from dfdbench.metrics.scores import AGAINST, correlation
from dfdbench.optics.sharpness import laplacian_energy

#: Units of depth files, in metres: metres, centimetres, millimetres, tenths of them, the 1/5000 of
#: TUM RGB-D and the 1/256 of KITTI.
_UNITS = {
    "metres": 1.0,
    "centimetres": 0.01,
    "millimetres": 0.001,
    "tenths of a millimetre": 0.0001,
    "1/5000 of a metre": 0.0002,
    "1/256 of a metre": 1 / 256,
}
# A median that misses the bounds by no more than this factor is a matter of the scene, not of the
# unit.
_NEARBY = 1.5
# A law's gain may differ from 1 by so much by chance.
_UNGAINED = 0.01
# One pair does not tell a fainter fall-off at the corners from its scene.
_FAINT = 0.05
_BY_HAND = "align and match them yourself, and say --no-align"
# A stack has so many images or more; sharpness is averaged over a square of so many pixels.
_FEWEST, _NEAR = 3, 31


def depth_of(
    values: NDArray[Any], files: CapturedFiles, depth: Depth, where: str
) -> NDArray[np.float32]:
    """Return a depth file's values in the unit of the set, NaN if unknown.

    Depths before `near` or beyond `far` count as unknown. Whole numbers give whole levels; a
    file with fractions keeps them.

    Parameters
    ----------
    values : ndarray, shape (y, x)
        As in the file.
    files, depth : CapturedFiles, Depth
        The manifest's sections.
    where : str
        The file, for messages.

    Raises
    ------
    SourceError
        If no pixel's depth is known, at least half the pixels are outside the stated bounds, as if
        in another unit, or values are not levels.
    """
    numbers = values.astype(np.float64)
    # A float32 is not the number that the manifest says, but the nearest to it.
    missing = np.array(files.depth_missing, values.dtype if values.dtype.kind == "f" else None)
    known = np.isfinite(numbers) & ~np.isin(values, missing)
    metres = depth.kind == "metres" or files.depth_unit is not None
    if metres:
        known &= numbers > 0
    if not known.any():
        kind = f"finite{' and above 0' * metres}, and not missing"
        raise SourceError(f"none of {values.size} depths is {kind}", where=where)
    if metres and depth.scale is not None:
        whole = values.dtype.kind != "f"
        _refuse_another_unit(float(np.median(numbers[known])), whole, files, depth.scale, where)
        distance = numbers * (files.depth_unit or 1.0)
        known &= (distance >= depth.scale.near) & (distance <= depth.scale.far)
    elif files.depth_ends is not None:
        known &= (numbers >= min(files.depth_ends)) & (numbers <= max(files.depth_ends))
    else:
        _refuse_no_levels(numbers[known], where)
        known &= numbers != depth.unknown
    found = in_unit_of(np.where(known, numbers, np.nan), files, depth)
    if depth.kind == "levels" and values.dtype.kind != "f":
        found = np.rint(found)
    return found.astype(np.float32)


def in_unit_of(
    values: NDArray[np.float64], files: CapturedFiles, depth: Depth
) -> NDArray[np.float64]:
    """Convert a depth file's values to the unit of the set.

    Parameters
    ----------
    values : ndarray of float64, any shape
        NaN stays.
    files, depth : CapturedFiles, Depth
        The manifest's sections.
    """
    ends = files.depth_ends
    if ends is not None:
        near, far = (LAST_LEVEL, 1) if depth.grows_with == "nearness" else (1, LAST_LEVEL)
        return far + (values - ends[1]) / (ends[0] - ends[1]) * (near - far)
    if depth.kind == "levels" and files.depth_unit is None:
        return values
    return depth.of_metres(values * (files.depth_unit or 1.0))


def _refuse_no_levels(found: NDArray[np.float64], where: str) -> None:
    whole = (found == np.rint(found)).all()
    if not whole or found.min() < 0 or found.max() > LAST_LEVEL:
        what = f"{_short(found.min())} to {_short(found.max())} are no depth levels, 0 to 255"
        fix = "state depth_unit and [depth.scale] with near and far in metres, or depth_ends"
        raise SourceError(what, where=where, fix=fix)


def _refuse_another_unit(
    median: float, whole: bool, files: CapturedFiles, scale: DepthScale, where: str
) -> None:
    unit = files.depth_unit or 1.0
    fitting = [
        f"{_short(size)} ({name})"
        for name, size in _UNITS.items()
        if scale.near <= median * size <= scale.far
    ]
    would = f"depth_unit = {' or '.join(fitting)} would fit"
    if whole and files.depth_unit is None:
        what = f"whole numbers, and not metres, with a median of {_short(median)}"
        fix = would if fitting else "no usual unit fits near and far under [depth.scale]"
        raise SourceError(what, where=where, fix=fix)
    if scale.near <= median * unit <= scale.far:
        return
    if scale.near / _NEARBY <= median * unit <= scale.far * _NEARBY:
        fix = "widen near and far under [depth.scale]"
    else:
        fix = would if fitting else "no usual unit fits: mend near and far under [depth.scale]"
    what = f"a median of {_short(median * unit)} m, not {scale.near:g} to {scale.far:g} m"
    raise SourceError(f"{what}: another unit, or other bounds", where=where, fix=fix)


def _short(number: Any) -> str:
    return f"{float(number):.6g}"


Image = NDArray[Any]
Mask = NDArray[np.bool_]
#: The bytes of a file, and its name for messages.
File = tuple[bytes, str]


@dataclass(frozen=True)
class CapturedImages:
    """Aligned photographs and the depth of their pixels.

    Parameters
    ----------
    images : ndarray of uint8 or uint16, shape (image, y, x, 3)
        RGB; those of a pair have 8 bits, the in-focus one first.
    depth : ndarray of float32, shape (y, x)
        In the unit of the set; NaN if unknown or beyond a photograph's edge.
    found : tuple of dict
        How each image but the first was aligned and its brightness matched, if it was.
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
    """Build a capture from its files.

    Parameters
    ----------
    photographs : sequence of (bytes, str)
        Of a pair, the in-focus image comes first.
    depth : (bytes, str) or None
        The depth file; without one, no depth is known.
    files, about : CapturedFiles, Depth
        The manifest's sections.

    Raises
    ------
    SourceError
        With everything that is wrong: damaged files, sizes that differ, depth in another unit, no
        alignment found, a crop beyond the image.
    """
    problems: list[Problem] = []
    bits, rotation = files.image_bits, files.exif_rotation
    read: list[tuple[Image, str]] = []
    for content, where in photographs:
        with gathered(problems):
            read.append(
                (read_photograph(content, where, bits, rotation, not files.of_pairs), where)
            )
    sized = list(read)
    found = None
    if depth is not None:
        with gathered(problems):
            values = read_depth_file(*depth, rotation)
            sized.append((values, depth[1]))
            found = depth_of(values, files, about, depth[1])
    for image, where in sized[1:]:
        is_depth = depth is not None and where == depth[1]
        fix = "resample the depth map onto the image" * is_depth
        if is_depth and image.shape[:2] == sized[0][0].shape[1::-1]:
            fix = "turn the depth map, or set exif_rotation to its other value, apply or ignore"
        with gathered(problems):
            require_size(image.shape, sized[0][0].shape, where, sized[0][1], fix)
    SourceError.raise_if(problems)
    if found is None:
        found = np.full(read[0][0].shape[:2], np.nan, np.float32)
    warnings = _swapped(read) if files.of_pairs and len(read) > 1 else ()
    laid, covered, told = _laid_on_the_first(read, files)
    kept = _kept(files.crop, found.shape, read[0][1])
    known = np.where(covered, found, np.float32(np.nan))[kept]
    if depth is not None and not np.isfinite(known).any():
        raise SourceError("no depth is known inside the crop", where=depth[1])
    return CapturedImages(in_one(laid)[:, *kept], known, told, warnings)


def _laid_on_the_first(
    read: list[tuple[Image, str]], files: CapturedFiles
) -> tuple[list[Image], Mask, tuple[dict[str, float], ...]]:
    first, where_first = read[0]
    covered = np.ones(first.shape[:2], bool)
    others: list[Image] = []
    told: list[dict[str, float]] = []
    problems: list[Problem] = []
    for image, where in read[1:]:
        try:
            first, other, both, found = matched(read[0][0], image, files)
            others.append(other)
            told.append(found)
            covered &= both
        except InputError as error:
            moved = where if files.moved == "defocus" else where_first
            problems += [replace(problem, where=moved) for problem in error.problems]
    SourceError.raise_if(problems)
    return [first, *others], covered, tuple(told)


def matched(
    infocus: Image, defocus: Image, files: CapturedFiles, level: Image | None = None
) -> tuple[Image, Image, Mask, dict[str, float]]:
    """Align two photographs, shape (y, x, 3), with each other and match their brightness.

    Parameters
    ----------
    infocus, defocus : ndarray of uint8 or uint16, shape (y, x, 3)
        The photographs.
    files : CapturedFiles
        Its `align`, `match_gain`, `moved` and `flat_field`.
    level : ndarray of uint8 or uint16, optional
        The defocus image without a fall-off of light that is left in it: place and gain are
        measured by it.

    Returns
    -------
    infocus, defocus : ndarray of uint8 or uint16, shape (y, x, 3)
    covered : ndarray of bool, shape (y, x)
        Which pixels both cover.
    found : dict of str to float
        The moved image's placement, and the gain.

    Raises
    ------
    InputError
        If no alignment is found, or the brightness differs too much.
    """
    images = {"infocus": infocus, "defocus": defocus}
    if files.flat_field:
        white = np.iinfo(defocus.dtype).max / 255
        flat = ViewChange(falloff=tuple(map(tuple, files.flat_field))).undone(defocus / white)
        images["defocus"] = _rounded(flat * white, defocus.dtype)
    seen = {**images, "defocus": images["defocus"] if level is None else level}
    whites = {role: np.iinfo(image.dtype).max for role, image in seen.items()}
    covered = np.ones(infocus.shape[:2], bool)
    found: dict[str, float] = {}
    if files.align != "none":
        fixed, moved = infocus if files.moved == "defocus" else defocus, seen[files.moved]
        at = find_placement(eight_bits(fixed), eight_bits(moved), files.align).rounded()
        images[files.moved], covered = place(images[files.moved].astype(np.float64), at)
        alike = level is None or files.moved == "infocus"
        seen[files.moved] = images[files.moved] if alike else place(moved.astype(np.float64), at)[0]
        found |= asdict(at)
    if files.match_gain:
        sharp, blurred = (image * np.float64(255 / whites[role]) for role, image in seen.items())
        found["gain"] = find_gain(sharp, blurred, covered)
        images["defocus"] = images["defocus"] * found["gain"]
    sharp, blurred = (
        _rounded(image, each.dtype)
        for image, each in zip(images.values(), (infocus, defocus), strict=True)
    )
    return sharp, blurred, covered, found


def matched_as_learned(
    infocus: Image, defocus: Image, files: CapturedFiles | None, laws: Sequence[BlurLaw]
) -> tuple[Image, Image, str]:
    """Match two photographs as those that a method learned from, and say in words how.

    Parameters
    ----------
    infocus, defocus : ndarray of uint8 or uint16, shape (y, x, 3)
        The photographs; the defocus image is moved.
    files : CapturedFiles or None
        How the build of the method's data set matched its pairs. If nothing is known of it, what
        they need is measured.
    laws : sequence of BlurLaw
        What the method itself expects, and takes out.

    Raises
    ------
    InputError
        If they cannot be aligned, or the brightness differs too much.
    """
    changes = [change for law in laws if (change := ViewChange.of(law)).changes]
    found, level = list[str](), None
    if files is None:
        seen, moving = eight_bits(defocus), any(any(change.similarity) for change in changes)
        # The method removes what the law says; removing it twice would be worse than not at all.
        for change in changes:
            level = seen = _rounded(ViewChange(falloff=change.falloff).undone(seen), seen.dtype)
        needed = matching_of([("the photographs", eight_bits(infocus), seen)])
        if not needed.measured and not moving:
            raise InputError("the photographs cannot be aligned", fix=_BY_HAND)
        align = "none" if moving else needed.align
        gained = any(abs(law.gain - 1) > _UNGAINED for law in laws)
        files = CapturedFiles(align=align, match_gain=needed.match_gain and not gained)
        moves = needed.align != "none"
        found += needed.found[: moves and align != "none"]
        found += needed.found[moves:] if files.match_gain else ()
        pair = Images.small(eight_bits(infocus), seen)
        light = ViewChange() if changes else find_falloff([pair])
        if any(abs(1 - curve[-1]) > _FAINT for curve in light.falloff):
            found.append(f"the defocus image seems {light.words()}; falloff in a lens undoes that")
    how = files.model_copy(update={"moved": "defocus"})
    try:
        infocus, defocus, _, did = matched(infocus, defocus, how, level)
    except InputError as error:
        raise InputError.of(replace(each, fix=_BY_HAND) for each in error.problems) from None
    if not found and (did or files.flat_field):
        parts = [f"{name} {did[name]:.4g}" for name in did if name != "correlation"]
        parts += ["flat_field"] * bool(files.flat_field)
        found.append(f"as the data set's pairs were: {', '.join(parts)}")
    if changes:
        words = ", ".join(change.words() for change in changes)
        found.append(f"the law says of the defocus image: {words}; that is taken out")
    return infocus, defocus, "; ".join(found)


def _rounded(image: Image, dtype: np.dtype[Any]) -> Image:
    if image.dtype == dtype:
        return image
    return np.clip(np.rint(image), 0, np.iinfo(dtype).max).astype(dtype)


def in_one(images: list[Image]) -> Image:
    """Return the images of a stack, those of 8 bits as 16 if others have 16: 255 becomes 65535."""
    deeper = np.result_type(*images)
    return np.stack([i if i.dtype == deeper else i * np.uint16(257) for i in images])


def _swapped(read: list[tuple[Image, str]]) -> tuple[str, ...]:
    (infocus, where), (defocus, _) = read
    if laplacian_energy(defocus) <= laplacian_energy(infocus):
        return ()
    return (f"{where}: the defocus image is the sharper one, are the two swapped?",)


def misordered(
    name: str, found: CapturedImages, told: Sequence[Mapping[str, float]], rises: bool
) -> tuple[str, ...]:
    """Return a warning if a stack is sharp where its depth map says that it is out of focus.

    Parameters
    ----------
    name : str
        The capture's, for the warning.
    found : CapturedImages
        The stack, and its depth.
    told : sequence of mapping of str to float
        What is known of each image: its ``focus_depth`` or ``focus_distance``.
    rises : bool
        Whether depth grows with distance; levels may grow with nearness.
    """
    focus = np.array([image["focus_depth"] for image in told])
    if np.isnan(focus).all():
        focus = np.array([image["focus_distance"] for image in told]) * (1 if rises else -1)
    stack = found.images[np.isfinite(focus)]
    if len(stack) < _FEWEST:
        return ()
    greys = (image.mean(axis=2, dtype=np.float32) for image in stack)
    sharp = np.stack([cv2.blur(abs(cv2.Laplacian(grey, -1)), (_NEAR, _NEAR)) for grey in greys])
    most, sharpest = sharp.max(axis=0), focus[np.isfinite(focus)][sharp.argmax(axis=0)]
    known = np.isfinite(found.depth) & (most > np.median(most))
    if not correlation(found.depth[known], sharpest[known]) < AGAINST:
        return ()
    what = "the images are sharp where depth says they are not"
    return (f"{name}: {what}: is the table of focus in the wrong order?",)


def _kept(crop: Crop | None, shape: tuple[int, ...], where: str) -> tuple[slice, slice]:
    if crop is None:
        return slice(None), slice(None)
    bottom, right = crop.y + crop.height, crop.x + crop.width
    if bottom > shape[0] or right > shape[1]:
        what = f"the crop reaches to row {bottom} and column {right} of {shape[0]} and {shape[1]}"
        raise SourceError(what, where=where, fix="mend [files.crop]")
    return slice(crop.y, bottom), slice(crop.x, right)
