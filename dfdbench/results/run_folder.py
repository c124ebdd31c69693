"""The folder of a run: its identity, finished pairs, depth maps, and where its store is."""

import itertools
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
import zarr
from numpy.typing import NDArray
from pydantic import TypeAdapter

from dfdbench.blur.recipe import LAST_LEVEL
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.fingerprint import array_digest
from dfdbench.datasets.manifest import Manifest, Pair
from dfdbench.errors import ResultError
from dfdbench.metrics.protocol import Unit
from dfdbench.results.output_place import RUN_IDENTITY
from dfdbench.results.record import Environment, PairResult, Result
from dfdbench.system.files import LARGEST_ARRAY, read_text, read_whole, whole_files, write_whole
from dfdbench.system.location import CHUNK_KEYS, Place, as_location, is_local, zarr_store
from dfdbench.system.text import parse_json
from dfdbench.tables.table import listed

_JOURNAL = "pairs.jsonl"
_STORE = "store.txt"
#: The suffix of a run that was set aside for a newer one; if there are several, they are numbered.
PREVIOUS = ".previous"
PREDICTIONS = "predictions.zarr"
#: What an identity says of the machines that the run was on.
ENVIRONMENTS = "environments"
Environments = TypeAdapter(list[Environment])


def open_run_folder(folder: Path, identity: Mapping[str, Any], goes_on: bool) -> Path | None:
    """Make a run's folder, or open the one that an earlier call of the same run left.

    Parameters
    ----------
    folder : Path
        Where the run goes.
    identity : mapping
        What must be the same to reuse the pairs of an earlier call.
    goes_on : bool
        Resume the run that is there, which is the same one according to `read_identity`.

    Returns
    -------
    Path or None
        Where an earlier run was moved, if it is a different one or is not to be resumed.

    Raises
    ------
    ResultError
        If the folder holds something else.
    """
    set_aside = None
    if whole_files(folder):
        if not (folder / RUN_IDENTITY).exists():
            what, fix = "the folder holds something other than a run", "choose another: --out"
            raise ResultError(what, where=str(folder), fix=fix)
        if not goes_on:
            set_aside = previous_of(folder)
            folder.rename(set_aside)
        else:
            maps = folder / PREDICTIONS
            for path in (folder / _JOURNAL, maps, *maps.rglob("*")):
                if path.is_symlink():
                    what = "a link where a run writes, and where it leads nobody said"
                    raise ResultError(what, where=str(path), fix="remove it, or say --fresh")
    folder.mkdir(parents=True, exist_ok=True)
    keep_identity(folder, identity)
    return set_aside


def previous_of(folder: Path) -> Path:
    """Return where to set a folder's content aside: the first free place with the suffix."""
    names = (f"{folder.name}{PREVIOUS}-{number}" for number in itertools.count(2))
    places = map(folder.with_name, itertools.chain([folder.name + PREVIOUS], names))
    return next(place for place in places if not place.exists())


def keep_identity(folder: Path, identity: Mapping[str, Any]) -> None:
    """Write down a run's identity."""
    write_whole(folder / RUN_IDENTITY, json.dumps(identity, indent=1) + "\n")


def read_identity(folder: Path) -> dict[str, Any] | None:
    """Return the identity of a folder's run; None if there is no run, empty if it is damaged."""
    path = folder / RUN_IDENTITY
    if not path.is_file():
        return None
    try:
        content: dict[str, Any] = parse_json(read_whole(path))
        Environments.validate_python(content.get(ENVIRONMENTS, []), strict=True)
    except (ValueError, AttributeError):  # of other fields, or no record at all
        return {}
    return content


def read_journal(folder: Path) -> dict[str, PairResult]:
    """Return the pairs that an earlier call finished, by id.

    Failed pairs and a line cut short by a kill are left out, so that they are tried again.
    """
    path = folder / _JOURNAL
    finished = {}
    if path.exists():
        # Bytes that are not text make a line unreadable, just like one cut short.
        for line in read_whole(path, LARGEST_ARRAY).decode("utf-8", "replace").splitlines():
            try:
                record = PairResult.model_validate_json(line)
            except ValueError:
                continue
            if record.status == "ok":
                finished[record.id] = record
        whole = "".join(record.model_dump_json() + "\n" for record in finished.values())
        write_whole(path, whole)
    return finished


def add_to_journal(folder: Path, record: PairResult) -> None:
    """Note a pair as finished."""
    with (folder / _JOURNAL).open("a", encoding="utf-8") as journal:
        journal.write(record.model_dump_json() + "\n")


def keep_store_place(folder: Path, place: Place) -> None:
    """Note on this machine where the data set is; results are shared and do not say it."""
    location = as_location(place)
    write_whole(folder / _STORE, f"{location.absolute() if is_local(location) else location}\n")


def read_store_place(folder: Path) -> str | None:
    """Return where the run's data set was, or None if no run in the folder noted it."""
    try:
        return read_text(folder / _STORE).strip()
    except (OSError, UnicodeDecodeError):
        return None


class Predictions:
    """The depth maps that a run keeps: one array per scene, indexed by the data set's axes.

    Parameters
    ----------
    folder : Path
        The run's folder.
    manifest : Manifest
        The data set.
    """

    def __init__(self, folder: Path, manifest: Manifest) -> None:
        self._folder, self._axes = folder, manifest.axes
        # Opened only once, since opening one takes as long as many methods need for a pair.
        self._arrays: dict[tuple[str, str], zarr.Array[Any]] = {}

    def has(self, pair: Pair) -> bool:
        """Return whether a depth map was kept of a pair; it is not read."""
        chunk = ".".join(map(str, ("c", *self._place(pair), 0, 0)))
        return (self._folder / PREDICTIONS / pair.scene / "depth" / chunk).is_file()

    def _place(self, pair: Pair) -> tuple[int, ...]:
        return tuple(self._axes[axis].index(value) for axis, value in pair.coordinates)

    def keep(
        self, pair: Pair, depth: NDArray[np.float32], sigma: NDArray[np.float32] | None = None
    ) -> None:
        """Keep a predicted depth map, shape (y, x), and each pixel's sigma, if there is one.

        Sigma is the standard deviation that the method gives; its array is beside the depth's.
        """
        index = self._place(pair)
        for name, values in (("depth", depth), ("sigma", sigma)):
            if values is None:
                continue
            if (pair.scene, name) not in self._arrays:
                self._arrays[pair.scene, name] = self._opened(pair.scene, name, values.shape)
            self._arrays[pair.scene, name][index] = values

    def _opened(self, scene: str, name: str, shape: tuple[int, ...]) -> zarr.Array[Any]:
        axes = self._axes
        group = zarr.open_group(self._folder / PREDICTIONS, path=scene, mode="a", zarr_format=3)
        if name in group:
            array = group[name]
            assert isinstance(array, zarr.Array)
            return array
        # `sel` finds depth maps by these values; one cut short by a kill is written again.
        for axis, values in axes.items():
            group.create_array(
                axis, data=np.asarray(values, np.int64), dimension_names=(axis,), overwrite=True
            )
        return group.create_array(
            name,
            shape=(*(len(values) for values in axes.values()), *shape),
            chunks=(*(1 for _ in axes), *shape),
            dtype="float32",
            fill_value=math.nan,
            chunk_key_encoding=CHUNK_KEYS,
            dimension_names=(*axes, "y", "x"),
            attributes={"axes": {axis: list(values) for axis, values in axes.items()}},
        )


def read_prediction(
    folder: Path,
    pair: Pair,
    shape: tuple[int, int],
    name: Literal["depth", "sigma"] = "depth",
    unit: Unit = "levels",
) -> NDArray[np.float32] | None:
    """Return a depth map that a run kept, shape (y, x), or None if there is none.

    Parameters
    ----------
    folder : Path
        The run's folder.
    pair : Pair
        The pair.
    shape : tuple of int
        The rows and columns that it must have: those of the images.
    name : {"depth", "sigma"}
        Depth, NaN where there is no answer, or its standard deviation according to the method.
    unit : {"levels", "metres"}
        The data set's. Levels end at 255.

    Raises
    ------
    ResultError
        If the folder holds something other than a run's depth maps.
    """
    place = folder / PREDICTIONS / pair.scene
    if not place.exists():
        return None
    try:
        # No earlier format, because one of its codecs can run code that the file chooses.
        group = zarr.open_group(zarr_store(as_location(place)), mode="r", zarr_format=3)
        if name == "sigma" and name not in group:
            return None
        array: Any = group[name]
        axes = array.attrs["axes"]
        index = tuple(values.index(pair.at[axis]) for axis, values in axes.items())
        fits = isinstance(array, zarr.Array) and array.dtype == np.float32
        if not fits or array.ndim != len(index) + 2 or array.shape[-2:] != shape:
            raise ValueError(f"{array}")
        found = np.asarray(array[index])
        there = found[~np.isnan(found)]
        most = LAST_LEVEL if name == "depth" and unit == "levels" else np.finfo(np.float32).max
        if not ((there >= 0) & (there <= most)).all():
            raise ValueError(f"{name} outside 0 to {most:g}")
    except (LookupError, ValueError, TypeError, AttributeError, OSError, RuntimeError) as error:
        maps = f"depth maps of {shape[0]} x {shape[1]} pixels, {pair.id} among them"
        fix = f"remove {place}, and run the method again: it makes what is missing"
        what = f"not a run's {maps}: {error!s:.200}"
        raise ResultError(what, where=str(place), fix=fix) from error
    return found if there.size else None


def answer_digest(depth: NDArray[np.float32], sigma: NDArray[np.float32] | None) -> str:
    """Return the SHA-256 of an answer: depth, shape (y, x), and sigma if there is one."""
    if sigma is None:
        return array_digest("depth", ("y", "x"), depth)
    return array_digest("depth and sigma", ("of", "y", "x"), np.stack([depth, sigma]))


def require_pairs_of(result: Result, store: Dataset, path: Path) -> None:
    """Raise if a result has pairs that its data set does not have.

    Raises
    ------
    ResultError
        If there are such pairs; it names the first.
    """
    known = {pair.id: pair.at for pair in store.manifest.pairs()}
    strange = [pair.id for pair in result.pairs if known.get(pair.id) != pair.coordinates]
    if strange:
        what = f"{store.manifest.stem} has no pair {listed(strange, most=1)}"
        raise ResultError(what, where=f"{path}: pairs", fix="run the method again")
