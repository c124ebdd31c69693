"""The learning rate of each step, and when training has ended."""

from __future__ import annotations

import math
from typing import Any, Protocol

from dfdbench.training.configuration import TrainingConfiguration
from dfdbench.training.ending import EndedBy
from dfdbench.training.saved_numbers import finite_number, finite_numbers, whole_number
from dfdbench.training.slope_test import (
    SURE,
    probability_of_fall,
    steps_without_progress,
    without_largest,
)

#: The slope test looks at all losses since the last change: not at each step.
_TEST_EVERY = 50
#: Of dlib's trainer: what a step adds to the budget of checks, and the losses it drops at least.
_BUDGET_A_STEP, _DROPPED = 200, 400


class Schedule(Protocol):
    """What the trainer asks after each step."""

    @property
    def rate(self) -> float:
        """The learning rate of the step to come."""

    def after(self, step: int, loss: float) -> None:
        """Take note of the loss of a step, the first being 1."""

    @property
    def ended(self) -> str:
        """Why training has ended, empty while it has not."""

    def state(self) -> dict[str, Any]:
        """Return what a checkpoint keeps."""

    def restore(self, state: dict[str, Any], step: int) -> None:
        """Go on from a checkpoint of that step; a `ValueError` says what it cannot have left."""


class ProgressSchedule:
    """The learning rate falls where the loss has made no progress for long: a rule of our own.

    Of all losses since the last change, the largest number of last ones that do not fall is sought,
    every 50 steps; then all are forgotten.

    Parameters
    ----------
    configuration : TrainingConfiguration
        Its `learning_rate`, `patience`, `shrink`, `minimum_learning_rate` and `steps`.

    Examples
    --------
    >>> choices = TrainingConfiguration(patience=50, learning_rate=0.1)
    >>> schedule = ProgressSchedule(choices)
    >>> for step in range(1, 101):
    ...     schedule.after(step, 1.0)
    >>> round(schedule.rate, 6)
    0.001
    """

    def __init__(self, configuration: TrainingConfiguration) -> None:
        self._patience = configuration.patience
        self._shrink = configuration.shrink
        self._least = configuration.minimum_learning_rate
        self._steps = configuration.steps
        self._losses: list[float] = []
        self._step = 0
        self._highest = self.rate = configuration.learning_rate

    def after(self, step: int, loss: float) -> None:
        """Take note of a loss; lower the rate where the slope test says so."""
        self._step = step
        self._losses.append(loss)
        due = step % _TEST_EVERY == 0 and len(self._losses) >= self._patience
        if due and steps_without_progress(self._losses) >= self._patience:
            self.rate *= self._shrink
            self._losses.clear()

    @property
    def ended(self) -> str:
        """Why training has ended, empty while it has not."""
        # Ten shrinkings by 0.1 leave a rounding error above 1e-10.
        if self.rate <= self._least * (1 + 1e-6):
            return f"{EndedBy.LEARNING_RATE} {self._least:g}"
        if self._steps is not None and self._step >= self._steps:
            return EndedBy.STEPS
        return ""

    def state(self) -> dict[str, Any]:
        """Return what a checkpoint keeps."""
        return {"step": self._step, "rate": self.rate, "losses": list(self._losses)}

    def restore(self, state: dict[str, Any], step: int) -> None:
        """Go on from a checkpoint of that step; a `ValueError` says what it cannot have left."""
        self._step = _same(state, step)
        self.rate = finite_number(state, "rate", self._highest)
        self._losses = finite_numbers(state, "losses", step)


class DlibSchedule(ProgressSchedule):
    """The learning rate falls where dlib's trainer would lower it (5.2.2).

    Only the last `patience` losses are kept. Every ``patience // 200 + 1`` steps, 13 for 2,500, a
    line is fitted to them, once there are so many; where it is not falling with a probability of
    0.51, neither over all of them nor without the largest 10 %, the rate is lowered and the
    oldest ``400 + patience // 10`` are dropped. After dlib's ``dnn_trainer`` and
    ``running_gradient``; that it goes back to its last file where the loss rises is left out.

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

    def after(self, step: int, loss: float) -> None:
        """Take note of a loss; lower the rate where dlib would."""
        self._step = step
        self._losses = [*self._losses[-self._patience + 1 :], loss]
        due = step % (self._patience // _BUDGET_A_STEP + 1) == 0
        if not due or len(self._losses) < self._patience:
            return
        kept = without_largest(self._losses)
        if max(probability_of_fall(self._losses), probability_of_fall(kept)) < SURE:
            self.rate *= self._shrink
            del self._losses[: _DROPPED + self._patience // 10]


class CosineSchedule:
    """The learning rate rises over `warm_up` steps, then falls along a cosine to 0.

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
        """Take note that a step is over."""
        self._step = step

    @property
    def ended(self) -> str:
        """Why training has ended, empty while it has not."""
        return EndedBy.STEPS if self._step >= self._steps else ""

    def state(self) -> dict[str, Any]:
        """Return what a checkpoint keeps."""
        return {"step": self._step}

    def restore(self, state: dict[str, Any], step: int) -> None:
        """Go on from a checkpoint of that step; a `ValueError` says what it cannot have left."""
        self._step = _same(state, step)


def _same(state: dict[str, Any], step: int) -> int:
    if whole_number(state, "step") != step:
        raise ValueError("the schedule is of another step")
    return step


def schedule_of(configuration: TrainingConfiguration) -> Schedule:
    """Return the schedule that a configuration asks for."""
    if configuration.schedule == "cosine":
        return CosineSchedule(configuration)
    return (DlibSchedule if configuration.schedule == "dlib" else ProgressSchedule)(configuration)
