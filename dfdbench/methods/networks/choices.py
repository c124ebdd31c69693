"""Check the choices for DfD-Net: filters, their sizes, activations, normalization."""

import tomllib
from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import Any

from dfdbench.blur.recipe import LEVELS
from dfdbench.errors import InputError, Problem
from dfdbench.tables.table import listed

#: Rows and columns of a filter.
Kernel = tuple[int, int]
#: The thesis's numbering of the convolutions, input to output: the columns of filters.toml.
LAYERS = (52, 48, 45, 42, 40, 37, 34, 32, 29, 27, 24, 20, 17, 15, 12, 8, 5, 1)
#: A residual block adds its input to its output, so these layers have the same width.
TIED = ((52, 45), (42, 37), (34, 29), (24, 17), (12, 5))

#: Filters of the 18 convolutions, input to output, by the name in Table D.2, and ``pso``.
FILTERS: dict[str, tuple[int, ...]] = {
    name: tuple(widths)
    for name, widths in tomllib.loads(
        files("dfdbench.methods.networks").joinpath("filters.toml").read_text(encoding="utf-8")
    ).items()
}


def narrowed(filters: tuple[int, ...], divisor: int) -> tuple[int, ...]:
    """Divide all widths, to at least 1, except the last, which is the number of depth levels.

    Examples
    --------
    >>> narrowed(FILTERS["original"], 8)[:4]
    (16, 16, 16, 32)
    """
    return (*(max(1, number // divisor) for number in filters[:-1]), filters[-1])


#: Layers by the width of a pixel on their level; and those of them on the way up.
_LEVELS = {1: (52, 48, 45, 12, 8, 5, 1), 2: (40, 37, 24, 20, 17), 4: (32, 29)}
_UP = ((12, 8, 5, 1), (24, 20, 17))


def reach_of(kernels: Mapping[int, Kernel], sampling_size: int) -> int:
    """Return the distance beyond which pixels do not affect a pixel's answer.

    Parameters
    ----------
    kernels : mapping of int to (int, int)
        Rows and columns of the filters that keep the resolution, by the thesis's layer.
    sampling_size : int
        Rows and columns of the filters that halve and double the resolution.

    Returns
    -------
    int
        In pixels.

    Examples
    --------
    >>> from dfdbench.methods.networks.choices import SIZED
    >>> reach_of(dict.fromkeys(SIZED, (3, 3)), 2), reach_of(dict.fromkeys(SIZED, (1, 9)), 2)
    (28, 103)
    """
    widened = max(
        sum(kernels[layer][axis] // 2 * width for width, of in _LEVELS.items() for layer in of)
        for axis in (0, 1)
    )
    # Halving and doubling together reach this much farther, once on level 1 and once on level 2.
    between = 3 * (sampling_size - 1)
    if sampling_size == 1:
        # Only every second pixel is seen. No wider filter on the way up: then the next one's.
        bare = [{kernels[layer][axis] for layer in up} == {1} for up in _UP for axis in (0, 1)]
        between = 2 if any(bare) else 0
    return widened + between


#: The layers whose filters keep the resolution and may have any size, input to output.
SIZED = tuple(layer for layer in LAYERS if layer not in (42, 34, 27, 15))
#: The sites of batch normalization and an activation, input to output.
SITES = (
    *("entry", "encode_1", "encode_2", "bottom"),
    *("merge_2", "decode_2", "merge_1", "decode_1", "classify"),
)


def checked_filters(filters: Sequence[int]) -> tuple[int, ...]:
    """Return the numbers of filters of the 18 convolutions.

    Raises
    ------
    InputError
        If they do not match; it names the thesis's layers.
    """
    numbers = tuple(int(number) for number in filters)
    if len(numbers) != len(LAYERS) or min(numbers) < 1 or numbers[-1] != LEVELS:
        what = f"filters do not fit DfD-Net: {listed(numbers)}"
        expected = f"{len(LAYERS)} positive numbers, the last {LEVELS}"
        raise InputError(what, where="filters", expected=expected)
    of = dict(zip(LAYERS, numbers, strict=True))
    InputError.raise_if(
        Problem(
            f"layers {one} and {other} are equally wide, not {of[one]} and {of[other]}, as a "
            "residual block adds them",
            where="filters",
        )
        for one, other in TIED
        if of[one] != of[other]
    )
    return numbers


def kernel_sizes(kernels: Sequence[int | Sequence[int]] | None) -> dict[int, Kernel]:
    """Return rows and columns of the filters, by the thesis's layer.

    Examples
    --------
    >>> kernel_sizes([5, [1, 9], *[3] * 12])[48]
    (1, 9)
    """
    sizes = [3] * len(SIZED) if kernels is None else kernels
    return {
        layer: (size, size) if isinstance(size, int) else (size[0], size[1])
        for layer, size in zip(SIZED, sizes, strict=True)
    }


def activation_names(activations: Sequence[str] | None, first: str) -> tuple[str, ...]:
    """Return the names of the nine activations; by default all but the first are PReLU.

    Examples
    --------
    >>> activation_names(None, "sigmoid")[:2]
    ('sigmoid', 'prelu')
    """
    return (first, *["prelu"] * (len(SITES) - 1)) if activations is None else tuple(activations)


def plain_choices(
    kernels: Sequence[int | Sequence[int]] | None,
    activations: Sequence[str] | None,
    normalized: Sequence[bool] | None,
) -> dict[str, Any]:
    """Return the constructor arguments for these choices, without those that are usual.

    Two ways to describe the same network give the same arguments. Those of a usual network are
    what they were before there was a choice.

    Examples
    --------
    >>> plain_choices([3] * 14, ["sigmoid", *["prelu"] * 8], None)
    {'first_activation': 'sigmoid'}
    """
    found: dict[str, Any] = {}
    sizes = [list(size) for size in kernel_sizes(kernels).values()]
    if any(size != [3, 3] for size in sizes):
        found["kernels"] = sizes
    if activations is not None:
        names = activation_names(activations, "")
        if names[0] in ("prelu", "sigmoid") and set(names[1:]) == {"prelu"}:
            found["first_activation"] = names[0]
        else:
            found["activations"] = list(names)
    if normalized is not None and not all(normalized):
        found["normalized"] = list(normalized)
    return found
