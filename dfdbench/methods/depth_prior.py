"""How often training shows each depth, as a cost, and how an answer is read from a cost volume.

A lens that is focused inside the scene gives two depths the same blur, and bare surfaces have no
blur to see: what then remains is which depths occur. How much that counts is chosen on training
captures, by cross-validation.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.recipe import LEVELS
from dfdbench.methods.fitted import NO_PRIOR, DepthPrior, evenly_spread
from dfdbench.methods.method import TrainingPair
from dfdbench.methods.stacks import sharp_and_blurred
from dfdbench.methods.view_change import ViewChange

#: What is tried: weights of the prior, until they do not help; how sharp a posterior is.
WEIGHTS = (0.25, 1.0, 4.0, 16.0, 64.0)
SHARPNESSES = (1.0, 4.0, 16.0)
#: Consecutive captures are alike, so that they are left out together.
FOLDS = 4
# Captures that are solved, evenly among all, and the side of the part of each.
_LOOKED_AT, _SIDE = 8, 256
# Levels that a histogram is smoothed by, and the share that is spread over all.
_SMOOTH, _ANYWHERE = 6.0, 1e-3
# So many weights in a row that do not help end the search.
_ENOUGH = 2
# Less is taken for chance, and the prior left off.
_BETTER = 0.95

Array = NDArray[Any]


class Part(NamedTuple):
    """Part of a training capture: images of uint8, (y, x, channel); levels and known, (y, x)."""

    infocus: NDArray[np.uint8]
    images: Sequence[NDArray[np.uint8]]
    levels: NDArray[np.uint8]
    valid: NDArray[np.bool_]


def depth_shares(captures: Sequence[TrainingPair]) -> NDArray[np.float64]:
    """Return how often each capture shows each level: shares, shape (capture, level)."""
    shares = np.zeros((len(captures), LEVELS))
    for share, capture in zip(shares, captures, strict=True):
        share[:] = np.bincount(capture.levels[capture.valid], minlength=LEVELS)
    return np.asarray(shares / np.maximum(shares.sum(axis=1, keepdims=True), 1))


def energy_of(shares: Array) -> NDArray[np.float64]:
    """Return what each level costs by how often it is shown: nats, the most frequent one 0."""
    mean = shares.mean(axis=0, keepdims=True)
    smooth = cv2.GaussianBlur(mean, (0, 0), _SMOOTH, borderType=cv2.BORDER_REFLECT)[0]
    known = (1 - _ANYWHERE) * smooth / max(smooth.sum(), 1e-12) + _ANYWHERE / LEVELS
    return np.asarray(np.log(known.max() / known))


def choose_prior(
    solve: Callable[[Part, DepthPrior], Array],
    captures: Sequence[TrainingPair],
    readouts: bool,
    changes: Sequence[ViewChange] = (),
) -> DepthPrior:
    """Choose weight and readout by cross-validation over training captures.

    Parts of some captures are solved with the histogram of those that are not near them; what has
    the least root mean square error is taken, if that is by a twentieth below the error without
    a prior.

    Parameters
    ----------
    solve : callable
        ``solve(part, prior)`` gives levels, shape (y, x).
    captures : sequence of TrainingPair
        Consecutive ones may be of one scene.
    readouts : bool
        Whether the method has a volume of costs, from which a median can be read.
    changes : sequence of ViewChange, optional
        Of each defocus image: undone before parts are cut out.
    """
    count = len(captures)
    read = evenly_spread(count)
    shares = depth_shares([captures[index] for index in read])
    fold = np.array(read) * FOLDS // count
    looked = [
        (_part(captures[index], turn, changes), shares[fold != index * FOLDS // count])
        for turn, index in enumerate(evenly_spread(count, _LOOKED_AT))
    ]
    tried = [(part, energy_of(others)) for part, others in looked if len(others)]
    if not tried:
        return NO_PRIOR

    def error(weight: float, sharpness: float = 0.0) -> float:
        found = []
        for part, energy in tried:
            answer = solve(part, DepthPrior(weight * energy, sharpness, weight))
            off = (np.asarray(answer, np.float64) - part.levels)[part.valid]
            found.append(np.sqrt(np.square(off).mean()) if off.size else 0.0)
        return float(np.mean(found))

    without = least = error(0.0)
    best = (0.0, 0.0)
    worse = 0
    for weight in WEIGHTS:
        if (found := error(weight)) < least:
            least, best, worse = found, (weight, 0.0), 0
        else:
            worse += 1
        if worse == _ENOUGH:
            break
    if not best[0]:
        return NO_PRIOR
    if readouts:
        for weight in (best[0], 4 * best[0]):
            for sharpness in SHARPNESSES:
                if (found := error(weight, sharpness)) < least:
                    least, best = found, (weight, sharpness)
    if least > _BETTER * without:
        return NO_PRIOR
    return DepthPrior(best[0] * energy_of(shares), best[1], best[0])


def _part(capture: TrainingPair, turn: int, changes: Sequence[ViewChange]) -> Part:
    # Of a large image one part, another of each capture: left, middle, right, and so on.
    region = rows, columns = tuple(
        slice(start := (size - min(size, _SIDE)) * (place % 3) // 2, start + _SIDE)
        for size, place in zip(capture.levels.shape, (turn // 3, turn), strict=True)
    )
    known = capture.levels[region], capture.valid[region]
    if any(change.changes for change in changes):
        whole, images = _images(capture, slice(None), slice(None))
        undone = [c.undone(image)[region] for c, image in zip(changes, images, strict=True)]
        return Part(whole[region], [np.rint(image).astype(np.uint8) for image in undone], *known)
    return Part(*_images(capture, rows, columns), *known)


def _images(capture: TrainingPair, rows: slice, columns: slice) -> tuple[Array, list[Array]]:
    if capture.is_pair:
        return capture.infocus[rows, columns], [capture.defocus[rows, columns]]
    return sharp_and_blurred(capture.stack[:, rows, columns])
