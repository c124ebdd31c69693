import csv
import hashlib
import io
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest import Manifest
from dfdbench.errors import InputError
from dfdbench.evaluation.loading import load_for
from dfdbench.evaluation.run import run_method
from dfdbench.methods.networks.weights import load_weights
from dfdbench.training import trainer
from dfdbench.training.configuration import TrainingConfiguration
from dfdbench.training.learner import Learner
from dfdbench.training.task import Task, task_of
from dfdbench.training.trainer import Log, OnStep, TrainingFolder, TrainingOutcome
from tests.conftest import store_of, write_png
from tests.methods.networks.test_architectures import SMALL
from tests.system.test_files import kill_while_writing

QUICK = {"filters": list(SMALL), "crop": 16, "crops_per_step": 1, "learning_rate": 1e-3}
QUICK |= {"steps": 12, "evaluate_every": 5, "evaluate_pairs": 1}


def task(store: Dataset, seed: int = 0, **changes: Any) -> Task:
    choices = TrainingConfiguration.model_validate(QUICK | changes)
    return task_of("dfd-net", store, choices, seed=seed)


def train(
    task: Task, folder: Path, max_seconds: float | None = None, on_step: OnStep | None = None
) -> TrainingOutcome:
    return trainer.train(Learner(task, "cpu"), folder, max_seconds, on_step)


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open() as file:
        return list(csv.DictReader(file))


def losses(folder: Path) -> list[str]:
    return [row["loss"] for row in rows_of(folder / "losses.csv")]


def test_a_training_leaves_weights_card_and_log(tiny_store: Dataset, tmp_path: Path) -> None:
    outcome = train(task(tiny_store), tmp_path / "t")
    network, card = load_weights(outcome.weights, "dfd-net")
    assert (card, card.steps, card.ended_by) == (outcome.card, 12, "its number of steps")
    assert (card.trained_on, card.scored_on) == ("tiny-1, split train", "test, 7 pairs")
    assert list(card.further_scores) == ["thesis-networks-2"]
    assert card.fingerprint == tiny_store.fingerprint
    means = network.state_dict()["pixels.means"].flatten().tolist()
    assert card.architecture["channel_means"] == pytest.approx(means)
    assert len(losses(tmp_path / "t")) == 12
    rows = rows_of(tmp_path / "t/scores.csv")
    assert [row["step"] for row in rows] == ["5", "10"]
    assert all(float(row["train_nmae"]) > 0 and float(row["test_nrmse"]) > 0 for row in rows)
    assert all(float(row["test_thesis-networks-2_nrmse"]) > 0 for row in rows)
    levels = rows_of(tmp_path / "t/depth_levels.csv")
    assert sum(int(row["trained"]) for row in levels) == 12 * 8 * 16 * 16
    assert sum(int(row["present"]) for row in levels) == 4 * 24 * 30


@pytest.mark.slow
def test_seeds_differ_and_repeat_and_the_card_keeps_the_precision_that_auto_came_to(
    tiny_store: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(torch.cpu, "get_capabilities", dict)
    outcome = train(task(tiny_store, precision="auto", steps=2), tmp_path / "t")
    assert outcome.card.configuration["precision"] == "float32"
    train(task(tiny_store, precision="float32", steps=2), tmp_path / "n")
    assert losses(tmp_path / "t") == losses(tmp_path / "n")
    train(task(tiny_store, 1, precision="float32", steps=2), tmp_path / "other")
    assert losses(tmp_path / "other") != losses(tmp_path / "n")
    # Gone on with where `auto` is something else, the losses would be others: it is refused.
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {"amx_bf16": True})
    with pytest.raises(InputError, match="precision"):
        train(task(tiny_store, precision="auto", steps=2), tmp_path / "t")


def stopping(at: int) -> OnStep:
    """Return what stops a training at a step, as Ctrl-C does."""

    def stop(step: int, steps: int | None) -> None:
        if step == at:
            raise KeyboardInterrupt

    return stop


@pytest.mark.slow
@pytest.mark.parametrize("schedule", ["dlib", "cosine"])
def test_stopped_and_resumed_it_has_the_same_losses_bit_for_bit(
    tiny_store: Dataset, tmp_path: Path, schedule: str
) -> None:
    whole = train(task(tiny_store, schedule=schedule), tmp_path / "whole")
    for stop in (4, 9):
        interrupt = stopping(stop)
        # Stopped by the clock, which writes a checkpoint, then by a hand that does not.
        train(task(tiny_store, schedule=schedule), tmp_path / "parts", 1e-9)
        with pytest.raises(KeyboardInterrupt):
            train(task(tiny_store, schedule=schedule), tmp_path / "parts", on_step=interrupt)
    parts = train(task(tiny_store, schedule=schedule), tmp_path / "parts")
    for name in ("losses.csv", "depth_levels.csv"):
        assert rows_of(tmp_path / "parts" / name) == rows_of(tmp_path / "whole" / name)
    networks = [load_weights(outcome.weights, "dfd-net")[0] for outcome in (whole, parts)]
    for one, other in zip(*(network.state_dict().values() for network in networks), strict=True):
        assert torch.equal(one, other)


@pytest.mark.slow
def test_time_is_up(tiny_store: Dataset, tmp_path: Path) -> None:
    outcome = train(task(tiny_store), tmp_path / "t", 1e-9)
    assert (outcome.card.steps, outcome.card.ended_by) == (1, "its time limit")
    assert not outcome.within_warm_up
    early = task(tiny_store, schedule="cosine", warm_up=5)
    outcome = train(early, tmp_path / "early", 1e-9)
    assert outcome.card.ended_by == "its time limit, within the warm-up, at step 1 of 5"
    assert outcome.within_warm_up
    assert not train(early, tmp_path / "early").within_warm_up


@pytest.mark.slow
def test_training_goes_on_from_weights_and_says_so(tiny_store: Dataset, tmp_path: Path) -> None:
    first = train(task(tiny_store), tmp_path / "first")
    more = replace(task(tiny_store, learning_rate=1e-9, steps=1), start=first.weights)
    second = train(more, tmp_path / "second")
    assert second.card.started_from.startswith("tiny-1, split train, 12 steps")
    assert float(losses(tmp_path / "second")[0]) < float(losses(tmp_path / "first")[0])
    third = train(replace(more, start=second.weights), tmp_path / "third")
    assert "; that from tiny-1, split train, 12 steps" in third.card.started_from
    with pytest.raises(InputError, match="start"):
        train(replace(more, start=second.weights), tmp_path / "second")
    wider = replace(task(tiny_store, narrow=2), start=first.weights)
    with pytest.raises(InputError, match="another network"):
        train(wider, tmp_path / "wider")
    # With fixed normalization the means stay.
    fine = replace(task(tiny_store, normalization="fixed"), start=first.weights)
    outcomes = first, train(fine, tmp_path / "fine")
    before, after = (load_weights(o.weights, "dfd-net")[0].state_dict() for o in outcomes)
    same = {name for name in before if torch.equal(before[name], after[name])}
    assert {name for name in before if "running" in name} <= same < before.keys()


@pytest.mark.slow
def test_an_unusual_network_is_trained_loaded_and_told_from_others(
    tiny_store: Dataset, tmp_path: Path
) -> None:
    kinds = ["srelu", "elu", "tanh", "relu", "prelu", "sigmoid", "elu", "srelu", "relu"]
    bits, kernels = [False] * 4 + [True] * 5, [[5, 1], *[3] * 12, 1]
    unusual = task(tiny_store, kernels=kernels, activations=kinds, normalized=bits, crop=12)
    outcome = train(unusual, tmp_path / "first")
    network, card = load_weights(outcome.weights, "dfd-net")
    assert network.get_parameter("entry.activate.pieces").shape == (4,)
    assert card.configuration["kernels"][0] == [5, 1]
    train(replace(unusual, start=outcome.weights), tmp_path / "second")
    # What the one says and the other leaves out differs, too.
    usual = replace(task(tiny_store, crop=12), start=outcome.weights)
    with pytest.raises(InputError, match="kernels"):
        train(usual, tmp_path / "third")


def noise_scenes(folder: Path) -> None:
    """Scenes of noise, whose blur is plain to see: boxes at a few depths."""
    random = np.random.default_rng(8)
    for scene in ("One", "Two", "Three"):
        for view in (1, 5):
            depth = np.full((72, 96), 60, np.uint8)
            for _ in range(6):
                top, left = random.integers(0, 48), random.integers(0, 64)
                depth[top : top + 24, left : left + 32] = random.choice([60, 130, 200])
            write_png(folder / scene / f"disp{view}.png", depth)
            for exposure in (0, 1):
                noise = random.integers(0, 256, (72, 96, 3)).astype(np.uint8)
                write_png(folder / scene / f"Illum1/Exp{exposure}/view{view}.png", noise)


@pytest.mark.slow
def test_a_tiny_dfd_net_beats_constant_on_a_cpu(tiny_manifest: Manifest, tmp_path: Path) -> None:
    noise_scenes(tmp_path / "site")
    store = store_of(tiny_manifest, tmp_path / "site", tmp_path / "tiny.zarr")
    choices = TrainingConfiguration(
        narrow=8, crops_per_step=6, expansion="one", learning_rate=1e-3, weight_decay=0,
        initial_filters="differences", label_width=5, schedule="cosine", steps=200,
        evaluate_every=10_000,
    )  # fmt: skip
    outcome = train(task_of("dfd-net", store, choices), tmp_path / "t")
    learned = load_for(store, "dfd-net", {"weights": str(outcome.weights), "device": "cpu"})
    constant = load_for(store, "constant", {})
    scores = {}
    for method in (learned, constant):
        averages = run_method(store, method, "test", tmp_path / method.name).result.averages
        assert averages is not None
        scores[method.name] = averages["thesis"]
    for metric in ("nrmse", "nmae"):
        assert scores["dfd-net"][metric] < 0.7 * scores["constant"][metric]  # type: ignore[operator]


IDENTITY = {"method": "dfd-net", "configuration": {"crop": 32, "noise": 0.0, "betas": (0.5, 0.99)}}
LOG = Log(
    [{"step": step, "learning_rate": 0.1, "loss": step / 3} for step in range(1, 5)],
    [{"step": 2}, {"step": 4, "test_nmae": 0.5}],
)


@pytest.fixture
def folder(tmp_path: Path) -> TrainingFolder:
    made = TrainingFolder(tmp_path / "training")
    made.save(IDENTITY, {"step": 4, "network": torch.ones(2)}, LOG)
    return made


def test_a_training_killed_before_its_first_file_is_none_and_no_stranger(tmp_path: Path) -> None:
    kill_while_writing(tmp_path / "training/losses.csv")
    assert not TrainingFolder(tmp_path / "training").foreign


def test_what_was_saved_comes_back_to_the_same_training_alone(folder: TrainingFolder) -> None:
    state, log = folder.load(IDENTITY)
    assert torch.equal(state["network"], torch.ones(2))
    assert log == LOG
    assert (folder.path / "scores.csv").read_text() == "step,test_nmae\n2,\n4,0.5\n"
    other = {"method": "u-net", "configuration": IDENTITY["configuration"] | {"noise": 2.0}}  # type: ignore[operator]
    with pytest.raises(InputError) as caught:
        folder.load(other)
    assert [problem.what.partition("with ")[2] for problem in caught.value.problems] == [
        "method dfd-net instead of u-net",
        "configuration.noise 0.0 instead of 2.0",
    ]


def test_a_checkpoint_that_was_changed_is_refused(folder: TrainingFolder) -> None:
    path = folder.path / "checkpoint.pt"
    content = path.read_bytes()
    half, flipped = content[: len(content) // 2], bytearray(content)
    flipped[200] ^= 1
    for damaged in (b"", b"hello", half, content[:500], bytes(flipped), content + b"x"):
        path.write_bytes(damaged)
        with pytest.raises(InputError, match="damaged checkpoint"):
            folder.load(IDENTITY)
    path.unlink()
    path.mkdir()
    with pytest.raises(InputError, match="cannot read the checkpoint: Is a directory"):
        folder.load(IDENTITY)


def test_a_checkpoint_runs_no_code(folder: TrainingFolder) -> None:
    class Evil:
        def __reduce__(self) -> tuple[object, tuple[str]]:
            return (pytest.fail, ("it ran",))

    content = io.BytesIO()
    torch.save({"evil": Evil()}, content)
    body = content.getvalue()
    (folder.path / "checkpoint.pt").write_bytes(body + hashlib.sha256(body).digest())
    with pytest.raises(Exception, match="weights_only"):
        folder.load(IDENTITY)
