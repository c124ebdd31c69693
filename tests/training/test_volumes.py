from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
import torch

from dfdbench.errors import InputError
from dfdbench.methods.networks.weights import load_weights
from dfdbench.methods.volume_net import levels_of
from dfdbench.training import trainer
from dfdbench.training.volume_examples import COUNT, Example
from dfdbench.training.volumes import (
    CROP,
    CROPS,
    HELD_OUT,
    draw,
    loss_of,
    steps_of,
    train_volume_net,
)

DEPTHS = torch.from_numpy(levels_of(COUNT) - 0.5).float()


def example(seed: int) -> Example:
    """Return an example whose costs tell its depth."""
    random = np.random.default_rng(seed)
    levels = np.kron(random.integers(0, 256, (8, 10)), np.ones((8, 8))).astype(np.int16)
    away = np.abs(levels[::2, ::2] - levels_of(COUNT)[:, None, None]) / 8
    roots = np.minimum(away * 51, 255).astype(np.uint8)
    return Example(
        roots,
        roots,
        np.full((32, 40), 60, np.uint8),
        random.normal(size=(64, 80)).astype(np.float16),
        np.where(random.random(levels.shape) < 0.1, -1, levels).astype(np.int16),
        np.zeros(COUNT, np.float32),
    )


@pytest.fixture
def cameras() -> Mapping[str, list[Example]]:
    return {"lens-00": [example(0), example(1)], HELD_OUT[0]: [example(2)]}


def test_crops_follow_from_seed_and_step_alone() -> None:
    examples = [example(0), example(1)]
    first, again, other = (draw(examples, 3, step) for step in (5, 5, 6))
    assert all(torch.equal(getattr(first, n), getattr(again, n)) for n in vars(first))
    assert not torch.equal(first.levels, other.levels)
    assert first.volume.shape == (CROPS, COUNT, 32, 32)
    assert first.levels.shape == (CROPS, 64, 64)
    assert CROP > 64


def test_however_a_crop_is_turned_costs_and_levels_lie_over_each_other() -> None:
    batch = draw([example(0)], 0, 0)
    cheapest = DEPTHS[batch.volume.argmin(1)]
    truth = batch.levels[:, ::2, ::2]
    known = truth >= 0
    assert ((cheapest - truth)[known].abs() <= 4.5).all()


def test_the_loss_is_least_at_the_truth_and_does_not_see_unknown_pixels() -> None:
    levels = torch.full((1, 8, 8), 99.5)
    mask = torch.zeros(1, 36, 4, 4)
    right = torch.full((1, COUNT, 4, 4), -9.0)
    right[:, int((DEPTHS == 99.5).nonzero())] = 9.0
    wrong = right.roll(3, 1)
    assert loss_of(right, mask, levels, DEPTHS) < 0.01 < loss_of(wrong, mask, levels, DEPTHS)
    unknown = torch.full_like(levels, -1)
    assert loss_of(wrong, mask, unknown, DEPTHS) == 0


def test_a_training_that_was_stopped_goes_on_as_if_it_had_not_been(
    cameras: Mapping[str, list[Example]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(trainer, "_SAVE_SECONDS", 0.0)
    whole, card, log = train_volume_net(cameras, "made", tmp_path / "whole", steps=3)
    assert card.ended_by == "its number of steps"
    assert [row["step"] for row in log.losses] == [1, 2, 3]
    assert log.scores[-1][HELD_OUT[0]] == card.further_scores["valid"]["nrmse"]

    def stop(step: int, steps: int | None) -> None:
        if step == 2:
            raise KeyboardInterrupt

    part = tmp_path / "part"
    with pytest.raises(KeyboardInterrupt):
        train_volume_net(cameras, "made", part, steps=3, on_step=stop)
    resumed, _, after = train_volume_net(cameras, "made", part, steps=3)
    assert after.losses == log.losses
    before, again = (load_weights(path, "volume-net")[0].state_dict() for path in (whole, resumed))
    assert all(torch.equal(before[name], again[name]) for name in before)


def test_time_that_is_up_ends_a_training(
    cameras: Mapping[str, list[Example]], tmp_path: Path
) -> None:
    _, card, _ = train_volume_net(cameras, "made", tmp_path, max_seconds=1e-9)
    assert (card.ended_by, card.steps) == ("its time limit", 1)


def test_images_smaller_than_its_scales_are_refused(tmp_path: Path) -> None:
    whole = example(0)
    small = Example(
        whole.paths[:, :8],
        whole.roots[:, :8],
        whole.told[:8],
        whole.guide[:16],
        whole.levels[:16],
        whole.prior,
    )
    with pytest.raises(InputError, match="images of 16 pixels are too small"):
        train_volume_net({"mine": [small]}, "made", tmp_path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [({"crop": 9}, "no such choice"), ({"steps": 0}, "no number"), ({"steps": True}, "no number")],
)
def test_only_steps_can_be_set(changes: dict[str, int], message: str) -> None:
    with pytest.raises(InputError, match=message):
        steps_of(changes)
