from typing import Any

import pytest

from dfdbench.datasets.dataset import Dataset
from dfdbench.errors import InputError, StoreError
from dfdbench.methods.networks.choices import FILTERS
from dfdbench.training.search.particle import PATCHES, Bounds, particle_at
from dfdbench.training.search.search_plan import Choices, _held_out
from tests.training.search.made_searches import position_of, small_plan


def test_scenes_are_held_out_of_training_by_the_seed_and_told(tiny_store: Dataset) -> None:
    plan = small_plan(tiny_store)
    assert plan.selected_on == f"scenes held out of test, drawn from seed 0: {plan.other[0]}"
    assert small_plan(tiny_store).other == plan.other
    others = {small_plan(tiny_store, seed=seed).other for seed in range(8)}
    assert others == {("Two",), ("Three",)}
    assert plan.trained_on == f"tiny-1, split test, less {plan.other[0]}"


@pytest.mark.parametrize("seed", range(8))
def test_scenes_of_a_group_are_held_out_together(seed: int) -> None:
    scenes = tuple("abcdefgh")
    group_of = dict.fromkeys("bcd", "hall") | dict.fromkeys("fg", "room")
    train, other = _held_out(scenes, group_of, Choices(held_out=2, seed=seed))
    assert (*sorted((*train, *other)),) == scenes
    assert 2 <= len(other) <= 4
    for group in ("bcd", "fg"):
        assert len({*group} & {*other}) in (0, len(group))
    large = dict.fromkeys("abcdefg", "hall")
    assert _held_out(scenes, large, Choices(held_out=1, seed=seed))[1] == ("h",)
    with pytest.raises(InputError, match="8 training scenes are too few to hold 2 out, with their"):
        _held_out(scenes, large, Choices(held_out=2, seed=seed))


def test_as_the_thesis_the_test_selects_and_that_is_told(tiny_store: Dataset) -> None:
    plan = small_plan(tiny_store, split="train", as_thesis=True)
    assert (plan.train, plan.other) == (("One",), ("Two", "Three"))
    assert "the TEST scenes, as the thesis did: Two, Three" in plan.selected_on
    assert plan.trained_on == "tiny-1, split train"
    tiny_store.scenes = ("One",)
    with pytest.raises(StoreError, match="no pair that tests"):
        small_plan(tiny_store, split="train", as_thesis=True)


def test_patches_a_step_are_the_author_s_where_the_base_has_28(tiny_store: Dataset) -> None:
    plan = small_plan(tiny_store, {"crop": 32, "crops_per_step": 28})
    for crop, patches in PATCHES.items():
        particle = particle_at(position_of(FILTERS["original"], crop=crop))
        assert plan.configuration_of(particle).crops_per_step == patches
    few = small_plan(tiny_store, {"crop": 32, "crops_per_step": 1})
    particle = particle_at(position_of(FILTERS["original"], crop=64))
    assert few.configuration_of(particle).crops_per_step == 1


def test_every_choice_makes_another_search(tiny_store: Dataset) -> None:
    choices: list[dict[str, Any]] = [
        *({}, {"gamma": 0.5}, {"variant": "author"}, {"particles": 3}, {"pairs": 2}, {"seed": 1}),
        *({"bounds": Bounds(crop=(12, 12))}, {"split": "train", "as_thesis": True}),
    ]
    plans = [small_plan(tiny_store, **choice) for choice in choices]
    plans.append(small_plan(tiny_store, {"noise": 1.0}))
    assert len({str(plan.identity) for plan in plans}) == len(plans)


def test_what_cannot_be_searched_is_told(tiny_store: Dataset) -> None:
    with pytest.raises(InputError, match="too few to hold 2"):
        small_plan(tiny_store, held_out=2)
    for choice, value, said in (
        ("filters", "pso", "chooses this itself"),
        ("crop", 68, "crop is 68"),
        ("sampling_size", 3, "2 x 2"),
    ):
        with pytest.raises(InputError, match=said):
            small_plan(tiny_store, {choice: value})
