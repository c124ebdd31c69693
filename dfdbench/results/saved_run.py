"""A run as it lies on disk: its result, and its depth maps where they can be shown."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dfdbench.datasets.store import PairImages, Store, open_store
from dfdbench.errors import DfdbenchError, Problem, ResultError
from dfdbench.results.folder import PREDICTIONS, read_prediction, read_store_place, require_pairs_of
from dfdbench.results.record import PairResult, Result
from dfdbench.results.record_file import RESULT, load_result
from dfdbench.results.wording import method_label


@dataclass(frozen=True)
class SavedRun:
    """A result file, and the store that it was made with where it is at hand.

    Parameters
    ----------
    path : Path
        The result file.
    result : Result
        What it says.
    store : Store or None
        The data set; None where its images cannot be shown.
    without : str
        Why there are no images; empty where there are.
    """

    path: Path
    result: Result
    store: Store | None
    without: str

    @property
    def label(self) -> str:
        """The method with its parameters."""
        return method_label(self.result.method)

    def images(self, pair: PairResult) -> tuple[PairImages, NDArray[np.float32]] | None:
        """Return a pair's images and the depth predicted for it, shape (y, x); None without.

        Raises
        ------
        ResultError
            Where what lies beside the result are no depth maps of its pairs.
        """
        if self.store is None:
            return None
        prediction = read_prediction(self.path.parent, pair.pair, self.store.shape_of(pair.scene))
        if prediction is None:
            return None
        return self.store.read(pair.pair), prediction


def open_run(path: Path, dataset: str | None = None) -> SavedRun:
    """Open a run by its result file or its folder.

    Parameters
    ----------
    path : Path
        ``result.json``, or the folder that it lies in.
    dataset : str, optional
        The store's path; if not given, the place that the run noted in its folder, or else the
        data set that the result names, in the default place.

    Raises
    ------
    ResultError
        Where there is no result or it is damaged.
    StoreError
        Where a store was named and is none, or holds other data.
    """
    if path.is_dir() and not (path / RESULT).exists():
        raise ResultError.of(_no_run(path))
    file = path / RESULT if path.is_dir() else path
    result = load_result(file)
    if not (file.parent / PREDICTIONS).is_dir():
        return SavedRun(file, result, None, "no depth maps lie beside the result")
    found: Store | None
    if dataset:
        store = open_store(dataset)
        if store.fingerprint != result.dataset.fingerprint:
            raise ResultError(
                "the store holds other data than the run was made with",
                where=str(file),
                expected=result.dataset.fingerprint,
                got=store.fingerprint,
            )
        found, without = store, ""
    else:
        found, without = _find_store(file.parent, result)
    if found:
        require_pairs_of(result, found, file)
    return SavedRun(file, result, found, without)


def _find_store(folder: Path, result: Result) -> tuple[Store | None, str]:
    """Return the store that a run was made with, or None and why there is none."""
    wanted = result.dataset.fingerprint
    noted = read_store_place(folder)
    without = ""
    if noted:
        with contextlib.suppress(DfdbenchError):
            store = Store(noted)
            if store.fingerprint == wanted:
                return store, ""
        without = "the data that it was run on are not where they were: --dataset PATH names them"
    try:
        store = open_store(result.dataset.name)
    except DfdbenchError as error:
        return None, without or error.problems[0].what
    if store.fingerprint == wanted:
        return store, ""
    return None, without or f"the built {result.dataset.short} set holds other data"


def _no_run(folder: Path) -> Problem:
    below = [found.parent for depth in ("*", "*/*") for found in folder.glob(f"{depth}/{RESULT}")]
    names = ", ".join(map(str, sorted(below)[:3])) + (", ..." if len(below) > 3 else "")
    return Problem(
        "no run in this folder",
        where=str(folder),
        expected=f"a folder with {RESULT}, or a result file",
        fix=f"name the runs: {names}" if below else "`dfdbench run` makes one",
    )
