"""A protocol: which pixels of which crop count, by which metrics, divided by what."""

from __future__ import annotations

import math
import typing
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from dfdbench.errors import InputError, UnknownNameError, unknown_name
from dfdbench.metrics.metric import (
    IN_METRES,
    METRICS,
    RANKED_BY,
    SURENESS,
    TIES_BY,
    Metric,
    aligned,
    find_metric,
)
from dfdbench.metrics.sureness import squared_errors

Crop = Literal["whole", "network-of-16"]
Unit = Literal["levels", "metres"]
#: The label of the protocol for how sure a method is; only here may a method leave pixels out.
SURE = "sure"
#: The protocol that every row of the leaderboard is ranked by.
VALID = "valid"
# The published networks halve images four times, so their program crops to multiples of this.
_NETWORK_MULTIPLE = 16


def window_of(crop: Crop, shape: tuple[int, ...], side: int) -> tuple[slice, ...]:
    """Return the part of an image that is scored, as slices of its axes.

    Parameters
    ----------
    crop : {"whole", "network-of-16"}
        The crop of a `dfdbench.metrics.protocol.Protocol`.
    shape : tuple of int
        The shape of the image.
    side : int
        The side of the centre square, in pixels.

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


class Scale(typing.Protocol):
    """How depth levels become metres; `near` and `far` are the nearest and farthest distance."""

    @property
    def near(self) -> float:
        """In metres."""

    @property
    def far(self) -> float:
        """In metres."""

    def to_metres(self, levels: NDArray[Any]) -> NDArray[np.float64]:
        """Return the distance of each level."""


def protocols_of(in_metres: bool, unit: Unit = "levels") -> dict[str, Protocol]:
    """Return the protocols that every run scores under, by label.

    `SURE` is added if a method says how sure it is or leaves pixels without an answer.

    Parameters
    ----------
    in_metres : bool
        Whether the data set says how levels become metres.
    unit : {"levels", "metres"}
        The unit of its depth. The thesis's protocols need levels.

    Examples
    --------
    >>> list(protocols_of(False)), list(protocols_of(True))[3:]
    (['thesis', 'thesis-networks-2', 'valid'], ['metric', 'aligned'])
    >>> list(protocols_of(True, "metres"))
    ['valid', 'metric', 'aligned']
    """
    return {
        label: protocol
        for label, protocol in RELEASED.items()
        if label != SURE
        and (in_metres or not protocol.in_metres)
        and (unit == "levels" or protocol.pixels == "known")
    }


def metrics_of(label: str) -> Mapping[str, Metric]:
    """Return the metrics of a protocol by name, in the order in which they are shown.

    Examples
    --------
    >>> list(metrics_of("valid")), list(metrics_of("aligned"))[:2]
    (['nrmse', 'nmae', 'ssim'], ['abs_rel', 'delta_105'])
    """
    names = RELEASED[label].metrics if label in RELEASED else ()
    return {name: find_metric(name) for name in names} if names else METRICS


def ranked_by(label: str) -> tuple[str, str]:
    """Return the metric that pairs and methods are ranked by, and the one that breaks ties.

    Examples
    --------
    >>> ranked_by("thesis"), ranked_by("metric"), ranked_by("aligned")
    (('nrmse', 'nmae'), ('abs_rel', 'rmse_m'), ('abs_rel', 'abs_rel'))
    """
    smaller = [
        name
        for name, metric in metrics_of(label).items()
        if not metric.larger_is_better and metric.best is None
    ]
    return (RANKED_BY, TIES_BY) if RANKED_BY in smaller else (smaller[0], smaller[-1])


def label_of(protocol: Mapping[str, Any]) -> str:
    """Return a protocol's label in results and folders, given its fields by name.

    The label is the name and, from the second version on, the version.

    Examples
    --------
    >>> label_of({"name": "mine", "version": 1}), label_of({"name": "mine", "version": 2})
    ('mine', 'mine-2')
    """
    name, version = protocol.get("name"), protocol.get("version", 1)
    return str(name) if version == 1 else f"{name}-{version}"


@dataclass(frozen=True)
class Protocol:
    """How a prediction is scored. A released protocol never changes; a change is a new version.

    Parameters
    ----------
    name, version : str, int
        Together they make its `label` in results.
    pixels : {"all", "known"}
        Whether pixels without ground truth count (at their stored level) or are left out.
    divisor : {"own-range", "255", "none"}
        What NRMSE and NMAE are divided by: the ground truth's range over the pixels that
        count, or 255. "none" for a protocol without these metrics.
    crop : {"whole", "network-of-16"}
        The whole image; or the image is cropped to multiples of 16 at its lower and right edge,
        and the centre square of the data set's `network_crop` is taken.
    source : str
        Where the definition comes from.
    metrics : tuple of str
        Names from `IN_METRES`, which score distances, or from `SURENESS`, which score a method's
        statements about its own errors. Empty: all of `METRICS`, which score levels.
    alignment : {"", "scale and shift in inverse depth"}
        What is first fitted to the ground truth of each image; see
        `dfdbench.metrics.metric.aligned`.
    """

    name: str
    version: int
    pixels: Literal["all", "known"]
    divisor: Literal["own-range", "255", "none"]
    crop: Crop
    source: str
    metrics: tuple[str, ...] = ()
    alignment: Literal["", "scale and shift in inverse depth"] = ""

    @property
    def label(self) -> str:
        """The name in results and folders, see `label_of`."""
        return label_of({"name": self.name, "version": self.version})

    @property
    def in_metres(self) -> bool:
        """Whether it scores distances."""
        return bool(IN_METRES.keys() & {*self.metrics})

    def as_dict(self) -> dict[str, Any]:
        """Return the definition by name, fit for JSON.

        Fields that only protocols in metres use are left out of the others, as in older results.
        """
        fields = asdict(self) | {"metrics": list(self.metrics)}
        return {name: value for name, value in fields.items() if value not in ([], "")}


_EMERSON = "Emerson 2019, Eq. 3.11, 3.13, 3.14; unknown pixels count as depth 0"
_NETWORKS = (
    "the scoring code published with the thesis's networks, which cuts images to multiples of 16 "
    "before it takes their centre"
)
_EIGEN = "Eigen et al. 2014 and Bochkovskii et al. 2024, in metres, known pixels only"
_RANFTL = (
    "Ranftl et al. 2020: least-squares scale and shift in inverse depth, at most the farthest "
    "distance; then Eigen et al. 2014, known pixels only"
)
_ILG = (
    "dfdbench, after Ilg et al. 2018: known pixels that are answered, by the order and the 90 % "
    "intervals that the method's own standard deviations give"
)
_DISTANCES = ("abs_rel", "rmse_m", "delta_105", "delta_115", "delta_125", "boundary_f1")
_RATIOS = ("abs_rel", "delta_105", "delta_115", "delta_125", "boundary_f1")
_FITTED: Literal["scale and shift in inverse depth"] = "scale and shift in inverse depth"
_ALL = (
    Protocol("thesis", 1, "all", "own-range", "whole", _EMERSON),
    Protocol("thesis-networks", 2, "all", "255", "network-of-16", _NETWORKS),
    Protocol("valid", 1, "known", "255", "whole", "dfdbench: known pixels only"),
    Protocol("metric", 1, "known", "none", "whole", _EIGEN, _DISTANCES),
    Protocol("aligned", 1, "known", "none", "whole", _RANFTL, _RATIOS, _FITTED),
    Protocol(SURE, 1, "known", "255", "whole", _ILG, tuple(SURENESS)),
)
#: Every protocol, by label.
RELEASED: Mapping[str, Protocol] = {protocol.label: protocol for protocol in _ALL}
#: The protocols that every run scores under, by label.
PROTOCOLS: Mapping[str, Protocol] = {
    label: protocol for label, protocol in RELEASED.items() if not protocol.metrics
}


def find_protocol(name: str) -> Protocol:
    """Return the protocol with this name or label.

    Raises
    ------
    UnknownNameError
        If there is none; it names the near misses.

    Examples
    --------
    >>> find_protocol("thesis-networks").label
    'thesis-networks-2'
    """
    for protocol in _ALL:
        if name in (protocol.name, protocol.label):
            return protocol
    raise unknown_name("protocol", name, {protocol.name for protocol in _ALL})


def title_of(label: str) -> str:
    """Return how tables name a result's protocol: without a version, if it is a released one."""
    return RELEASED[label].name if label in RELEASED else label


def require_scored(label: str, scored: Iterable[str], whose: str) -> None:
    """Raise if a result was not scored under a protocol.

    Parameters
    ----------
    label : str
        The protocol asked for.
    scored : iterable of str
        The labels of the protocols it was scored under.
    whose : str
        The result, named by its file or its method.

    Raises
    ------
    UnknownNameError
        If `label` is not among `scored`.
    """
    there = tuple(scored)
    if label in there:
        return
    asked = RELEASED.get(label)
    if label == SURE:
        what = "the method neither says how sure it is nor leaves pixels without an answer"
    elif asked and asked.in_metres:
        what = f"{label} needs depth in metres"
    else:
        raise unknown_name(f"protocol of {whose}", label, there)
    raise UnknownNameError(what, where=whose, expected=f"one of: {', '.join(there)}")


def score(
    protocol: Protocol,
    depth: NDArray[np.uint8] | NDArray[np.float32],
    valid: NDArray[np.bool_],
    prediction: NDArray[np.float32],
    network_crop: int,
    scale: Scale | None = None,
    unit: Unit = "levels",
    sigma: NDArray[np.float32] | None = None,
) -> dict[str, float]:
    """Score one prediction under one protocol.

    Parameters
    ----------
    protocol : Protocol
        See `PROTOCOLS`.
    depth : ndarray of uint8 or float32, shape (y, x)
        Ground truth, in `unit`.
    valid : ndarray of bool, shape (y, x)
        True where the ground truth is known.
    prediction : ndarray of float32, shape (y, x)
        Estimated depth, in `unit`; NaN where there is no answer.
    network_crop : int
        Side of the centre square, in pixels, for protocols that crop. Along an axis on which the
        image, cropped to a multiple of 16, is smaller, all of it is taken.
    scale : Scale, optional
        How levels become metres; for protocols in metres, and for depth in metres.
    unit : {"levels", "metres"}
        The unit of truth and prediction. In metres, NRMSE and NMAE are divided by far - near, the
        range of the set, just as levels are divided by 255.
    sigma : ndarray of float32, shape (y, x), optional
        The standard deviation that the method gives each pixel, in `unit`.

    Returns
    -------
    dict of str to float
        Each of the protocol's metrics by name, NaN if undefined. All are NaN if the crop is empty:
        ``network-of-16`` on fewer than 16 rows or columns, which the published networks cannot
        take either. Except under `SURE`, all are also NaN if any pixel of the prediction has no
        answer: otherwise a method would gain by leaving out what is hard.

    Raises
    ------
    InputError
        If a protocol in metres gets no scale.

    Examples
    --------
    >>> depth = np.arange(64 * 64, dtype=np.uint8).reshape(64, 64)
    >>> score(PROTOCOLS["thesis"], depth, depth > 0, depth.astype(np.float32), 32)
    {'nrmse': 0.0, 'nmae': 0.0, 'ssim': 1.0}
    """
    window = window_of(protocol.crop, depth.shape, network_crop)
    truth: NDArray[Any] = depth[window]
    test: NDArray[Any] = prediction[window]
    left_out = protocol.label != SURE and np.isnan(prediction).any()
    if not truth.size or left_out:
        return dict.fromkeys(protocol.metrics or METRICS, math.nan)
    mask = valid[window] if protocol.pixels == "known" else None
    if (protocol.in_metres or unit == "metres") and scale is None:
        raise InputError("nothing says how levels become metres", where="scale")
    if scale is not None and unit == "metres":
        truth = np.where(valid[window], truth, scale.far)
    if scale is not None and protocol.in_metres:
        if unit == "levels":
            truth, test = scale.to_metres(truth), scale.to_metres(test)
        if protocol.alignment:
            test = aligned(truth, test, scale.far, mask)
        return {name: IN_METRES[name].function(truth, test, mask=mask) for name in protocol.metrics}
    whole = 255.0 if scale is None or unit == "levels" else scale.far - scale.near
    if protocol.label == SURE:
        errors = squared_errors(truth, test, sigma, mask)
        return {name: each.function(errors, data_range=whole) for name, each in SURENESS.items()}
    divisor = whole if protocol.divisor == "255" else None
    # Once, since each metric would.
    truth, test = (np.asarray(each, np.float64) for each in (truth, test))
    found = {}
    for name, metric in METRICS.items():
        own = metric.data_range if unit == "levels" else whole
        data_range = divisor if metric.data_range is None else own
        found[name] = metric.function(truth, test, data_range=data_range, mask=mask)
    return found
