import shutil
from pathlib import Path

import numpy as np
import pytest

from dfdbench.datasets.dataset import Dataset
from dfdbench.errors import InputError, ResultError, StoreError
from dfdbench.evaluation.run import run_method
from dfdbench.evaluation.scored import score_predictions
from dfdbench.results.record import load_result
from dfdbench.results.run_folder import read_prediction
from dfdbench.results.run_tables import run_tables
from dfdbench.results.summary import summarise
from tests.evaluation.made_methods import grey, method
from tests.evaluation.made_predictions import in_metres, write_all


def test_it_scores_as_a_run_does_and_says_that_nothing_was_run(
    tiny_store: Dataset, tmp_path: Path
) -> None:
    ran = run_method(tiny_store, method(grey), "test", tmp_path / "run").result
    for pair in tiny_store.pairs("test"):
        path = tmp_path / "made" / f"{pair.id}.npy"
        path.parent.mkdir(parents=True, exist_ok=True)
        np.save(path, tiny_store.read(pair).infocus[..., 0])
    done = score_predictions(tmp_path / "made", tiny_store, "test", tmp_path / "out", "mine")
    result = load_result(done.folder)
    assert result == done.result
    assert (result.averages, result.protocols) == (ran.averages, ran.protocols)
    for mine, its in zip(result.pairs, ran.pairs, strict=True):
        assert (mine.scores, mine.prediction_sha256) == (its.scores, its.prediction_sha256)
        assert (mine.warnings, mine.seconds) == (its.warnings, None)
    assert (result.method.scored, result.method.source_sha256) == ("levels", None)
    titles = [table.title for table in run_tables(summarise(result, "thesis"))]
    assert titles[0].startswith("mine (scored, not run) on tiny-1")
    assert not any("seconds" in title for title in titles)
    pair = tiny_store.pairs("test")[0]
    kept = read_prediction(done.folder, pair, tiny_store.shape_of(pair.scene))
    assert kept is not None
    np.testing.assert_array_equal(kept, tiny_store.read(pair).infocus[..., 0])


def test_nothing_is_written_where_a_file_is_wrong(tiny_store: Dataset, tmp_path: Path) -> None:
    (tmp_path / "made").mkdir()
    with pytest.raises(ResultError, match="pairs without a depth map: 7"):
        score_predictions(tmp_path / "made", tiny_store, "test", tmp_path / "out", "mine")
    assert not (tmp_path / "out").exists()
    with pytest.raises(InputError, match="no name for a method"):
        score_predictions(tmp_path / "made", tiny_store, "test", tmp_path / "out", "a\nb")


def test_what_looks_like_another_unit_is_said(tiny_store: Dataset, tmp_path: Path) -> None:
    write_all(tiny_store, "all", tmp_path / "a", lambda stem, d: np.save(f"{stem}.npy", d / 255))
    said = score_predictions(tmp_path / "a", tiny_store, "test", tmp_path / "out", "mine").result
    assert "no depth map rises above level 1; levels go from 0 to 255" in said.warnings
    assert "4 files are of other pairs of the set, and were not scored" in said.warnings
    store, _ = in_metres(tiny_store)
    write_all(store, "test", tmp_path / "b", lambda stem, d: np.save(f"{stem}.npy", 1 + d / 200))
    done = score_predictions(tmp_path / "b", store, "test", tmp_path / "out", "mine", "metres")
    assert done.set_aside == tmp_path / "out.previous"
    assert done.result.method.scored == "metres"
    (told,) = [text for text in done.result.warnings if "beyond" in text]
    assert told.endswith("of all pixels lie beyond 0.5 to 2 m and count as the end")


def test_pairs_that_the_store_lacks_are_asked_of_nobody(
    tiny_store: Dataset, tmp_path: Path
) -> None:
    write_all(tiny_store, "test", tmp_path / "made", lambda stem, d: np.save(f"{stem}.npy", d))
    shutil.rmtree(Path(str(tiny_store.path)) / "Three")
    partial = Dataset(tiny_store.path)
    with pytest.raises(StoreError, match="has lost scenes"):
        score_predictions(tmp_path / "made", partial, "test", tmp_path / "out", "m")
    # As of a build that was lacking the scene's files.
    lacking = partial.manifest.pairs_of_scene("Three")
    partial.attributes["missing_pairs"] = [pair.id for pair in lacking]
    result = score_predictions(tmp_path / "made", partial, "test", tmp_path / "out", "m").result
    assert [pair.status for pair in result.pairs].count("missing") == 3
    assert result.averages is None
