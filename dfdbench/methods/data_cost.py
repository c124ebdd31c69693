"""The data cost of depth from defocus: how badly each blur explains each pixel (Eq. 4.1).

The definition blurs the in-focus image once per label. We blur it at only a dozen sigmas: the
kernels of all labels are sums of those few, to a fraction of a thousandth. Blurring is linear, so
the same sums of the few images give the blurred images of all labels. Rows are processed one at a
time, and no blurred image is ever stored.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dfdbench.blur.recipe import gaussian_rows
from dfdbench.errors import InputError
from dfdbench.system.compiled import compiled

# Largest sum of absolute differences between a label's kernel and the sum that replaces it: at most
# 0.013 grey levels where black meets white, a hundredth of that in photographs.
KERNEL_TOLERANCE = 1e-4

# Weight of the factors' size in the fit of the kernels. Without it they, and float32 rounding with
# them, grow to hundreds. With it they stay below 6 and the fit is nearly as good.
RIDGE = 1e-6

# Added before a cost is truncated to an integer. Flat areas have integer costs, which rounding must
# not push just below the integer.
ROUNDING = np.float32(2**-13)

# Taps below this share of a kernel's sum cannot change a float32 sum of 8-bit values.
NEGLIGIBLE = 1e-9

Array = NDArray[Any]


def data_cost(
    infocus: NDArray[np.uint8] | NDArray[np.float32],
    defocus: NDArray[np.uint8] | NDArray[np.float32],
    sigmas: ArrayLike,
    weight: float = 12,
    limit: int = 1021,
    kernel_size: int = 27,
    out: NDArray[np.uint16] | None = None,
    rows: slice = slice(None),
    columns: slice = slice(None),
) -> tuple[NDArray[np.uint16], int]:
    """Compute the cost of every label at every pixel: Eq. 4.1 with integer costs.

    ``cost[y, x, i] = int(weight * sum over channels of (defocus - blurred_i)^2)``, where
    ``blurred_i`` is the in-focus image correlated with a Gaussian of ``sigmas[i]``, cut off to a
    square and normalised to sum to 1; the image's edge is repeated outside. About one cost in a
    thousand differs by 1 from this definition in float64, and hardly any by more.

    Parameters
    ----------
    infocus, defocus : (y, x, channel) uint8 or float32
        The two images, in the colour space in which to compare them (in the thesis Y, Cr, Cb), with
        one to four channels.
    sigmas : (label,) float64
        Standard deviation of the blur of each label in pixels, ascending, above 0.
    weight : float, optional
        Factor of the squared differences; c of Eq. 4.1.
    limit : int, optional
        Costs this far above a pixel's least are stored as `limit`, at most 65535. Choose at least
        four times the largest smoothness cost plus one; 1021 suits costs up to 255.
    kernel_size : int, optional
        Side of the square kernel in pixels, odd, whatever the sigma.
    out : (y, x, label) uint16, optional
        Contiguous memory to write the costs into: on some systems, allocating it takes as long as
        the computation.
    rows, columns : slice, optional
        The part of the image whose costs to compute, without a step; by default all of it.

    Returns
    -------
    unary : (y, x, label) uint16
        Costs relative to the pixel's least.
    offset : int
        Sum of the least costs of all pixels.

    Raises
    ------
    InputError
        If an image is not as described above.

    Examples
    --------
    >>> import numpy as np
    >>> infocus = np.zeros((1, 5, 1), np.uint8)
    >>> infocus[0, 2] = 100
    >>> unary, offset = data_cost(infocus, infocus, [0.1, 0.4, 0.8])
    >>> unary[0, 2].tolist(), offset
    ([0, 783, 1021], 0)
    """
    sharp, blurred = np.asarray(infocus), np.asarray(defocus)
    values = np.asarray(sigmas, np.float64)
    require_pair(sharp, blurred, "uint8", "float32")
    radius = kernel_size // 2
    nodes, mixture = _mixture(values, radius)
    kernels = gaussian_rows(nodes, radius)
    padded, blurred = part_of_pair(sharp, blurred, radius, rows, columns)
    shape = (*blurred.shape[:2], len(values))
    unary = np.empty(shape, np.uint16) if out is None else out
    offset = _fill(
        padded.astype(np.float32),
        np.ascontiguousarray(blurred),
        kernels[:, radius:].astype(np.float32),
        (kernels[:, radius:] > NEGLIGIBLE).sum(1),
        mixture.astype(np.float32),
        float(weight),
        # Four neighbours cost at most four times the largest smoothness cost. A label that exceeds
        # the pixel's least cost by more than that is in no labeling of least energy, so its exact
        # cost does not matter as long as it stays above.
        limit,
        unary,
    )
    return unary, int(offset)


def part_of_pair(
    infocus: Array, defocus: Array, radius: int, rows: slice, columns: slice
) -> tuple[Array, Array]:
    """Return a part of both images, (channel, y, x); the first with the margin its blur reaches.

    The margin repeats the image's edge where it extends outside.
    """
    (top, bottom, _), (left, right, _) = map(slice.indices, (rows, columns), infocus.shape[:2])
    padded = np.pad(infocus, ((radius, radius), (radius, radius), (0, 0)), mode="edge")
    near = padded[top : bottom + 2 * radius, left : right + 2 * radius]
    return np.ascontiguousarray(near.transpose(2, 0, 1)), defocus[top:bottom, left:right]


def require_pair(infocus: Array, defocus: Array, *kinds: str) -> None:
    """Raise unless images have the shape (y, x, channel), an allowed kind and the same size.

    Raises
    ------
    InputError
        If they do not.
    """
    for name, image in (("infocus", infocus), ("defocus", defocus)):
        if image.ndim != 3 or 0 in image.shape or image.shape[2] > 4:
            raise InputError(
                f"{name}: expected a shape (y, x, channel) with 1 to 4 channels, got {image.shape}"
            )
        if image.dtype.name not in kinds:
            raise InputError(f"{name}: expected {' or '.join(kinds)}, got {image.dtype}")
    if infocus.shape != defocus.shape:
        raise InputError(f"defocus: expected the shape {infocus.shape}, got {defocus.shape}")


def _mixture(sigmas: Array, radius: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Choose few sigmas, and weights with which their 2-D kernels sum to the given ones.

    Returns the sigmas of the nodes and a (node, label) float64 matrix whose columns sum to 1.
    """
    wanted = planes_of(gaussian_rows(sigmas, radius))
    for count in range(4, min(len(sigmas), 33), 4):
        # Chebyshev points in sqrt(sigma): dense where the kernel changes fast.
        points = np.cos((2 * np.arange(count) + 1) * math.pi / (2 * count))[::-1]
        low, high = math.sqrt(sigmas[0]), math.sqrt(sigmas[-1])
        nodes = ((low + high) / 2 + (high - low) / 2 * points) ** 2
        planes = planes_of(gaussian_rows(nodes, radius))
        # Least squares over factors that sum to 1, so that flat areas are exact.
        others, last = planes[:-1] - planes[-1], planes[-1]
        bent = np.concatenate([others.T, RIDGE * np.eye(count - 1)])
        aim = np.concatenate([(wanted - last).T, np.zeros((count - 1, len(sigmas)))])
        factors = np.linalg.lstsq(bent, aim, rcond=None)[0]
        error = np.abs(wanted - last - factors.T @ others).sum(1).max()
        if error <= KERNEL_TOLERANCE:
            return nodes, np.concatenate([factors, 1 - factors.sum(0, keepdims=True)])
    return sigmas, np.eye(len(sigmas))


def planes_of(kernels: Array) -> NDArray[np.float64]:
    """Build 2-D kernels from rows of 1-D ones; by symmetry one quadrant represents all four."""
    radius = kernels.shape[1] // 2
    # In sums over the kernel, a tap off an axis also counts for its mirror images.
    half = kernels[:, radius:] * np.where(np.arange(radius + 1) > 0, 2.0, 1.0)
    return np.asarray(np.einsum("ia,ib->iab", half, half).reshape(len(half), -1))


# One long loop nest: shorter functions would need a dozen arrays and counters for every pixel.
@compiled(fastmath={"contract"})
def _fill(
    padded: Array,
    defocus: Array,
    kernels: Array,
    lengths: Array,
    mixture: Array,
    weight: float,
    limit: int,
    unary: Array,
) -> int:
    height, width, channels = defocus.shape
    nodes, labels = mixture.shape
    radius = kernels.shape[1] - 1
    column_sums = np.empty(width + 2 * radius, np.float32)
    # Four pixels share each pass over the mixture; columns that pad the last four are unused.
    fours = (width + 3) // 4 * 4
    residuals = np.zeros((channels, (nodes + 1) // 2 * 2, fours), np.float32)
    factors = np.zeros((residuals.shape[1], labels), np.float32)
    # Use loops: numba takes seconds to compile the error message for an assignment of arrays.
    for node in range(nodes):
        for label in range(labels):
            factors[node, label] = mixture[node, label]
    difference = np.empty((4, labels), np.float32)
    squares = np.empty((4, labels), np.float32)
    costs = np.empty(labels, np.int32)
    scale, most = np.float32(weight), np.int32(limit)
    offset = 0
    for y in range(height):
        # Residuals of the row at every node; a Gaussian separates into columns, then rows.
        for channel in range(channels):
            rows = padded[channel]
            for node in range(nodes):
                row = residuals[channel, node, :width]
                for x in range(width + 2 * radius):
                    column_sums[x] = kernels[node, 0] * rows[y + radius, x]
                for tap in range(1, lengths[node]):
                    factor = kernels[node, tap]
                    above, below = rows[y + radius - tap], rows[y + radius + tap]
                    for x in range(width + 2 * radius):
                        column_sums[x] += factor * (above[x] + below[x])
                for x in range(width):
                    row[x] = np.float32(defocus[y, x, channel])
                    row[x] -= kernels[node, 0] * column_sums[x + radius]
                for tap in range(1, lengths[node]):
                    factor = kernels[node, tap]
                    for x in range(width):
                        row[x] -= factor * (
                            column_sums[x + radius - tap] + column_sums[x + radius + tap]
                        )
        for start in range(0, width, 4):
            squares[:] = 0
            for channel in range(channels):
                difference[:] = 0
                for node in range(0, factors.shape[0], 2):
                    _add_two(
                        factors[node],
                        factors[node + 1],
                        residuals[channel, node, start : start + 4],
                        residuals[channel, node + 1, start : start + 4],
                        difference,
                    )
                for pixel in range(4):
                    for label in range(labels):
                        squares[pixel, label] += difference[pixel, label] * difference[pixel, label]
            for pixel in range(min(4, width - start)):
                least = np.int32(2**31 - 1)
                for label in range(labels):
                    costs[label] = np.int32(scale * squares[pixel, label] + ROUNDING)
                    least = min(least, costs[label])
                offset += int(least)
                for label in range(labels):
                    unary[y, start + pixel, label] = min(costs[label] - least, most)
    return offset


@compiled(fastmath={"contract"}, inline="always")
def _add_two(first: Array, second: Array, by_first: Array, by_second: Array, out: Array) -> None:
    a0, a1, a2, a3 = by_first[0], by_first[1], by_first[2], by_first[3]
    b0, b1, b2, b3 = by_second[0], by_second[1], by_second[2], by_second[3]
    for label in range(first.size):
        one, other = first[label], second[label]
        out[0, label] += one * a0 + other * b0
        out[1, label] += one * a1 + other * b1
        out[2, label] += one * a2 + other * b2
        out[3, label] += one * a3 + other * b3
