from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

import pytest

pytest.importorskip("torch", reason="needs the extra nets")
import torch

from dfdbench.datasets.store import Store
from dfdbench.errors import InputError
from dfdbench.training.checkpoint import DAMAGED
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


def spoil_step(state: dict[str, Any]) -> None:
    state["step"] = state["schedule"]["step"] = 10**9


def spoil_moment(state: dict[str, Any]) -> None:
    state["optimizer"]["state"][0]["exp_avg"] = torch.zeros(1).expand(7)


def spoil_name(state: dict[str, Any]) -> None:
    del state["optimizer"]["state"][0]["exp_avg"]


def spoil_square(state: dict[str, Any]) -> None:
    state["optimizer"]["state"][0]["exp_avg_sq"].fill_(-1)


SPOILS: dict[str, Callable[[dict[str, Any]], object]] = {
    "a step beyond the last": spoil_step,
    "a step that is none": lambda state: state.update(step=True),
    "a fraction of a step": lambda state: state.update(step=1.5),
    "no step of the schedule": lambda state: state["schedule"].update(step=None),
    "another step of the schedule": lambda state: state["schedule"].update(step=2**70),
    "one level": lambda state: state.update(trained=torch.zeros(1, dtype=torch.int64)),
    "levels that are no counts": lambda state: state.update(trained=torch.full((256,), -1)),
    "an optimizer of nothing": lambda state: state["optimizer"].update(state={}),
    "an optimizer of other parameters": lambda state: state["optimizer"]["state"].update({99: 1}),
    "a moment of another shape": spoil_moment,
    "a moment that lacks": spoil_name,
    "squares below 0": spoil_square,
}


@pytest.mark.parametrize("spoil", SPOILS)
def test_what_no_training_leaves_is_refused(tiny_store: Store, spoil: str) -> None:
    learner = Learner(task(tiny_store), CPU)
    learner.learn()
    state = copy.deepcopy(learner.state())
    SPOILS[spoil](state)
    with pytest.raises(DAMAGED):
        Learner(task(tiny_store), CPU).restore(state)


def test_how_the_optimizer_is_set_is_not_taken_from_a_file(tiny_store: Store) -> None:
    learner = Learner(task(tiny_store), CPU)
    learner.learn()
    state = copy.deepcopy(learner.state())
    loss = learner.learn()
    for group in state["optimizer"]["param_groups"]:
        group.update(betas=None, maximize=True, amsgrad=True, lr=float("nan"))
    other = Learner(task(tiny_store), CPU)
    other.restore(state)
    assert other.learn() == loss
    assert other.learn() == learner.learn()


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
