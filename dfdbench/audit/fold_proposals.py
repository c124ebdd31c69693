"""Folds that part scenes so that each test is covered."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from dfdbench.audit.splits import Candidate, Group, Scenes, in_order
from dfdbench.errors import InputError

_RESTARTS = 40


@dataclass(frozen=True)
class Folds:
    """A cross validation: each scene in one fold.

    Parameters
    ----------
    folds : tuple of Candidate
        In the order of their scenes.
    """

    folds: tuple[Candidate, ...]

    @property
    def not_covered(self) -> int:
        """How many folds are not covered."""
        return sum(not fold.covered for fold in self.folds)

    @property
    def cost(self) -> tuple[int, float]:
        """What partitions are ranked by: folds not covered, then the sum of their shares."""
        return self.not_covered, round(math.fsum(fold.uncovered for fold in self.folds), 12)


def propose_folds(scenes: Scenes, number: int, seed: int = 0) -> list[Folds]:
    """Search partitions into folds, the best first: fewest folds not covered, then least share.

    From random partitions, two groups are exchanged as long as that helps; each restart gives
    one proposal. The same seed gives the same proposals.

    Raises
    ------
    InputError
        Where there are fewer groups than folds.
    """
    if not 2 <= number <= len(scenes.groups):
        raise InputError(
            "no such folds", where="folds", expected=f"2 to {len(scenes.groups)}", got=str(number)
        )
    random = np.random.default_rng(seed)
    known: dict[Group, Candidate] = {}

    def judge(folds: Sequence[Sequence[Group]]) -> Folds:
        tests = [in_order(scenes, fold) for fold in folds]
        unknown = [test for test in tests if test not in known]
        known.update(zip(unknown, scenes.judge(unknown), strict=True))
        return Folds(tuple(known[test] for test in tests))

    proposals: dict[tuple[Group, ...], Folds] = {}
    for _ in range(_RESTARTS):
        best = _improve(_random_folds(scenes, number, random), judge)
        folds = tuple(sorted(best.folds, key=lambda f: scenes.names.index(f.test[0])))
        proposals[tuple(fold.test for fold in folds)] = Folds(folds)
    return sorted(proposals.values(), key=lambda p: (p.cost, [fold.test for fold in p.folds]))


def _random_folds(scenes: Scenes, number: int, random: np.random.Generator) -> list[list[Group]]:
    order = [scenes.groups[place] for place in random.permutation(len(scenes.groups))]
    folds: list[list[Group]] = [[] for _ in range(number)]
    for group in sorted(order, key=len, reverse=True):
        min(folds, key=lambda fold: sum(map(len, fold))).append(group)
    return folds


def _improve(
    folds: list[list[Group]], judge: Callable[[Sequence[Sequence[Group]]], Folds]
) -> Folds:
    better = True
    while better:
        better = False
        for a, b in itertools.combinations(range(len(folds)), 2):
            least = judge([folds[a], folds[b]]).cost
            if least == (0, 0.0):
                continue
            for i, j in itertools.product(range(len(folds[a])), range(len(folds[b]))):
                if len(folds[a][i]) != len(folds[b][j]):
                    continue
                folds[a][i], folds[b][j] = folds[b][j], folds[a][i]
                cost = judge([folds[a], folds[b]]).cost
                if cost < least:
                    least, better = cost, True
                else:
                    folds[a][i], folds[b][j] = folds[b][j], folds[a][i]
    return judge(folds)
