"""Which part of an image a protocol scores."""

from __future__ import annotations

from typing import Literal

Crop = Literal["whole", "network-of-16"]
# The published networks halve their images four times, so their program cuts images to this.
_NETWORK_MULTIPLE = 16


def window_of(crop: Crop, shape: tuple[int, ...], side: int) -> tuple[slice, ...]:
    """Return the part of an image that is scored, as slices of its axes.

    Parameters
    ----------
    crop : {"whole", "network-of-16"}
        As of a `dfdbench.metrics.protocol.Protocol`.
    shape : tuple of int
        Of the image.
    side : int
        Of the centre square, in pixels.

    Examples
    --------
    >>> window_of("network-of-16", (370, 463), 352)
    (slice(8, 360, None), slice(48, 400, None))
    """
    if crop == "whole":
        return tuple(slice(0, extent) for extent in shape)
    shape = tuple(extent - extent % _NETWORK_MULTIPLE for extent in shape)
    starts = (max(extent - side, 0) // 2 for extent in shape)
    return tuple(
        slice(start, min(start + side, extent)) for start, extent in zip(starts, shape, strict=True)
    )
