"""Draw numbers and choices from a seed, the same ones on every machine."""

from collections.abc import Sequence
from typing import TypeVar

from dfdbench.blur.formation import uniform_numbers

Item = TypeVar("Item")

_BLOCK = 1024


class Draws:
    """A stream of random numbers under a key; another key gives another stream.

    Parameters
    ----------
    *key : str or int
        What the numbers are for.

    Examples
    --------
    >>> draws = Draws("room", 7, 0)
    >>> draws.between(1.0, 2.0) == Draws("room", 7, 0).between(1.0, 2.0)
    True
    """

    def __init__(self, *key: str | int) -> None:
        self.key = key
        self._taken = 0
        self._block: list[float] = []

    def share(self) -> float:
        """Return a number between 0 and 1."""
        block, place = divmod(self._taken, _BLOCK)
        if place == 0:
            self._block = uniform_numbers(_BLOCK, *self.key, "block", block).tolist()
        self._taken += 1
        return self._block[place]

    def between(self, low: float, high: float) -> float:
        """Return a number between two others, all equally likely."""
        return low + (high - low) * self.share()

    def whole(self, low: int, high: int) -> int:
        """Return a whole number from `low` to `high`, both included."""
        return low + int((high - low + 1) * self.share())

    def chance(self, share: float) -> bool:
        """Return True in this share of calls."""
        return self.share() < share

    def one_of(self, items: Sequence[Item]) -> Item:
        """Return one of the items, all equally likely."""
        return items[self.whole(0, len(items) - 1)]
