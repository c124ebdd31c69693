"""What may be chosen of DfD-Net, checked: filters, their sizes, activations, normalization."""

from collections.abc import Mapping, Sequence
from typing import Any

from dfdbench.blur.recipe import LEVELS
from dfdbench.errors import InputError, Problem
from dfdbench.tables.table import listed

# A residual block adds its input to its output: these columns of Table D.2 must be equal.
EQUAL = ((0, 2), (3, 5), (6, 8), (10, 12), (14, 16))
#: Rows and columns of a filter.
Kernel = tuple[int, int]
#: The thesis's numbers of the convolutions, input to output, which head the columns below.
LAYERS = (52, 48, 45, 42, 40, 37, 34, 32, 29, 27, 24, 20, 17, 15, 12, 8, 5, 1)

# In the copy of the thesis at hand the table's print is damaged: the heading of column 42 and
# many of its cells are lost, and some digits are turned (66 for 99). A residual block adds its
# input to its output, so column 42 equals column 37, 34 equals 29, 24 equals 17, 12 equals 5 and
# 52 equals 45. Cells that are read from that rule and from Table D.1 alone: column 42 of B-01-01
# to B-02-03, B-03-03, F-02-02 and F-03-02; column 29 of B-03-02 and F-03-01; column 17 of F-03-01;
# columns 52 and 45 of B-02-02 and B-02-03. No row remains unknown. F-02-02L is said to be rounded
# down to multiples of eight; as printed, of the layers that are no multiple, 48, 40, 27 and 8 are
# rounded down, 34, 32, 29, 20, 15, 12 and 5 up. It is kept as printed.
_TABLE = """
original 128 128 128 256 256 256 512 512 512 256 256 256 256 128 128 128 128 256
B-01-01   33  39  33 115 152 115 126 270 126 121 119 125 119  91  20  18  20 256
B-01-02   96  39  96 162 152 162 133 270 133 121 121 125 121  91  65  18  65 256
B-01-03   96  39  96 162 152 162 133 270 133 121 121 125 121  91  50  18  50 256
B-02-01   41  46  41 122 163 122 140 275 140 128 122 135 122  95  20  18  20 256
B-02-02   99  46  99 166 163 166 145 275 145 128 125 135 125  95  71  18  71 256
B-02-03   99  46  99 166 163 166 145 275 145 128 125 135 125  95  61  18  61 256
B-03-01   46  54  46 129 171 129 152 283 152 133 127 148 127 100  20  19  20 256
B-03-02  104  54 104 171 171 171 155 283 155 133 129 148 129 100  74  19  74 256
B-03-03  104  54 104 171 171 171 155 283 155 133 129 148 129 100  70  19  70 256
F-01-01   96  44  96 104 150 104 145 206 145 129 112 109 112  93  71  18  71 256
F-01-02   96  44  96 104 150 104 185 206 185 129 112 109 112  93  71  18  71 256
F-02-01   96  44  96 104 150 104 160 253 160 145 112 109 112  93  71  18  71 256
F-02-02   96  44  96 104 150 104 190 253 190 145 112 109 112  93  71  18  71 256
F-03-01   96  44  96 104 150 104 155 226 155 139 112 109 112  93  71  18  71 256
F-03-02   96  44  96 104 150 104 188 226 188 139 112 109 112  93  71  18  71 256
F-02-02L  96  40  96 104 144 104 192 256 192 144 112 112 112  96  72  16  72 256
F-02-02H  96  48  96 104 152 104 192 256 192 152 112 112 112  96  72  24  72 256
"""

# The network that the particle swarm chose. The thesis has its widths in Fig. 6.2 alone, which has
# no text; these are of the author's 20 generated network headers of the swarm's iteration 60, all
# alike. That they are Fig. 6.2's network is very likely, not proven: they fit every word of 6.1.
_SWARM = """
pso      145 121 145 238 267 238 434 190 434 251 255 297 255 138 135 181 135 256
"""

#: Filters of the 18 convolutions, input to output, by the name in Table D.2, and ``pso``.
FILTERS: dict[str, tuple[int, ...]] = {
    row.split()[0]: tuple(int(number) for number in row.split()[1:])
    for row in (_TABLE.strip() + _SWARM).strip().splitlines()
}


def narrowed(filters: tuple[int, ...], divisor: int) -> tuple[int, ...]:
    """Return all widths but the last, the number of depth levels, divided; at least 1.

    Examples
    --------
    >>> narrowed(FILTERS["original"], 8)[:4]
    (16, 16, 16, 32)
    """
    return (*(max(1, number // divisor) for number in filters[:-1]), filters[-1])


#: Layers by how wide a pixel of their level is; and those of them on the way up.
_LEVELS = {1: (52, 48, 45, 12, 8, 5, 1), 2: (40, 37, 24, 20, 17), 4: (32, 29)}
_UP = ((12, 8, 5, 1), (24, 20, 17))


def reach_of(kernels: Mapping[int, Kernel], sampling_size: int) -> int:
    """Return the distance beyond which pixels do not change a pixel's answer.

    Parameters
    ----------
    kernels : mapping of int to (int, int)
        Rows and columns of the filters that keep the resolution, by the thesis's layer.
    sampling_size : int
        Of the filters that halve and double the resolution.

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
    # Halving and doubling together see so much farther, once on level 1 and once on level 2.
    between = 3 * (sampling_size - 1)
    if sampling_size == 1:
        # Only every second pixel is seen. No wider filter on the way up: then the next one's.
        bare = [{kernels[layer][axis] for layer in up} == {1} for up in _UP for axis in (0, 1)]
        between = 2 if any(bare) else 0
    return widened + between


#: The layers whose filters keep the resolution, input to output: their sizes are free.
SIZED = tuple(layer for layer in LAYERS if layer not in (42, 34, 27, 15))
#: Where batch normalization and an activation stand, input to output.
SITES = (
    *("entry", "encode_1", "encode_2", "bottom"),
    *("merge_2", "decode_2", "merge_1", "decode_1", "classify"),
)


def checked_filters(filters: Sequence[int]) -> tuple[int, ...]:
    """Return the numbers of filters of the 18 convolutions.

    Raises
    ------
    InputError
        If they do not fit each other, naming the thesis's layers.
    """
    numbers = tuple(int(number) for number in filters)
    if len(numbers) != len(LAYERS) or min(numbers) < 1 or numbers[-1] != LEVELS:
        what = f"filters do not fit DfD-Net: {listed(numbers)}"
        expected = f"{len(LAYERS)} positive numbers, the last {LEVELS}"
        raise InputError(what, where="filters", expected=expected)
    problems = [
        Problem(
            f"layers {LAYERS[one]} and {LAYERS[other]} are equally wide, not {numbers[one]} and "
            f"{numbers[other]}, as a residual block adds them",
            where="filters",
        )
        for one, other in EQUAL
        if numbers[one] != numbers[other]
    ]
    InputError.raise_if(problems)
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
    """Return the names of the nine activations; by default PReLU but for the first.

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
    """Return the constructor arguments that these choices come to, what is usual left out.

    Two ways to say the same network give the same arguments, and those of a network that has
    nothing unusual are what they were before there was a choice.

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
