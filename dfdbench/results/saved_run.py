"""A run on disk: its result, its label, and its depth maps if they can be shown."""

import os
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dfdbench.datasets.captures import Capture
from dfdbench.datasets.dataset import Dataset, open_dataset
from dfdbench.errors import DfdbenchError, Problem, ResultError, spelt_out, unknown_name
from dfdbench.results import output_place, run_folder, run_tables, summary, wording
from dfdbench.results.record import RESULT, PairResult, Result, load_result, shown_protocol
from dfdbench.system.thumbnails import depth_map, gallery
from dfdbench.tables.table import as_html, counted, grouped, listed

#: The number of worst pairs that a notebook shows.
_WORST = 3
# How many characters of an error a line shows.
_LONGEST = 100


@dataclass(frozen=True)
class SavedRun:
    """A result file, and the store that it was made with, if available.

    Parameters
    ----------
    path : Path
        The result file.
    result : Result
        Its content.
    store : Dataset or None
        The data set; None if its images cannot be shown.
    without : str
        Why there are no images; empty if there are.
    place : str
        What the label adds to tell it from another run of the same method: see
        `dfdbench.results.saved_run.distinguished`.
    """

    path: Path
    result: Result
    store: Dataset | None
    without: str
    place: str = ""

    def __repr__(self) -> str:
        on = self.result.dataset
        failed = [pair.error or "" for pair in self.result.pairs if pair.status == "failed"]
        why = spelt_out(failed[0].partition("\n")[0][:_LONGEST]) if failed else ""
        return (
            f"<run of {self.label} on {on.name}, split {on.split}: "
            f"{on.evaluated} of {counted(on.expected, 'pair')}"
            + (f", {len(failed)} failed: {why}>" if failed else ">")
        )

    @property
    def label(self) -> str:
        """The method with its parameters, and the place if it is needed."""
        label = wording.method_label(self.result.method)
        return f"{label} ({self.place})" if self.place else label

    def images(self, pair: PairResult | str) -> tuple[Capture, NDArray[np.float32]] | None:
        """Return a pair's images and its predicted depth, shape (y, x), or None if not available.

        Parameters
        ----------
        pair : PairResult or str
            The record of a pair, or its name.

        Raises
        ------
        UnknownNameError
            If the run has no pair of that name.
        ResultError
            If the files beside the result are not its depth maps, or are another run's, or the
            folder is gone.
        """
        if isinstance(pair, str):
            records = {record.id: record for record in self.result.pairs}
            if pair not in records:
                raise unknown_name("pair of the run", pair, records)
            pair = records[pair]
        if self.store is None:
            return None
        of_pair = self.path.parent, pair.pair, self.store.shape_of(pair.scene)
        prediction = run_folder.read_prediction(*of_pair, "depth", self.store.manifest.depth.kind)
        if prediction is None and not self.path.parent.exists():
            # A run's temporary folder goes with it, even while a copy is in another process.
            fix = "give the run a folder, which stays: out=FOLDER"
            raise ResultError("the run's folder is gone", where=str(self.path.parent), fix=fix)
        if prediction is None or pair.prediction_sha256 is None:
            return None
        sigma = run_folder.read_prediction(*of_pair, "sigma")
        if run_folder.answer_digest(prediction, sigma) != pair.prediction_sha256:
            raise self._replaced()
        return self.store.read(pair.pair), prediction

    def require_in_place(self) -> None:
        """Raise if another run has since been written to this run's folder.

        Raises
        ------
        ResultError
            If the result file has changed.
        """
        if load_result(self.path) != self.result:
            raise self._replaced()

    def _replaced(self) -> ResultError:
        folder = self.path.parent
        moved = f"{folder.name}{run_folder.PREVIOUS}"
        fix = f"look in {moved} beside it, where an earlier run is moved; or run the method again "
        fix += "with --fresh"
        return ResultError("the folder holds another run than this", where=str(folder), fix=fix)

    def _repr_html_(self, protocol: str | None = None) -> str:
        protocol = protocol or shown_protocol(self.result)
        rows = []
        for pair in summary.ranked(self.result, protocol)[::-1][:_WORST]:
            if (found := self.images(pair)) is None:
                continue
            images, prediction = found
            (infocus, _), *others = images.thumbnails()
            scores = ", ".join(map(" ".join, wording.titled_scores(pair, protocol)))
            answered, levels = ~np.isnan(prediction), images.about.levels_of(prediction)
            depth = depth_map(levels, answered, f"prediction: {scores}")
            rows.append([(infocus, f"{pair.id}, in-focus"), *others, depth])
        worst = f"<p><b>worst pairs</b></p>{gallery(rows)}" if rows else ""
        return as_html(run_tables.run_score_table(summary.summarise(self.result, protocol))) + worst


def open_saved_run(path: Path | str, dataset: str | None = None) -> SavedRun:
    """Open a run by its result file or its folder.

    Parameters
    ----------
    path : Path or str
        ``result.json``, or its folder.
    dataset : str, optional
        The store's path; by default the place that the run noted in its folder, or else the
        default place of the data set that the result names.

    Raises
    ------
    ResultError
        If there is no result, or it is damaged.
    StoreError
        If `dataset` is not a store, or holds other data.
    """
    path = Path(path)
    if path.is_dir() and not (path / RESULT).exists():
        raise ResultError.of(_no_run(path))
    file = path / RESULT if path.is_dir() else path
    result = load_result(file)
    if not (file.parent / run_folder.PREDICTIONS).is_dir():
        return SavedRun(file, result, None, "no depth maps lie beside the result")
    found, without = (open_dataset(dataset), "") if dataset else _find_store(file.parent, result)
    if found:
        if found.fingerprint != result.dataset.fingerprint:
            what = "the store holds other data than the run was made with"
            raise ResultError(what, where=f"{found.path}, {file}")
        run_folder.require_pairs_of(result, found, file)
    return SavedRun(file, result, found, without)


def _find_store(folder: Path, result: Result) -> tuple[Dataset | None, str]:
    """Return the store that a run was made with, or None and the reason."""
    noted = run_folder.read_store_place(folder)
    why = f"the built {result.dataset.short} set holds other data"
    for place in dict.fromkeys((noted, None)):
        try:
            store = open_dataset(result.dataset.name, place)
            if store.fingerprint == result.dataset.fingerprint:
                return store, ""
        except DfdbenchError as error:
            why = error.problems[0].what
    if noted:
        why = "the data that it was run on are not where they were: --dataset PATH names them"
    return None, why


def _no_run(folder: Path) -> Problem:
    if (folder / output_place.RUN_IDENTITY).is_file():
        what = "this run was stopped before its end; the pairs that it finished are kept"
        fix = "the same command that began it finishes it"
        return Problem(what, where=str(folder), fix=fix)
    below = [found.parent for depth in ("*", "*/*") for found in folder.glob(f"{depth}/{RESULT}")]
    found = f"name the runs: {listed(sorted(below), most=3)}"
    fix = found if below else "`dfdbench run` makes one"
    return Problem(f"no run in this folder: no {RESULT}", where=str(folder), fix=fix)


def distinguished(runs: Iterable[SavedRun]) -> list[SavedRun]:
    """Return the runs, adding the place to each label that would otherwise be ambiguous.

    The place is relative to the folder that they share. Runs on different data or splits never
    appear in one table, so they may have the same label.

    Parameters
    ----------
    runs : iterable of SavedRun
        Runs from different files.
    """
    runs = list(runs)
    data = [(run.result.dataset.fingerprint, run.result.dataset.split) for run in runs]
    alike = grouped(((*data[number], run.label), number) for number, run in enumerate(runs))
    for numbers in alike.values():
        if len(numbers) > 1:
            places = [_place(runs[number].path) for number in numbers]
            shared = os.path.commonpath(places)
            for number, place in zip(numbers, places, strict=True):
                runs[number] = replace(runs[number], place=os.path.relpath(place, shared))
    return runs


def _place(file: Path) -> Path:
    file = file.absolute()
    return file.parent if file.name == RESULT else file.with_suffix("")
