from __future__ import annotations

import math
import time
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("torch", reason="needs the extra nets")
import numpy as np
import pytest

from dfdbench.datasets.dataset import Dataset
from dfdbench.errors import InputError, ResultError
from dfdbench.methods.networks.choices import FILTERS
from dfdbench.methods.networks.weights import load_weights
from dfdbench.system.work_folder import hold
from dfdbench.training.search import evaluation as module
from dfdbench.training.search.evaluation import Job, evaluate, objective
from dfdbench.training.search.particle import position_of
from tests.training.search.made_searches import small_plan

pytest.importorskip("torch", reason="needs the extra nets")
import torch

from dfdbench.methods.networks.architectures import DfDNet
from dfdbench.methods.networks.inference import Predictor
from dfdbench.training.scoring import mean_scores
from dfdbench.training.search.evaluation import mean_parts
from tests.methods.networks.test_architectures import SMALL


def job(store: Dataset, folder: Path, until: float = math.inf, **configuration: Any) -> Job:
    plan = small_plan(store, configuration)
    position = position_of(FILTERS["original"], crop=12)
    return plan.job(plan.work("cpu", 1, until), 0, 1, position, folder / "000-001")


def test_a_particle_is_trained_and_scored_on_both_sets(tiny_store: Dataset, tmp_path: Path) -> None:
    asked = job(tiny_store, tmp_path)
    outcome = evaluate(asked)
    assert outcome is not None
    assert (outcome.failed, outcome.steps) == ("", 2)
    assert outcome.value == objective(outcome.train, outcome.other, 0.3) < math.inf
    card = load_weights(asked.folder / "weights.safetensors", "dfd-net")[1]
    assert (card.seed, card.parameters) == (asked.seed, outcome.parameters)
    assert "less " in card.trained_on
    assert evaluate(asked) == outcome  # gone on with, nothing is left to train


@pytest.mark.parametrize(
    ("raised", "told"),
    [
        (None, "diverged: the loss became nan, step"),
        (RuntimeError("CUDA out of memory\nmore"), "failed: CUDA out of memory"),
        (MemoryError(), "failed: MemoryError"),
    ],
)
def test_a_training_that_fails_is_infinitely_bad(
    tiny_store: Dataset,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    raised: Exception | None,
    told: str,
) -> None:
    def fail(*_: Any, **__: Any) -> None:
        assert raised is not None
        raise raised

    if raised:
        monkeypatch.setattr(module, "train", fail)
    outcome = evaluate(job(tiny_store, tmp_path, learning_rate=1e30, steps=5))
    assert outcome is not None
    assert outcome.value == math.inf
    assert outcome.failed.startswith(told)


def test_what_says_nothing_of_the_network_is_raised(
    tiny_store: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: Any, **__: Any) -> None:
        raise ResultError("cannot write the training", got="No space left on device")

    monkeypatch.setattr(module, "train", fail)
    with pytest.raises(ResultError, match="No space left"):
        evaluate(job(tiny_store, tmp_path))


def test_time_is_up_before_and_within_a_training(tiny_store: Dataset, tmp_path: Path) -> None:
    assert evaluate(job(tiny_store, tmp_path, until=time.time())) is None
    assert not (tmp_path / "000-001").exists()
    late = job(tiny_store, tmp_path, until=time.time() + 0.5, steps=100_000)
    assert evaluate(late) is None
    assert (tmp_path / "000-001/checkpoint.pt").exists()


def test_no_two_processes_train_the_same_particle(tiny_store: Dataset, tmp_path: Path) -> None:
    taken = InputError("taken")
    with (
        hold(tmp_path / ".000-001.lock", taken),
        pytest.raises(InputError, match="another process is training this particle"),
    ):
        evaluate(job(tiny_store, tmp_path))


CPU = torch.device("cpu")


def test_eq_6_1_by_hand() -> None:
    train = {"nrmse": 0.06, "nmae": 0.02, "ssim": 0.9}
    test = {"nrmse": 0.10, "nmae": 0.04, "ssim": 0.8}
    assert objective(train, test, 0.3) == pytest.approx(0.3 * 0.18 + 0.7 * 0.34)
    assert objective(train, test, 1.0) == pytest.approx(0.18)
    for broken in ({}, test | {"ssim": math.nan}, {"nrmse": 0.1, "nmae": 0.1}):
        assert objective(train, broken, 0.3) == math.inf
        assert objective(broken, test, 1.0) == math.inf


def network() -> Any:
    torch.manual_seed(3)
    return DfDNet(SMALL).eval()


def test_whole_images_are_scored_as_trainings_are(tiny_store: Dataset) -> None:
    pairs = tiny_store.pairs("test")[:3]
    found = mean_parts(network(), tiny_store, pairs, CPU, "mode", centre=False)
    assert found == mean_scores(network(), tiny_store, pairs, CPU)["thesis"]


def test_the_author_scores_the_centre_and_divides_by_255(
    tiny_store: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "CENTRE", (16, 400))  # the images have 24 rows and 30 columns
    (pair,) = tiny_store.pairs("test")[:1]
    images = tiny_store.read(pair)
    levels = Predictor(network(), CPU)(images.infocus, images.defocus)
    depth, answer = images.depth[4:20], levels[4:20].astype(np.float32)
    found = mean_parts(network(), tiny_store, [pair], CPU, "mode", centre=True)
    errors = answer.astype(float) - depth
    assert found["nmae"] == pytest.approx(np.abs(errors).mean() / 255, abs=1e-6)
    assert found["nrmse"] == pytest.approx(np.sqrt((errors**2).mean()) / 255, abs=1e-6)
    whole = mean_parts(network(), tiny_store, [pair], CPU, "mode", centre=False)
    assert found["ssim"] != whole["ssim"]
