import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dfdbench.audit import run_errors
from dfdbench.audit.coverage import CoverageRecord, Verdict, compare_depths
from dfdbench.audit.leaks import Leak
from dfdbench.audit.sides import sides_of
from dfdbench.audit.trained_on import Training
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest import Pair
from dfdbench.datasets.manifest_file import parse_manifest
from dfdbench.errors import ResultError
from dfdbench.evaluation.evaluate import score_predictions
from dfdbench.evaluation.loading import load_for
from dfdbench.evaluation.run import RunDone, run_method
from tests.conftest import store_of
from tests.evaluation.made_predictions import in_metres
from tests.made_stack_folder import STACK_TOML, make_stacks

DEPTH = np.array([[9, 9, 80, 0]], np.uint8)
ERRORS = run_errors.level_errors(DEPTH, DEPTH > 0, np.array([[13, 3, 80.5, 200]], np.float32))
NINE = np.arange(256) == 9


def test_errors_go_by_true_level_and_leave_unknown_pixels_out() -> None:
    assert (ERRORS.pixels.sum(), ERRORS.mean(NINE)) == (3, 5)
    assert ERRORS.root_mean_square(NINE) == pytest.approx(math.sqrt((16 + 36) / 2))
    assert ERRORS.share(NINE) == pytest.approx(2 / 3)
    assert math.isnan(ERRORS.mean(np.arange(256) == 7))
    # The mean is 10.5 / 3 = 3.5; if level 9 did as level 80 it would be 0.5.
    assert ERRORS.excess(NINE) == pytest.approx(1 - 0.5 / 3.5)
    assert ERRORS.excess(~NINE) < 0
    assert math.isnan(ERRORS.excess(np.ones(256, bool)))


def errors_of(levels: dict[int, tuple[int, float]]) -> run_errors.LevelErrors:
    """The errors of some pixels of each level, by level: how many, and by how much."""
    pixels, absolute, squared = np.zeros(256, np.int64), np.zeros(256), np.zeros(256)
    for level, (count, error) in levels.items():
        pixels[level], absolute[level], squared[level] = count, count * error, count * error**2
    return run_errors.LevelErrors(pixels, absolute, squared)


def join_of(scarce: float, share: int = 20) -> run_errors.ErrorJoin:
    """Level 9 is scarce and 100 covered; of 100 pixels of scene a some share is scarce."""
    of_level = {verdict: np.zeros(256, bool) for verdict in Verdict}
    of_level[Verdict.scarce][9] = True
    of_level[Verdict.covered][100] = True
    pairs = {
        Pair("a", ()): errors_of({9: (share, scarce), 100: (100 - share, 2.0)}),
        Pair("b", ()): errors_of({100: (100, 2.0)}),
    }
    return run_errors.ErrorJoin(pairs, of_level)


@pytest.fixture(scope="module")
def record(tiny_set: Path) -> CoverageRecord:
    return compare_depths(*sides_of(Dataset(tiny_set / "tiny.zarr")))


def test_the_conclusion_follows_from_errors_training_and_leaks(record: CoverageRecord) -> None:
    for join, training, told in (
        (join_of(22.0), Training.known, "fall by 50.0 %: the errors gather where training lacks"),
        (join_of(22.0), Training.none, "fall by 50.0 %; the method names no training"),
        (join_of(22.0), Training.unknown, "is not known: its trained_on names no scenes"),
        (join_of(1.0), Training.known, "fall by 0 %: most of the error has another cause"),
        (join_of(9.0, share=0), Training.known, "what is wrong is not coverage"),
        (join_of(9.0, share=0), Training.unknown, "what the method was trained on is not known"),
    ):
        assert told in run_errors.conclusion(join, record, training)
    leak = Leak(kind="scene", train="a", test="a", detail="all")
    leaky = record.model_copy(update={"leaks": [leak, leak]})
    told = run_errors.conclusion(join_of(22.0), leaky, Training.known)
    assert told.startswith("training holds 2 scenes of the test: these errors say nothing")


def test_tables_have_means_by_verdict_and_by_scene() -> None:
    table = run_errors.error_table(join_of(22.0), "title", "meaning")
    assert [row[:4] for row in table.rows] == [
        ("covered", "180", "90.0 %", "2.00"),
        ("scarce", "20", "10.0 %", "22.00"),
        ("missing", "0", "0 %", "–"),
        ("all known", "200", "100.0 %", "4.00"),
    ]
    assert table.notes == ("meaning",)
    assert run_errors.scene_table(join_of(22.0)).rows == (
        ("a", "20.0 %", "2.00", "22.00", "–", "66.7 %"),
        ("b", "0 %", "2.00", "–", "–", "–"),
    )


def test_only_a_runs_own_predictions_are_joined(
    tiny_store: Dataset, tmp_path: Path, run: RunDone, record: CoverageRecord
) -> None:
    join = run_errors.join_errors(tiny_store, run.result, run.folder, record)
    assert list(join.pairs) == [pair.pair for pair in run.result.pairs]
    truth = [tiny_store.read_levels(pair)[1].sum() for pair in tiny_store.pairs("test")]
    assert join.total.pixels.sum() == sum(truth)
    first = run.result.pairs[0].model_copy(update={"prediction_sha256": "0" * 64})
    edited = run.result.model_copy(update={"pairs": [first, *run.result.pairs[1:]]})
    with pytest.raises(ResultError, match="is not the result's"):
        run_errors.join_errors(tiny_store, edited, run.folder, record)
    with pytest.raises(ResultError, match="no prediction was kept"):
        run_errors.join_errors(tiny_store, run.result, tmp_path / "nowhere", record)


@pytest.fixture(scope="module")
def run(tiny_set: Path, tmp_path_factory: pytest.TempPathFactory) -> RunDone:
    store = Dataset(tiny_set / "tiny.zarr")
    method = load_for(store, "constant", {"training_mean": 60.0})
    return run_method(store, method, "test", tmp_path_factory.mktemp("runs") / "run")


def test_errors_are_those_of_known_pixels_by_depth(tiny_store: Dataset, run: RunDone) -> None:
    store, scale = in_metres(Dataset(tiny_store.path))
    found = run_errors.depth_errors(store, run.result, run.folder, "mine")
    depths = [store.read_levels(pair) for pair in store.pairs("test")]
    known = np.concatenate([depth[valid] for depth, valid in depths]).astype(float)
    assert found.levels.pixels.sum() == known.size == found.answers.sum()
    assert found.levels.mean() == pytest.approx(np.abs(known - 60).mean())
    assert found.metres is not None
    off = np.abs(scale.to_metres(np.array([60.0])) - scale.to_metres(known))
    assert found.metres.mean() == pytest.approx(off.mean())
    # Every answer is 60, whatever the truth.
    assert found.answers[:, 60].sum() == known.size
    assert (found.answers.sum(axis=1) == found.levels.pixels).all()
    constant = run_errors.constant_errors(store, run.result, 60.0, "constant")
    assert (constant.levels.absolute == found.levels.absolute).all()


def test_the_truth_itself_is_not_off_where_depth_lies_between_levels(tmp_path: Path) -> None:
    manifest = parse_manifest(STACK_TOML.encode(), "mine-1.toml")
    store = store_of(manifest, make_stacks(tmp_path / "mine"), tmp_path / "one.zarr")
    maps = tmp_path / "maps"
    for pair in store.pairs("test"):
        (maps / pair.id).parent.mkdir(parents=True)
        np.save(maps / f"{pair.id}.npy", store.read(pair).depth)
    done = score_predictions(maps, store, "test", tmp_path / "out", "mine", "metres")
    found = run_errors.depth_errors(store, done.result, done.folder, "mine")
    assert found.metres is not None
    assert [found.levels.mean(), found.metres.mean()] == pytest.approx([0, 0], abs=1e-4)


def test_the_table_has_a_row_a_band_that_occurs_and_metres_where_they_are_told(
    tiny_store: Dataset, run: RunDone
) -> None:
    store, scale = in_metres(Dataset(tiny_store.path))
    found = [run_errors.depth_errors(store, run.result, run.folder, name) for name in ("a", "b")]
    levels, metres = run_errors.depth_error_tables(store, "test", found)
    assert levels.columns == metres.columns == ("levels", "metres", "of all", "a", "b")
    there = np.flatnonzero(found[0].levels.pixels)
    assert len(levels.rows) == len(np.unique(there // 16)) + 1
    first = levels.rows[0][0].split("-")
    near_end, far_end = (f"{scale.to_metres(np.array([int(e)]))[0]:.2f}" for e in first[::-1])
    assert levels.rows[0][1] in (f"{near_end} to {far_end}", f"{far_end} to {far_end}")
    assert levels.rows[-1][3] == f"{found[0].levels.mean():.2f}"
    untold = run_errors.depth_error_tables(tiny_store, "test", found)
    assert [table.columns for table in untold] == [("levels", "of all", "a", "b")]
    half = replace(found[1].levels, pixels=found[1].levels.pixels // 2)
    some = [found[0], replace(found[1], levels=half)]
    gaps = run_errors.depth_error_tables(tiny_store, "test", some)
    assert "for want of answers: b " in gaps[0].notes[0]
    assert "for want of answers" not in untold[0].notes[0]
    blank = found[0].levels.pixels * (np.arange(256) > there[0] + 16)
    fewest = [replace(found[1], levels=replace(half, pixels=blank)), found[0]]
    bands = [row[:2] for row in run_errors.depth_error_tables(tiny_store, "test", fewest)[0].rows]
    assert bands == [row[:2] for row in untold[0].rows]
    fewer = run.result.model_copy(update={"pairs": run.result.pairs[1:]})
    found[1] = run_errors.depth_errors(store, fewer, run.folder, "b")
    with pytest.raises(ResultError, match="different pairs"):
        run_errors.depth_error_tables(tiny_store, "test", found)
