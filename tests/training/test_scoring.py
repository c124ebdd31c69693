from __future__ import annotations

import copy

import numpy as np
import pytest

pytest.importorskip("torch", reason="needs the extra nets")
import torch
from hypothesis import given
from hypothesis import strategies as st

from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest import Pair
from dfdbench.methods.networks.inference import Predictor
from dfdbench.methods.networks.weights import build_network
from dfdbench.metrics.protocol import PROTOCOLS, score
from dfdbench.training.scoring import evenly_spaced, mean_scores, same_threads
from tests.methods.networks.test_architectures import SMALL

CPU = torch.device("cpu")


@given(count=st.integers(1, 40), pairs=st.integers(1, 30))
def test_some_of_the_pairs_are_spread_over_all(count: int, pairs: int) -> None:
    every = [Pair("Art", (("view", number),)) for number in range(pairs)]
    chosen = [every.index(pair) for pair in evenly_spaced(every, count)]
    assert len(set(chosen)) == len(chosen) == min(count, pairs)
    steps = np.diff([*chosen, pairs])
    assert chosen[0] == 0
    assert steps.max() - steps.min() <= 1


def test_they_are_the_means_of_the_thesis_protocols(tiny_store: Dataset) -> None:
    torch.manual_seed(1)
    network = build_network("dfd-net", {"filters": list(SMALL)}).train()
    before = copy.deepcopy(network.state_dict())
    pairs = tiny_store.pairs("test")[:2]
    found = mean_scores(network, tiny_store, pairs, CPU)
    predict = Predictor(copy.deepcopy(network).eval(), CPU)
    scores: dict[str, list[dict[str, float]]] = {"thesis": [], "thesis-networks-2": []}
    for pair in pairs:
        images = tiny_store.read(pair)
        levels = predict(images.infocus, images.defocus).astype(np.float32)
        for label, taken in scores.items():
            taken.append(score(PROTOCOLS[label], images.levels, images.valid, levels, 16))
    assert found == {
        label: {name: pytest.approx(np.mean([one[name] for one in taken])) for name in taken[0]}
        for label, taken in scores.items()
    }
    assert found["thesis"] != found["thesis-networks-2"]
    # The network goes on learning where it was: its means, and that it learns.
    assert network.training
    after = network.state_dict()
    assert all(torch.equal(before[name], after[name]) for name in before)


def test_without_pairs_there_is_no_score(tiny_store: Dataset) -> None:
    network = build_network("dfd-net", {"filters": list(SMALL)})
    assert mean_scores(network, tiny_store, (), CPU) == {"thesis": {}, "thesis-networks-2": {}}


def test_threads_are_as_many_afterwards_whatever_happens() -> None:
    before = torch.get_num_threads()
    with same_threads():
        torch.set_num_threads(before + 1)
    assert torch.get_num_threads() == before

    @same_threads()
    def fail() -> None:
        torch.set_num_threads(before + 1)
        raise ValueError("wrong")

    with pytest.raises(ValueError, match="wrong"):
        fail()
    assert torch.get_num_threads() == before
