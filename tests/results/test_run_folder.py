import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr

from dfdbench.datasets.dataset import Dataset
from dfdbench.errors import ResultError
from dfdbench.results import run_folder
from tests.system.test_files import kill_while_writing


def kept(place: Path) -> Any:
    return zarr.open_array(place / "depth", mode="a")


def test_depth_maps_that_are_something_else_are_told(tiny_store: Dataset, tmp_path: Path) -> None:
    spoils: list[Callable[[Path], object]] = [
        lambda place: zarr.create_array(place / "depth", shape=2, dtype="int8", overwrite=True),
        lambda place: shutil.rmtree(place / "depth"),
        lambda place: kept(place).attrs.update(axes={"colour": [1]}),
        lambda place: (place / "depth/zarr.json").write_text("nonsense"),
        lambda place: kept(place).set_basic_selection(..., -0.5),
        lambda place: kept(place).set_basic_selection(..., 255.5),
    ]
    pair = tiny_store.pairs("test")[0]
    shape = tiny_store.shape_of(pair.scene)
    for number, spoil in enumerate(spoils):
        folder, nine = tmp_path / f"{number}", np.full(shape, 9, np.float32)
        run_folder.Predictions(folder, tiny_store.manifest).keep(pair, nine)
        assert run_folder.read_prediction(folder, pair, shape) is not None
        with pytest.raises(ResultError, match="not a run's depth maps"):
            run_folder.read_prediction(folder, pair, (shape[0] + 1, shape[1]))
        run_folder.Predictions(folder, tiny_store.manifest).keep(pair, 99 * nine)
        assert run_folder.read_prediction(folder, pair, shape, unit="metres") is not None
        spoil(folder / run_folder.PREDICTIONS / pair.scene)
        with pytest.raises(ResultError, match="not a run's depth maps"):
            run_folder.read_prediction(folder, pair, shape)


def test_a_run_killed_while_its_identity_was_written_is_begun_anew(tmp_path: Path) -> None:
    kill_while_writing(tmp_path / "run.json")
    assert run_folder.open_run_folder(tmp_path, {"entry": "mine"}, goes_on=False) is None
    assert run_folder.read_identity(tmp_path) == {"entry": "mine"}
    (tmp_path / "run.json").rename(tmp_path / "thesis.txt")
    with pytest.raises(ResultError, match="something other than a run"):
        run_folder.open_run_folder(tmp_path, {"entry": "mine"}, goes_on=False)


def test_a_run_goes_on_in_its_own_folder_only(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    run_folder.open_run_folder(folder, {"entry": "mine"}, goes_on=False)
    maps = folder / run_folder.PREDICTIONS
    for place in (folder / "pairs.jsonl", maps, maps / "Art"):
        place.parent.mkdir(exist_ok=True)
        place.symlink_to(tmp_path / "elsewhere")
        with pytest.raises(ResultError, match="a link where a run writes"):
            run_folder.open_run_folder(folder, {"entry": "mine"}, goes_on=True)
        place.unlink()
    (folder / "pairs.jsonl").symlink_to(tmp_path / "elsewhere")
    assert run_folder.open_run_folder(folder, {"entry": "mine"}, goes_on=False)


def test_a_note_that_is_no_text_names_no_place(tmp_path: Path) -> None:
    (tmp_path / "store.txt").write_bytes(b"\xff")
    assert run_folder.read_store_place(tmp_path) is None
