"""A protocol: which pixels count, what the error is divided by, which crop is scored."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from dfdbench.errors import unknown_name
from dfdbench.metrics import nmae, nrmse, ssim

#: The metrics' names, and whether a larger value is better.
METRICS: Mapping[str, bool] = MappingProxyType({"nrmse": False, "nmae": False, "ssim": True})


@dataclass(frozen=True)
class Scores:
    """The three metrics of one prediction; NaN where a metric is undefined."""

    nrmse: float
    nmae: float
    ssim: float


@dataclass(frozen=True)
class Protocol:
    """How a prediction is scored. A released protocol never changes; a change is a new version.

    Parameters
    ----------
    name, version : str, int
        Under which results name it.
    pixels : {"all", "known"}
        Whether pixels without ground truth count (at their stored level) or are left out.
    divisor : {"own-range", "255"}
        What NRMSE and NMAE are divided by: the ground truth's range over the pixels that
        count, or 255.
    crop : {"whole", "network"}
        The whole image, or the centre square of the data set's `network_crop`.
    source : str
        Where the definition comes from.
    """

    name: str
    version: int
    pixels: Literal["all", "known"]
    divisor: Literal["own-range", "255"]
    crop: Literal["whole", "network"]
    source: str

    def as_dict(self) -> dict[str, Any]:
        """Return the definition by name, fit for JSON."""
        return asdict(self)


#: The protocols by name; a run scores under all of them.
PROTOCOLS: Mapping[str, Protocol] = MappingProxyType(
    {
        protocol.name: protocol
        for protocol in (
            Protocol(
                "thesis", 1, "all", "own-range", "whole",
                "Emerson 2019, Eq. 3.11, 3.13, 3.14; unknown pixels count as depth 0",
            ),
            Protocol(
                "thesis-networks", 1, "all", "255", "network",
                "the scoring code published with the thesis's networks",
            ),
            Protocol("valid", 1, "known", "255", "whole", "dfdbench: known pixels only"),
        )
    }
)  # fmt: skip


def find_protocol(name: str) -> Protocol:
    """Return the protocol of that name.

    Raises
    ------
    UnknownNameError
        Where there is none; near misses are named.
    """
    if name not in PROTOCOLS:
        raise unknown_name("protocol", name, PROTOCOLS)
    return PROTOCOLS[name]


def score(
    protocol: Protocol,
    depth: NDArray[np.uint8],
    valid: NDArray[np.bool_],
    prediction: NDArray[np.float32],
    network_crop: int,
) -> Scores:
    """Score one prediction under one protocol.

    Parameters
    ----------
    protocol : Protocol
        See `PROTOCOLS`.
    depth : ndarray of uint8, shape (y, x)
        Ground truth in depth levels.
    valid : ndarray of bool, shape (y, x)
        True where the ground truth is known.
    prediction : ndarray of float32, shape (y, x)
        Estimated depth levels, 0 to 255.
    network_crop : int
        Side of the centre square, in pixels, for protocols that crop; a smaller image is
        taken whole.

    Examples
    --------
    >>> depth = np.arange(64 * 64, dtype=np.uint8).reshape(64, 64)
    >>> score(PROTOCOLS["thesis"], depth, depth > 0, depth.astype(np.float32), 32)
    Scores(nrmse=0.0, nmae=0.0, ssim=1.0)
    """
    window = (slice(None), slice(None))
    if protocol.crop == "network":
        window = _centre(depth.shape, network_crop)
    truth, test = depth[window], prediction[window]
    mask = valid[window] if protocol.pixels == "known" else None
    data_range = 255.0 if protocol.divisor == "255" else None
    return Scores(
        nrmse=nrmse(truth, test, data_range=data_range, mask=mask),
        nmae=nmae(truth, test, data_range=data_range, mask=mask),
        ssim=ssim(truth, test, data_range=255.0, mask=mask),
    )


def _centre(shape: tuple[int, ...], side: int) -> tuple[slice, slice]:
    height, width = (min(side, extent) for extent in shape)
    top, left = (shape[0] - height) // 2, (shape[1] - width) // 2
    return slice(top, top + height), slice(left, left + width)
