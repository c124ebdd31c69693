"""Find where surfaces end in a focal stack: which of two surfaces a pixel at a jump belongs to.

A law says how a surface blurs, but not that a near surface out of focus occludes what is behind it.
So next to a near surface the far one explains its own images badly, and the near one grows.
"""

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.law import BlurLaw
from dfdbench.blur.occlusion import GAP, without_tails
from dfdbench.blur.recipe import LAST_LEVEL
from dfdbench.methods.alignment import Array, light_of, noise_of
from dfdbench.methods.blurred import aligned
from dfdbench.system.compiled import compiled

#: For one or more images: their target, its noise, the kernels by level, and the kernels' reach.
Views = tuple[Array, Array, Array, Array]

# Chosen on the demo set's training stacks. A misfit counts in full up to about this many nats, and
# logarithmically above, since there may be a third surface.
_NATS = 5.0
# How many images focused nearest to either surface are used; others show too little of where it
# ends.
_NEAREST = 2
# How far around a changed pixel its effect is evaluated.
_REACH = 2
_SWEEPS = 4
# A surface with a smaller visible share is not there.
_TRACE = 1e-6


def settle_rims(
    laws: Sequence[Any],
    infocus: NDArray[np.uint8],
    images: Sequence[NDArray[np.uint8]],
    levels: NDArray[np.float32],
    *,
    farther_is_higher: bool = False,
) -> NDArray[np.float32]:
    """Return a depth map whose surfaces end where the images of a stack show it.

    A pixel beside a jump in depth takes the level of the neighbour across the jump if that explains
    the images around it better. As in `dfdbench.blur.occlusion.composite_layers`, the near surface
    covers the far one, which continues behind it. The map is scanned forwards and backwards until
    nothing changes, four times at most.

    Parameters
    ----------
    laws : sequence of BlurLaw
        How each defocus image was made.
    infocus : ndarray of uint8, shape (y, x, channel) or (y, x)
        The image that they are blurred from.
    images : sequence of ndarray of uint8, of that shape
        The defocus images.
    levels : ndarray of float32, shape (y, x)
        The depth map so far.
    farther_is_higher : bool
        Whether the lower of two levels occludes the other, instead of the higher.

    Examples
    --------
    >>> law = BlurLaw(sigmas=(0.1,) * 256, kernel_size=3, noise=(1.0,))
    >>> flat = np.full((4, 6), 90, np.uint8)
    >>> settle_rims([law], flat, [flat], np.full((4, 6), 7.5, np.float32))[0, :3].tolist()
    [7.5, 7.5, 7.5]
    """
    light = light_of(np.atleast_3d(infocus), laws[0].linear)
    # Filled one by one, as they are large.
    aims = np.empty((len(images), *light.shape), np.float32)
    noise = np.empty_like(aims)
    for place, (law, image) in enumerate(zip(laws, images, strict=True)):
        aims[place] = aligned(law, light, np.atleast_3d(image))
        noise[place] = noise_of(law, aims[place]) * math.sqrt(1 + law.infocus_noise**2)
    kernels = np.stack([_quadrants(law) for law in laws])
    reach = (kernels[:, :, 0] > 0).sum(2) - 1
    order = np.argsort(np.argsort([law.sigmas for law in laws], axis=0, kind="stable"), axis=0)
    whole = np.rint(levels).astype(np.int64)
    if farther_is_higher:
        kernels, reach, order = (
            np.ascontiguousarray(each[:, ::-1]) for each in (kernels, reach, order)
        )
        whole = LAST_LEVEL - whole
    settled = whole.copy()
    views = (aims, noise, kernels, reach)
    for turn in range(_SWEEPS):
        if not _sweep(settled, light, views, order < _NEAREST, turn % 2 == 1):
            break
    ends = LAST_LEVEL - settled if farther_is_higher else settled
    return np.where(settled == whole, levels, ends).astype(np.float32)


@lru_cache(maxsize=32)
def _quadrants(law: BlurLaw) -> NDArray[np.float32]:
    middle = law.kernel_size // 2
    return without_tails(law.kernels())[:, middle:, middle:].astype(np.float32)


@compiled(fastmath={"contract"})
def _sweep(levels: Array, light: Array, views: Views, focused: Array, backwards: bool) -> int:
    aims, noise, kernels, reach = views
    height, width = levels.shape
    changed = 0
    for row in range(height):
        y = height - 1 - row if backwards else row
        for column in range(width):
            x = width - 1 - column if backwards else column
            most, best = 0.0, levels[y, x]
            for down, right in ((0, 1), (0, -1), (1, 0), (-1, 0)):
                j, i = y + down, x + right
                if not (0 <= j < height and 0 <= i < width):
                    continue
                other = levels[j, i]
                if abs(other - levels[y, x]) <= GAP or other == best:
                    continue
                near, far = max(other, levels[y, x]), min(other, levels[y, x])
                gain = 0.0
                for image in range(len(aims)):
                    if focused[image, near] or focused[image, far]:
                        view = aims[image], noise[image], kernels[image], reach[image]
                        gain += _far_over_near((y, x, near, far), levels, light, view)
                if other == near:
                    gain = -gain
                if gain > most:
                    most, best = gain, other
            if best != levels[y, x]:
                levels[y, x] = best
                changed += 1
    return changed


@compiled(fastmath={"contract"})
def _far_over_near(
    pixel: tuple[int, int, int, int], levels: Array, light: Array, view: Views
) -> float:
    """Return how many nats better a far pixel explains an image than a near pixel does."""
    (y, x, near, far), (aim, noise, kernels, reach) = pixel, view
    height, width, channels = light.shape
    split = (near + far) // 2
    # The colours and the share seen of the far and the near surface, without the pixel itself.
    sums = np.empty((2, channels + 1), np.float64)
    radius = max(reach[near], reach[far])
    about = min(radius, _REACH)
    total = 0.0
    for v in range(max(0, y - about), min(height, y + about + 1)):
        for u in range(max(0, x - about), min(width, x + about + 1)):
            sums[:] = 0.0
            for down in range(-radius, radius + 1):
                j = min(max(v + down, 0), height - 1)
                for right in range(-radius, radius + 1):
                    i = min(max(u + right, 0), width - 1)
                    level = levels[j, i]
                    weight = kernels[level, abs(down), abs(right)]
                    if weight == 0.0 or (j == y and i == x):
                        continue
                    side = 1 if level > split else 0
                    for channel in range(channels):
                        sums[side, channel] += weight * light[j, i, channel]
                    sums[side, channels] += weight
            down, right = abs(v - y), abs(u - x)
            nats = (
                _misfit(sums, 1, kernels[near, down, right], light[y, x], aim[v, u], noise[v, u]),
                _misfit(sums, 0, kernels[far, down, right], light[y, x], aim[v, u], noise[v, u]),
            )
            total += _NATS * (math.log1p(nats[0] / _NATS) - math.log1p(nats[1] / _NATS))
    return total


@compiled(fastmath={"contract"})
def _misfit(
    sums: Array, side: int, weight: float, colour: Array, aim: Array, noise: Array
) -> float:
    """Return how badly two surfaces explain a pixel, in nats, if one of them gets another pixel."""
    channels = len(colour)
    far = sums[0, channels] + (weight if side == 0 else 0.0)
    near = sums[1, channels] + (weight if side == 1 else 0.0)
    # If no far surface reaches the pixel, the near one covers all of it.
    share = min(near, 1.0) if far > _TRACE else 1.0
    square = 0.0
    for channel in range(channels):
        more = weight * colour[channel]
        seen = 0.0
        if near > _TRACE:
            seen += share * (sums[1, channel] + (more if side == 1 else 0.0)) / near
        if far > _TRACE:
            seen += (1.0 - share) * (sums[0, channel] + (more if side == 0 else 0.0)) / far
        square += ((aim[channel] - seen) / noise[channel]) ** 2
    return square / 2
