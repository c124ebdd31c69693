from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

pytest.importorskip("torch", reason="needs the extra nets")
from dfdbench.training.configuration import TrainingConfiguration
from dfdbench.training.schedule import ProgressSchedule, schedule_of


def falling_then_level(schedule: ProgressSchedule, falls: int, steps: int) -> list[float]:
    random = np.random.default_rng(1)
    rates = []
    for step in range(1, steps + 1):
        schedule.after(step, float(max(0, 5 - 5 * step / falls) + random.normal(0, 0.05)))
        rates.append(schedule.rate)
    return rates


def test_the_rate_falls_only_once_the_loss_is_level() -> None:
    schedule = ProgressSchedule(TrainingConfiguration(patience=300, learning_rate=1e-2))
    rates = falling_then_level(schedule, 1000, 2000)
    assert set(rates[:1200]) == {1e-2}
    assert rates[1999] < 1e-2


def test_it_ends_at_the_least_rate_after_six_shrinkings() -> None:
    schedule = ProgressSchedule(TrainingConfiguration(patience=50))
    step = 0
    while not schedule.ended:
        step += 1
        schedule.after(step, 1.0)
    assert schedule.ended == "learning rate 1e-10"
    assert step == 6 * 50
    assert schedule.rate == pytest.approx(1e-10)


def test_it_ends_at_its_steps_where_that_is_earlier() -> None:
    schedule = schedule_of(TrainingConfiguration(steps=7))
    for step in range(1, 8):
        assert not schedule.ended
        schedule.after(step, 1.0)
    assert schedule.ended == "its number of steps"


def test_the_cosine_rises_then_falls_to_nothing() -> None:
    schedule = schedule_of(
        TrainingConfiguration(schedule="cosine", steps=100, warm_up=9, learning_rate=1.0)
    )
    rates = []
    for step in range(1, 101):
        rates.append(schedule.rate)
        schedule.after(step, 1.0)
    assert rates[0] == pytest.approx(0.1)
    assert max(rates) == pytest.approx(rates[9], rel=0.05)
    assert all(before > after for before, after in pairwise(rates[9:]))
    assert rates[-1] < 1e-3
    assert schedule.ended


@pytest.mark.parametrize("kind", ["progress", "cosine"])
def test_a_restored_schedule_goes_on_alike(kind: str) -> None:
    choices = TrainingConfiguration.model_validate(
        {"schedule": kind, "steps": 900, "patience": 100}
    )
    whole, half = schedule_of(choices), schedule_of(choices)
    losses = np.random.default_rng(0).normal(1, 0.1, 400)
    rates = []
    for step, loss in enumerate(losses, 1):
        whole.after(step, float(loss))
        rates.append(whole.rate)
    for step, loss in enumerate(losses[:170], 1):
        half.after(step, float(loss))
    again = schedule_of(choices)
    again.restore(half.state())
    for step, loss in enumerate(losses[170:], 171):
        again.after(step, float(loss))
        assert again.rate == rates[step - 1]
