from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("torch", reason="needs the extra nets")
from dfdbench.training.configuration import TrainingConfiguration
from dfdbench.training.schedule import DlibSchedule, ProgressSchedule, schedule_of


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


def steps_without_decrease(losses: Iterable[float], ignored_above: float = math.inf) -> int:
    """dlib's count, a value at a time from the newest back: sums of a growing regression."""
    n = sum_x = sum_y = sum_xx = sum_xy = sum_yy = 0.0
    count = 0
    for number, loss in enumerate(losses, 1):
        if loss <= ignored_above:
            x, y = n, loss - 1.0
            n, sum_x, sum_y = n + 1, sum_x + x, sum_y + y
            sum_xx, sum_xy, sum_yy = sum_xx + x * x, sum_xy + x * y, sum_yy + y * y
        if n > 2:
            spread = sum_xx - sum_x**2 / n
            slope = (sum_xy - sum_x * sum_y / n) / spread
            residual = sum_yy - sum_y**2 / n - slope**2 * spread
            error = math.sqrt(max(residual, 0.0) / (n - 2) * 12 / (n**3 - n))
            if math.erfc(-slope / error / math.sqrt(2)) / 2 < 0.51:
                count = number
    return count


def lowered_by_dlib(losses: Iterable[float], patience: int) -> list[int]:
    """The steps at which dlib's trainer lowers the rate, as its source tells it."""
    kept: deque[float] = deque()
    budget, lowered = 0, []
    for step, loss in enumerate(losses, 1):
        budget += 200
        kept.append(loss)
        while len(kept) > patience:
            kept.popleft()
        if budget <= patience:
            continue
        budget = 0
        newest_first = list(reversed(kept))
        if steps_without_decrease(newest_first) >= patience:
            quantile = sorted(kept)[math.floor((len(kept) - 1) * (1 - 0.10) + 0.5)]
            if steps_without_decrease(newest_first, quantile) >= patience:
                lowered.append(step)
                for _ in range(min(len(kept), 400 + patience // 10)):
                    kept.popleft()
    return lowered


def lowered_by(schedule: ProgressSchedule, losses: Iterable[float]) -> list[int]:
    lowered = []
    for step, loss in enumerate(losses, 1):
        before = schedule.rate
        schedule.after(step, loss)
        if schedule.rate < before:
            lowered.append(step)
    return lowered


def curve(name: str, steps: int = 5000) -> NDArray[np.float64]:
    random = np.random.default_rng(7)
    step = np.arange(steps)
    if name == "falls, then level":
        return 1 + 4 * np.exp(-step / 500) + random.normal(0, 0.1, steps)
    if name == "falls on and on":
        return 3 / np.sqrt(1 + step / 300) + random.normal(0, 0.3, steps)
    return 1 + 2 * np.exp(-step / 300) + random.normal(0, 0.05, steps) + 3 * (step % 700 > 640)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["falls, then level", "falls on and on", "bad stretches"])
def test_dlibs_schedule_lowers_the_rate_where_dlib_does(name: str) -> None:
    losses, choices = curve(name), TrainingConfiguration(patience=600)
    expected = lowered_by_dlib(losses, 600)
    assert lowered_by(DlibSchedule(choices), losses) == expected
    assert len(expected) > 2
    # The rule of our own, which forgets all losses, asks again later.
    assert lowered_by(ProgressSchedule(choices), losses) != expected


def test_dlib_checks_every_13_steps_and_drops_the_oldest_650() -> None:
    published = DlibSchedule(TrainingConfiguration())
    # 193 * 13 is the first check of 2,500 losses, 650 more are there at step 243 * 13.
    assert lowered_by(published, [1.0] * 3200) == [2509, 3159]


def test_a_bad_stretch_at_the_end_alone_does_not_lower_the_rate() -> None:
    losses = 2 - np.arange(600) / 1000 + np.random.default_rng(1).normal(0, 0.01, 600)
    losses[-40:] += 30
    assert steps_without_decrease(losses[::-1]) == 600
    assert lowered_by(DlibSchedule(TrainingConfiguration(patience=600)), losses) == []


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


@pytest.mark.parametrize("kind", ["dlib", "progress", "cosine"])
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
    again.restore(half.state(), half.state()["step"])
    for step, loss in enumerate(losses[170:], 171):
        again.after(step, float(loss))
        assert again.rate == rates[step - 1]


@pytest.mark.parametrize(
    "changes",
    [
        {"rate": float("nan")},
        {"rate": 1e9},
        {"rate": "0.1"},
        {"losses": [1.0] * 6},
        {"losses": [float("inf")]},
        {"losses": ["1"]},
        {"losses": None},
        {"step": None},
        {"step": 4},
    ],
)
def test_what_no_schedule_left_is_refused(changes: dict[str, object]) -> None:
    schedule = schedule_of(TrainingConfiguration(schedule="progress"))
    with pytest.raises(ValueError, match=r"rate|losses|step"):
        schedule.restore({"step": 5, "rate": 1e-4, "losses": [1.0] * 5, **changes}, 5)
    schedule.restore({"step": 5, "rate": 1e-4, "losses": [1.0] * 5}, 5)
    assert schedule.rate == 1e-4
