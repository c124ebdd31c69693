"""The public functions and what they return; `import dfdbench` brings them."""

from __future__ import annotations

import shutil
import tempfile
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from dfdbench.blur.tracks import CLEAN
from dfdbench.building.build import build_store
from dfdbench.building.obtaining import obtain
from dfdbench.building.plan import plan_build
from dfdbench.datasets.captures import Capture
from dfdbench.datasets.catalog import find_manifest, released_manifests
from dfdbench.datasets.dataset import Dataset, open_dataset
from dfdbench.datasets.store_place import default_store
from dfdbench.errors import InputError, ResultError
from dfdbench.evaluation.evaluate import evaluate
from dfdbench.evaluation.scored import score_predictions
from dfdbench.evaluation.tracks import run_over_tracks
from dfdbench.methods.method import Method
from dfdbench.methods.registry import load_method as _load_method
from dfdbench.methods.registry import method_words, registered_methods
from dfdbench.results.difference_tables import change_tables
from dfdbench.results.first_table import first_protocol, shown_protocol
from dfdbench.results.frame import scores_of
from dfdbench.results.output_place import output_place
from dfdbench.results.record import Result, Unit
from dfdbench.results.record_file import RESULT
from dfdbench.results.run_names import told_apart
from dfdbench.results.run_tables import run_score_table
from dfdbench.results.saved_run import SavedRun
from dfdbench.results.saved_run import open_run as _open_run
from dfdbench.results.summary import summarise
from dfdbench.system.location import Place
from dfdbench.system.parallel import Threads
from dfdbench.tables.table import as_html
from dfdbench.tables.wording import counted, listed

Progress = Callable[[int, int], None]


class Run:
    """The scores of a method on a split of a data set, and on its tracks if it was run on them.

    Parameters
    ----------
    runs : mapping of str to SavedRun
        By ``clean`` and ``TRACK-SEVERITY``.
    """

    def __init__(self, runs: Mapping[str, SavedRun]) -> None:
        self._runs = dict(runs)
        self._first = next(iter(self._runs.values()))

    def __repr__(self) -> str:
        more = f", and on {len(self._runs) - 1} tracks" if len(self._runs) > 1 else ""
        return f"{self._first!r}"[:-1] + f"{more}>"

    def _repr_html_(self) -> str:
        return self._first._repr_html_()

    @property
    def results(self) -> dict[str, Result]:
        """Everything a run recorded, by ``clean`` and ``TRACK-SEVERITY``."""
        return {label: run.result for label, run in self._runs.items()}

    @property
    def scores(self) -> pd.DataFrame:
        """Every score: a row per track, pair, protocol and metric."""
        return scores_of(list(self.results.values()))

    def to_frame(self, protocol: str | None = None) -> pd.DataFrame:
        """Return the pairs' scores under one protocol, a row per pair and a column per metric."""
        return self._first.to_frame(protocol)

    def table(self, protocol: str | None = None) -> pd.DataFrame:
        """Return the mean scores, by illumination and exposure or whatever axes the set has.

        Parameters
        ----------
        protocol : str, optional
            By default the data set's first.

        Returns
        -------
        DataFrame
            A row per group of pairs, a column per metric; of a run on tracks, a row per track.

        Raises
        ------
        UnknownNameError
            If the run was not scored under that protocol.
        """
        if len(self._runs) == 1:
            result = self._first.result
            table = run_score_table(summarise(result, protocol or shown_protocol(result)))
            return pd.DataFrame(table.rows, columns=list(table.columns))
        shown = protocol or shown_protocol(self._first.result)
        means = {
            label: (run.result.averages or {}).get(shown, {}) for label, run in self._runs.items()
        }
        return pd.DataFrame.from_dict(means, orient="index").rename_axis("track")

    @property
    def predictions(self) -> Iterator[tuple[str, NDArray[np.float32]]]:
        """The depth maps that the run kept, as (pair, depth levels of shape (y, x))."""
        for pair in self._first.result.pairs:
            found = self._first.images(pair)
            if found is not None:
                yield pair.id, found[1]

    def images(self, pair: str) -> tuple[Capture, NDArray[np.float32]]:
        """Return a pair's images and the depth predicted for it.

        Raises
        ------
        UnknownNameError
            If the run has no such pair.
        ResultError
            If the run kept no depth maps, or the data set is not there.
        """
        found = self._first.images(pair)
        if found is None:
            raise ResultError(
                self._first.without or "the run kept no depth map of this pair", where=pair
            )
        return found

    def report(self, path: Path | str, protocol: str | None = None) -> Path:
        """Write an HTML page about the run into a folder, worst pairs first; return its path."""
        from dfdbench.report.html import write_html  # it imports matplotlib

        shown = protocol or first_protocol(self._first.result.dataset.short)
        folder = output_place(path, self._first.path.parent)
        folder.mkdir(parents=True, exist_ok=True)
        return write_html(list(self._runs.values()), shown, folder)

    def save(self, path: Path | str) -> Path:
        """Copy the run into a folder, which `open_run` opens; return the folder.

        Raises
        ------
        InputError
            If something is there already.
        """
        folder = output_place(path, self._first.path.parent)
        if folder.exists():
            raise InputError(
                "there is something already", where=str(folder), fix="name a new folder"
            )
        many = len(self._runs) > 1
        for label, run in self._runs.items():
            shutil.copytree(run.path.parent, folder / label if many else folder)
        return folder


class Comparison:
    """The differences of runs on the same data from the first of them, pair by pair.

    Parameters
    ----------
    runs : sequence of Run
        At least two.
    protocol : str, optional
        By default the data set's first.
    """

    def __init__(self, runs: Sequence[Run], protocol: str | None = None) -> None:
        if len(runs) < 2:
            raise InputError("a comparison needs two runs", got=str(len(runs)))
        self._runs = told_apart([run._first for run in runs])
        self.protocol = protocol or first_protocol(self._runs[0].result.dataset.short)
        first = self._runs[0]
        self.tables = {
            other.label: change_tables(
                first.result, other.result, self.protocol, 10, (first.label, other.label)
            )
            for other in self._runs[1:]
        }

    def __repr__(self) -> str:
        return f"<{listed([run.label for run in self._runs])}, under {self.protocol}>"

    def _repr_html_(self) -> str:
        return "".join(as_html(tables[0]) for tables in self.tables.values())

    @property
    def scores(self) -> pd.DataFrame:
        """Every score of all runs, a row per run, pair, protocol and metric."""
        return scores_of([run.result for run in self._runs])

    def table(self) -> pd.DataFrame:
        """Return the mean differences from the first run, with their intervals."""
        frames = {
            label: pd.DataFrame(tables[0].rows, columns=list(tables[0].columns))
            for label, tables in self.tables.items()
        }
        return pd.concat(frames, names=["run"])


def build(
    name: str,
    source: Path | str | None = None,
    *,
    store: Place | None = None,
    recipe: str | None = None,
    steps: tuple[int, int] | None = None,
    mirrors: Sequence[str] = (),
    offline: bool = False,
    workers: int | None = None,
    cache: Path | None = None,
    on_scene: Progress | None = None,
) -> Dataset:
    """Build a data set; what was fetched or finished before is kept.

    Parameters
    ----------
    name : str
        A data set's name or a manifest's path; ``NAME@TRACK-SEVERITY`` for a track.
    source : Path or str, optional
        The folder with the files; by default Middlebury's are downloaded, and demo is made.
    store : str, Path or UPath, optional
        Where to build, a path or a URL; by default the cache.
    recipe : str, optional
        A blur recipe in place of the manifest's: ``published`` or ``text``.
    steps : tuple of int, optional
        In-focus and defocus voltage step of captured pairs.
    mirrors : sequence of str
        Addresses to download from before the site.
    offline : bool
        Use only what was fetched before.
    workers : int, optional
        How many threads; by default one per processor core.
    cache : Path, optional
        The cache folder.
    on_scene : callable, optional
        Called with (scenes done, scenes to do).

    Returns
    -------
    Dataset
        The data set. What is missing or looks odd is warned about.

    Raises
    ------
    UnknownNameError, ManifestError, SourceError, InputError
        If there is no such data set, or its files cannot be had or read.

    Examples
    --------
    >>> build("demo")  # doctest: +SKIP
    <demo-1: 162 pairs of 9 scenes>
    """
    plan = plan_build(find_manifest(name), store, recipe, steps, cache)
    files = obtain(plan, Path(source) if source else None, mirrors, offline, cache).source
    pool = Threads(workers) if workers else None
    report = build_store(plan.manifest, files, plan.place, plan.recipe, pool, on_scene)
    said = [*map(str, report.problems), *report.warnings]
    if report.missing:
        said.append(f"{counted(len(report.missing), 'pair')} of {plan.manifest.stem} are missing")
    for text in said:
        warnings.warn(text, stacklevel=2)
    return Dataset(plan.place)


def list_datasets(cache: Path | None = None) -> pd.DataFrame:
    """Return the data sets that come with the package, a row each.

    Examples
    --------
    >>> list_datasets().loc["demo", ["scenes", "pairs"]].tolist()
    [9, 162]
    """
    rows = [
        {
            "name": manifest.short,
            "scenes": manifest.scene_count,
            "pairs": manifest.pair_count,
            "splits": ", ".join(split.name for split in manifest.splits),
            "built": default_store(manifest, cache).exists(),
            "title": manifest.title,
        }
        for manifest in released_manifests()
    ]
    return pd.DataFrame(rows).set_index("name")


def list_methods() -> pd.DataFrame:
    """Return the registered methods: what each is, and where it is defined.

    Examples
    --------
    >>> list_methods().loc["local", "entry"]
    'dfdbench.methods.baselines:Local'
    """
    words, entries = method_words(), registered_methods()
    rows = [(name, words[name], entries[name]) for name in sorted(entries)]
    return pd.DataFrame(rows, columns=["name", "what", "entry"]).set_index("name")


def load_method(name: str, **parameters: Any) -> Method:
    """Return a method: call it with an in-focus and a defocus image.

    Parameters
    ----------
    name : str
        A registered name, ``file.py:attribute`` or ``module:attribute``.
    **parameters
        The method's; ``recipe`` may be a blur recipe's name, fields, TOML file or object.

    Raises
    ------
    MethodError, UnknownNameError
        If there is no such method, or it does not take these parameters.

    Examples
    --------
    >>> method = load_method("constant", training_mean=80.0)
    >>> image = np.zeros((2, 3, 3), np.uint8)
    >>> method(image, image).tolist()
    [[80.0, 80.0, 80.0], [80.0, 80.0, 80.0]]
    """
    return _load_method(name, parameters, {"seed": lambda: 0}, {"recipe": lambda: None})


def run(
    method: str | Callable[..., Any],
    dataset: str | Dataset,
    split: str = "test",
    *,
    parameters: Mapping[str, Any] = MappingProxyType({}),
    limit: int | None = None,
    seed: int = 0,
    out: Path | str | None = None,
    cache: Path | None = None,
    on_pair: Progress | None = None,
) -> Run:
    """Run a method on a split of a built data set, as ``dfdbench run`` does.

    Takes what `dfdbench.evaluation.evaluate.evaluate` takes.

    Examples
    --------
    >>> found = run(lambda infocus, defocus: 255 - infocus.mean(2), "demo")  # doctest: +SKIP
    >>> found.table()  # doctest: +SKIP
    """
    done = evaluate(
        method,
        dataset,
        split,
        parameters=parameters,
        limit=limit,
        seed=seed,
        out=out,
        cache=cache,
        on_pair=on_pair,
    )
    return Run({CLEAN: done})


def run_tracks(
    method: str | Callable[..., Any],
    dataset: str,
    split: str = "test",
    *,
    parameters: Mapping[str, Any] = MappingProxyType({}),
    tracks: Sequence[str] | None = None,
    given_blur: bool = False,
    source: Path | None = None,
    seed: int = 0,
    out: Path | str | None = None,
    cache: Path | None = None,
) -> Run:
    """Run a method on the clean images and on every track, as ``dfdbench tracks`` does.

    Takes what `dfdbench.evaluation.tracks.run_over_tracks` takes; `out` is by default a new
    temporary folder.

    Examples
    --------
    >>> found = run_tracks("local", "demo", tracks=["noise"])  # doctest: +SKIP
    >>> found.table()  # doctest: +SKIP
    """
    folder = Path(out or tempfile.mkdtemp(prefix="dfdbench-"))
    runs = run_over_tracks(
        method,
        dataset,
        folder,
        split,
        parameters=parameters,
        tracks=tracks,
        given_blur=given_blur,
        source=source,
        seed=seed,
        cache=cache,
    )
    return Run(runs)


def score(
    folder: Path | str,
    dataset: str | Dataset,
    split: str = "test",
    *,
    unit: Unit = "levels",
    method: str | None = None,
    out: Path | str | None = None,
    cache: Path | None = None,
) -> Run:
    """Score depth maps that were made elsewhere, one file per pair.

    Parameters
    ----------
    folder : Path or str
        The depth maps: npy, npz, PNG or TIFF, named after the pairs.
    dataset : str or Dataset
        The data set.
    split : str
        Which of its pairs.
    unit : {"levels", "metres"}
        What the files hold.
    method : str, optional
        What tables call it; by default the folder's name.
    out : Path or str, optional
        Where the result goes; by default a new temporary folder.
    cache : Path, optional
        The cache folder.

    Raises
    ------
    ResultError
        With everything that is wrong with the files.

    Examples
    --------
    >>> score("depth_maps", "demo").table()  # doctest: +SKIP
    """
    data = dataset if isinstance(dataset, Dataset) else open_dataset(dataset, cache=cache)
    place = output_place(out or Path(tempfile.mkdtemp(prefix="dfdbench-")) / "run", folder)
    name = method or Path(folder).resolve().name
    done = score_predictions(Path(folder), data, split, place, name, unit)
    return Run({CLEAN: SavedRun(place / RESULT, done.result, data, "")})


def compare(*runs: Run | Path | str, protocol: str | None = None) -> Comparison:
    """Compare runs on the same data with the first of them, pair by pair.

    Parameters
    ----------
    *runs : Run, Path or str
        Runs, or their folders.
    protocol : str, optional
        By default the data set's first.

    Raises
    ------
    ResultError
        If they are on different data or splits.

    Examples
    --------
    >>> compare(run("local", "demo"), run("constant", "demo")).table()  # doctest: +SKIP
    """
    opened = [each if isinstance(each, Run) else open_run(each) for each in runs]
    return Comparison(opened, protocol)


def open_run(path: Path | str, dataset: str | None = None) -> Run:
    """Open what ``dfdbench run`` or ``dfdbench tracks`` left in a folder.

    Parameters
    ----------
    path : Path or str
        A run's folder or its ``result.json``; the folder of a run on tracks.
    dataset : str, optional
        The store's path, if it is not where the run found it.

    Raises
    ------
    ResultError
        If there is no run, or its result is damaged.

    Examples
    --------
    >>> open_run("results/demo-1-test/local").table()  # doctest: +SKIP
    """
    folder = Path(path)
    if (folder / CLEAN / RESULT).is_file():
        labels = [CLEAN, *sorted(p.parent.name for p in folder.glob(f"*-[1-9]/{RESULT}"))]
        return Run({label: _open_run(folder / label, dataset) for label in labels})
    return Run({CLEAN: _open_run(path, dataset)})
