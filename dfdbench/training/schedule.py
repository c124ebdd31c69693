"""The learning rate of each step, and when training has ended."""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from dfdbench.training.configuration import TrainingConfiguration

#: Of dlib's trainer: what a step adds to the budget of checks, and the losses it drops at least.
_BUDGET_A_STEP, _DROPPED = 200, 400
#: The probability from which a loss counts as fallen.
_SURE = 0.51


class EndedBy(StrEnum):
    """Why a training ended: the words that a card's `ended_by` begins with."""

    STEPS = "its number of steps"
    LEARNING_RATE = "learning rate"
    TIME_LIMIT = "its time limit"
    #: Such weights are hardly trained: their scores say nothing about the network.
    TIME_LIMIT_IN_WARM_UP = "its time limit, within the warm-up"

    @classmethod
    def of(cls, text: str) -> EndedBy | None:
        """Parse the text of a card; None if it says something else.

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
        """True if training would continue with more time."""
        return self in (EndedBy.TIME_LIMIT, EndedBy.TIME_LIMIT_IN_WARM_UP)


class DlibSchedule:
    """Lower the learning rate if dlib's trainer would (5.2.2).

    It keeps the last `patience` losses. Once there are so many, it fits a line to them every
    ``patience // 200 + 1`` steps (13 for 2,500). If that line does not fall with a probability of
    0.51, neither over all of them nor without the largest 10 %, it lowers the rate and drops the
    oldest ``400 + patience // 10`` losses. After dlib's ``dnn_trainer`` and ``running_gradient``,
    except that dlib also returns to its last file if the loss rises.

    Parameters
    ----------
    configuration : TrainingConfiguration
        Its `learning_rate`, `patience`, `shrink`, `minimum_learning_rate` and `steps`.

    Examples
    --------
    >>> choices = TrainingConfiguration(patience=600, learning_rate=0.1)
    >>> schedule = DlibSchedule(choices)
    >>> lowered = []
    >>> for step in range(1, 1201):
    ...     before = schedule.rate
    ...     schedule.after(step, 1.0)
    ...     if schedule.rate < before:
    ...         lowered.append(step)
    >>> lowered  # 460 are dropped, and 460 more have to come
    [600, 1060]
    """

    def __init__(self, configuration: TrainingConfiguration) -> None:
        self._patience = configuration.patience
        self._shrink = configuration.shrink
        self._least = configuration.minimum_learning_rate
        self._steps = configuration.steps
        self._losses: list[float] = []
        self._step = 0
        self.rate = configuration.learning_rate

    def after(self, step: int, loss: float) -> None:
        """Note a loss; lower the rate if dlib would."""
        self._step = step
        self._losses = [*self._losses[-self._patience + 1 :], loss]
        due = step % (self._patience // _BUDGET_A_STEP + 1) == 0
        if not due or len(self._losses) < self._patience:
            return
        kept = without_largest(self._losses)
        if max(probability_of_fall(self._losses), probability_of_fall(kept)) < _SURE:
            self.rate *= self._shrink
            del self._losses[: _DROPPED + self._patience // 10]

    @property
    def ended(self) -> str:
        """Why training has ended; empty if it has not."""
        # Ten shrinkings by 0.1 leave a rounding error above 1e-10.
        if self.rate <= self._least * (1 + 1e-6):
            return f"{EndedBy.LEARNING_RATE} {self._least:g}"
        if self._steps is not None and self._step >= self._steps:
            return EndedBy.STEPS
        return ""

    def state(self) -> dict[str, Any]:
        """Return what a checkpoint keeps."""
        return {"step": self._step, "rate": self.rate, "losses": list(self._losses)}

    def restore(self, state: dict[str, Any]) -> None:
        """Continue from what `state` returned."""
        self._step, self.rate, self._losses = state["step"], state["rate"], state["losses"]


class CosineSchedule:
    """Raise the learning rate over `warm_up` steps, then lower it along a cosine to 0.

    Parameters
    ----------
    configuration : TrainingConfiguration
        Its `learning_rate`, `warm_up` and `steps`.

    Examples
    --------
    >>> schedule = CosineSchedule(TrainingConfiguration(schedule="cosine", steps=4))
    >>> schedule.rate
    0.0001
    >>> schedule.after(2, 1.0)
    >>> round(schedule.rate, 9)
    5e-05
    """

    def __init__(self, configuration: TrainingConfiguration) -> None:
        assert configuration.steps is not None
        self._steps = configuration.steps
        self._warm_up = configuration.warm_up
        self._highest = configuration.learning_rate
        self._step = 0

    @property
    def rate(self) -> float:
        """The learning rate of the step to come."""
        rising = min(1.0, (self._step + 1) / (self._warm_up + 1))
        return self._highest * rising * (1 + math.cos(math.pi * self._step / self._steps)) / 2

    def after(self, step: int, loss: float) -> None:
        """Note that a step is over."""
        self._step = step

    @property
    def ended(self) -> str:
        """Why training has ended; empty if it has not."""
        return EndedBy.STEPS if self._step >= self._steps else ""

    def state(self) -> dict[str, Any]:
        """Return what a checkpoint keeps."""
        return {"step": self._step}

    def restore(self, state: dict[str, Any]) -> None:
        """Continue from what `state` returned."""
        self._step = state["step"]


def schedule_of(configuration: TrainingConfiguration) -> DlibSchedule | CosineSchedule:
    """Return the schedule that a configuration asks for."""
    if configuration.schedule == "cosine":
        return CosineSchedule(configuration)
    return DlibSchedule(configuration)


def probability_of_fall(losses: Sequence[float] | NDArray[np.float64]) -> float:
    """Return the probability that the loss has fallen, by the line through all losses.

    Parameters
    ----------
    losses : array_like of float, shape (n,)
        One a step, oldest first; at least 3.

    Examples
    --------
    >>> probability_of_fall([5.0, 4.0, 3.0]), probability_of_fall([1.0, 1.0, 1.0])
    (1.0, 0.5)
    >>> round(probability_of_fall([2.0, 1.0, 3.0, 2.0]), 3)
    0.319
    """
    values = np.asarray(losses, np.float64)
    steps = np.arange(values.size) - (values.size - 1) / 2
    centred = values - values.mean()
    slope = float(steps @ centred / (steps @ steps))
    residual = centred - slope * steps
    error = float(np.sqrt(residual @ residual / (values.size - 2) / (steps @ steps)))
    least = _rounding(values)
    if error > least:
        return float(ndtr(-slope / error))
    return 0.5 if abs(slope) <= least else float(slope < 0)


def without_largest(losses: Sequence[float] | NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the losses without the largest tenth, in their order, as dlib does.

    Examples
    --------
    >>> without_largest([3, 9, 1, 2, 5, 4, 6, 7, 8, 2, 1]).tolist()
    [3.0, 1.0, 2.0, 5.0, 4.0, 6.0, 7.0, 8.0, 2.0, 1.0]
    """
    values = np.asarray(losses, np.float64)
    highest = int((values.size - 1) * 0.9 + 0.5)
    kept: NDArray[np.float64] = values[values <= np.partition(values, highest)[highest]]
    return kept


def _rounding(values: NDArray[np.float64]) -> float:
    # Below this, slopes and their errors are the sums' own rounding.
    return float(1e-12 * max(1.0, np.abs(values).max()))
