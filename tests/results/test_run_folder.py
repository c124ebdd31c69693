import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import zarr

from dfdbench.datasets.dataset import Dataset
from dfdbench.errors import ResultError
from dfdbench.results.run_folder import (
    PREDICTIONS,
    Predictions,
    open_run_folder,
    read_identity,
    read_prediction,
)
from tests.system.test_files import kill_while_writing


def test_depth_maps_that_are_something_else_are_told(tiny_store: Dataset, tmp_path: Path) -> None:
    pair = tiny_store.pairs("test")[0]
    shape = tiny_store.shape_of(pair.scene)
    cases: list[Callable[[Path], object]] = [
        lambda depth: zarr.create_array(depth, shape=(2,), dtype="int8", overwrite=True),
        shutil.rmtree,
        lambda depth: zarr.open_array(depth, mode="a").attrs.update(axes={"colour": [1]}),
        lambda depth: (depth / "zarr.json").write_text("nonsense"),
        lambda depth: zarr.open_array(depth, mode="a").set_basic_selection(..., -0.5),
        lambda depth: zarr.open_array(depth, mode="a").set_basic_selection(..., 255.5),
    ]
    for number, spoil in enumerate(cases):
        run = tmp_path / str(number)
        Predictions(run, tiny_store.manifest).keep(pair, np.full(shape, 9, np.float32))
        assert read_prediction(run, pair, shape) is not None
        with pytest.raises(ResultError, match="not a run's depth maps"):
            read_prediction(run, pair, (shape[0] + 1, shape[1]))
        spoil(run / PREDICTIONS / pair.scene / "depth")
        with pytest.raises(ResultError, match="not a run's depth maps"):
            read_prediction(run, pair, shape)


def test_a_run_killed_while_its_identity_was_written_is_begun_anew(tmp_path: Path) -> None:
    kill_while_writing(tmp_path / "run.json")
    assert open_run_folder(tmp_path, {"entry": "mine"}, goes_on=False) is None
    assert read_identity(tmp_path) == {"entry": "mine"}
    (tmp_path / "run.json").rename(tmp_path / "thesis.txt")
    with pytest.raises(ResultError, match="something other than a run"):
        open_run_folder(tmp_path, {"entry": "mine"}, goes_on=False)
    assert (tmp_path / "thesis.txt").exists()
