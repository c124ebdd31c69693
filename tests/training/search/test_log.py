import math
import time
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
import torch

from dfdbench.datasets.dataset import Dataset
from dfdbench.errors import InputError, ResultError
from dfdbench.methods.networks.architectures import DfDNet
from dfdbench.methods.networks.choices import FILTERS
from dfdbench.methods.networks.inference import Predictor
from dfdbench.methods.networks.weights import load_weights
from dfdbench.system.files import hold
from dfdbench.training.search import log as keeping
from dfdbench.training.search.search_plan import SearchPlan
from dfdbench.training.task import mean_scores
from tests.methods.networks.test_architectures import SMALL
from tests.system.test_files import kill_while_writing
from tests.training.search.made_searches import position_of, small_plan, some_rows, some_swarm


def opened(plan: SearchPlan, path: Path) -> keeping.SearchFolder:
    folder = keeping.SearchFolder(path)
    folder.open(plan.identity)
    return folder


@pytest.fixture
def plan(tiny_store: Dataset) -> SearchPlan:
    return small_plan(tiny_store, particles=3)


@pytest.fixture
def path(plan: SearchPlan, tmp_path: Path) -> Path:
    folder = opened(plan, tmp_path / "s")
    for row in some_rows(plan):
        folder.note(row)
    return tmp_path / "s"


def work_of(row: keeping.LogRow) -> dict[str, Any]:
    return {name: value for name, value in vars(row).items() if name != "position"}


def test_what_is_noted_is_read_again_bit_for_bit(plan: SearchPlan, path: Path) -> None:
    again = opened(plan, path)
    assert list(again.rows) == [(0, 0), (0, 1), (0, 2)]
    found = again.rows_of(some_swarm(plan))
    assert [row.place for row in found] == [(0, 0), (0, 1), (0, 2)]
    for row, noted in zip(found, some_rows(plan), strict=True):
        assert np.array_equal(row.position, noted.position)
    assert work_of(found[0]) == work_of(some_rows(plan)[0])
    assert (found[2].objective, found[2].failed) == (np.inf, "diverged: at step 3")


def test_a_line_that_a_kill_cut_short_is_left_out(plan: SearchPlan, path: Path) -> None:
    log = path / "positions.csv"
    text = log.read_text()
    for cut in (1, 5, len(text.splitlines()[-1])):
        log.write_text(text[:-cut])
        assert len(opened(plan, path).rows) == 2
        assert log.read_text() == "".join(text.splitlines(keepends=True)[:-1])
    log.write_text(text[: len(text) // 8])
    assert len(opened(plan, path).rows) == 0
    # Killed before it said what it is, a search begins again.
    kill_while_writing(path.with_name("other") / "search.json")
    assert len(opened(plan, path.with_name("other")).rows) == 0


def changed(text: str, column: str, value: str) -> str:
    """Return a log with another value in its second line."""
    rows = [row.split(",") for row in text.splitlines()]
    rows[1][rows[0].index(column)] = value
    return "\n".join(map(",".join, rows)) + "\n"


def test_a_log_that_cannot_be_is_named_and_kept(plan: SearchPlan, path: Path) -> None:
    log = path / "positions.csv"
    text = log.read_text()
    for wrong, said in (
        (changed(text, "objective", "nan"), "objective: no number"),
        (changed(text, "objective", "0.1"), "objective 0.1, and 0.5 by its scores"),
        (changed(text, "train_nrmse", "0.01"), "by its scores"),
        (changed(text, "particle", "first"), "line 2"),
        (text.replace("\n0,1,", "\n0,1,,", 1), "line 3"),
        (text.replace("width_8", "width"), "width_8"),
        (text + text.splitlines()[1] + "\n", "twice"),
    ):
        log.write_text(wrong)
        with pytest.raises(InputError, match=said):
            opened(plan, path)
        assert log.read_text() == wrong


def evaluated(
    store: Dataset, folder: Path, until: float = math.inf, **configuration: Any
) -> keeping.LogRow | None:
    evaluate = keeping.Evaluation(small_plan(store, configuration), folder, "cpu", 1, until)
    return evaluate(((0, 1), position_of(FILTERS["original"], crop=12)))


@pytest.mark.slow
def test_a_particle_is_trained_and_scored_on_both_sets(tiny_store: Dataset, tmp_path: Path) -> None:
    outcome = evaluated(tiny_store, tmp_path)
    assert outcome is not None
    assert (outcome.failed, outcome.steps) == ("", 2)
    assert outcome.objective == keeping.objective(outcome.scores, 0.3) < math.inf
    weights = keeping.training_folder(tmp_path, (0, 1)) / "weights.safetensors"
    card = load_weights(weights, "dfd-net")[1]
    assert (card.parameters, card.seed) == (outcome.parameters, 1310249577)
    assert "less " in card.trained_on
    again = evaluated(tiny_store, tmp_path)  # gone on with, nothing is left to train
    assert again is not None
    assert work_of(again) == work_of(outcome)


def test_a_training_that_fails_is_infinitely_bad(
    tiny_store: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for raised, said in (
        (None, "diverged: the loss became nan, step"),
        (RuntimeError("CUDA out of memory\nmore"), "failed: CUDA out of memory"),
        (MemoryError(), "failed: MemoryError"),
    ):
        if raised:
            monkeypatch.setattr(keeping, "train", Mock(side_effect=raised))
        outcome = evaluated(tiny_store, tmp_path / said[:12], learning_rate=1e30, steps=5)
        assert outcome is not None
        assert outcome.objective == math.inf
        assert outcome.failed.startswith(said)


def test_time_is_up_before_and_within_a_training(tiny_store: Dataset, tmp_path: Path) -> None:
    assert evaluated(tiny_store, tmp_path, time.time()) is None
    assert not (tmp_path / "particles/000-001").exists()
    assert evaluated(tiny_store, tmp_path, time.time() + 0.5, steps=100_000) is None
    assert (tmp_path / "particles/000-001/checkpoint.pt").exists()
    # No two processes train the same particle.
    taken = hold(tmp_path / "particles/.000-001.lock", InputError("taken"))
    with taken, pytest.raises(ResultError, match="another training is writing this folder"):
        evaluated(tiny_store, tmp_path)


def test_eq_6_1_by_hand() -> None:
    train = {"train_nrmse": 0.06, "train_nmae": 0.02, "train_ssim": 0.9}
    test = {"other_nrmse": 0.10, "other_nmae": 0.04, "other_ssim": 0.8}
    assert keeping.objective(train | test, 0.3) == pytest.approx(0.3 * 0.18 + 0.7 * 0.34)
    assert keeping.objective(train | test, 1.0) == pytest.approx(0.18)
    broken = {"train_ssim": math.nan}, {"other_ssim": math.nan}
    for scores in (train, test, *(train | test | other for other in broken)):
        assert keeping.objective(scores, 0.3) == keeping.objective(scores, 1.0) == math.inf


def test_the_author_scores_the_centre_and_divides_by_255(tiny_store: Dataset) -> None:
    assert keeping.CENTRE == (368, 400)
    torch.manual_seed(3)
    network, cpu, pairs = DfDNet(SMALL).eval(), torch.device("cpu"), tiny_store.pairs("test")[:1]
    images = tiny_store.read(pairs[0])
    levels = Predictor(network, cpu)(images.infocus, images.defocus)
    # The images have 24 rows and 30 columns.
    errors = levels[4:20].astype(float) - images.levels[4:20]
    scored = mean_scores(network, tiny_store, pairs, cpu, "mode", [keeping.OF_CENTRE], (16, 400))
    found = scored[keeping.OF_CENTRE.label]
    assert found["nmae"] == pytest.approx(np.abs(errors).mean() / 255, abs=1e-6)
    assert found["nrmse"] == pytest.approx(np.sqrt((errors**2).mean()) / 255, abs=1e-6)
    assert found["ssim"] != mean_scores(network, tiny_store, pairs, cpu)["thesis"]["ssim"]
