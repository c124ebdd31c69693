from pathlib import Path

import numpy as np
import pytest

from dfdbench.audit import depth_errors
from dfdbench.audit.sides import scene_histograms, side_of
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.depth_scale import DepthScale
from dfdbench.errors import ResultError
from dfdbench.evaluation.loading import load_for
from dfdbench.evaluation.run import RunDone, run_method

SCALE = DepthScale(law="inverse", near=0.5, far=5.0)


def with_metres(store: Dataset) -> Dataset:
    """The store, as if its manifest said what its levels are in metres."""
    depth = store.manifest.depth.model_copy(update={"scale": SCALE})
    store.__dict__["manifest"] = store.manifest.model_copy(update={"depth": depth})
    return store


@pytest.fixture
def run(tiny_store: Dataset, tmp_path: Path) -> RunDone:
    method = load_for(tiny_store, "constant", {"training_mean": 60.0})
    return run_method(tiny_store, method, "test", tmp_path / "run")


def test_errors_are_those_of_all_known_pixels_by_their_depth(
    tiny_store: Dataset, run: RunDone
) -> None:
    store = with_metres(Dataset(tiny_store.path))
    found = depth_errors.depth_errors(store, run.result, run.folder, "mine")
    depths = [store.read_levels(pair) for pair in store.pairs("test")]
    known = np.concatenate([depth[valid] for depth, valid in depths]).astype(float)
    whole = np.ones(256, bool)
    assert found.levels.pixels.sum() == known.size == found.answers.sum()
    assert found.levels.mean(whole) == pytest.approx(np.abs(known - 60).mean())
    assert found.metres is not None
    off = np.abs(SCALE.to_metres(np.array([60.0])) - SCALE.to_metres(known))
    assert found.metres.mean(whole) == pytest.approx(off.mean())
    # Every answer is 60, whatever the truth.
    assert found.answers[:, 60].sum() == known.size
    assert (found.answers.sum(axis=1) == found.levels.pixels).all()
    constant = depth_errors.constant_errors(store, run.result, 60.0, "constant")
    assert (constant.levels.absolute == found.levels.absolute).all()


def test_the_table_has_a_row_a_band_that_occurs_and_metres_where_they_are_told(
    tiny_store: Dataset, run: RunDone
) -> None:
    store = with_metres(Dataset(tiny_store.path))
    found = [depth_errors.depth_errors(store, run.result, run.folder, name) for name in ("a", "b")]
    levels, metres = depth_errors.depth_error_tables(store, "test", found)
    assert levels.columns == metres.columns == ("levels", "metres", "of all", "a", "b")
    there = np.flatnonzero(found[0].levels.pixels)
    assert len(levels.rows) == len(np.unique(there // 16)) + 1
    first = levels.rows[0][0].split("-")
    near_end, far_end = (f"{SCALE.to_metres(np.array([int(e)]))[0]:.2f}" for e in first[::-1])
    assert levels.rows[0][1] in (f"{near_end} to {far_end}", f"{far_end} to {far_end}")
    assert levels.rows[-1][3] == f"{found[0].levels.mean(np.ones(256, bool)):.2f}"
    untold = depth_errors.depth_error_tables(tiny_store, "test", found)
    assert [table.columns for table in untold] == [("levels", "of all", "a", "b")]


def test_runs_of_different_pairs_are_not_set_side_by_side(
    tiny_store: Dataset, run: RunDone, tmp_path: Path
) -> None:
    method = load_for(tiny_store, "constant", {"training_mean": 60.0})
    other = run_method(tiny_store, method, "train", tmp_path / "other")
    found = [
        depth_errors.depth_errors(tiny_store, one.result, one.folder, "x") for one in (run, other)
    ]
    with pytest.raises(ResultError, match="different pairs"):
        depth_errors.depth_error_tables(tiny_store, "test", found)


def test_levels_stand_sixteen_a_row_and_each_by_itself_as_data(tiny_store: Dataset) -> None:
    side = side_of(tiny_store, scene_histograms(tiny_store), "Three", ("Three",))
    counts = side.histogram.counts
    table = depth_errors.level_count_table(side)
    assert table.title == "depths of tiny-1, Three (3 pairs of 1 scene)"
    assert [row[0] for row in table.rows][::15] == ["0-15", "240-255"]
    assert [int(row[1].replace(",", "")) for row in table.rows] == [
        counts[first : first + 16].sum() for first in range(0, 256, 16)
    ]
    assert [record["pixels"] for record in table.records] == counts.tolist()
    assert np.isclose(sum(float(str(record["share"])) for record in table.records), 1)


def test_levels_that_do_not_occur_are_named_and_scenes_that_are_not_there(
    tiny_store: Dataset,
) -> None:
    histograms = scene_histograms(tiny_store)
    del histograms["Two"]
    side = side_of(tiny_store, histograms, "all", ("One", "Two", "Three"))
    counts = side.histogram.counts
    table = depth_errors.level_count_table(side)
    absent = [row[3] for row in table.rows]
    assert [gaps == "all" for gaps in absent] == [
        not counts[first : first + 16].any() for first in range(0, 256, 16)
    ]
    assert table.notes[-1] == "not in the store, so not counted: Two"
