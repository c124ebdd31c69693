"""No file that somebody hands over runs code when it is read: each is told as no such file."""

import io
import itertools
import json
import os
import pickle
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dfdbench.board.row_file import known_fingerprints, read_row
from dfdbench.building.export import STACK_FILE
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest_file import read_manifest
from dfdbench.errors import DfdbenchError
from dfdbench.evaluation.fitting import FIT, read_fit
from dfdbench.evaluation.loading import load_for
from dfdbench.evaluation.map_files import KeptMaps, find_predictions
from dfdbench.evaluation.photographs import read_images, read_stack
from dfdbench.evaluation.run import run_method
from dfdbench.methods.parameters import read_fields
from dfdbench.optics.lens_table import read_lens_table
from dfdbench.results.record import RESULT, load_result
from dfdbench.results.run_folder import PREDICTIONS, read_prediction
from dfdbench.results.saved_run import open_saved_run
from dfdbench.rig.lidar import read_beams, read_ranges
from dfdbench.rig.registration import read_registration
from leaderboard.published import load_published


class Trap:
    """Touches a file where its pickle is read."""

    def __init__(self, marker: Path) -> None:
        self.marker = marker

    def __reduce__(self) -> tuple[Any, ...]:
        return Path.touch, (self.marker,)


@pytest.fixture
def trap(tmp_path: Path) -> Iterator[Trap]:
    """A trap that went off in no test that uses it."""
    made = Trap(tmp_path / "sprung")
    yield made
    assert not made.marker.exists()


def as_pickle(trap: Trap) -> bytes:
    return pickle.dumps(trap)


def as_npy(trap: Trap) -> bytes:
    file = io.BytesIO()
    np.save(file, np.array([trap], object), allow_pickle=True)
    return file.getvalue()


def as_npz(trap: Trap) -> bytes:
    file = io.BytesIO()
    names = ("fitted_on", "seconds", "learned.level", "depth")
    np.savez(file, **dict.fromkeys(names, np.array(trap, object)))  # type: ignore[arg-type]
    return file.getvalue()


def as_torch(trap: Trap) -> bytes:
    torch = pytest.importorskip("torch", reason="needs the extra nets")
    file = io.BytesIO()
    torch.save({"version": 1, "identity": "{}", "state": trap}, file)
    return file.getvalue()


BAITS = [as_pickle, as_npy, as_npz, as_torch]


def test_the_traps_go_off_where_they_are_read_carelessly(tmp_path: Path) -> None:
    for bait in (as_pickle, as_npy, as_npz):
        trap = Trap(tmp_path / bait.__name__)
        found = np.load(io.BytesIO(bait(trap)), allow_pickle=True)
        if bait is as_npz:
            found["learned.level"]
        assert trap.marker.exists()


def nets(module: str) -> Any:
    """Import a module that may need PyTorch."""
    return pytest.importorskip(f"dfdbench.{module}", reason="needs the extra nets")


#: The name that a file has, and what reads it.
READERS: dict[str, Callable[[Path], object]] = {
    RESULT: load_result,
    "row.json": read_row,
    "run/result.json": lambda path: open_saved_run(path.parent),
    "published/table.json": lambda path: load_published(path.parents[1]),
    "fingerprints.json": lambda path: known_fingerprints(path.parent),
    "mine.toml": read_manifest,
    "defocus.png": lambda path: read_images([path]),
    STACK_FILE: lambda path: read_stack(path.parent),
    "recipe.toml": read_fields,
    "lens.csv": read_lens_table,
    "registration.json": read_registration,
    "beams.csv": read_beams,
    "ranges.npy": read_ranges,
    "ranges.txt": read_ranges,
    "ranges.bin": read_ranges,
    FIT: lambda path: read_fit(path.parent),
    "weights.safetensors": lambda path: nets("methods.networks.weights").load_weights(
        path, "u-net"
    ),
    "checkpoint.pt": lambda path: nets("training.trainer").TrainingFolder(path.parent).load({}),
    "training.toml": lambda path: nets("training.configuration").read_configuration(str(path)),
    "experiment.toml": lambda path: nets("training.experiments").find_experiment(str(path)),
}


@pytest.mark.filterwarnings("ignore:Detected pickle protocol")
@pytest.mark.parametrize("name", READERS)
def test_a_file_is_what_it_should_be_or_not_read(tmp_path: Path, trap: Trap, name: str) -> None:
    path = tmp_path / "theirs" / name
    path.parent.mkdir(parents=True)
    for bait in BAITS:
        path.write_bytes(bait(trap))
        with pytest.raises(DfdbenchError):
            READERS[name](path)
    # A pipe is not waited for, and a device not read to its end.
    for make in (os.mkfifo, partial(os.symlink, "/dev/zero")):
        path.unlink()
        make(path)
        with impatient(), pytest.raises(DfdbenchError):
            READERS[name](path)


@pytest.mark.parametrize("place", ["One/depth/zarr.json", "One/depth/c*", "zarr.json"])
def test_a_store_waits_for_no_pipe(tiny_store: Dataset, place: str) -> None:
    for path in Path(str(tiny_store.path)).glob(place):
        path.unlink()
        os.mkfifo(path)
    with impatient(), pytest.raises(DfdbenchError, match="not a regular file"):
        Dataset(tiny_store.path).read(tiny_store.pairs("One")[0])


def test_maps_wait_for_no_pipe(tmp_path: Path, tiny_store: Dataset) -> None:
    os.mkfifo(tmp_path / ".predicted.json")
    method = load_for(tiny_store, "constant", {"training_mean": 90.0})
    with impatient():
        assert KeptMaps(tmp_path, method, {}).set_aside is None


class StillWaitingError(BaseException):
    """What no reader takes for a file's fault."""


@contextmanager
def impatient() -> Iterator[None]:
    """Raise an error where somebody still waits after ten seconds."""

    def end(*_: object) -> None:
        raise StillWaitingError

    before = signal.signal(signal.SIGALRM, end)
    signal.alarm(10)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


def test_depth_maps_handed_in_run_nothing(tmp_path: Path, tiny_store: Dataset, trap: Trap) -> None:
    for bait, suffix in itertools.product(BAITS, (".npy", ".npz", ".png", ".tif")):
        folder = tmp_path / f"{bait.__name__}{suffix}"
        for pair in tiny_store.pairs("One"):
            path = folder / f"{pair.id}{suffix}"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(bait(trap))
        with pytest.raises(DfdbenchError, match="cannot be read"):
            find_predictions(folder, tiny_store, "One", "levels")


def make_old_zarr(folder: Path, trap: Trap, codecs: dict[str, Any]) -> None:
    """Write arrays of zarr's second format, whose codecs are named by the file: pickle is one."""
    folder.mkdir(parents=True)
    (folder / ".zgroup").write_text('{"zarr_format": 2}')
    (folder / ".zattrs").write_text('{"format": "dfdbench store", "format_version": 1}')
    array = folder / "depth"
    array.mkdir()
    description = {"zarr_format": 2, "shape": [1], "chunks": [1], "fill_value": None, "order": "C"}
    description |= {"dtype": "|u1", "compressor": None, "filters": None}
    (array / ".zarray").write_text(json.dumps(description | codecs))
    (array / ".zattrs").write_text('{"axes": {"view": [1]}}')
    (array / "0").write_bytes(as_pickle(trap))


PICKLE = {"id": "pickle", "protocol": 4}


def test_a_store_and_a_run_of_an_older_zarr_run_nothing(
    tmp_path: Path, tiny_store: Dataset, trap: Trap
) -> None:
    pair = tiny_store.pairs("One")[0]
    filters = {"filters": [PICKLE]}
    every: list[dict[str, Any]] = [{"compressor": PICKLE}, filters, {**filters, "dtype": "|O"}]
    for number, codecs in enumerate(every):
        folder = tmp_path / f"{number}"
        make_old_zarr(folder / "old.zarr", trap, codecs)
        with pytest.raises(DfdbenchError, match="not a data set built by dfdbench"):
            Dataset(folder / "old.zarr")
        make_old_zarr(folder / PREDICTIONS / pair.scene, trap, codecs)
        with pytest.raises(DfdbenchError, match="not a run's depth maps"):
            read_prediction(folder, pair, tiny_store.shape_of(pair.scene))


def test_a_store_names_no_codec_that_runs_code(tiny_store: Dataset, trap: Trap) -> None:
    folder = Path(str(tiny_store.path)) / "One/images"
    for chunk in folder.glob("c*"):
        chunk.write_bytes(as_pickle(trap))
    content = json.loads((folder / "zarr.json").read_text())
    for name in ("pickle", "numcodecs.pickle", "numcodecs.Pickle"):
        content["codecs"] = [{"name": name, "configuration": {"id": "pickle"}}]
        (folder / "zarr.json").write_text(json.dumps(content))
        with pytest.raises(DfdbenchError, match="cannot be read"):
            Dataset(tiny_store.path).read(tiny_store.pairs("One")[0])


def test_a_run_goes_on_without_odd_text(tmp_path: Path, tiny_store: Dataset, trap: Trap) -> None:
    method = load_for(tiny_store, "constant", {"training_mean": 90.0})
    folder = tmp_path / "out"
    for name in ("pairs.jsonl", "run.json"):
        run_method(tiny_store, method, "One", folder)
        (folder / name).write_bytes(as_pickle(trap))
        again = run_method(tiny_store, method, "One", folder)
        assert (again.reused, again.result.complete) == (0, True)
