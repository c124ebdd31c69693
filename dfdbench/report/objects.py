"""Runs, comparisons and transfers as Python objects: scores, tables, figures, pages."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from dfdbench.board import LEADERBOARD
from dfdbench.datasets.captures import Capture
from dfdbench.datasets.manifest import Pair
from dfdbench.errors import InputError, ResultError
from dfdbench.metrics.protocol import find_protocol, metrics_of, ranked_by, title_of
from dfdbench.metrics.regions import REGIONS
from dfdbench.results import differences, record, saved_run, summary, wording
from dfdbench.results.frame import frame_of, scores_of, severities_table, track_means
from dfdbench.results.output_place import output_place
from dfdbench.results.run_tables import all_tables, run_score_table
from dfdbench.system.files import writing_folder
from dfdbench.tables.table import Table, as_html, counted, listed

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dfdbench.methods.measured_law import Calibration


class Run:
    """The scores of a method on a split of a data set, and on its tracks if they were run.

    Parameters
    ----------
    runs : mapping of str to SavedRun
        By ``clean`` and ``TRACK-SEVERITY``.
    protocol : str, optional
        The protocol of its tables; by default the data set's first.
    notes : sequence of str
        What was reused from an earlier run in the same folder, and what was moved away.
    calibration : Calibration, optional
        What the method's fit measured of the blur.
    """

    def __init__(
        self,
        runs: Mapping[str, saved_run.SavedRun],
        protocol: str | None = None,
        notes: Sequence[str] = (),
        calibration: Calibration | None = None,
    ) -> None:
        self._runs = dict(runs)
        self._first = next(iter(self._runs.values()))
        self._calibration = calibration
        self.protocol = protocol or record.shown_protocol(self.result)
        self.notes = tuple(notes)

    def __repr__(self) -> str:
        tracks = {label.rpartition("-")[0] for label in self._runs} - {""}
        more = f", and on {counted(len(tracks), 'track')}" if self._on_tracks else ""
        return f"{self._first!r}"[:-1] + f"{more}>"

    def _repr_html_(self) -> str:
        if self._on_tracks:
            return as_html(self.tables()[0])
        return self._first._repr_html_(self.protocol)

    def _asked(self, protocol: str | None) -> str:
        return find_protocol(protocol).label if protocol else self.protocol

    @property
    def _on_tracks(self) -> bool:
        return len(self._runs) > 1

    @property
    def result(self) -> record.Result:
        """The run's whole record; for a run on tracks, that on the clean images."""
        return self._first.result

    @property
    def results(self) -> dict[str, record.Result]:
        """The run's whole record, by ``clean`` and ``TRACK-SEVERITY``."""
        return {label: run.result for label, run in self._runs.items()}

    @property
    def folder(self) -> Path:
        """The folder of its files."""
        place = self._first.path.parent
        return place.parent if self._on_tracks else place

    def __fspath__(self) -> str:
        self._first.require_in_place()
        # In a run on tracks, the one on clean images has a fit.
        return str(self._first.path.parent)

    @property
    def failed(self) -> int:
        """The number of pairs on which the method failed."""
        pairs = (pair for result in self.results.values() for pair in result.pairs)
        return sum(pair.status == "failed" for pair in pairs)

    @property
    def scores(self) -> pd.DataFrame:
        """Every score: a row per track, severity, pair, protocol and metric."""
        return scores_of(list(self.results.values()))

    def to_frame(self, protocol: str | None = None) -> pd.DataFrame:
        """Return the pairs' scores under one protocol, by default the run's own; a row per pair.

        For a run on tracks, those of clean images.
        """
        return frame_of(self.result, self._asked(protocol))

    @property
    def regions(self) -> pd.DataFrame:
        """The NRMSE of each pair at edges, in flat regions, far and near; NaN if it has none.

        For a run on tracks, that on clean images. `dfdbench.metrics.regions.REGIONS` defines these
        regions.
        """
        pairs = self.result.pairs
        rows = [[pair.regions.get(region) for region in REGIONS] for pair in pairs]
        index = pd.Index([pair.id for pair in pairs], name="pair")
        return pd.DataFrame(rows, index, list(REGIONS), dtype=float)

    def table(self, protocol: str | None = None) -> pd.DataFrame:
        """Return the mean scores by illumination and exposure, or by the set's own axes.

        Parameters
        ----------
        protocol : str, optional
            The protocol; by default the run's own.

        Returns
        -------
        DataFrame
            A row per group of pairs, a column per metric; for a run on tracks, a row per track and
            severity. NaN where not every pair of the group was evaluated.

        Raises
        ------
        UnknownNameError
            If the run was not scored under that protocol.
        """
        shown = self._asked(protocol)
        first = summary.summarise(self.result, shown)
        if not self._on_tracks:
            found, data = pd.DataFrame(run_score_table(first).records), self.result.dataset
            axes = [axis for axis in dict.fromkeys((data.blocks, data.rows)) if axis in found]
            whole = found["evaluated"] == found["expected"]
            found["mean"] = found["mean"].where(whole).astype(float)
            groups: pd.Series[float] = found.set_index([*axes, "metric"])["mean"]
            return pd.DataFrame(groups.unstack(sort=False))[list(metrics_of(shown))]
        means = {label: (run.averages or {}).get(shown, {}) for label, run in self.results.items()}
        return pd.DataFrame.from_dict(means, orient="index").rename_axis("track")

    def tables(self) -> list[Table]:
        """Return all tables of the run, as the command line prints them."""
        if self._on_tracks:
            return [severities_table(list(self.results.values()), self.protocol)]
        return all_tables(summary.summarise(self.result, self.protocol), self._first.store)

    def verdict(self) -> str:
        """Summarise the run: its score, a constant's, the best comparable row's, its worst pairs.

        It has the lines that ``dfdbench run`` ends with; for a run on tracks, those of clean
        images.
        """
        from dfdbench.report.verdict import verdict_text

        return verdict_text(self.verdict_facts())

    def verdict_facts(self) -> dict[str, dict[str, Any]]:
        """Return the verdict's lines as data: see `dfdbench.report.verdict.verdict_facts`."""
        # It reads rows, so it is imported only when needed.
        from dfdbench.report.verdict import verdict_facts

        return verdict_facts(self._first, self.protocol)

    @property
    def predictions(self) -> Iterator[tuple[str, NDArray[np.float32]]]:
        """The depth maps that the run kept, as (pair, depth of shape (y, x)).

        Depth is in levels, or in metres on a set in metres. For a run on tracks, those of clean
        images.

        Raises
        ------
        ResultError
            If the run kept none, a later run replaced it, or the data set is missing.
        """
        kept = False
        for pair in self.result.pairs:
            found = self._first.images(pair)
            if found is not None:
                kept = True
                yield pair.id, found[1]
        if not kept:
            why = self._first.without or "no depth maps were kept"
            raise ResultError(why, where=str(self._first.path.parent))

    def images(self, pair: Capture | Pair | str) -> tuple[Capture, NDArray[np.float32]]:
        """Return the images of a pair (an object or its name) and the depth predicted for it.

        Depth is in levels, or in metres on a set in metres. For a run on tracks, they are the clean
        images.

        Raises
        ------
        UnknownNameError
            If the run has no such pair.
        ResultError
            If the run kept no depth maps, a later run replaced it, or the data set is missing.
        """
        pair = pair.pair if isinstance(pair, Capture) else pair
        pair = pair if isinstance(pair, str) else pair.id
        found = self._first.images(pair)
        if found is None:
            why = self._first.without or "no depth map of this pair was kept"
            raise ResultError(why, where=pair)
        return found

    def draw(self, forms: Sequence[str] = ("png",)) -> list[Path]:
        """Draw the run's figures into its folder, as png, pdf or svg; return the files."""
        from dfdbench.figures.comparisons import tracks_figure  # they import matplotlib
        from dfdbench.figures.runs import draw_run
        from dfdbench.figures.style import forms_of, write_forms

        forms = forms_of(forms)
        if self._on_tracks:
            metric = ranked_by(self.protocol)[0]
            means = track_means(self.scores, self.protocol, metric)
            name = self.result.method.name
            figure = tracks_figure({name: means}, metric, self.tables()[0].title)
            return write_forms(figure, self.folder, "tracks", forms)
        self._first.require_in_place()
        drawn = draw_run(self._first, self.protocol, forms)
        if self._calibration:
            from dfdbench.figures.camera import law_figure

            figure = law_figure(self._calibration)
            drawn += write_forms(figure, self.folder / "figures", "law", forms)
        return drawn

    def report(self, path: Path | str, protocol: str | None = None) -> Path:
        """Write an HTML page about the run into a folder, worst pairs first; return its path."""
        from dfdbench.report.page import write_html  # it imports matplotlib

        folder = output_place(path, self._first.path.parent)
        with writing_folder(folder / "report.html", "report"):
            return write_html(list(self._runs.values()), self._asked(protocol), folder)

    def save(self, path: Path | str) -> Path:
        """Copy the run into a folder that `open_run` can open; return the folder.

        Raises
        ------
        InputError
            If something is already there.
        ResultError
            If a later run replaced this one, or the folder cannot be written.
        """
        folder = output_place(path, self._first.path.parent)
        if folder.exists():
            raise InputError(
                "something is there already", where=str(folder), fix="name a new folder"
            )
        for run in self._runs.values():
            run.require_in_place()
        with writing_folder(folder, "run"):
            for label, run in self._runs.items():
                shutil.copytree(run.path.parent, folder / label if self._on_tracks else folder)
        return folder

    def submit(self, leaderboard: Path | str = LEADERBOARD) -> Path:
        """Write the run into a leaderboard's folder, for a pull request; return the row's file.

        Parameters
        ----------
        leaderboard : Path
            Its folder; by default that of the clone you are in.

        Raises
        ------
        ResultError
            If the leaderboard would refuse the row.
        """
        from dfdbench.board.submission import submit

        return submit(list(self.results.values()), Path(leaderboard))


class Comparison:
    """Pair-by-pair differences of runs on the same data from the first of them.

    Parameters
    ----------
    runs : sequence of SavedRun
        At least two.
    protocol : str, optional
        The protocol; by default the data set's first.
    most : int
        How many changed pairs to list.
    given : object, optional
        Kept alive as long as the comparison: a run's temporary folder is deleted with the run.
    """

    def __init__(
        self,
        runs: Sequence[saved_run.SavedRun],
        protocol: str | None = None,
        most: int = 10,
        given: object = None,
    ) -> None:
        self._given = given
        if len(runs) < 2:
            raise InputError("a comparison needs two runs", got=str(len(runs)))
        if len({run.path.resolve() for run in runs}) < len(runs):
            for run in runs:
                run.require_in_place()
            raise InputError("one run is given twice", where=str(runs[0].path))
        first, *others = self.runs = saved_run.distinguished(runs)
        self.protocol = protocol or record.first_protocol(first.result.dataset.short)
        found = {
            other.label: differences.paired_differences(first.result, other.result, self.protocol)
            for other in others
        }
        self.tables = {}
        for other in others:
            beside = [
                one for label in found if label != other.label for one in found[label].values()
            ]
            names = first.label, other.label
            self.tables[other.label] = differences.change_tables(
                first.result, other.result, self.protocol, most, names, beside
            )

    def __repr__(self) -> str:
        return f"<{listed([run.label for run in self.runs])}, under {self.protocol}>"

    def _repr_html_(self) -> str:
        return "".join(as_html(tables[0]) for tables in self.tables.values())

    @property
    def scores(self) -> pd.DataFrame:
        """Every score of all runs, a row per run, pair, protocol and metric.

        Of a run on tracks, those on clean images.
        """
        return scores_of([run.result for run in self.runs])

    def table(self) -> pd.DataFrame:
        """Return the mean differences from the first run, with their intervals."""
        numbers = dict.fromkeys(("low", "high", "p"), float)
        frames = {
            label: pd.DataFrame(tables[0].records).astype(numbers)
            for label, tables in self.tables.items()
        }
        return pd.concat(frames, names=["run"])

    def figure(self, most: int = 4) -> Figure | None:
        """Draw the pairs that changed most between the first two runs; None if there are none."""
        from dfdbench.figures.comparisons import change_figure  # it imports matplotlib

        one, other = self.runs[:2]
        found = differences.changes_to_show(one.result, other.result, self.protocol, most)
        return change_figure(one, other, found, ranked_by(self.protocol)[0])


class Transfer:
    """The scores of a method fitted on one data set and tested on another.

    Parameters
    ----------
    results : mapping of (str, str) to Result
        By the set that it was fitted on and the set that it was tested on.
    protocol : str
        The protocol of its table.
    folder : Path
        Where its runs are.
    """

    def __init__(
        self, results: Mapping[tuple[str, str], record.Result], protocol: str, folder: Path
    ) -> None:
        self.results = dict(results)
        self.protocol, self.folder = protocol, folder
        self._name = ranked_by(protocol)[0]
        first = next(iter(self.results.values()))
        self._metric = metrics_of(protocol)[self._name]
        self.title = (
            f"{wording.method_label(first.method)} across data sets, split {first.dataset.split}, "
            f"protocol {title_of(protocol)}: {self._metric.heading}"
        )

    def __repr__(self) -> str:
        return f"<{self.title}>"

    def _repr_html_(self) -> str:
        return as_html(self.as_table())

    def table(self) -> pd.DataFrame:
        """Return the means: a row per set it was fitted on, a column per set it was tested on."""
        means = {
            pair: result.mean(self.protocol, self._name) for pair, result in self.results.items()
        }
        order = list(dict.fromkeys(own for own, _ in means))
        frame = pd.Series(means, dtype=float).unstack().loc[order, order]
        return frame.rename_axis(index="fitted on", columns="tested on")

    def worst(self) -> float:
        """Return the highest cost of a foreign fit: its score over that of the set's own fit."""
        means = self.table().to_numpy()
        return float((means / np.diag(means))[~np.eye(len(means), dtype=bool)].max())

    def as_table(self) -> Table:
        """Return the means as a table for the command line."""
        means = self.table()
        rows = tuple((str(own), *map(wording.score_text, row)) for own, row in means.iterrows())
        note = f"The worst foreign fit has {self.worst():.2f} times the score of the set's own."
        note = note if np.isfinite(self.worst()) else "A run lacks a mean, so no fit is the worst."
        columns = ("fitted on", *map(str, means.columns))
        return Table(self.title, columns, rows, "l", (note,))

    def draw(self, forms: Sequence[str] = ("png",)) -> list[Path]:
        """Draw the matrix into its folder, as png, pdf or svg; return the files."""
        from dfdbench.figures.comparisons import transfer_figure  # it imports matplotlib
        from dfdbench.figures.style import forms_of, write_forms

        figure = transfer_figure(self.table(), self.title)
        return write_forms(figure, self.folder, "transfer", forms_of(forms))
