"""A particle: 51 numbers that describe a network and the patches it is trained on (6.1, App. C)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError, model_validator

from dfdbench.blur.recipe import LEVELS
from dfdbench.errors import InputError
from dfdbench.methods.networks.choices import (
    LAYERS,
    SITES,
    SIZED,
    checked_activations,
    checked_filters,
    checked_kernels,
    checked_normalized,
)
from dfdbench.methods.networks.layers import ACTIVATIONS
from dfdbench.system.record import Record, problems_of
from dfdbench.training.search.swarm import Box, Numbers


@dataclass(frozen=True)
class Variant:
    """A choice for everything in which the author's program differs from the thesis's text.

    Parameters
    ----------
    kernel_speed : float
        The fastest that a filter's rows and columns change, in halves of their size.
    crop_wraps : bool
        The size of patches wraps around at its limits; otherwise it stops there.
    crop_late : bool
        The size of patches starts at its largest velocity and moves by that of the iteration
        before.
    whole : bool
        Positions start at whole numbers, all equally likely, and are rounded after every move.
    against_previous : bool
        A particle's own best is replaced if the value is below that of the iteration before.
    begins_with_published : bool
        The first particle begins as DfD-Net itself; otherwise at random, as the others.
    scores_centre : bool
        The objective scores the centre of 368 x 400 pixels and divides by 255; otherwise whole
        images by the protocol ``thesis``.
    """

    kernel_speed: float = 2
    crop_wraps: bool = False
    crop_late: bool = False
    whole: bool = False
    against_previous: bool = False
    begins_with_published: bool = False
    scores_centre: bool = False


VARIANTS = {
    "thesis": Variant(),
    "author": Variant(
        kernel_speed=1,
        crop_wraps=True,
        crop_late=True,
        whole=True,
        against_previous=True,
        begins_with_published=True,
        scores_centre=True,
    ),
}
#: The layers that share a width, and those of them that share the size of their filters, output to
#: input. Layer 1 is no choice, nor are the sizes of filters that halve and double the resolution.
ROWS: tuple[tuple[tuple[int, ...], tuple[int, ...]], ...] = (
    ((5, 12), (5, 12)),
    ((8,), (8,)),
    ((15,), ()),
    ((17, 24), (17, 24)),
    ((20,), (20,)),
    ((27,), ()),
    ((29, 34), (29,)),
    ((32,), (32,)),
    ((37, 42), (37,)),
    ((40,), (40,)),
    ((45, 52), (45, 52)),
    ((48,), (48,)),
)
#: Patches a step by the rows and columns of a patch, each in eight orientations.
PATCHES = {
    12: 100, 16: 90, 20: 65, 24: 56, 28: 40, 32: 28, 36: 20, 40: 18, 44: 16, 48: 14, 52: 10,
    56: 8, 60: 6, 64: 5,
}  # fmt: skip
_KINDS = tuple(ACTIVATIONS)
_OUTWARD = tuple(reversed(SITES))


def _names() -> tuple[str, ...]:
    names = []
    for layers, sized in ROWS:
        names.append("width_" + "_".join(map(str, layers)))
        names += [f"{side}_" + "_".join(map(str, sized)) for side in ("rows", "columns") if sized]
    names += [f"{kind}_{site}" for kind in ("normalized", "activation") for site in _OUTWARD]
    return (*names, "crop")


#: What each component is, output to input; numbers are the thesis's layers.
COMPONENTS = _names()


class Bounds(Record):
    """What a particle may describe; by default what Tables C.1 and C.3 allow.

    Parameters
    ----------
    width : tuple of int
        Filters of a layer.
    kernel : tuple of int
        Rows and columns of a filter, odd.
    crop : tuple of int
        Rows and columns of a patch, multiples of four.
    """

    width: tuple[Annotated[int, Field(ge=1)], Annotated[int, Field(le=512)]] = (8, 512)
    kernel: tuple[Annotated[int, Field(ge=1)], Annotated[int, Field(le=9)]] = (1, 9)
    crop: tuple[Annotated[int, Field(ge=12)], Annotated[int, Field(le=64)]] = (12, 64)

    @model_validator(mode="after")
    def _fit(self) -> Bounds:
        for name, (low, high) in self:
            if low > high:
                raise ValueError(f"{name}: the lower bound first, got {low}:{high}")
        for name, rest, step in (("kernel", 1, 2), ("crop", 0, 4)):
            if any(number % step != rest for number in getattr(self, name)):
                raise ValueError(f"{name}: {'odd numbers' if rest else f'multiples of {step}'}")
        return self


def bounds_of(given: Mapping[str, str]) -> Bounds:
    """Return bounds from texts such as ``8:256``, by name.

    Raises
    ------
    InputError
        If they are none.

    Examples
    --------
    >>> bounds_of({"crop": "12:24"}).crop
    (12, 24)
    """
    try:
        return Bounds.model_validate({name: str(text).split(":") for name, text in given.items()})
    except ValidationError as error:
        what = "not the bounds of a search"
        fix = "as width=8:512, kernel=1:9, crop=12:64"
        raise InputError.of(problems_of(error, what, file="--bounds", fix=fix)) from error


class Particle(Record):
    """What a position means: fields are choices of a training's configuration of that name."""

    filters: list[int]
    kernels: list[tuple[int, int]]
    activations: list[str]
    normalized: list[bool]
    crop: int


def box_of(bounds: Bounds, variant: Variant) -> Box:
    """Return the box that particles move in: Tables C.1 to C.3.

    Examples
    --------
    >>> from dfdbench.training.search.particle import VARIANTS
    >>> box_of(Bounds(), VARIANTS["thesis"]).high[-1].item()
    13.0
    """
    limits = {
        # lowest, highest, fastest, fastest at first
        "width": (*bounds.width, 16, 8),
        "rows": (*_halved(bounds.kernel), variant.kernel_speed, 1),
        "columns": (*_halved(bounds.kernel), variant.kernel_speed, 1),
        "normalized": (0, 1, 1, 1),
        "activation": (0, len(_KINDS) - 1, 1, 1),
        "crop": (*((side - 12) // 4 for side in bounds.crop), 1, 1),
    }
    kinds = [name.partition("_")[0] for name in COMPONENTS]
    columns = np.array([limits[kind] for kind in kinds], np.float64).T
    going_round = {"activation", *(["crop"] if variant.crop_wraps else [])}
    wraps = np.array([kind in going_round for kind in kinds])
    late = (kinds.index("crop"),) if variant.crop_late else ()
    return Box(columns[0], columns[1], columns[2], columns[3], wraps, variant.whole, late)


def whole_numbers(positions: Numbers) -> NDArray[np.int64]:
    """Return what components are read as, shape (..., components): the nearest whole numbers."""
    found = np.floor(positions + 0.5).astype(np.int64)
    kinds = np.array([name.startswith("activation") for name in COMPONENTS])
    return np.where(kinds, found % len(_KINDS), found)


def particle_at(position: Numbers) -> Particle:
    """Return the network that a position describes.

    Examples
    --------
    >>> particle_at(position_of(filters=[16] * 17 + [256])).filters[-2:]
    [16, 256]
    """
    values = dict(zip(COMPONENTS, whole_numbers(position).tolist(), strict=True))
    widths, sizes = {1: LEVELS}, {1: (3, 3)}
    for layers, sized in ROWS:
        widths |= dict.fromkeys(layers, values["width_" + "_".join(map(str, layers))])
        if sized:
            label = "_".join(map(str, sized))
            size = (2 * values[f"rows_{label}"] + 1, 2 * values[f"columns_{label}"] + 1)
            sizes |= dict.fromkeys(sized, size)
    return Particle(
        filters=[widths[layer] for layer in LAYERS],
        kernels=[sizes[layer] for layer in SIZED],
        activations=[_KINDS[values[f"activation_{site}"]] for site in SITES],
        normalized=[bool(values[f"normalized_{site}"]) for site in SITES],
        crop=4 * values["crop"] + 12,
    )


def position_of(
    filters: Sequence[int],
    kernels: Sequence[int | Sequence[int]] | None = None,
    activations: Sequence[str] | None = None,
    normalized: Sequence[bool] | None = None,
    crop: int = 32,
    first_activation: str = "prelu",
) -> Numbers:
    """Return the position that describes a network, the inverse of `particle_at`.

    Of filters that share a size the first one counts.
    """
    widths = dict(zip(LAYERS, checked_filters(filters), strict=True))
    sizes = checked_kernels(kernels)
    kinds = dict(zip(SITES, checked_activations(activations, first_activation), strict=True))
    bits = dict(zip(SITES, checked_normalized(normalized), strict=True))
    position: list[float] = []
    for layers, sized in ROWS:
        position.append(widths[layers[0]])
        position += [side // 2 for layer in sized[:1] for side in sizes[layer]]
    position += [int(bits[site]) for site in _OUTWARD]
    position += [_KINDS.index(kinds[site]) for site in _OUTWARD]
    position.append((crop - 12) / 4)
    return np.array(position, np.float64)


def _halved(sizes: tuple[int, int]) -> tuple[int, int]:
    return sizes[0] // 2, sizes[1] // 2
