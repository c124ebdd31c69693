"""What a depth file's values are, metres or levels, turned into the unit of the set."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.recipe import LAST_LEVEL
from dfdbench.datasets.captured_files import CapturedFiles
from dfdbench.datasets.depth_scale import DepthScale
from dfdbench.datasets.manifest import Depth
from dfdbench.errors import SourceError

#: Units that depth files are written in, in metres: metres, centimetres, millimetres, tenths of
#: them, the 1/5000 of TUM RGB-D and the 1/256 of KITTI.
_UNITS = {
    "metres": 1.0,
    "centimetres": 0.01,
    "millimetres": 0.001,
    "tenths of a millimetre": 0.0001,
    "1/5000 of a metre": 0.0002,
    "1/256 of a metre": 1 / 256,
}
# A median that misses the bounds by no more than this factor is of a scene, not of a unit.
_NEARBY = 1.5


def depth_of(
    values: NDArray[Any], files: CapturedFiles, depth: Depth, where: str
) -> NDArray[np.float32]:
    """Return a depth file's values in the unit of the set, NaN where they are not known.

    What lies before near or beyond far counts as not known. Of whole numbers levels are whole; a
    file with fractions keeps them.

    Parameters
    ----------
    values : ndarray, shape (y, x)
        As they stand in the file.
    files, depth : CapturedFiles, Depth
        The manifest's sections.
    where : str
        The file, for messages.

    Raises
    ------
    SourceError
        Where no pixel's depth is known, half the pixels or more lie outside the stated bounds, as
        in another unit, or values are no levels.
    """
    numbers = values.astype(np.float64)
    known = np.isfinite(numbers) & ~np.isin(numbers, files.depth_missing)
    metres = depth.kind == "metres" or files.depth_unit is not None
    if metres:
        known &= numbers > 0
    if not known.any():
        kind = f"finite{' and above 0' * metres}, and not missing"
        raise SourceError(f"none of {values.size} depths is {kind}", where=where)
    if metres and depth.scale is not None:
        whole = values.dtype.kind != "f"
        _refuse_another_unit(float(np.median(numbers[known])), whole, files, depth.scale, where)
    elif files.depth_ends is None:
        _refuse_no_levels(numbers[known], where)
        known &= numbers != depth.unknown
    ends = files.depth_ends
    if ends is not None:
        known &= (numbers >= min(ends)) & (numbers <= max(ends))
    if metres and depth.scale is not None:
        distance = numbers * (files.depth_unit or 1.0)
        known &= (distance >= depth.scale.near) & (distance <= depth.scale.far)
    found = in_unit_of(np.where(known, numbers, np.nan), files, depth)
    if depth.kind == "levels" and values.dtype.kind != "f":
        found = np.rint(found)
    return found.astype(np.float32)


def in_unit_of(
    values: NDArray[np.float64], files: CapturedFiles, depth: Depth
) -> NDArray[np.float64]:
    """Return values of a depth file in the unit of the set.

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
    fitting = _units_that_fit(median, scale)
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


def _units_that_fit(median: float, scale: DepthScale) -> list[str]:
    return [
        f"{_short(size)} ({name})"
        for name, size in _UNITS.items()
        if scale.near <= median * size <= scale.far
    ]


def _short(number: Any) -> str:
    return f"{float(number):.6g}"
