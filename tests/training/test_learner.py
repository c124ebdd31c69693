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


def test_a_loss_that_is_no_number_ends_it(tiny_store: Store) -> None:
    learner = Learner(task(tiny_store), CPU)
    with torch.no_grad():
        next(learner.network.parameters()).fill_(float("nan"))
    with pytest.raises(InputError, match="no number any more"):
        learner.learn()
    assert learner.step == 0
