"""Blur as light does where depth jumps: layers, composited from back to front."""

import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.synthesis import reaches, require_kernels
from dfdbench.system.compiled import compiled

#: A kernel ends where it falls below this share of its peak: of a Gaussian at 3.7 sigma, a
#: thousandth of its light.
TAIL = 1e-3
#: Depths further apart than this are different surfaces where they meet; nearer ones are one that
#: slants.
GAP = 8


def without_tails(kernels: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return kernels without the weights below `TAIL` of their peak, again of sum 1.

    Examples
    --------
    >>> row = np.array([1e-4, 0.1, 1, 0.1, 1e-4])
    >>> without_tails(np.outer(row, row)[np.newaxis])[0, 2].round(3).tolist()
    [0.0, 0.069, 0.694, 0.069, 0.0]
    """
    peaks = kernels.max(axis=(1, 2), keepdims=True)
    cut = np.where(kernels < TAIL * peaks, 0, kernels)
    return np.asarray(cut / cut.sum(axis=(1, 2), keepdims=True), dtype=np.float64)


def composite_layers(
    image: NDArray[np.float64], depth: NDArray[np.integer], kernels: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Blur a layer a depth level, and lay surfaces over one another, the nearest last.

    Parameters
    ----------
    image : ndarray of float64, shape (y, x, channel) or (y, x)
        The in-focus image, in any unit; it and the depth go on past the border as at the edge.
    depth : ndarray of int, shape (y, x)
        Which layer each pixel belongs to; the greater, the nearer.
    kernels : ndarray of float64, shape (level, size, size)
        One a depth level, of odd size, symmetric in both axes and their diagonal.

    Returns
    -------
    ndarray of float64
        Of the image's shape, not rounded.

    Raises
    ------
    InputError
        Where shapes do not fit one another, or a depth has no kernel.

    Notes
    -----
    Let m_d be the mask of the pixels at depth d, K_d that depth's kernel and * a convolution. A
    layer covers a_d = K_d * m_d of a pixel and shows the colour c_d = K_d * (m_d I). At each pixel
    the depths with a_d > 0, from the farthest to the nearest, are cut into surfaces S wherever two
    successive ones lie more than `GAP` apart. From the farthest surface to the nearest, with f and
    n the farthest and the nearest depth of S::

        seen   =   sum of a_d over S
        share  =   seen / (seen + K_n * m_{d < f})
        C     <-   (1 - share) C + share (sum of c_d) / seen

    So a share is what is seen of a surface among everything that nearer surfaces leave visible, and
    the farthest surface has share 1: it is taken to go on behind the others. At a straight edge
    both sides weigh 1/2, as in a lens.

    Level by level instead, without surfaces, a slanted plane would cover itself: of the many thin
    layers that reach a pixel the nearer ones would weigh up to e times as much as the farther ones.

    A pixel's light is spread over its neighbours, layer by layer, and each layer is added
    where it reaches: the work grows with the kernels' area, not with the number of levels. The
    order of the sums is fixed, so that the last bit is the same on any machine.

    Examples
    --------
    >>> image, depth = np.zeros((5, 9)), np.zeros((5, 9), int)
    >>> image[:, 4:], depth[:, 4:] = 90, 50  # bright and near, in focus, beside dark and far
    >>> kernels = np.zeros((51, 3, 3))
    >>> kernels[0], kernels[50, 1, 1] = 1 / 9, 1
    >>> composite_layers(image, depth, kernels)[2].round().tolist()
    [0.0, 0.0, 0.0, 0.0, 90.0, 90.0, 90.0, 90.0, 90.0]
    """
    require_kernels(image, depth, kernels)
    channels = image if image.ndim == 3 else image[:, :, np.newaxis]
    reach = reaches(kernels)
    radius, centre = int(reach[np.unique(depth)].max()), kernels.shape[1] // 2
    around = ((radius, radius), (radius, radius))
    window = slice(centre - radius, centre + radius + 1)
    pixels = np.pad(channels, (*around, (0, 0)), mode="edge").reshape(-1, channels.shape[2])
    padded = np.pad(depth, around, mode="edge").astype(np.int16)
    levels = padded.ravel()
    starts = np.searchsorted(np.sort(levels), np.arange(len(kernels) + 1))
    covered = _composite(
        np.ascontiguousarray(pixels, dtype=np.float64),
        padded,
        np.argsort(levels, kind="stable"),
        starts,
        np.ascontiguousarray(kernels[:, centre:, centre:], dtype=np.float64),
        np.ascontiguousarray(kernels[:, window, window], dtype=np.float64),
        channels.shape[:2],
        radius,
    )
    return np.asarray(covered[..., 1:], dtype=np.float64).reshape(image.shape)


@compiled()
def _composite(
    pixels: NDArray[np.float64],
    depth: NDArray[np.int16],
    order: NDArray[np.int64],
    starts: NDArray[np.int64],
    quadrants: NDArray[np.float64],
    whole: NDArray[np.float64],
    shape: tuple[int, int],
    radius: int,
) -> NDArray[np.float64]:
    # The pixels of a level are order[starts[level]:starts[level + 1]], numbers of pixels of the
    # padded image. What a layer covers and its colours lie side by side, as one more channel.
    height, width = shape
    planes = pixels.shape[1] + 1
    layer = np.zeros((height, width * planes), np.float64)
    surface = np.zeros((height, width * planes), np.float64)
    total = np.zeros((height, width * planes), np.float64)
    # The nearest and the farthest depth of each pixel's surface so far.
    latest = np.zeros((height, width), np.int64)
    begun = np.zeros((height, width), np.int64)
    seen = np.empty(whole.shape[1], np.float64)
    first, last = np.empty(height, np.int64), np.empty(height, np.int64)
    for level in range(quadrants.shape[0]):
        own = order[starts[level] : starts[level + 1]]
        if own.size:
            first[:], last[:] = width, 0
            _spread(pixels, own, quadrants[level], layer, first, last, radius, planes)
            for y in range(height):
                for x in range(first[y], last[y]):
                    if layer[y, x * planes] != 0.0:
                        if surface[y, x * planes] == 0.0:
                            begun[y, x] = level
                        elif level - latest[y, x] > GAP:
                            behind = 0.0
                            if total[y, x * planes] != 0.0:
                                near = latest[y, x]
                                behind = _behind(depth, y, x, begun[y, x], whole[near], seen)
                            _lay_over(surface[y], total[y], x * planes, planes, behind)
                            begun[y, x] = level
                        for i in range(x * planes, (x + 1) * planes):
                            surface[y, i] += layer[y, i]
                            layer[y, i] = 0.0
                        latest[y, x] = level
    for y in range(height):
        for x in range(width):
            behind = 0.0
            if total[y, x * planes] != 0.0:
                behind = _behind(depth, y, x, begun[y, x], whole[latest[y, x]], seen)
            _lay_over(surface[y], total[y], x * planes, planes, behind)
    return total.reshape((height, width, planes))


@compiled()
def _spread(
    pixels: NDArray[np.float64],
    own: NDArray[np.int64],
    quadrant: NDArray[np.float64],
    layer: NDArray[np.float64],
    first: NDArray[np.int64],
    last: NDArray[np.int64],
    radius: int,
    planes: int,
) -> None:
    """Add each pixel's light, and the pixel itself, to the layer; note which columns it reaches."""
    height, width = layer.shape[0], layer.shape[1] // planes
    halves, weights = _rows_of(quadrant, planes)
    reach = halves[0]
    light = np.empty(weights.shape[1], np.float64)
    for number in own:
        y = number // (width + 2 * radius) - radius
        x = number % (width + 2 * radius) - radius
        if x + reach < 0 or x - reach >= width:
            continue
        for i in range(0, (2 * reach + 1) * planes, planes):
            light[i] = 1.0
            for plane in range(1, planes):
                light[i + plane] = pixels[number, plane - 1]
        for row in range(max(0, y - reach), min(height, y + reach + 1)):
            j = abs(row - y)
            left, right = max(0, x - halves[j]), min(width, x + halves[j] + 1)
            if left >= right:
                continue
            first[row], last[row] = min(first[row], left), max(last[row], right)
            begin, count = (left - x + halves[j]) * planes, (right - left) * planes
            target = layer[row, left * planes : right * planes]
            row_weights = weights[j, begin : begin + count]
            for i in range(count):
                target[i] += row_weights[i] * light[i]


@compiled()
def _rows_of(
    quadrant: NDArray[np.float64], planes: int
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return a kernel's rows from its middle on, a weight a plane, and half of each one's width."""
    size = quadrant.shape[0]
    halves = np.zeros(size, np.int64)
    weights = np.empty((size, (2 * size - 1) * planes), np.float64)
    for j in range(size):
        for i in range(size):
            if quadrant[j, i] != 0.0:
                halves[j] = i
        for i in range(2 * halves[j] + 1):
            weights[j, i * planes : (i + 1) * planes] = quadrant[j, abs(i - halves[j])]
    return halves, weights


@compiled()
def _behind(
    depth: NDArray[np.int16],
    y: int,
    x: int,
    level: int,
    kernel: NDArray[np.float64],
    seen: NDArray[np.float64],
) -> float:
    """Return how much of a kernel around a pixel falls on what is farther than a level."""
    # Row by row of the window into one row, which vectorises.
    size = kernel.shape[0]
    seen[:] = 0.0
    for j in range(size):
        weights, row = kernel[j], depth[y + j, x : x + size]
        for i in range(size):
            seen[i] += weights[i] if row[i] < level else 0.0
    total = 0.0
    for i in range(size):
        total += seen[i]
    return total


@compiled()
def _lay_over(
    surface: NDArray[np.float64], total: NDArray[np.float64], begin: int, planes: int, behind: float
) -> None:
    """Put a pixel's surface over what lies behind it, and empty it for the next."""
    own = surface[begin]
    if own != 0.0:
        share = own / (own + behind)
        for i in range(begin, begin + planes):
            total[i] = (1.0 - share) * total[i] + share / own * surface[i]
            surface[i] = 0.0
