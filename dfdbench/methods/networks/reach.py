"""How far a pixel of DfD-Net sees: what tiles have to overlap by."""

from __future__ import annotations

from collections.abc import Mapping

from dfdbench.methods.networks.layers import Kernel

#: Layers by where they stand: on their way down, at the bottom, on their way up.
_DOWN = ((52, 48, 45), (40, 37))
_BOTTOM = (32, 29)
_UP = ((24, 20, 17), (12, 8, 5, 1))

Span = tuple[int, int]


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
    farthest = 0
    for axis in (0, 1):
        sizes = {layer: kernel[axis] for layer, kernel in kernels.items()}
        for pixel in range(4):  # halving and doubling treat pixels alike only every fourth
            low, high = _seen((pixel, pixel), sizes, sampling_size)
            farthest = max(farthest, pixel - low, high - pixel)
    return farthest


def _seen(span: Span, sizes: Mapping[int, int], sampling: int) -> Span:
    """Return the pixels of the image that a span of the answer depends on: Fig. 5.5, backwards."""
    level_1 = _widened(span, sizes, _UP[1])
    level_2 = _widened(_doubled_from(level_1, sampling), sizes, _UP[0])
    bottom = _widened(_doubled_from(level_2, sampling), sizes, _BOTTOM)
    level_2 = _widened(_joined(level_2, _halved_from(bottom, sampling)), sizes, _DOWN[1])
    return _widened(_joined(level_1, _halved_from(level_2, sampling)), sizes, _DOWN[0])


def _widened(span: Span, sizes: Mapping[int, int], layers: tuple[int, ...]) -> Span:
    more = sum(sizes[layer] // 2 for layer in layers)
    return span[0] - more, span[1] + more


def _joined(one: Span, other: Span) -> Span:
    return min(one[0], other[0]), max(one[1], other[1])


def _halved_from(span: Span, size: int) -> Span:
    first = -((size - 1) // 2)
    return 2 * span[0] + first, 2 * span[1] + first + size - 1


def _doubled_from(span: Span, size: int) -> Span:
    # Where only every second pixel has something to be doubled from, at least the next one.
    padding = (size - 1) // 2
    low, high = -((size - 1 - padding - span[0]) // 2), (span[1] + padding) // 2
    return min(low, high), max(low, high)
