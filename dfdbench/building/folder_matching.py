"""Measure what photographs of a folder need to be laid on each other."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dfdbench.building.sources.matching import Movement, find_gain, find_movement
from dfdbench.errors import InputError
from dfdbench.methods.view_change import Images, ViewChange, find_change

Image = NDArray[np.uint8]
Align = Literal["none", "translation", "euclidean", "similarity"]

# Movements of a corner (pixels) and gains below these need no correction. Of Middlebury's scenes,
# blurred and in register, all but the barest are measured with errors below 0.4 pixels, the barest
# with 0.48, through noise, JPEG and unequal fall-off of light.
_STILL, _UNGAINED = 0.5, 0.01


@dataclass(frozen=True)
class Matching:
    """How pairs of photographs differ in place and brightness.

    Parameters
    ----------
    align, match_gain : str, bool
        The fields to write into a manifest.
    flat_field : tuple of tuple of float
        Likewise; empty where the light falls off alike.
    found, open : tuple of str
        In words: what was found, and what a person has to decide.
    measured : int
        How many pairs could be compared.
    """

    align: Align = "none"
    match_gain: bool = False
    flat_field: tuple[tuple[float, ...], ...] = ()
    found: tuple[str, ...] = ()
    open: tuple[str, ...] = ()
    measured: int = 0


def matching_of(pairs: Iterable[tuple[str, Image, Image]]) -> Matching:
    """Measure some pairs.

    Parameters
    ----------
    pairs : iterable of (str, ndarray of uint8, ndarray of uint8)
        Each scene's name, its in-focus and its defocus image, shape (y, x, 3).
    """
    moves: list[tuple[Movement, tuple[int, ...]]] = []
    gains, unlike, problems, tried, seen = [0.0], 0, [], 0, []
    for name, sharp, blurred in pairs:
        tried += 1
        if sharp.shape != blurred.shape:
            problems.append(f"photographs of {name} differ in size")
            continue
        seen.append(Images.small(sharp, blurred))
        try:
            moves.append((find_movement(sharp, blurred), sharp.shape))
            everywhere = np.ones(sharp.shape[:2], bool)
            gains.append(find_gain(sharp.astype(float), blurred.astype(float), everywhere) - 1)
        except InputError:
            unlike += 1
    if unlike:
        problems.append(f"{unlike} of {tried} pairs tried cannot be aligned")
    gain = max(map(abs, gains))
    align, moved = _movement(moves)
    light = replace(find_change(seen), similarity=ViewChange.similarity)
    found = [*moved, f"photographs differ in brightness by up to {100 * gain:.1f} %"]
    if light.changes:
        found.append(f"the defocus images are {light.words()}")
    measured = len(moves)
    return Matching(align, gain > _UNGAINED, light.falloff, tuple(found), tuple(problems), measured)


def _movement(moves: list[tuple[Movement, tuple[int, ...]]]) -> tuple[Align, list[str]]:
    """Return the alignment to propose, and what was measured."""

    def most(part: Callable[[Movement], Movement]) -> float:
        return max(part(move).at_corners(shape) for move, shape in moves)

    if not moves:
        return "none", []
    shift = most(lambda move: Movement(move.right, move.down, 0, 1))
    turn = most(lambda move: Movement(0, 0, move.degrees, 1))
    rigid = most(lambda move: Movement(move.right, move.down, move.degrees, 1))
    magnified = most(lambda move: Movement(0, 0, 0, move.scale))
    degrees = max(abs(move.degrees) for move, _ in moves)
    percent = max(100 * abs(move.scale - 1) for move, _ in moves)
    moved = (
        f"photographs moved by up to {most(lambda move: move):.2f} pixels at the corners: shifted "
        f"by {shift:.2f} pixels, turned by {degrees:.3f} degrees, magnified by {percent:.2f} %"
    )
    align: Align = "none"
    if magnified > _STILL:
        align = "similarity"
    elif rigid > _STILL:
        align = "euclidean" if turn > _STILL else "translation"
    return align, [moved]
