from __future__ import annotations

import copy

import pytest
import torch

from dfdbench.datasets.dataset import Dataset
from dfdbench.errors import InputError
from dfdbench.training.crops import IGNORED
from dfdbench.training.learner import Learner, LevelLoss
from tests.training.test_trainer import task

CPU = torch.device("cpu")


def test_restored_it_learns_as_if_it_had_not_stopped(tiny_store: Dataset) -> None:
    learner = Learner(task(tiny_store), CPU)
    learner.learn()
    state = copy.deepcopy(learner.state())
    losses = [learner.learn() for _ in range(2)]
    other = Learner(task(tiny_store), CPU)
    other.restore(state)
    assert [other.learn() for _ in range(2)] == losses
    assert (other.step, other.trained.tolist()) == (3, learner.trained.tolist())


def test_prelus_decay_as_in_dlib_where_the_configuration_says_so(tiny_store: Dataset) -> None:
    def decayed(**changes: bool) -> set[str]:
        learner = Learner(task(tiny_store, weight_decay=0.5, **changes), CPU)
        named = {id(parameter): name for name, parameter in learner.network.named_parameters()}
        first, second = learner.state()["optimizer"]["param_groups"]
        assert (first["weight_decay"], second["weight_decay"]) == (0.5, 0.0)
        assert len(first["params"]) + len(second["params"]) == len(named)
        groups = learner._optimizer.param_groups
        return {named[id(parameter)] for parameter in groups[0]["params"]}

    with_slopes, filters = decayed(), decayed(decay_prelu=False)
    assert with_slopes - filters == {name for name in with_slopes if "activate" in name}
    assert len(with_slopes - filters) == 9
    assert all(name.endswith("weight") for name in with_slopes)
    assert not any("normalize" in name for name in with_slopes)


def test_a_loss_that_is_no_number_ends_it(tiny_store: Dataset) -> None:
    learner = Learner(task(tiny_store), CPU)
    with torch.no_grad():
        next(learner.network.parameters()).fill_(float("nan"))
    with pytest.raises(InputError, match="the loss became nan"):
        learner.learn()
    assert learner.step == 0


def logits_for(level: int) -> torch.Tensor:
    logits = torch.zeros(1, 256, 1, 2)
    logits[0, level] = 50.0
    return logits


def test_without_width_it_is_cross_entropy() -> None:
    torch.manual_seed(0)
    logits, levels = torch.randn(2, 256, 3, 3), torch.randint(0, 256, (2, 3, 3))
    expected = torch.nn.functional.cross_entropy(logits, levels)
    assert torch.allclose(LevelLoss(0, CPU)(logits, levels), expected)


def test_with_width_near_misses_cost_less() -> None:
    loss = LevelLoss(4, CPU)
    truth = torch.tensor([[[100, 100]]])
    at, near, far = (float(loss(logits_for(level), truth)) for level in (100, 104, 150))
    assert at < near < far


@pytest.mark.parametrize("level", [0, 100, 255])
def test_the_target_itself_costs_nothing(level: int) -> None:
    loss = LevelLoss(3, CPU)
    levels = torch.arange(256.0)
    logits = -(((levels - level) / 3) ** 2) / 2
    truth = torch.full((1, 1, 1), level)
    assert abs(float(loss(logits.reshape(1, 256, 1, 1), truth))) < 1e-4


def test_its_gradient_is_that_of_its_definition() -> None:
    torch.manual_seed(0)
    width = 3.0
    levels = torch.randint(0, 256, (2, 4, 5))
    levels[0, 0, :2] = IGNORED
    known = levels != IGNORED
    places = torch.arange(256.0)
    targets = torch.softmax(-(((places - levels[known][:, None]) / width) ** 2) / 2, 1)
    logits = torch.randn(2, 256, 4, 5, requires_grad=True)
    logarithms = torch.log_softmax(logits.permute(0, 2, 3, 1)[known], 1)
    expected = (targets * (targets.log().clamp(min=-1e4) - logarithms)).sum(1).mean()
    (wanted,) = torch.autograd.grad(expected, logits)
    found = LevelLoss(width, CPU)(logits, levels)
    (gradient,) = torch.autograd.grad(found, logits)
    assert torch.allclose(found, expected, rtol=1e-5)
    assert torch.allclose(gradient, wanted, atol=1e-7)


@pytest.mark.parametrize("width", [0, 4])
def test_pixels_left_out_do_not_count(width: float) -> None:
    loss = LevelLoss(width, CPU)
    both = torch.cat([logits_for(7), logits_for(200)], 3)
    counted = loss(both, torch.tensor([[[7, 7, IGNORED, IGNORED]]]))
    assert torch.allclose(counted, loss(logits_for(7), torch.tensor([[[7, 7]]])))
