import math
from collections import deque
from collections.abc import Iterable
from itertools import pairwise

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy.stats import linregress, norm

from dfdbench.datasets.dataset import Dataset
from dfdbench.training.configuration import TrainingConfiguration
from dfdbench.training.crops import IGNORED
from dfdbench.training.learner import (
    DlibSchedule,
    Learner,
    LevelLoss,
    cosine_rate,
    probability_of_fall,
)
from tests.training.test_trainer import task

CPU = torch.device("cpu")


def test_prelus_decay_as_in_dlib_where_the_configuration_says_so(tiny_store: Dataset) -> None:
    def decayed(**changes: bool) -> set[str]:
        learner = Learner(task(tiny_store, weight_decay=0.5, **changes), "cpu")
        named = {id(parameter): name for name, parameter in learner.network.named_parameters()}
        first, second = learner.state()["optimizer"]["param_groups"]
        assert (first["weight_decay"], second["weight_decay"]) == (0.5, 0.0)
        assert len(first["params"]) + len(second["params"]) == len(named)
        groups = learner.optimizer.param_groups
        return {named[id(parameter)] for parameter in groups[0]["params"]}

    with_slopes, filters = decayed(), decayed(decay_prelu=False)
    assert with_slopes - filters == {name for name in with_slopes if "activate" in name}
    assert len(with_slopes - filters) == 9
    assert all(name.endswith("weight") for name in with_slopes)
    assert not any("normalize" in name for name in with_slopes)


def test_without_width_it_is_cross_entropy_of_known_pixels() -> None:
    torch.manual_seed(0)
    logits, levels = torch.randn(2, 256, 3, 3), torch.randint(0, 256, (2, 3, 3))
    levels[0, 0, :2] = IGNORED
    expected = torch.nn.functional.cross_entropy(logits, levels, ignore_index=IGNORED)
    assert torch.allclose(LevelLoss(0, CPU)(logits, levels), expected)


@pytest.mark.parametrize("width", [0.0, 3.0])
def test_where_no_pixel_is_known_nothing_is_learned(width: float) -> None:
    logits = torch.randn(2, 256, 3, 3, requires_grad=True)
    loss = LevelLoss(width, CPU)(logits, torch.full((2, 3, 3), IGNORED))
    (gradient,) = torch.autograd.grad(loss, logits)
    assert loss.item() == 0
    assert not gradient.any()


def test_its_gradient_is_that_of_its_definition() -> None:
    torch.manual_seed(0)
    levels = torch.randint(0, 256, (2, 4, 5))
    levels[0, 0, :2] = IGNORED
    known = levels != IGNORED
    targets = torch.softmax(-(((torch.arange(256.0) - levels[known][:, None]) / 3) ** 2) / 2, 1)
    logits = torch.randn(2, 256, 4, 5, requires_grad=True)
    logarithms = torch.log_softmax(logits.permute(0, 2, 3, 1)[known], 1)
    expected = (targets * (targets.log().clamp(min=-1e4) - logarithms)).sum(1).mean()
    (wanted,) = torch.autograd.grad(expected, logits)
    found = LevelLoss(3.0, CPU)(logits, levels)
    (gradient,) = torch.autograd.grad(found, logits)
    assert torch.allclose(found, expected, rtol=1e-5)
    assert torch.allclose(gradient, wanted, atol=1e-7)


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


def lowered_by(schedule: DlibSchedule, losses: Iterable[float]) -> list[int]:
    rates = [schedule.rate, *rates_of(schedule, losses)]
    return [step for step, (a, b) in enumerate(pairwise(rates), 1) if b < a]


def rates_of(schedule: DlibSchedule, losses: Iterable[float], first: int = 1) -> list[float]:
    """The rate after each step."""
    rates = []
    for step, loss in enumerate(losses, first):
        schedule.after(step, float(loss))
        rates.append(schedule.rate)
    return rates


def curve(name: str, steps: int = 5000) -> NDArray[np.float64]:
    random, step = np.random.default_rng(7), np.arange(steps)
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


def test_a_bad_stretch_at_the_end_alone_does_not_lower_the_rate() -> None:
    losses = 2 - np.arange(600) / 1000 + np.random.default_rng(1).normal(0, 0.01, 600)
    losses[-40:] += 30
    assert steps_without_decrease(losses[::-1]) == 600
    assert lowered_by(DlibSchedule(TrainingConfiguration(patience=600)), losses) == []


def test_dlib_checks_every_13_steps_and_drops_the_oldest_650_down_to_the_least_rate() -> None:
    published = DlibSchedule(TrainingConfiguration())
    # 193 * 13 is the first check of 2,500 losses, 650 more are there at step 243 * 13.
    assert lowered_by(published, [1.0] * 3200) == [2509, 3159]
    schedule = DlibSchedule(TrainingConfiguration(patience=50))
    assert len(lowered_by(schedule, [1.0] * 300)) == 6
    assert schedule.ended == "learning rate 1e-10"
    assert schedule.rate == pytest.approx(1e-10)


def test_the_cosine_rises_then_falls_to_nothing() -> None:
    choices = TrainingConfiguration(schedule="cosine", steps=100, warm_up=9, learning_rate=1.0)
    rates = [cosine_rate(choices, step) for step in range(100)]
    assert rates[0] == pytest.approx(0.1)
    assert max(rates) == pytest.approx(rates[9], rel=0.05)
    assert all(before > after for before, after in pairwise(rates[9:]))
    assert rates[-1] < 1e-3


def test_a_restored_schedule_goes_on_alike() -> None:
    choices = TrainingConfiguration(patience=100)
    whole, half = DlibSchedule(choices), DlibSchedule(choices)
    losses = np.random.default_rng(0).normal(1, 0.1, 400)
    rates = rates_of(whole, losses)
    rates_of(half, losses[:170])
    again = DlibSchedule(choices)
    again.restore(half.state())
    assert rates_of(again, losses[170:], 171) == rates[170:]


@pytest.mark.parametrize("seed", range(5))
def test_the_probability_of_a_fall_is_that_of_the_line_through_all(seed: int) -> None:
    losses = np.linspace(1.03, 1, 200) + np.random.default_rng(seed).normal(0, 0.1, 200)
    fit = linregress(np.arange(200), losses)
    assert probability_of_fall(losses) == pytest.approx(norm.cdf(-fit.slope / fit.stderr))
