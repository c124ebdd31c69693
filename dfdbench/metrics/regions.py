"""The regions in which errors are compared: edges, flat parts, far and near."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: The regions in the order in which they are shown, and what each is.
REGIONS: Mapping[str, str] = {
    "edges": "within 3 pixels of neighbours whose true depths differ by 4 % of the range",
    "flat": "where the in-focus image's grey value has a standard deviation below 3 in 7 x 7",
    "far": "the farthest third of the range, by the truth",
    "near": "the nearest third of the range, by the truth",
}
_JUMP, _FLAT, _SIDE = 0.04, 3.0, 7


def regions_of(
    truth: NDArray[Any], known: NDArray[np.bool_], infocus: NDArray[Any], ends: tuple[float, float]
) -> dict[str, NDArray[np.bool_]]:
    """Return which known pixels are in each region; a pixel may be in several or none.

    Parameters
    ----------
    truth : ndarray, shape (y, x)
        True depth, in levels or metres.
    known : ndarray of bool, shape (y, x)
        True where it is known.
    infocus : ndarray of uint8, shape (y, x, channel)
        The in-focus image, or the first of a stack without one.
    ends : tuple of float
        The nearest and the farthest depth that the data set may show, in the unit of `truth`.

    Returns
    -------
    dict of str to ndarray of bool
        Keyed by the names of `REGIONS`.

    Examples
    --------
    >>> depth = np.repeat([[0.0, 255.0]], 10, axis=1)
    >>> found = regions_of(depth, depth >= 0, np.zeros((1, 20, 3), np.uint8), (255.0, 0.0))
    >>> {name: int(mask.sum()) for name, mask in found.items()}
    {'edges': 6, 'flat': 20, 'far': 10, 'near': 10}
    """
    import cv2  # slow to import, and reading a result does not need it

    near, far = ends
    depth = np.where(known, truth, np.nan).astype(np.float64)
    jumps = np.zeros(known.shape, np.uint8)
    for part, of in ((jumps, depth), (jumps.T, depth.T)):
        # A jump to a pixel of unknown depth does not count.
        steps = np.abs(np.diff(of, axis=0)) >= _JUMP * abs(near - far)
        part[:-1] |= steps
        part[1:] |= steps
    # Both pixels at a jump count, and two more on either side.
    around = cv2.dilate(jumps, np.ones((_SIDE - 2, _SIDE - 2), np.uint8)) > 0
    # Channel by channel: numpy's mean over an axis of three takes more than twice as long.
    channels = np.moveaxis(infocus.reshape(*known.shape, -1), 2, 0)
    grey = np.zeros(known.shape)
    for channel in channels:
        grey += channel
    grey /= len(channels)
    window, edge = (_SIDE, _SIDE), cv2.BORDER_REPLICATE
    mean, square = (
        cv2.boxFilter(values, cv2.CV_64F, window, borderType=edge) for values in (grey, grey * grey)
    )
    # In place: new arrays of this size take longer than what is computed into them.
    variance = np.subtract(square, np.square(mean, out=mean), out=square)
    share = np.subtract(depth, far, out=depth)
    share /= near - far
    masks = (around, variance < _FLAT**2, share < 1 / 3, share > 2 / 3)
    return {name: known & mask for name, mask in zip(REGIONS, masks, strict=True)}


def region_errors(
    truth: NDArray[Any],
    estimate: NDArray[Any],
    regions: Mapping[str, NDArray[np.bool_]],
    data_range: float,
) -> dict[str, float | None]:
    """Return the NRMSE of each region, computed as in protocol ``valid``.

    It is None if a region has no pixel, or a pixel without an answer.

    Examples
    --------
    >>> region_errors(np.zeros((1, 2)), np.array([[2.0, 9]]), {"far": np.array([[True, False]])}, 4)
    {'far': 0.5}
    """
    found: dict[str, float | None] = {}
    for name, mask in regions.items():
        off = (np.asarray(estimate, np.float64) - truth)[mask]
        mean = float(np.mean(off**2)) if off.size else math.nan
        found[name] = None if math.isnan(mean) else math.sqrt(mean) / data_range
    return found
