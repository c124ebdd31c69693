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


def other_dtype(place: Path) -> None:
    zarr.open_group(place, mode="a").create_array("depth", shape=(2,), dtype="int8", overwrite=True)


def no_array(place: Path) -> None:
    shutil.rmtree(place / "depth")


def other_axes(place: Path) -> None:
    zarr.open_group(place, mode="a")["depth"].attrs["axes"] = {"colour": [1]}


def no_metadata(place: Path) -> None:
    (place / "depth/zarr.json").write_text("nonsense")


def below_0(place: Path) -> None:
    zarr.open_array(place / "depth", mode="a")[...] = -0.5


def above_255(place: Path) -> None:
    zarr.open_array(place / "depth", mode="a")[...] = 255.5


@pytest.mark.parametrize(
    "spoil", [other_dtype, no_array, other_axes, no_metadata, below_0, above_255]
)
def test_depth_maps_that_are_something_else_are_told(
    tiny_store: Dataset, tmp_path: Path, spoil: Callable[[Path], None]
) -> None:
    pair = tiny_store.pairs("test")[0]
    shape = tiny_store.shape_of(pair.scene)
    Predictions(tmp_path, tiny_store.manifest).keep(pair, np.full(shape, 9, np.float32))
    assert read_prediction(tmp_path, pair, shape) is not None
    with pytest.raises(ResultError, match="not a run's depth maps"):
        read_prediction(tmp_path, pair, (shape[0] + 1, shape[1]))
    spoil(tmp_path / PREDICTIONS / pair.scene)
    with pytest.raises(ResultError, match="not a run's depth maps"):
        read_prediction(tmp_path, pair, shape)


def test_a_run_killed_while_its_identity_was_written_is_begun_anew(tmp_path: Path) -> None:
    kill_while_writing(tmp_path / "run.json")
    assert open_run_folder(tmp_path, {"entry": "mine"}, goes_on=False) is None
    assert read_identity(tmp_path) == {"entry": "mine"}
    (tmp_path / "run.json").rename(tmp_path / "thesis.txt")
    with pytest.raises(ResultError, match="something other than a run"):
        open_run_folder(tmp_path, {"entry": "mine"}, goes_on=False)
