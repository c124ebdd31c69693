import copy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from dfdbench.blur.recipe import RECIPES
from dfdbench.blur.tracks import OF_PATCHES
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest import Pair
from dfdbench.datasets.manifest_file import parse_manifest
from dfdbench.errors import InputError, StoreError, UnknownNameError
from dfdbench.methods.networks.inference import Predictor
from dfdbench.methods.networks.weights import build_network
from dfdbench.metrics.protocol import PROTOCOLS, score
from dfdbench.training import task as tasks
from dfdbench.training.configuration import TrainingConfiguration
from dfdbench.training.crops import TrainingImages
from dfdbench.training.reduction import counts, reduce
from tests.conftest import store_of
from tests.made_stack_folder import STACK_TOML, make_stacks
from tests.methods.made_weights import save_small
from tests.methods.networks.test_architectures import SMALL


def test_folds_and_splits_say_what_they_trained_on(tiny_store: Dataset) -> None:
    choices = TrainingConfiguration()
    fold = tasks.task_of("dfd-net", tiny_store, choices, fold="K2")
    assert {pair.scene for pair in fold.train} == {"One", "Two"}
    assert {pair.scene for pair in fold.test} == {"Three"}
    assert (fold.trained_on, fold.tested_on) == ("tiny-1, all but K2", "K2")
    split = tasks.task_of("dfd-net", tiny_store, choices, split="test")
    assert (split.trained_on, split.tested_on) == ("tiny-1, split test", "train")
    with pytest.raises(UnknownNameError):
        tasks.task_of("dfd-net", tiny_store, choices, split="trian")
    some = task(tiny_store, redraw_depth=True, tracks=["noise", "psf"])
    assert some.trained_on == "tiny-1, split train, random tracks: noise psf"
    every = task(tiny_store, redraw_depth=True, tracks=list(OF_PATCHES))
    assert every.trained_on == "tiny-1, split train, random tracks"


def task(store: Dataset, **changes: Any) -> tasks.Task:
    choices = TrainingConfiguration.model_validate({"crop": 16} | changes)
    return tasks.task_of("dfd-net", store, choices)


def test_another_seed_or_start_is_another_training(tiny_store: Dataset, tmp_path: Path) -> None:
    first = task(tiny_store)
    others = [
        replace(first, seed=1),
        replace(first, method="u-net"),
        replace(first, start=save_small(tmp_path / "start.safetensors")),
        tasks.task_of("dfd-net", tiny_store, first.configuration, "test"),
        task(tiny_store, noise=2.0),
    ]
    identities = [str(other.identity) for other in (first, *others)]
    assert len(set(identities)) == len(identities)
    # What it is watched on changes no step.
    assert replace(first, test=()).identity == first.identity


def test_what_cannot_be_trained_is_told(tiny_store: Dataset) -> None:
    choices: list[tuple[dict[str, Any], str]] = [
        ({"crop": 18}, "a multiple of 4"),
        # A patch and what its blur reaches: 13 pixels at each side.
        ({"crop": 16, "redraw_depth": True}, "crop"),
        ({"tracks": ["noise"]}, "--set redraw_depth=true"),
    ]
    for changes, said in choices:
        with pytest.raises(InputError, match=said):
            tasks.require_trainable(task(tiny_store, **changes))
    # A set without a recipe is blurred by one that is named.
    tiny_store.attributes["recipe"] = {"name": "", "parameters": None}
    with pytest.raises(InputError, match=r"captured defocus has not(.|\n)*recipe=published"):
        tasks.require_trainable(task(tiny_store, crop=12, redraw_depth=True))
    assert task(tiny_store, redraw_depth=True, recipe="text").recipe == RECIPES["text"]
    tiny_store.scenes = ("Two",)
    with pytest.raises(StoreError, match="no pair to train on, of tiny-1, split train"):
        task(tiny_store)


@given(count=st.integers(1, 40), pairs=st.integers(1, 30))
def test_some_of_the_pairs_are_spread_over_all(count: int, pairs: int) -> None:
    every = [Pair("Art", (("view", number),)) for number in range(pairs)]
    chosen = [every.index(pair) for pair in tasks.evenly_spaced(every, count)]
    assert len(set(chosen)) == len(chosen) == min(count, pairs)
    steps = np.diff([*chosen, pairs])
    assert chosen[0] == 0
    assert steps.max() - steps.min() <= 1


def test_they_are_the_means_of_the_thesis_protocols(tiny_store: Dataset) -> None:
    torch.manual_seed(1)
    network = build_network("dfd-net", {"filters": list(SMALL)}).train()
    before = copy.deepcopy(network.state_dict())
    pairs, cpu = tiny_store.pairs("test")[:2], torch.device("cpu")
    found = tasks.mean_scores(network, tiny_store, pairs, cpu)
    predict = Predictor(copy.deepcopy(network).eval(), cpu)
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


def test_a_network_gets_the_two_images_of_a_stack_that_a_run_gives_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    toml = STACK_TOML.replace("[axes]", "pair_images = [2, 3]\n\n[axes]")
    manifest = parse_manifest(toml.encode(), "mine-1.toml")
    store = store_of(manifest, make_stacks(tmp_path / "mine"), tmp_path / "mine.zarr")
    pairs, seen = store.pairs("all")[:1], list[Any]()
    read = TrainingImages.read(store, pairs, ignore_unknown=False).pixels[0]
    seen.append(read.permute(1, 2, 0).numpy())

    def watch(infocus: Any, defocus: Any) -> Any:
        seen.append(np.concatenate([infocus, defocus], axis=2))
        return np.zeros(infocus.shape[:2])

    for module in (tasks, reduce):
        monkeypatch.setattr(module, "Predictor", lambda *_, **__: watch)
    tasks.mean_scores(torch.nn.Identity(), store, pairs, torch.device("cpu"))
    reduce.seconds_an_image({"mine": save_small(tmp_path / "w.safetensors")}, store, "cpu")

    def tap(network: Any, infocus: Any, defocus: Any, where: str) -> dict[int, Any]:
        watch(infocus, defocus)
        return {}

    monkeypatch.setattr(counts, "tap", tap)
    counts.count_clusters(torch.nn.Identity(), store, pairs)
    expected = np.concatenate(list(store.read(pairs[0]).images[2:4]), axis=2)
    assert len(seen) == 13
    assert all(np.array_equal(images, expected) for images in seen)
