from __future__ import annotations

import copy

import pytest

pytest.importorskip("torch", reason="needs the extra nets")
import torch

from dfdbench.datasets.store import Store
from dfdbench.errors import InputError
from dfdbench.training.learner import Learner
from tests.training.test_trainer import task

CPU = torch.device("cpu")


def test_restored_it_learns_as_if_it_had_not_stopped(tiny_store: Store) -> None:
    learner = Learner(task(tiny_store), CPU)
    learner.learn()
    state = copy.deepcopy(learner.state())
    losses = [learner.learn() for _ in range(2)]
    other = Learner(task(tiny_store), CPU)
    other.restore(state)
    assert [other.learn() for _ in range(2)] == losses
    assert (other.step, other.trained.tolist()) == (3, learner.trained.tolist())


def test_prelus_decay_as_in_dlib_where_the_configuration_says_so(tiny_store: Store) -> None:
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


def test_a_loss_that_is_no_number_ends_it(tiny_store: Store) -> None:
    learner = Learner(task(tiny_store), CPU)
    with torch.no_grad():
        next(learner.network.parameters()).fill_(float("nan"))
    with pytest.raises(InputError, match="no number any more"):
        learner.learn()
    assert learner.step == 0
