"""What a fit chooses on training captures: how often depths occur, how much to smooth, the readout.

A lens that is focused inside the scene gives two depths the same blur, and bare surfaces have no
blur to see: what then remains is which depths occur, and what lies near. How much each counts is
chosen by cross-validation.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import product
from typing import TYPE_CHECKING, Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.recipe import LEVELS
from dfdbench.methods.fitted import evenly_spread
from dfdbench.methods.method import TrainingPair
from dfdbench.methods.readout import AS_USUAL, Chosen

if TYPE_CHECKING:
    from dfdbench.methods.view_change import ViewChange

#: What is tried: weights of the prior and factors on the smoothing, until they do not help; how
#: sharp a posterior is.
WEIGHTS = (0.0, 0.0625, 0.25, 1.0, 4.0, 16.0, 64.0)
SMOOTHINGS = (1, 4, 13)
SHARPNESSES = (0.25, 1.0, 4.0)
#: Where no groups are known, consecutive captures are taken for alike: so many parts of them.
FOLDS = 4
#: Fewer training captures choose nothing.
FEWEST = 4
# Captures that are solved, evenly among all, and the side of the part of each.
_LOOKED_AT, _SIDE = 16, 256
# Every so many parts tell whether the others are worth a look.
_FIRST = 3
# Levels that a histogram is smoothed by, and the share that is spread over all.
_SMOOTH, _ANYWHERE = 6.0, 1e-3
# So many weights in a row that do not help end the search.
_ENOUGH = 2
# Less is taken for chance, and all left as usual; so it is where the error is but a level.
_BETTER, _LEVEL = 0.95, 1.0

Array = NDArray[Any]


class Part(NamedTuple):
    """Part of a training pair: images of uint8, (y, x, channel); levels and known, (y, x)."""

    infocus: NDArray[np.uint8]
    defocus: NDArray[np.uint8]
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


def choose(
    solve: Callable[[Part, Chosen], Array],
    captures: Sequence[TrainingPair],
    prior: bool,
    smooth: bool,
    readouts: bool = True,
    change: ViewChange | None = None,
) -> Chosen:
    """Choose the prior's weight, smoothing and readout by cross-validation over training pairs.

    Parts of some captures are solved with the histogram of the other groups' captures. First
    weight and smoothing are taken, then the readout, that have the least root mean square error,
    the mean over parts; all only if that is by a twentieth below the error as usual.

    Parameters
    ----------
    solve : callable
        ``solve(part, chosen)`` gives levels, shape (y, x).
    captures : sequence of TrainingPair
        Of fewer than `FEWEST`, or of one ``group``, nothing is chosen.
    prior : bool
        Whether a prior is tried.
    smooth : bool
        Whether more smoothing than usual is tried.
    readouts : bool, optional
        Whether the method has a volume of costs, from which a median can be read.
    change : ViewChange, optional
        Of the defocus image: undone before parts are cut out.
    """
    count = len(captures)
    if count < FEWEST:
        return AS_USUAL
    read = evenly_spread(count)
    counted = [captures[index] for index in read]
    shares = depth_shares(counted)
    groups = np.array([str(getattr(capture, "group", "")) for capture in counted])
    if not all(groups):
        groups = np.array([str(index * FOLDS // count) for index in read])
    if len(set(groups)) == 1:
        return AS_USUAL
    search = _Search(
        solve,
        [
            (_part(counted[place], turn, change), energy_of(shares[groups != groups[place]]))
            for turn, place in enumerate(evenly_spread(len(counted), _LOOKED_AT))
        ],
    )
    if search.error(AS_USUAL) < _LEVEL:
        return AS_USUAL
    weights = WEIGHTS if prior else (0.0,)
    for smoothing in SMOOTHINGS if smooth else (1,):
        if not search.takes_one_of(weights, smoothing) and smoothing > 1:
            break
    if readouts and (least := search.best.weight):
        for weight, sharpness in product((least, 4 * least), SHARPNESSES):
            search.takes(replace(search.best, weight=weight, sharpness=sharpness))
    best = search.best
    if search.error(best) >= _BETTER * search.error(AS_USUAL):
        return AS_USUAL
    return replace(best, energy=best.weight * energy_of(shares))


class _Search:
    """The best choice so far, and what was tried on parts, each with the energy of the others."""

    def __init__(
        self, solve: Callable[[Part, Chosen], Array], parts: Sequence[tuple[Part, Array]]
    ) -> None:
        self.best = AS_USUAL
        self._solve, self._parts = solve, parts
        self._errors: dict[tuple[float, float, int, int], float] = {}

    def takes_one_of(self, weights: Sequence[float], smoothing: int) -> bool:
        """Try rising weights of the prior until they do not help; return whether one is taken."""
        taken, worse, least = False, 0, np.inf
        for weight in weights:
            choice = replace(self.best, weight=weight, smoothing=smoothing)
            taken |= self.takes(choice)
            error = self.error(choice, _FIRST)
            worse = 0 if error < least else worse + 1
            least = min(error, least)
            if worse == _ENOUGH:
                break
        return taken

    def takes(self, choice: Chosen) -> bool:
        """Make a choice the best one, if the error is less on few parts and then on all."""
        if any(self.error(choice, step) >= self.error(self.best, step) for step in (_FIRST, 1)):
            return False
        self.best = choice
        return True

    def error(self, choice: Chosen, step: int = 1) -> float:
        """Return the root mean square error, the mean over every so many parts."""
        places = range(0, len(self._parts), step)
        return float(np.mean([self._error(choice, place) for place in places]))

    def _error(self, choice: Chosen, place: int) -> float:
        key = (choice.weight, choice.sharpness, choice.smoothing, place)
        if key not in self._errors:
            part, energy = self._parts[place]
            answer = self._solve(part, replace(choice, energy=choice.weight * energy))
            off = (np.asarray(answer, np.float64) - part.levels)[part.valid]
            self._errors[key] = float(np.sqrt(np.square(off).mean())) if off.size else 0.0
        return self._errors[key]


def _part(capture: TrainingPair, turn: int, change: ViewChange | None) -> Part:
    # Of a large image one part, another of each capture: left, middle, right, and so on.
    region = rows, columns = tuple(
        slice(start := (size - min(size, _SIDE)) * (place % 3) // 2, start + _SIDE)
        for size, place in zip(capture.levels.shape, (turn // 3, turn), strict=True)
    )
    defocus = capture.defocus
    if change and change.changes:
        defocus = np.rint(change.undone(defocus)).astype(np.uint8)
    known = capture.levels[region], capture.valid[region]
    return Part(capture.infocus[rows, columns], defocus[rows, columns], *known)
