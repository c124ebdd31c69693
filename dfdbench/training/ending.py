"""What ended a training, as its card tells it."""

from __future__ import annotations

from enum import StrEnum


class EndedBy(StrEnum):
    """What ended a training: the words that a card's `ended_by` begins with."""

    STEPS = "its number of steps"
    LEARNING_RATE = "learning rate"
    TIME_LIMIT = "its time limit"
    #: Such weights have hardly been trained, and their scores say nothing of the network.
    TIME_LIMIT_IN_WARM_UP = "its time limit, within the warm-up"

    @classmethod
    def of(cls, text: str) -> EndedBy | None:
        """Return what a card says; None where it says something else.

        Examples
        --------
        >>> EndedBy.of("learning rate 1e-10").name
        'LEARNING_RATE'
        >>> EndedBy.of("its time limit, within the warm-up, at step 1 of 5").name
        'TIME_LIMIT_IN_WARM_UP'
        """
        said = [ending for ending in cls if text.startswith(ending)]
        return max(said, key=len, default=None)

    @property
    def early(self) -> bool:
        """True where more time would have trained further."""
        return self in (EndedBy.TIME_LIMIT, EndedBy.TIME_LIMIT_IN_WARM_UP)
