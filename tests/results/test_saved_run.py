from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dfdbench.api import run as evaluate
from dfdbench.audit.coverage import compare_depths
from dfdbench.audit.run_errors import join_errors
from dfdbench.audit.sides import sides_of
from dfdbench.datasets.dataset import Dataset
from dfdbench.errors import ResultError
from dfdbench.evaluation.loading import load_for
from dfdbench.evaluation.run import run_method
from dfdbench.figures.audits import mask_figure
from dfdbench.results.record import save_result
from dfdbench.results.saved_run import SavedRun, distinguished, open_saved_run
from dfdbench.system.thumbnails import depth_map
from tests.made_folder import SHAPE, built
from tests.made_results import make_demo_result, make_result
from tests.made_stack_folder import make_stacks


def test_a_folder_of_runs_names_them(tmp_path: Path) -> None:
    with pytest.raises(ResultError, match="`dfdbench run` makes one"):
        open_saved_run(tmp_path)
    for name in ("a", "b"):
        place = tmp_path / f"demo-1-test/{name}/result.json"
        save_result(make_result({("a", 1, 1, 0): 0.1}), place)
    assert open_saved_run(tmp_path / "demo-1-test/a").label == "mine"
    for folder in (tmp_path, tmp_path / "demo-1-test"):
        with pytest.raises(ResultError, match=r"name the runs: .*demo-1-test/a, .*demo-1-test/b"):
            open_saved_run(folder)


def test_a_run_on_a_path_finds_its_store_again(
    tiny_store: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    constant = load_for(tiny_store, "constant", {})
    run_method(Dataset(Path("tiny.zarr")), constant, "test", Path("out"))
    monkeypatch.chdir("/")
    found = open_saved_run(tmp_path / "out")
    assert found.store is not None
    assert found.without == ""
    assert found.images(found.result.pairs[0]) is not None
    # Elsewhere, or overwritten by another build: told, not shown.
    (tmp_path / "tiny.zarr").rename(tmp_path / "moved.zarr")
    moved = open_saved_run(tmp_path / "out")
    assert moved.store is None
    assert "--dataset" in moved.without
    assert "<img" not in moved._repr_html_()
    assert open_saved_run(tmp_path / "out", str(tmp_path / "moved.zarr")).store is not None
    (tmp_path / "out/store.txt").unlink()
    assert "unknown data set" in open_saved_run(tmp_path / "out").without


def test_a_run_shows_its_worst_pairs_worst_first(tiny_store: Dataset) -> None:
    run = evaluate(lambda infocus, defocus: defocus.mean(axis=2), tiny_store, protocol="thesis")
    text = run._repr_html_()
    assert "protocol thesis" in text
    worst = run.to_frame("thesis")["nrmse"].nlargest(3).index
    places = [text.index(f"{pair}, in-focus") for pair in worst]
    assert places == sorted(places)
    assert text.count("<img") == 3 * 4
    assert "prediction: NRMSE" in text


def test_metres_are_shown_as_bright_as_they_are_near(tmp_path: Path) -> None:
    def predict(stack: Any) -> Any:
        return np.where(np.arange(SHAPE[1]) < 9, 4.0, 1.0) * np.ones((SHAPE[0], 1))

    predict.unit = "metres"  # type: ignore[attr-defined]
    _, store = built(make_stacks(tmp_path / "mine"))
    levels = np.where(np.arange(SHAPE[1]) < 9, 1, 255) * np.ones((SHAPE[0], 1))
    shown, _ = depth_map(levels.astype(np.uint8), np.ones(SHAPE, bool), "")
    run = evaluate(predict, store)
    assert shown in run._repr_html_()
    join = join_errors(store, run.result, run.folder, compare_depths(*sides_of(store)))
    drawn = mask_figure(store, run.result, run.folder, join).axes[1].images[0].get_array()
    np.testing.assert_allclose(np.asarray(drawn), levels, atol=1e-3)


def test_runs_of_one_label_are_told_apart_by_places() -> None:
    same = make_demo_result(lambda _: 0.1)
    for paths, labels in (
        (["v1/result.json", "v2/result.json"], ["mine (v1)", "mine (v2)"]),
        (["a/x/result.json", "b/x/result.json"], ["mine (a/x)", "mine (b/x)"]),
        (["old.json", "new.json"], ["mine (old)", "mine (new)"]),
    ):
        runs = [SavedRun(Path(path), same, None, "") for path in paths]
        assert [each.label for each in distinguished(runs)] == labels
