"""What a fit chooses on training captures: the weight of the depths' prior, smoothing, the readout.

A lens focused inside the scene gives two depths the same blur, and bare surfaces show no blur. All
that is left then is how often each depth occurs, and the depth of neighbours. Cross-validation
chooses how much each of these counts.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.recipe import LEVELS
from dfdbench.methods.fitted import Array, evenly_spread, part_of
from dfdbench.methods.method import TrainingPair
from dfdbench.methods.readout import AS_USUAL, Chosen
from dfdbench.system.compiled import in_threads

if TYPE_CHECKING:
    from dfdbench.methods.view_change import ViewChange

#: The values to try: weights of the prior and factors of the smoothing, in this order until they
#: stop helping; sharpnesses of a posterior.
WEIGHTS = (0.0, 0.0625, 0.25, 1.0, 4.0, 16.0)
SMOOTHINGS = (1, 4, 13)
SHARPNESSES = (0.25, 1.0, 4.0)
#: The number of folds if no groups are known; consecutive captures then go into the same fold.
FOLDS = 4
#: With fewer training captures, nothing is chosen.
FEWEST = 4
# How many captures to solve, evenly among all, and the side of the part of each.
_LOOKED_AT, _SIDE = 16, 192
# Smoothing with this many times the best error so far, all else unchanged, is not tried further.
_HOPELESS = 1.2
# How many levels a histogram is smoothed over, and the share that is spread over all levels.
_SMOOTH, _ANYWHERE = 6.0, 1e-3
# The search ends after this many weights in a row that do not help.
_ENOUGH = 2
# A gain of a tenth on parts cost `sgm` 0.003 on demo's `law-3`. So a gain below a seventh counts
# as chance and changes nothing, nor does any gain if the error is only a few levels.
_BETTER, _FEW_LEVELS = 0.85, 5.0
# Added to errors, so that an error of 0 has a logarithm: about the error of rounding.
_ROUNDING = 0.5


class Part(NamedTuple):
    """Part of a training pair: images of uint8, (y, x, channel); levels and known, (y, x)."""

    infocus: NDArray[np.uint8]
    defocus: NDArray[np.uint8]
    levels: NDArray[np.uint8]
    valid: NDArray[np.bool_]


def energy_of(shares: Array) -> NDArray[np.float64]:
    """Return each level's cost in nats from how often it occurs; the most frequent costs 0."""
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
    window: int = 0,
) -> Chosen:
    """Choose the prior's weight, smoothing and readout by cross-validation over training pairs.

    Parts of some captures are solved with the histogram of the other groups' captures. The choice
    with the least root mean square error, averaged over parts, is taken: at each smoothing first
    the weight, then the readout. Everything stays as usual unless that error is a seventh below the
    usual one, in the geometric mean as well: two bare walls can outweigh the gain or loss on
    everything else.

    Parameters
    ----------
    solve : callable
        ``solve(part, chosen)`` returns levels, shape (y, x). It is called in several threads.
    captures : sequence of TrainingPair
        If there are fewer than `FEWEST`, or all are of one ``group``, nothing is chosen.
    prior : bool
        Whether to try a prior.
    smooth : bool
        Whether to try more smoothing than usual.
    readouts : bool, optional
        Whether the method has a volume of costs, from which a median can be read.
    change : ViewChange, optional
        The change of the defocus image, which is undone before parts are cut out.
    window : int, optional
        The side of the user's window, which must fit into the parts.
    """
    count = len(captures)
    if count < FEWEST:
        return AS_USUAL
    read = evenly_spread(count)
    looked_at = {place: turn for turn, place in enumerate(evenly_spread(len(read), _LOOKED_AT))}
    shares, named, parts = np.zeros((len(read), LEVELS)), list[str](), dict[int, Part]()
    # One capture at a time, as they may be large.
    for place, index in enumerate(read):
        capture = captures[index]
        shares[place] = shares_of(capture)
        named.append(str(getattr(capture, "group", "")))
        if place in looked_at:
            parts[place] = cut_out(capture, looked_at[place], max(_SIDE, window), change)
    groups = groups_of(named, read, count)
    if len(set(groups)) == 1:
        return AS_USUAL
    search = _Search(
        solve, [(part, energy_of(shares[groups != groups[at]])) for at, part in parts.items()]
    )
    if search.error(AS_USUAL) < _FEW_LEVELS:
        return AS_USUAL
    best, weights = AS_USUAL, WEIGHTS if prior else (0.0,)
    for smoothing in SMOOTHINGS if smooth else (1,):
        if search.error(replace(best, smoothing=smoothing)) > _HOPELESS * search.error(best):
            continue
        here = search.best([replace(AS_USUAL, smoothing=smoothing, weight=w) for w in weights])
        if readouts and here.weight:
            sharper = [replace(here, sharpness=sharpness) for sharpness in SHARPNESSES]
            here = min([here, *sharper], key=search.error)
        best = min(best, here, key=search.error)
    better = [choice for choice in search.tried if search.is_better(choice)]
    if not better:
        return AS_USUAL
    best = min(better, key=search.error)
    return replace(best, energy=best.weight * energy_of(shares))


def groups_of(named: Sequence[str], read: Sequence[int], count: int) -> NDArray[np.str_]:
    """Return the groups of captures: their names, or `FOLDS` of consecutive ones if any has none.

    Parameters
    ----------
    named : sequence of str
        The group of each capture that was read, empty if unknown.
    read : sequence of int
        Its index among all captures.
    count : int
        How many captures there are.

    Examples
    --------
    >>> groups_of(["", "den"], [0, 1], 2).tolist()
    ['0', '2']
    """
    return np.array(named if all(named) else [str(index * FOLDS // count) for index in read])


def shares_of(capture: TrainingPair) -> NDArray[np.float64]:
    """Return the share of a capture's known pixels at each level."""
    counts = np.bincount(capture.levels[capture.valid], minlength=LEVELS)
    return np.asarray(counts / max(counts.sum(), 1))


def cut_out(capture: TrainingPair, turn: int, side: int, change: ViewChange | None = None) -> Part:
    """Return part of a training pair, see `part_of`, a change of its defocus image undone."""
    region = part_of(capture.levels.shape, turn, side)
    defocus = capture.defocus
    if change and change.changes:
        defocus = np.rint(change.undone(defocus)).astype(np.uint8)
    # Copies: a view would keep all of a large capture.
    images = capture.infocus[region].copy(), defocus[region].copy()
    return Part(*images, capture.levels[region].copy(), capture.valid[region].copy())


class _Search:
    """The choices tried on parts, each part with the energy from other groups."""

    def __init__(
        self, solve: Callable[[Part, Chosen], Array], parts: Sequence[tuple[Part, Array]]
    ) -> None:
        self._solve, self._parts = solve, parts
        self._errors: dict[tuple[float, float, int], Array] = {}
        self.tried: list[Chosen] = []

    def best(self, choices: Sequence[Chosen]) -> Chosen:
        """Try choices until several in a row do not help, and return the best."""
        found, worse = choices[0], 0
        for choice in choices[1:]:
            if self.error(choice) < self.error(found):
                found, worse = choice, 0
            elif (worse := worse + 1) == _ENOUGH:
                break
        return found

    def error(self, choice: Chosen) -> float:
        """Return the root mean square error in levels, averaged over parts."""
        return float(np.mean(self._on_parts(choice)))

    def is_better(self, choice: Chosen) -> bool:
        """Return whether the error is a seventh below the usual one in both means over parts."""
        found, usual = self._on_parts(choice), self._on_parts(AS_USUAL)
        typical = np.log(found + _ROUNDING).mean() - np.log(usual + _ROUNDING).mean()
        return bool(found.mean() < _BETTER * usual.mean() and math.exp(typical) < _BETTER)

    def _on_parts(self, choice: Chosen) -> Array:
        key = (choice.weight, choice.sharpness, choice.smoothing)
        if key not in self._errors:
            self.tried.append(choice)
            errors = in_threads(lambda each: self._of(*each, choice), self._parts)
            self._errors[key] = np.array(errors)
        return self._errors[key]

    def _of(self, part: Part, energy: Array, choice: Chosen) -> float:
        answer = self._solve(part, replace(choice, energy=choice.weight * energy))
        off = (np.asarray(answer, np.float64) - part.levels)[part.valid]
        return float(np.sqrt(np.square(off).mean())) if off.size else 0.0
