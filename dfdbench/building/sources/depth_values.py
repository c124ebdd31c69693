"""What a depth file's values are: metres in some unit, or levels; turned into levels."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.recipe import LAST_LEVEL
from dfdbench.datasets.captured_files import CapturedFiles
from dfdbench.datasets.depth_scale import DepthScale
from dfdbench.datasets.manifest import Depth
from dfdbench.errors import SourceError

Levels = NDArray[np.uint8]
Mask = NDArray[np.bool_]

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


def depth_levels(
    values: NDArray[np.float64], files: CapturedFiles, depth: Depth, where: str
) -> tuple[Levels, Mask]:
    """Return the levels of a depth file's values, and where they are known.

    What lies before near or beyond far counts as not known.

    Parameters
    ----------
    values : ndarray of float64, shape (y, x)
        As they stand in the file.
    files, depth : CapturedFiles, Depth
        The manifest's sections.
    where : str
        The file, for messages.

    Returns
    -------
    ndarray of uint8, shape (y, x)
        Levels; that of unknown depth where it is not known.
    ndarray of bool, shape (y, x)
        True where it is known.

    Raises
    ------
    SourceError
        Where no pixel's depth is known, half the pixels or more lie outside the stated bounds, as
        in another unit, or values are no levels.
    """
    told = np.isfinite(values) & ~np.isin(values, files.depth_missing)
    if files.depth_unit is not None:
        told &= values > 0
    if not told.any():
        least = "" if files.depth_unit is None else " and above 0"
        raise SourceError(
            "the depth map tells no depths",
            where=where,
            expected=f"values that are finite{least}, and not among depth_missing",
            got=f"none of {values.size}",
        )
    scale = depth.scale
    if files.depth_unit is None or scale is None:
        return _as_levels(values, told, depth, where)
    metres = np.where(told, values, np.nan) * files.depth_unit
    _refuse_another_unit(float(np.median(values[told])), files.depth_unit, scale, where)
    known = told & (metres >= scale.near) & (metres <= scale.far)
    levels = scale.to_levels(np.where(known, metres, np.nan), depth.unknown)
    return levels, known


def _as_levels(
    values: NDArray[np.float64], told: Mask, depth: Depth, where: str
) -> tuple[Levels, Mask]:
    found = values[told]
    whole = (found == np.rint(found)).all()
    if not whole or found.min() < 0 or found.max() > LAST_LEVEL:
        raise SourceError(
            "values that are no depth levels",
            where=where,
            expected=f"whole numbers from 0 to {LAST_LEVEL}",
            got=f"{_short(found.min())} to {_short(found.max())}",
            fix="state depth_unit under [files], and [depth.scale] with near and far in metres",
        )
    known = told & (values != depth.unknown)
    return np.where(known, values, depth.unknown).astype(np.uint8), known


def _refuse_another_unit(median: float, unit: float, scale: DepthScale, where: str) -> None:
    if scale.near <= median * unit <= scale.far:
        return
    if scale.near / _NEARBY <= median * unit <= scale.far * _NEARBY:
        fix = "widen near and far under [depth.scale]"
    elif fitting := _units_that_fit(median, scale):
        fix = f"depth_unit = {' or '.join(fitting)} would fit"
    else:
        fix = "no usual unit fits: mend near and far under [depth.scale]"
    raise SourceError(
        "depth in another unit, or other bounds",
        where=where,
        expected=f"a median from {scale.near:g} to {scale.far:g} m",
        got=f"{_short(median * unit)} m with depth_unit = {_short(unit)}",
        fix=fix,
    )


def _units_that_fit(median: float, scale: DepthScale) -> list[str]:
    return [
        f"{_short(size)} ({name})"
        for name, size in _UNITS.items()
        if scale.near <= median * size <= scale.far
    ]


def _short(number: Any) -> str:
    return f"{float(number):.6g}"
