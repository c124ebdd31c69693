from __future__ import annotations

import math
import time
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("torch", reason="needs the extra nets")

from dfdbench.datasets.store import Store
from dfdbench.errors import InputError, ResultError
from dfdbench.methods.networks.choices import FILTERS
from dfdbench.methods.networks.weights import load_weights
from dfdbench.system.work_folder import hold
from dfdbench.training.search import evaluation as module
from dfdbench.training.search.evaluation import Job, evaluate
from dfdbench.training.search.objective import objective
from dfdbench.training.search.particle import position_of
from tests.training.search.made_searches import small_plan


def job(store: Store, folder: Path, until: float = math.inf, **configuration: Any) -> Job:
    plan = small_plan(store, configuration)
    position = position_of(FILTERS["original"], crop=12)
    return plan.job(plan.work("cpu", 1, until), 0, 1, position, folder / "000-001")


def test_a_particle_is_trained_and_scored_on_both_sets(tiny_store: Store, tmp_path: Path) -> None:
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
        (None, "diverged: the loss is no number any more, step"),
        (RuntimeError("CUDA out of memory\nmore"), "failed: CUDA out of memory"),
        (MemoryError(), "failed: MemoryError"),
    ],
)
def test_a_training_that_fails_is_infinitely_bad(
    tiny_store: Store,
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
    tiny_store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: Any, **__: Any) -> None:
        raise ResultError("cannot write the training", got="No space left on device")

    monkeypatch.setattr(module, "train", fail)
    with pytest.raises(ResultError, match="No space left"):
        evaluate(job(tiny_store, tmp_path))


def test_time_is_up_before_and_within_a_training(tiny_store: Store, tmp_path: Path) -> None:
    assert evaluate(job(tiny_store, tmp_path, until=time.time())) is None
    assert not (tmp_path / "000-001").exists()
    late = job(tiny_store, tmp_path, until=time.time() + 0.5, steps=100_000)
    assert evaluate(late) is None
    assert (tmp_path / "000-001/checkpoint.pt").exists()


def test_no_two_processes_train_the_same_particle(tiny_store: Store, tmp_path: Path) -> None:
    taken = InputError("taken")
    with (
        hold(tmp_path / ".000-001.lock", taken),
        pytest.raises(InputError, match="another process is training this particle"),
    ):
        evaluate(job(tiny_store, tmp_path))
