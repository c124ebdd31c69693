"""Shape from focus: the depth whose image shows a pixel sharpest, from a stack of images."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.recipe import LAST_LEVEL
from dfdbench.errors import MethodError, unknown_name
from dfdbench.methods.fitted import number_within, odd_window
from dfdbench.system.compiled import compiled

if TYPE_CHECKING:
    from xarray import DataArray

_NAME = "shape-from-focus"
# Side in pixels of the cells in which a measure is averaged, and the filter works: a sixteenth of
# the numbers. Among 1, 2, 3 and 4 this had the least error on stacks made of Middlebury's training
# scenes; a measure of single pixels is noise.
_CELL = 4
# Rows that are measured at once: what is between an image and its cells stays in the cache.
_BAND = 64
# Grey levels that a measure is no less than, so that black has a logarithm.
_LEAST = np.float32(1e-2)
PEAKS = ("defocus", "gaussian", "none")
# How fast contrast may fall with blur: to the power -p / 2 of what it adds to the blur's square.
# One over the p-th power of contrast is a parabola then; of disks p is 2 or 3, of Gaussians 1.
_POWERS = (0.5, 0.7, 1.0, 1.4, 2.0, 2.8)
_USUAL_POWER = 2.0
# Cells that it is measured from.
_CELLS = 1024
# Below the logarithm of any contrast.
_NONE = np.float32(-1e30)

Array = NDArray[Any]
Floats = NDArray[np.float32]


def _modified_laplacian(grey: Floats) -> Floats:
    bend, one = np.array([-1, 2, -1], np.float32), np.ones(1, np.float32)
    across, down = (cv2.sepFilter2D(grey, cv2.CV_32F, *w) for w in ((bend, one), (one, bend)))
    return np.asarray(np.abs(across) + np.abs(down))


def _tenengrad(grey: Floats) -> Floats:
    across, down = (cv2.Sobel(grey, cv2.CV_32F, *way) for way in ((1, 0), (0, 1)))
    return np.asarray(across * across + down * down)


def _variance(grey: Floats) -> Floats:
    mean = cv2.boxFilter(grey, cv2.CV_32F, (3, 3))
    return np.maximum(cv2.sqrBoxFilter(grey, cv2.CV_32F, (3, 3)) - mean * mean, 0)


def _ring_kernel() -> Floats:
    """Return the mean of a disk less that of a ring around it, a gap between them: (5, 5)."""
    squares = np.add.outer(np.arange(-2, 3) ** 2, np.arange(-2, 3) ** 2)
    disk, ring = squares <= 1, (squares > 2) & (squares <= 4)
    return np.asarray(disk / disk.sum() - ring / ring.sum(), np.float32)


_RING = _ring_kernel()


def _ring_difference(grey: Floats) -> Floats:
    return np.asarray(np.abs(cv2.filter2D(grey, cv2.CV_32F, _RING)))


#: The focus measures, and of which power of a texture's contrast each is.
MEASURES: Mapping[str, tuple[Callable[[Floats], Floats], int]] = {
    "ring": (_ring_difference, 1),
    "sml": (_modified_laplacian, 1),
    "tenengrad": (_tenengrad, 2),
    "variance": (_variance, 2),
}


def focus_cells(image: Array, measure: str = "ring") -> Floats:
    """Return the logarithm of a focus measure, averaged in cells of 4 x 4 pixels.

    Parameters
    ----------
    image : ndarray of uint8 or uint16, shape (y, x, channel)
        Of 1 or 3 channels.
    measure : str
        One of `MEASURES`.

    Returns
    -------
    ndarray of float32, shape (ceil(y / 4), ceil(x / 4))
        Of the contrast, whatever power of it the measure is.

    Examples
    --------
    >>> focus_cells(np.zeros((6, 9, 1), np.uint8)).shape
    (2, 3)
    """
    function, power = MEASURES[measure]
    bands = []
    for top in range(0, len(image), _BAND):
        # One row of cells more on either side than is kept: measures reach two pixels far.
        before = _CELL * bool(top)
        band = image[top - before : top + _BAND + _CELL]
        cells = _cells(function(grey_of_image(band)))
        bands.append(cells[bool(top) :][: _BAND // _CELL])
    return np.asarray(np.log(np.vstack(bands) + _LEAST**power) / power, np.float32)


def _cells(image: Floats) -> Floats:
    down, right = (-side % _CELL for side in image.shape)
    if down or right:
        edge = cv2.BORDER_REPLICATE
        image = np.asarray(cv2.copyMakeBorder(image, 0, down, 0, right, borderType=edge))
    size = image.shape[1] // _CELL, image.shape[0] // _CELL
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.float32)


def grey_of_image(image: Array) -> Floats:
    """Return an image of uint8 or uint16, of 1 or 3 channels, as grey levels 0 to 255: (y, x)."""
    grey = image[..., 0] if image.shape[2] == 1 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    # From float32 OpenCV filters faster than from bytes.
    scale = LAST_LEVEL / np.iinfo(image.dtype).max
    return np.asarray(grey if scale == 1 else grey * np.float32(scale), np.float32)


def sharpest_image(focus: Floats) -> NDArray[np.intp]:
    """Return which image is sharpest around each cell, from their `focus_cells`: (y, x)."""
    around = [cv2.blur(cells, (3, 3), borderType=cv2.BORDER_REPLICATE) for cells in focus]
    return np.asarray(np.argmax(around, axis=0))


def power_of_blur(focus: Floats, places: NDArray[np.float64]) -> float:
    """Return the power p for which one over contrast to the p is a parabola over focus.

    Of cells that differ much between the images, the parabola through the sharpest image and its
    neighbours tells the contrast of the next image; of a few powers that one is taken which is
    wrong to neither side. With three images there is no next one, and it is 2.

    Parameters
    ----------
    focus : ndarray of float32, shape (image, y, x)
        From `focus_cells`.
    places : ndarray of float64, shape (image,)
        Where each image's focus lies, rising.
    """
    count = len(places)
    values = np.stack([cv2.blur(cells, (3, 3)).ravel() for cells in focus])
    values = values[:, :: -(-values.shape[1] // _CELLS)].astype(np.float64)
    best = values.argmax(axis=0)
    contrast = np.ptp(values, axis=0)
    tells = (contrast >= np.median(contrast)) & (best > 0) & (best < count - 1)
    values, best = values[:, tells], best[tells]

    def at(step: int) -> tuple[Array, Array]:
        index = np.clip(best + step, 0, count - 1)
        return places[index], values[best, np.arange(best.size)] - values[
            index, np.arange(best.size)
        ]

    (middle, _), (before, lower), (after, upper) = at(0), at(-1), at(1)
    wrong = np.full(len(_POWERS), np.inf)
    for number, power in enumerate(_POWERS):
        rise = -np.expm1(power * lower) / (middle - before)
        bend = (np.expm1(power * upper) / (after - middle) - rise) / (after - before)
        off = []
        for step in (-2, 2):
            there, value = at(step)
            inside = (best + step >= 0) & (best + step < count)
            parabola = (there - middle) * (rise + bend * (there - before))
            off.append((np.log1p(np.maximum(parabola, 0)) / power - value)[inside])
        if sum(map(len, off)):
            wrong[number] = abs(np.median(np.concatenate(off)))
    return _POWERS[int(wrong.argmin())] if np.isfinite(wrong).any() else _USUAL_POWER


class ShapeFromFocus:
    """Depth by the image in which a pixel's surroundings are sharpest; nothing is fitted.

    Each image has a focus measure at every pixel, the mean in cells of 4 x 4 pixels. Its logarithm
    is smoothed by a guided filter over the cells, the guide being the stack's sharpest pixels, so
    that depth ends where surfaces end. A pixel takes the focus distance of the image of the
    largest value, moved by a curve through that and its two neighbours.

    Images with the role ``infocus`` are left out. The others need a `focus_depth`, three
    different ones or more, in any order and at any distances from each other.

    Parameters
    ----------
    measure : {"ring", "sml", "tenengrad", "variance"}
        Ring difference (a disk's mean less that of a ring around it, absolute), sum-modified
        Laplacian, squared Sobel gradient, variance in 3 x 3 pixels.
    window : int
        Side in pixels of the guided filter's window, odd; below 9 there is none. Larger windows
        carry depth farther into areas without texture, and blur it more.
    flatness : float
        Variance in squared grey levels of the guide below which a window is but averaged.
    peak : {"defocus", "gaussian", "none"}
        The curve between focus distances. ``defocus``: a texture's contrast falls as the blur
        grows with distance from the focus, so that one over its square is a parabola.
        ``gaussian``, as in the paper, pulls depths towards the focus distances. ``none``: whole.

    Raises
    ------
    MethodError
        For a parameter out of range, all of them named; at a call with fewer than three focus
        depths, an unknown one, or the same one twice.

    Notes
    -----
    Nayar and Nakagawa 1994; the ring difference, and that costs are smoothed along the edges of an
    image: Surh et al. 2017. The defaults are those of least error on stacks made, by a disk's blur
    and with occlusion, of six of Middlebury's training scenes.

    It breaks where there is no texture within a window's reach; where a near edge, out of focus,
    covers what lies behind; and where an edge is so strong that its blur is the sharpest thing
    around in every image. It answers no depth beyond the nearest and farthest focus.

    Examples
    --------
    >>> from xarray import DataArray
    >>> random = np.random.default_rng(0)
    >>> texture = random.integers(0, 256, (64, 64, 3)).astype(np.uint8)
    >>> focus = np.array([50.0, 90.0, 130.0, 170.0, 210.0])
    >>> images = [cv2.GaussianBlur(texture, (0, 0), 0.1 + abs(z - 140) / 40) for z in focus]
    >>> stack = DataArray(
    ...     np.stack(images),
    ...     dims=("image", "y", "x", "channel"),
    ...     coords={"role": ("image", ["defocus"] * 5), "focus_depth": ("image", focus)},
    ...     attrs={"unit": "levels", "near": 255.0, "far": 0.0},
    ... )
    >>> bool(abs(np.median(ShapeFromFocus()(stack)) - 140) < 6)
    True
    """

    paper = (
        "Nayar and Nakagawa, Shape from focus, PAMI 1994; Surh et al., Noise robust depth from "
        "focus using a ring difference filter, CVPR 2017"
    )
    #: It answers in the stack's own unit.
    unit = "stack"
    #: A set of pairs is refused before a run.
    needs_stack = True

    #: What `dfdbench.tune` tries.
    ranges: ClassVar[dict[str, Sequence[Any]]] = {
        "measure": tuple(MEASURES),
        "window": (7, 13, 21, 35),
    }

    def __init__(
        self, measure: str = "ring", window: int = 21, flatness: float = 30.0, peak: str = "defocus"
    ) -> None:
        for kind, name, known in (("measure", measure, tuple(MEASURES)), ("peak", peak, PEAKS)):
            if name not in known:
                raise unknown_name(kind, str(name), known)
        problems = odd_window("window", window)
        problems += number_within("flatness", flatness, 1e6)
        MethodError.raise_if(problems)
        self._measure, self._peak = measure, peak
        self._window = (2 * (window // (2 * _CELL)) + 1,) * 2
        self._flatness = np.float32(flatness)

    def __call__(self, stack: DataArray) -> Floats:
        """Return depth in the stack's unit, float32 of shape (y, x)."""
        places, where = focus_places(stack)
        return depth_at(self._found(stack.values, where, places, self._peak), stack)

    def sharpest(self, images: Array) -> NDArray[np.intp]:
        """Return which of one or more images is sharpest at every pixel: (y, x)."""
        count = len(images)
        if count == 1:
            return np.zeros(images.shape[1:3], np.intp)
        found = self._found(images, list(range(count)), np.arange(float(count)), "none")
        return np.rint(found).astype(np.intp)

    def _found(self, images: Array, where: list[int], places: Array, peak: str) -> Floats:
        # Nothing is kept of an image but its cells, a sixteenth of its pixels.
        focus = np.stack([focus_cells(images[index], self._measure) for index in where])
        sharp = np.empty(images.shape[1:], images.dtype)
        _take(images, np.array(where)[sharpest_image(focus)], sharp)
        guide = grey_of_image(sharp)
        lines = self._smoothed(focus, _cells(guide))
        power = power_of_blur(focus, places) if peak == "defocus" else 0.0
        found = np.empty_like(guide)
        _peaks(*lines, guide, places, power, peak != "none", found)
        return found

    def _smoothed(self, focus: Floats, guide: Floats) -> Floats:
        """Return a guided filter's lines: slopes and starts, (image, row of cells, x)."""
        rows, columns = guide.shape
        lines = np.empty((2, len(focus), rows, _CELL * columns), np.float32)
        size = lines.shape[:1:-1]
        for index, parts in enumerate(guided_lines(guide, focus, self._window, self._flatness)):
            for line, part in zip(lines, parts, strict=True):
                cv2.resize(part, size, line[index])
        return lines


def guided_lines(
    guide: Floats, planes: Iterable[Floats], window: tuple[int, int], flatness: np.float32
) -> Iterator[tuple[Floats, Floats]]:
    """Yield of each plane the slopes and starts of a guided filter's lines over the guide's values.

    He, Sun and Tang, Guided image filtering, PAMI 2013, with a grey guide, by box filters.

    Parameters
    ----------
    guide : ndarray of float32, shape (y, x)
        What has the edges.
    planes : iterable of ndarray of float32, of that shape
        What is to be smoothed.
    window : tuple of int
        Columns and rows.
    flatness : float32
        Variance of the guide below which a window is but averaged; epsilon of the paper.
    """

    def box(image: Array) -> Floats:
        return np.asarray(cv2.blur(image, window, borderType=cv2.BORDER_REPLICATE))

    mean = box(guide)
    spread = box(guide * guide) - mean * mean + flatness
    for plane in planes:
        average = box(plane)
        slope = (box(guide * plane) - mean * average) / spread
        yield box(slope), box(average - slope * mean)


#: What to do where there are only pairs.
STACKS = "dfdbench build demo@stack-9 makes stacks, as of any set with synthetic blur"


def focus_places(stack: DataArray, name: str = _NAME) -> tuple[NDArray[np.float64], list[int]]:
    """Return where the focus lies, rising, on a scale that blur grows along; and which images.

    Blur grows with the difference of inverse distances. Levels are inverse distances.

    Raises
    ------
    MethodError
        Where a distance is not known or twice the same, or there are fewer than three; it begins
        with the method's name.
    """
    roles = stack["role"].values.tolist()
    used = [index for index, role in enumerate(roles) if role != "infocus"]
    depths = np.asarray(stack["focus_depth"].values, np.float64)[used]
    unknown = [index for index, depth in zip(used, depths, strict=True) if np.isnan(depth)]
    if unknown and len(roles) == 2:
        raise MethodError(f"{name} needs a focal stack, and this is a pair", fix=STACKS)
    if unknown:
        what = f"images {unknown} of {len(roles)} have no known focus depth"
        fix = "say in the manifest at what distance each image was focused"
        raise MethodError(what, where=f"{name}: focus_depth", fix=fix)
    different, counts = np.unique(depths, return_counts=True)
    if (counts > 1).any():
        what = f"images of one stack have the same focus depth: {different[counts > 1].tolist()}"
        fix = "leave all but one of them out"
        raise MethodError(what, where=f"{name}: focus_depth", fix=fix)
    if len(used) < 3:
        what = "too few images with a focus depth"
        raise MethodError(what, where=name, expected="3 or more", got=str(len(used)))
    if stack.attrs["unit"] == "metres":
        if depths.min() <= 0:
            what = f"a focus depth of {depths.min():g} metres; distances are above 0"
            raise MethodError(what, where=f"{name}: focus_depth")
        depths = 1 / depths
    order = np.argsort(depths)
    return depths[order], [used[index] for index in order]


def depth_at(found: Floats, stack: DataArray) -> Floats:
    """Return places as depth in a stack's unit, none beyond the ends of its set."""
    places: Array = found
    if stack.attrs["unit"] == "metres":
        # Beyond infinity nothing is farther.
        with np.errstate(divide="ignore"):
            places = 1 / np.maximum(places, 0)
    ends = sorted((stack.attrs["near"], stack.attrs["far"]))
    return np.asarray(np.clip(places, *ends), np.float32)


@compiled()
def _take(images: Array, which: Array, out: Array) -> None:
    height, width, channels = out.shape
    for y in range(height):
        for x in range(width):
            image = which[y // _CELL, x // _CELL]
            for channel in range(channels):
                out[y, x, channel] = images[image, y, x, channel]


# Long, as one loop nest is: what it would hand on to shorter ones are arrays by the dozen.
@compiled(fastmath=True)
def _peaks(
    slopes: Array,
    starts: Array,
    guide: Array,
    places: Array,
    power: float,
    curved: bool,
    out: Array,
) -> None:
    """Write each pixel's place of the peak; without a power, of the logarithm."""
    height, width = guide.shape
    count, rows = slopes.shape[:2]
    values = np.empty((count, width), np.float32)
    largest = np.empty(width, np.float32)
    # As float32 it stays in the same registers as the values.
    which = np.zeros(width, np.float32)
    curve = np.empty((2, width), np.float32)
    factor = np.float32(power / 1024)
    # No peak is farther than halfway to the next image, which is less sharp.
    bounds = np.empty(count + 1)
    bounds[0], bounds[count] = places[0], places[count - 1]
    for index in range(1, count):
        bounds[index] = (places[index - 1] + places[index]) / 2
    for y in range(height):
        down = min(max((y + 0.5) / _CELL - 0.5, 0.0), rows - 1.0)
        above = min(int(down), max(rows - 2, 0))
        below = min(above + 1, rows - 1)
        part = np.float32(down - above)
        grey = guide[y]
        largest[:] = _NONE
        for index in range(count):
            slope, next_slope = slopes[index, above], slopes[index, below]
            start, next_start = starts[index, above], starts[index, below]
            value, number = values[index], np.float32(index)
            for x in range(width):
                upper = slope[x] * grey[x] + start[x]
                lower = next_slope[x] * grey[x] + next_start[x]
                value[x] = upper + part * (lower - upper)
            for x in range(width):
                if value[x] > largest[x]:
                    which[x], largest[x] = number, value[x]
        for x in range(width if curved else 0):
            middle = min(max(int(which[x]), 1), count - 2)
            curve[0, x] = values[middle, x] - values[middle - 1, x]
            curve[1, x] = values[middle, x] - values[middle + 1, x]
        if power > 0:
            for side in range(2):
                for x in range(width):
                    # The exponential, as (1 + x / 1024)^1024: at once for many pixels.
                    grown = 1 + factor * curve[side, x]
                    for _ in range(10):
                        grown *= grown
                    curve[side, x] = grown - 1
        for x in range(width):
            best = int(which[x])
            if not curved:
                out[y, x] = places[best]
                continue
            middle = min(max(best, 1), count - 2)
            # The least of the parabola through three points, as Newton's differences give it.
            rise = -curve[0, x] / (places[middle] - places[middle - 1])
            next_rise = curve[1, x] / (places[middle + 1] - places[middle])
            bend = (next_rise - rise) / (places[middle + 1] - places[middle - 1])
            if not bend > 0:
                out[y, x] = places[best]
            else:
                least = bounds[middle] - rise / (2 * bend)
                out[y, x] = min(max(least, bounds[best]), bounds[best + 1])
