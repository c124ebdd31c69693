from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from dfdbench.datasets.dataset import Dataset
from dfdbench.errors import InputError
from dfdbench.methods.networks.weights import load_weights
from dfdbench.training import trainer
from dfdbench.training.cameras import CameraLearner, Course, kept_examples, loss_of
from dfdbench.training.volumes import HELD_OUT, VOLUME_NET
from tests.training.test_trainer import stopping
from tests.training.test_volumes import example


def train_on(
    course: Course[Any],
    cameras: Mapping[str, Sequence[Any]],
    folder: Path,
    steps: int | None = None,
    on_step: trainer.OnStep | None = None,
) -> trainer.TrainingOutcome:
    learner = CameraLearner(course, cameras, "made", steps=steps)
    return trainer.train(learner, folder, on_step=on_step)


train_volume_net = partial(train_on, VOLUME_NET)


def test_a_training_that_was_stopped_goes_on_as_if_it_had_not_been(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(trainer, "_SAVE_SECONDS", 0.0)
    cameras = {"lens-00": [example(0), example(1)], HELD_OUT[0]: [example(2)]}
    whole, card, log = train_volume_net(cameras, tmp_path / "whole", steps=3)
    assert card.ended_by == "its number of steps"
    assert [row["step"] for row in log.losses] == [1, 2, 3]
    assert [row["learning_rate"] for row in log.losses] == pytest.approx([2e-5, 3e-5, 1.5e-5])
    assert log.scores[-1][HELD_OUT[0]] == card.further_scores["valid"]["nrmse"]
    part = tmp_path / "part"
    with pytest.raises(KeyboardInterrupt):
        train_volume_net(cameras, part, steps=3, on_step=stopping(2))
    resumed, _, after = train_volume_net(cameras, part, steps=3)
    assert after.losses == log.losses
    # The card names the machine that trained, not one that had nothing left to do.
    monkeypatch.setattr(trainer, "_environment", lambda learner: {"processor": "another"})
    assert train_volume_net(cameras, part, steps=3).card.environment == card.environment
    before, again = (load_weights(path, "volume-net")[0].state_dict() for path in (whole, resumed))
    assert all(torch.equal(before[name], again[name]) for name in before)


def test_examples_are_kept_and_damaged_ones_named(tmp_path: Path) -> None:
    def kept() -> dict[str, Sequence[Any]]:
        made = {"lens": lambda: {"truth": np.ones(3)}}
        return kept_examples(tmp_path, made, lambda arrays: [arrays["truth"]], None)

    np.testing.assert_array_equal(kept()["lens"], [np.ones(3)])
    whole = (tmp_path / "lens.npz").read_bytes()
    for damaged in (b"", whole[:100], whole[:-30], b"no archive"):
        (tmp_path / "lens.npz").write_bytes(damaged)
        with pytest.raises(InputError, match="damaged examples: "):
            kept()


def test_a_training_does_not_go_on_with_data_that_have_changed(
    tiny_store: Dataset, tmp_path: Path
) -> None:
    def trained() -> trainer.TrainingOutcome:
        made = {"lens-00": [example(0)]}
        learner = CameraLearner(VOLUME_NET, made, "made", steps=1, store=tiny_store)
        return trainer.train(learner, tmp_path / "t")

    assert trained().card.fingerprint == tiny_store.fingerprint
    tiny_store.attributes["fingerprint"] = "0" * 64
    with pytest.raises(InputError, match=r"of another training(.|\n)*fingerprint"):
        trained()


def test_depths_may_lie_unevenly_and_differ_between_captures() -> None:
    depths = torch.tensor([[0.0, 1.0, 5.0], [10.0, 30.0, 40.0]])
    mask, known = torch.zeros(2, 9 * 16, 2, 2), torch.ones(2, 8, 8, dtype=torch.bool)
    truth = torch.tensor([4.0, 15.0]).view(2, 1, 1).expand(2, 8, 8).contiguous()
    # The truth is shared by the two depths about it: 1 : 3 and 3 : 1.
    shares = torch.tensor([[1e-9, 0.25, 0.75], [0.75, 0.25, 1e-9]]).log()
    right = shares.view(2, 3, 1, 1).expand(2, 3, 2, 2)
    best = loss_of(right, mask, truth, depths, known)
    entropy = -(0.25 * torch.tensor(0.25).log() + 0.75 * torch.tensor(0.75).log())
    torch.testing.assert_close(best, entropy)
    for other in (right.roll(1, 1), right.flip(1), 2 * right):
        assert loss_of(other, mask, truth, depths, known) > best
        assert loss_of(other, mask, truth, depths, ~known) == 0
