"""What may be chosen of DfD-Net, checked: filters, their sizes, activations, normalization."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from dfdbench.blur.recipe import LEVELS
from dfdbench.errors import InputError, Problem
from dfdbench.methods.networks.layers import ACTIVATIONS, EQUAL, Kernel
from dfdbench.methods.networks.widths import LAYERS
from dfdbench.tables.wording import listed

#: The layers whose filters keep the resolution, input to output: their sizes are free.
SIZED = tuple(layer for layer in LAYERS if layer not in (42, 34, 27, 15))
#: Where batch normalization and an activation stand, input to output.
SITES = (
    "entry",
    "encode_1",
    "encode_2",
    "bottom",
    "merge_2",
    "decode_2",
    "merge_1",
    "decode_1",
    "classify",
)
LARGEST_KERNEL = 9


def checked_filters(filters: Sequence[int]) -> tuple[int, ...]:
    """Return the numbers of filters of the 18 convolutions.

    Raises
    ------
    InputError
        Where they do not fit each other, naming the thesis's layers.
    """
    numbers = tuple(int(number) for number in filters)
    if len(numbers) != len(LAYERS) or min(numbers) < 1 or numbers[-1] != LEVELS:
        raise InputError(
            "filters do not fit DfD-Net",
            where="filters",
            expected=f"{len(LAYERS)} positive numbers, the last {LEVELS}",
            got=listed(numbers),
        )
    problems = [
        Problem(
            "a residual block adds its input to its output",
            where="filters",
            expected=f"layers {LAYERS[one]} and {LAYERS[other]} equal",
            got=f"{numbers[one]} and {numbers[other]}",
        )
        for one, other in EQUAL
        if numbers[one] != numbers[other]
    ]
    if problems:
        raise InputError.of(problems)
    return numbers


def checked_kernels(kernels: Sequence[int | Sequence[int]] | None) -> dict[int, Kernel]:
    """Return rows and columns of the filters, by the thesis's layer.

    Raises
    ------
    InputError
        Where there are not 14, or one is not odd or too large.

    Examples
    --------
    >>> checked_kernels([5, [1, 9], *[3] * 12])[48]
    (1, 9)
    """
    if kernels is None:
        return dict.fromkeys(SIZED, (3, 3))
    sizes = [(size, size) if isinstance(size, int) else tuple(size) for size in kernels]
    fits = [
        len(size) == 2 and all(side in range(1, LARGEST_KERNEL + 1, 2) for side in size)
        for size in sizes
    ]
    if len(sizes) != len(SIZED) or not all(fits):
        raise InputError(
            "filter sizes do not fit DfD-Net",
            where="kernels",
            expected=f"{len(SIZED)} of them, for layers {listed(SIZED)}: each an odd number up to "
            f"{LARGEST_KERNEL}, or rows and columns",
            got=listed(kernels),
        )
    return {layer: (rows, columns) for layer, (rows, columns) in zip(SIZED, sizes, strict=True)}


def checked_activations(activations: Sequence[str] | None, first: str) -> tuple[str, ...]:
    """Return the names of the nine activations; by default PReLU but for the first.

    Raises
    ------
    InputError
        Where there are not nine, or one is unknown.

    Examples
    --------
    >>> checked_activations(None, "sigmoid")[:2]
    ('sigmoid', 'prelu')
    """
    names = (first, *["prelu"] * (len(SITES) - 1)) if activations is None else tuple(activations)
    if len(names) != len(SITES) or not set(names) <= ACTIVATIONS.keys():
        raise InputError(
            "unknown activation",
            where="first_activation" if activations is None else "activations",
            expected=" or ".join(ACTIVATIONS)
            + ("" if activations is None else f", {len(SITES)} of them"),
            got=first if activations is None else listed(activations),
        )
    return names


def checked_normalized(normalized: Sequence[bool] | None) -> tuple[bool, ...]:
    """Return at which of the nine sites there is batch normalization; by default at all.

    Raises
    ------
    InputError
        Where there are not nine choices.
    """
    found = (True,) * len(SITES) if normalized is None else tuple(map(bool, normalized))
    if len(found) != len(SITES):
        raise InputError(
            "wrong number of choices",
            where="normalized",
            expected=f"{len(SITES)}: {listed(SITES)}",
            got=str(len(found)),
        )
    return found


def plain_choices(
    kernels: Sequence[int | Sequence[int]] | None,
    activations: Sequence[str] | None,
    normalized: Sequence[bool] | None,
) -> dict[str, Any]:
    """Return the constructor arguments that these choices come to, what is usual left out.

    Two ways to say the same network give the same arguments, and those of a network that has
    nothing unusual are what they were before there was a choice.

    Raises
    ------
    InputError
        Where a choice does not fit the network.

    Examples
    --------
    >>> plain_choices([3] * 14, ["sigmoid", *["prelu"] * 8], None)
    {'first_activation': 'sigmoid'}
    """
    found: dict[str, Any] = {}
    sizes = [list(size) for size in checked_kernels(kernels).values()]
    if any(size != [3, 3] for size in sizes):
        found["kernels"] = sizes
    if activations is not None:
        names = checked_activations(activations, "")
        if names[0] in ("prelu", "sigmoid") and set(names[1:]) == {"prelu"}:
            found["first_activation"] = names[0]
        else:
            found["activations"] = list(names)
    if normalized is not None and not all(checked_normalized(normalized)):
        found["normalized"] = list(normalized)
    return found
