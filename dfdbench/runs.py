"""A run as it lies on disk: its result, and its depth maps where they can be shown."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dfdbench.errors import DfdbenchError, Problem, ResultError
from dfdbench.manifest import Pair
from dfdbench.result import PairResult, Result, load_result
from dfdbench.run_folder import PREDICTIONS, RESULT, read_prediction, require_pairs_of
from dfdbench.store import PairImages, Store, open_store
from dfdbench.submission import method_label


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
        place = Pair(pair.scene, tuple(pair.coordinates.items()))
        prediction = read_prediction(self.path.parent, place, self.store.shape_of(pair.scene))
        if prediction is None:
            return None
        return self.store.read(place), prediction


def open_run(path: Path, dataset: str | None = None) -> SavedRun:
    """Open a run by its result file or its folder.

    Parameters
    ----------
    path : Path
        ``result.json``, or the folder that it lies in.
    dataset : str, optional
        The store's path; the data set that the result names, in the default place, if not given.

    Raises
    ------
    ResultError
        Where there is no result or it is damaged.
    StoreError
        Where a store was named and is none, or holds other data.
    """
    if path.is_dir() and not (path / RESULT).exists():
        raise ResultError(_no_run(path))
    file = path / RESULT if path.is_dir() else path
    result = load_result(file)
    if not (file.parent / PREDICTIONS).is_dir():
        return SavedRun(file, result, None, "no depth maps lie beside the result")
    try:
        store = open_store(dataset or result.dataset.short)
    except DfdbenchError as error:
        if dataset:
            raise
        return SavedRun(file, result, None, error.problems[0].what)
    if store.fingerprint == result.dataset.fingerprint:
        require_pairs_of(result, store, file)
        return SavedRun(file, result, store, "")
    if dataset:
        raise ResultError(
            Problem(
                "the store holds other data than the run was made with", str(file),
                result.dataset.fingerprint, store.fingerprint,
            )
        )  # fmt: skip
    return SavedRun(file, result, None, f"the built {result.dataset.short} set holds other data")


def _no_run(folder: Path) -> Problem:
    below = [found.parent for depth in ("*", "*/*") for found in folder.glob(f"{depth}/{RESULT}")]
    names = ", ".join(map(str, sorted(below)[:3])) + (", ..." if len(below) > 3 else "")
    return Problem(
        "no run in this folder", str(folder), f"a folder with {RESULT}, or a result file",
        fix=f"name the runs: {names}" if below else "`dfdbench run` makes one",
    )  # fmt: skip
