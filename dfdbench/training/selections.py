"""How often a training drew patches from each pair, and from which of its pixels (Fig. 5.8)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dfdbench.training.crops import Cropper


@dataclass(frozen=True)
class Selections:
    """The patches of a training, each counted once, in however many orientations it was given.

    Parameters
    ----------
    pairs : tuple of str
        The training pairs' names.
    shapes : tuple of (int, int)
        Rows and columns of each pair's images.
    size : int
        Rows and columns of a patch.
    places : ndarray of int32, shape (patches, 3)
        Of each patch the pair's number, its first row and its first column.
    """

    pairs: tuple[str, ...]
    shapes: tuple[tuple[int, int], ...]
    size: int
    places: NDArray[np.int32]

    @property
    def patches(self) -> NDArray[np.int64]:
        """How many patches were drawn from each pair, shape (pairs,)."""
        counts: NDArray[np.int64] = np.bincount(self.places[:, 0], minlength=len(self.pairs))
        return counts

    def uses(self, pair: int) -> NDArray[np.int64]:
        """Return in how many patches each pixel of a pair lay, shape (y, x).

        Examples
        --------
        >>> drawn = Selections(("a",), ((2, 4),), 2, np.array([[0, 0, 0], [0, 0, 1]], np.int32))
        >>> drawn.uses(0).tolist()
        [[1, 2, 1, 0], [1, 2, 1, 0]]
        """
        rows, columns = self.shapes[pair]
        _, top, left = self.places[self.places[:, 0] == pair].T
        # Each patch by its corners; their sums along both axes are its pixels.
        corners = np.zeros((rows + 1, columns + 1), np.int64)
        for row, column, sign in (
            (top, left, 1),
            (top + self.size, left, -1),
            (top, left + self.size, -1),
            (top + self.size, left + self.size, 1),
        ):
            np.add.at(corners, (row, column), sign)
        summed: NDArray[np.int64] = corners.cumsum(0).cumsum(1)[:rows, :columns]
        return summed

    def rows(self) -> list[dict[str, object]]:
        """Return a row a pair: its patches, and least, mean and most patches a pixel lay in."""
        found: list[dict[str, object]] = []
        for number, (pair, patches) in enumerate(zip(self.pairs, self.patches, strict=True)):
            uses = self.uses(number)
            found.append(
                {
                    "pair": pair,
                    "patches": int(patches),
                    "pixel_least": int(uses.min()),
                    "pixel_mean": round(float(uses.mean()), 3),
                    "pixel_most": int(uses.max()),
                }
            )
        return found


def selections_of(
    cropper: Cropper,
    pairs: Sequence[str],
    steps: int,
    on_step: Callable[[int, int], None] | None = None,
) -> Selections:
    """Return what a training of so many steps drew: a step's patches follow from its number.

    Parameters
    ----------
    cropper : Cropper
        Of the training.
    pairs : sequence of str
        The names of its pairs.
    steps : int
        Steps done.
    on_step : callable, optional
        Called with (steps counted, steps in all).
    """
    places = np.empty((steps * cropper.count, 3), np.int32)
    for step in range(steps):
        first = step * cropper.count
        places[first : first + cropper.count] = [
            (place.index, place.top, place.left) for place in cropper.places(step)
        ]
        if on_step:
            on_step(step + 1, steps)
    return Selections(tuple(pairs), cropper.shapes, cropper.size, places)
