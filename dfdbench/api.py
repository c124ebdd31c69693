"""The public functions and what they return; `import dfdbench` exports them."""

import shutil
import tempfile
import warnings
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from functools import partial
from numbers import Integral
from pathlib import Path
from types import MappingProxyType
from typing import Any

import pandas as pd

from dfdbench.blur.tracks import CLEAN
from dfdbench.datasets.catalog import default_store, released_manifests
from dfdbench.datasets.dataset import Dataset, open_dataset
from dfdbench.datasets.fingerprint import require_sound
from dfdbench.errors import InputError, MethodError, UnknownNameError
from dfdbench.evaluation import evaluate, fitting, loading, plan
from dfdbench.evaluation.run import OnPair, RunDone
from dfdbench.methods import registry
from dfdbench.methods.measured_law import Calibration
from dfdbench.methods.method import Method
from dfdbench.metrics.protocol import Unit, find_protocol, require_scored
from dfdbench.report.objects import Comparison, Run, Transfer
from dfdbench.results.output_place import output_place
from dfdbench.results.record import RESULT, Result, shown_protocol
from dfdbench.results.saved_run import SavedRun, open_saved_run
from dfdbench.system.files import write_whole, writing_folder
from dfdbench.system.location import Place
from dfdbench.system.parallel import Pool, Shown, Threads
from dfdbench.tables.render import render
from dfdbench.tables.table import Format, counted, listed

#: The file in a run's folder that holds all of its tables.
TABLES = "tables.md"
Progress = Callable[[int, int], None]


def build(
    name: Path | str,
    source: Path | str | None = None,
    *,
    store: Place | None = None,
    recipe: str | None = None,
    steps: tuple[int, int] | None = None,
    mirrors: Sequence[str] = (),
    offline: bool = False,
    seed: int | None = None,
    workers: int | None = None,
    cache: Path | str | None = None,
    shown: Shown = lambda what: nullcontext(),
) -> Dataset:
    """Build a data set, reusing what was fetched or finished before.

    Parameters
    ----------
    name : str or Path
        A data set's name or a manifest's path; ``NAME@TRACK-SEVERITY`` for a track.
    source : Path or str, optional
        The folder with the files; by default Middlebury's are downloaded and demo is generated.
    store : str, Path or UPath, optional
        Where to build, as a path or URL; by default the cache.
    recipe : str, optional
        A blur recipe that replaces the manifest's: ``published`` or ``text``.
    steps : tuple of int, optional
        The in-focus and the defocus voltage step of captured pairs.
    mirrors : sequence of str
        Addresses to try before the original site.
    offline : bool
        Use only what was fetched before.
    seed : int, optional
        The seed of the rooms, for ``unseen`` and ``unseen-stack``; by default 0.
    workers : int, optional
        The number of threads; by default one per processor core.
    cache : Path or str, optional
        The cache folder.
    shown : callable
        Shows progress: called with the name of a step, it returns a context manager that gives a
        callable (done, total).

    Returns
    -------
    Dataset
        The data set. Warnings name whatever is missing or looks odd.

    Raises
    ------
    UnknownNameError, ManifestError, SourceError, InputError
        If there is no such data set, or its files cannot be obtained or read.

    Examples
    --------
    >>> build("demo")  # doctest: +SKIP
    <demo-1: 162 pairs of 9 scenes>
    """
    # Imported here because it takes longer to import than a short run takes.
    from dfdbench.building.obtaining import build_dataset

    report = build_dataset(
        str(name),
        Path(source) if source else None,
        store=store,
        recipe=recipe,
        steps=steps,
        mirrors=mirrors,
        offline=offline,
        seed=seed,
        pool=Threads(workers) if workers else None,
        cache=cache,
        shown=shown,
    )
    said = [*map(str, report.problems), *report.warnings]
    if report.missing:
        said.append(f"{counted(len(report.missing), 'pair')} of {report.manifest.stem} are missing")
    for text in said:
        warnings.warn(text, stacklevel=2)
    return Dataset(report.path)


def list_datasets(cache: Path | str | None = None) -> pd.DataFrame:
    """Return the data sets that come with the package, one per row.

    Parameters
    ----------
    cache : Path or str, optional
        The cache folder, for what is built.

    Returns
    -------
    DataFrame
        By ``name``: the numbers of ``scenes`` and ``pairs``, the names of the ``splits``, whether
        it is ``built`` in the cache, and the ``title``.

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
    """Return the registered methods: what each one is and where it is defined.

    Examples
    --------
    >>> list_methods().loc["local", "entry"]
    'dfdbench.methods.baselines:Local'
    """
    words, entries = registry.method_words(), registry.registered_methods()
    rows = [(name, words[name], entries[name]) for name in sorted(entries)]
    return pd.DataFrame(rows, columns=["name", "what", "entry"]).set_index("name")


def load_method(name: str, **parameters: Any) -> Method:
    """Return a method, which you call with an in-focus and a defocus image, or with a stack.

    Parameters
    ----------
    name : str
        A registered name, ``file.py:attribute``, ``module:attribute`` or ``model.onnx``.
    **parameters
        The method's parameters; ``recipe`` may be a blur recipe's name, fields, TOML file or
        object.

    Raises
    ------
    MethodError, UnknownNameError
        If there is no such method, or it does not take these parameters.

    Examples
    --------
    >>> import numpy as np
    >>> method = load_method("constant", training_mean=80.0)
    >>> image = np.zeros((2, 3, 3), np.uint8)
    >>> method(image, image).tolist()
    [[80.0, 80.0, 80.0], [80.0, 80.0, 80.0]]
    """
    return registry.load_method(name, parameters, {"seed": lambda: 0}, {"recipe": lambda: None})


def _check_for_board(split: str, limit: int | None = None) -> Callable[..., None]:
    """Return the check of store and method that a leaderboard run begins with.

    Raises
    ------
    InputError
        If the leaderboard would not take such a run.
    """
    # Few runs are for the leaderboard, and its libraries take as long to import as a short run.
    from dfdbench.board.submission import require_fit_to_submit, require_submittable

    require_submittable(limit)
    return partial(require_fit_to_submit, split=split)


def run(
    method: str | Callable[..., Any],
    dataset: Place | Dataset,
    split: str = "test",
    *,
    parameters: Mapping[str, Any] = MappingProxyType({}),
    protocol: str | None = None,
    limit: int | None = None,
    seed: int = 0,
    out: Path | str | None = None,
    keep_predictions: bool = True,
    fresh: bool = False,
    fitted: Run | Path | str | None = None,
    pool: Pool | None = None,
    for_board: bool = False,
    cache: Path | str | None = None,
    on_pair: OnPair | None = None,
) -> Run:
    """Run a method on a split of a built data set, as ``dfdbench run`` does.

    Parameters
    ----------
    method : str, callable or Method
        A registered name, ``module:attribute`` or ``file.py:attribute``; or what `load_method`
        returned, which is fitted anew; or a function of two RGB images, uint8 of shape (y, x, 3),
        that returns depth levels 0 to 255, shape (y, x); or a class whose instances are called
        that way, or an instance. It may be defined in a notebook.
    dataset : str, Path, UPath or Dataset
        A data set's name, a store's path or URL, or an open data set.
    split : str
        A split, a fold, a scene, or ``"all"``.
    parameters : mapping
        Passed to a class when it is constructed, and to a function at each call.
    protocol : str, optional
        The protocol of the run's tables; by default the data set's first.
    limit : int, optional
        Run only this many pairs, the first ones; there are then no averages.
    seed : int
        For methods that draw random numbers.
    out : Path or str, optional
        The folder for the result and the depth maps. A run that was stopped resumes there, unless
        only this process knows the method. By default a temporary folder, which lasts as long as
        the returned run; a copy of it, such as one from another process, needs a folder given.
    keep_predictions : bool
        Keep the depth maps; figures need them.
    fresh : bool
        Evaluate all pairs anew.
    fitted : Run, Path or str, optional
        A run or its folder: use what its fit learned, on this camera or another, and do not fit
        again.
    pool : Pool, optional
        Processes that evaluate several pairs at once; times are then not comparable.
    for_board : bool
        Raise before the run if the leaderboard would refuse it.
    cache : Path or str, optional
        The cache folder.
    on_pair : callable, optional
        Called with the number of pairs done, the number to do, and the mean score so far as text.

    Raises
    ------
    StoreError
        If the data set is not built.
    UnknownNameError
        If there is no such method, data set, split or protocol.
    InputError
        If `limit` is not a whole number from 1, or `out` holds something else.
    MethodError
        If the method cannot be loaded or fitted. An error on a pair goes into that pair's record.

    Examples
    --------
    >>> found = run(lambda infocus, defocus: 255 - infocus.mean(2), "demo")  # doctest: +SKIP
    >>> found.table()  # doctest: +SKIP
    """
    _require_number(limit)
    check = _check_for_board(split, limit) if for_board else None
    if for_board and fitted is not None:
        what = "the leaderboard takes no run with the fit of another"
        raise InputError(what, where="fitted", fix="let the method be fitted here")
    store = _opened(dataset, cache)
    store.manifest.scenes_of(split)
    shown = plan.protocol_on(store.manifest, protocol)
    learned = None if fitted is None else Path(fitted)
    options = plan.RunOptions(limit, keep_predictions, fresh, seed, learned)
    with _folder(out, str(store.path)) as folder:
        evaluated = partial(evaluate.evaluate, pool=pool, check=check, on_pair=on_pair)
        done, calibration = evaluated(method, store, split, folder, parameters, options)
        note = None
        if calibration:
            training = [] if fitted else fitting.training_pairs(store, split)[1]
            note = fitting.camera_note(calibration.law, store.captures(split), training)
        return _run_of({CLEAN: done}, {CLEAN: store}, shown, out, calibration, note)


def run_tracks(
    method: str | Callable[..., Any],
    dataset: str,
    split: str = "test",
    *,
    parameters: Mapping[str, Any] = MappingProxyType({}),
    tracks: Sequence[str] | None = None,
    given_blur: bool = False,
    protocol: str = "valid",
    source: Path | str | None = None,
    fresh: bool = False,
    seed: int = 0,
    out: Path | str | None = None,
    for_board: bool = False,
    cache: Path | str | None = None,
    on_result: Callable[[str, Result], None] = lambda label, result: None,
    shown: Shown = lambda what: nullcontext(),
) -> Run:
    """Run a method on the clean images and on every track, as ``dfdbench tracks`` does.

    Parameters
    ----------
    method, split, parameters, fresh, seed, out, for_board, cache
        As for `run`. Depth maps are not kept.
    dataset : str
        The name of a data set with synthetic blur, without a track.
    tracks : sequence of str, optional
        The tracks to run on; by default all.
    given_blur : bool
        Give the method each track's blur; the row then has no rank.
    protocol : str
        The protocol of the run's table.
    source : Path or str, optional
        The data set's files, needed if a track is not built yet.
    on_result : callable
        Called with each label, ``clean`` or ``TRACK-SEVERITY``, and its result.
    shown : callable
        As for `build`.

    Raises
    ------
    StoreError
        If a data set is not built and cannot be built here.
    DfdbenchError
        As for `run`.

    Examples
    --------
    >>> found = run_tracks("local", "demo", tracks=["noise"])  # doctest: +SKIP
    >>> found.table()  # doctest: +SKIP
    """
    if isinstance(dataset, Dataset):
        fix = evaluate.by_name(dataset.manifest)
        raise InputError("tracks are built by a data set's name", where="dataset", fix=fix)
    check = _check_for_board(split) if for_board else None
    plain = evaluate.without_track(dataset, cache)
    plain.scenes_of(split)
    protocol = plan.protocol_on(plain, protocol)
    labels = evaluate.labels_of(tracks)
    # Fail before anything is built or run for long.
    if isinstance(method, str):
        registry.find_entry(method)
    options = plan.RunOptions(keep_predictions=False, fresh=fresh, seed=seed)
    with _folder(out, source, replaces=False) as folder:
        stores = {CLEAN: evaluate.built_track(dataset, CLEAN, source, cache, shown)}
        loading.load_for(stores[CLEAN], method, parameters, seed, given_blur)
        for label in labels[1:]:
            stores[label] = evaluate.built_track(dataset, label, source, cache, shown)
        runs = {}
        evaluated = partial(evaluate.evaluate, given_blur=given_blur, check=check)
        name = method if isinstance(method, str) else repr(method)
        for label, store in stores.items():
            with shown(f"running {name} on {label}") as step:
                place = folder / label
                runs[label], _ = evaluated(
                    method, store, split, place, parameters, options, on_pair=step
                )
            _require_some(runs[label].result)
            clean = runs[CLEAN].result
            require_scored(protocol, clean.protocol_names, f"{clean.method.name}'s result")
            on_result(label, runs[label].result)
        return _run_of(runs, stores, protocol, out)


def tune(
    method: str | Callable[..., Any],
    dataset: Place | Dataset,
    ranges: Mapping[str, Sequence[Any]] | None = None,
    *,
    parameters: Mapping[str, Any] = MappingProxyType({}),
    protocol: str | None = None,
    limit: int | None = None,
    seed: int = 0,
    cache: Path | str | None = None,
    on_pair: Progress | None = None,
) -> pd.DataFrame:
    """Try parameters on training captures, by cross-validation over their groups.

    It looks at no test capture. Our methods repeat in each fold whatever their fit chooses.

    Parameters
    ----------
    method, parameters, protocol, seed, cache, on_pair
        As for `run`.
    dataset : str, Path, UPath or Dataset
        A data set, built with its training split.
    ranges : mapping of str to sequence, optional
        The values of each parameter; every combination is tried. By default the method's own
        ``ranges``.
    limit : int, optional
        Score at most so many captures, drawn at random with the seed, the same for every value.

    Returns
    -------
    pandas.DataFrame
        One row per combination, the best first: the metrics' means, indexed by the parameters.

    Raises
    ------
    InputError
        If there is nothing to try, if `limit` is not a whole number from 1, or if there are fewer
        than four groups, one for each fold.
    MethodError
        If the method does not take a parameter, or fails.

    Examples
    --------
    >>> dfdbench.tune("s-transform", "dfd-indoor", {"window": [9, 91]})  # doctest: +SKIP
    """
    _require_number(limit)
    return evaluate.cross_validate(
        _opened(dataset, cache), method, ranges, parameters, protocol, limit, seed, on_pair
    )


def run_transfer(
    method: str | Callable[..., Any],
    datasets: Sequence[Place | Dataset],
    split: str = "test",
    *,
    parameters: Mapping[str, Any] = MappingProxyType({}),
    protocol: str = "valid",
    seed: int = 0,
    out: Path | str | None = None,
    cache: Path | str | None = None,
    on_result: Callable[[str, Result], None] = lambda label, result: None,
    shown: Shown = lambda what: nullcontext(),
) -> Transfer:
    """Fit a method on each data set and test every fit on all of them.

    Rendered sets of different seeds have different cameras, so this shows what a fit is worth on
    another camera. A call that was stopped resumes in the same folder.

    Parameters
    ----------
    method, split, parameters, seed, cache
        As for `run`. The method needs a fit that returns what it learned.
    datasets : sequence of str, Path, UPath or Dataset
        Two or more built data sets.
    protocol : str
        The protocol of the table.
    out : Path or str, optional
        A folder that keeps the runs, ``FITTED/TESTED``; by default a temporary one.
    on_result : callable
        Called with ``FITTED -> TESTED`` and the result.
    shown : callable
        As for `build`.

    Raises
    ------
    InputError
        If there are fewer than two data sets, or one is named twice.
    DfdbenchError
        As for `run`.

    Examples
    --------
    >>> found = run_transfer("sgm", ["unseen-1", "unseen-2"])  # doctest: +SKIP
    >>> found.worst()  # doctest: +SKIP
    """
    stores = {store.manifest.short: store for store in (_opened(each, cache) for each in datasets)}
    results = {}
    with _folder(out, *(str(store.path) for store in stores.values()), replaces=False) as folder:
        if not 2 <= len(stores) == len(datasets):
            what = (
                f"a transfer is between two or more data sets, each named once; got {len(datasets)}"
            )
            raise InputError(what, where="datasets")
        # Fail before anything is run for long.
        for store in stores.values():
            store.manifest.scenes_of(split)
            plan.protocol_on(store.manifest, protocol)
            if loading.load_for(store, method, parameters, seed).learner is None:
                what = f"the method has no fit on {store.manifest.short} to transfer"
                fix = "name one that is fitted there; recipe=null withholds the blur from ours"
                raise MethodError(what, where="method", fix=fix)
        for own in stores:
            for other in (own, *(name for name in stores if name != own)):
                fitted = None if other == own else folder / own / own
                options = plan.RunOptions(keep_predictions=False, seed=seed, fitted=fitted)
                store, place = stores[other], folder / own / other
                with shown(f"fitted on {own}, on {other}") as step:
                    done, _ = evaluate.evaluate(
                        method, store, split, place, parameters, options, on_pair=step
                    )
                results[own, other] = done.result
                on_result(f"{own} -> {other}", done.result)
    made = Transfer(results, protocol, folder)
    if out is None:
        weakref.finalize(made, shutil.rmtree, folder, ignore_errors=True)
    return made


def score(
    folder: Path | str,
    dataset: Place | Dataset,
    split: str = "test",
    *,
    unit: Unit = "levels",
    method: str | None = None,
    protocol: str | None = None,
    out: Path | str | None = None,
    for_board: bool = False,
    cache: Path | str | None = None,
    on_pair: Progress | None = None,
) -> Run:
    """Score depth maps that were made elsewhere, one file per pair.

    Parameters
    ----------
    folder : Path or str
        The depth maps: npy, npz, PNG or TIFF, named after the pairs.
    dataset, split, protocol, for_board, cache, on_pair
        As for `run`.
    unit : {"levels", "metres"}
        The unit of the files.
    method : str, optional
        The method's name in tables; by default the folder's name.
    out : Path or str, optional
        Where the result goes; by default a new temporary folder.

    Raises
    ------
    ResultError
        If files are missing or invalid; it lists every problem.
    """
    if for_board:
        _check_for_board(split)
    store = _opened(dataset, cache)
    store.manifest.scenes_of(split)
    if for_board:
        require_sound(store)
    shown = plan.protocol_on(store.manifest, protocol)
    name = method or Path(folder).resolve().name
    with _folder(out, folder, str(store.path)) as place:
        done = evaluate.score_predictions(Path(folder), store, split, place, name, unit, on_pair)
        return _run_of({CLEAN: done}, {CLEAN: store}, shown, out)


def _require_number(limit: int | None) -> None:
    if limit is not None and not (isinstance(limit, Integral) and limit >= 1):
        expected, got = "a whole number from 1", repr(limit)
        raise InputError("no number of pairs", where="limit", expected=expected, got=got)


def _opened(dataset: Place | Dataset, cache: Path | str | None) -> Dataset:
    return dataset if isinstance(dataset, Dataset) else open_dataset(dataset, cache=cache)


@contextmanager
def _folder(
    out: Path | str | None, *inputs: Path | str | None, replaces: bool = True
) -> Iterator[Path]:
    """Give the run's folder: `out`, or a temporary one, which is removed if the run fails."""
    if out is not None:
        place = output_place(out, *inputs, replaces=replaces)
        # Beside "." no other name can be put.
        yield place if place.name.strip(".") else place.resolve()
        return
    folder = Path(tempfile.mkdtemp(prefix="dfdbench-"))
    try:
        yield folder
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise


def _require_some(result: Result) -> None:
    """Raise if a method failed on every pair of a track, so that the next one is not run."""
    errors = {pair.error for pair in result.pairs}
    if all(pair.status == "failed" for pair in result.pairs):
        what = f"it failed on every pair of {result.dataset.name}: {listed(errors, most=1)}"
        fix = f"dfdbench check-method {result.method.entry}"
        raise MethodError(what, where=result.method.entry, fix=fix)


def _run_of(
    done: Mapping[str, RunDone],
    stores: Mapping[str, Dataset],
    protocol: str,
    out: Path | str | None,
    calibration: Calibration | None = None,
    note: str | None = None,
) -> Run:
    runs = {
        label: SavedRun(each.folder / RESULT, each.result, stores[label], "")
        for label, each in done.items()
    }
    notes = [each_note for each in done.values() for each_note in each.notes]
    notes += [note] if note else []
    if calibration and (change := calibration.change).changes:
        notes.append(f"the fit found the defocus images {change.words()}, and took that out")
    elif calibration and change.has_shadow:
        notes.append(f"the fit found the defocus images {change.words()}")
    first = next(iter(runs.values())).result
    try:
        require_scored(protocol, first.protocol_names, f"{first.method.name}'s result")
    except UnknownNameError as error:
        if out is not None:
            raise
        # A temporary folder goes with an error, and the scores with it.
        protocol = shown_protocol(first)
        warnings.warn(f"{error}; shown under {protocol}", stacklevel=3)
    made = Run(runs, protocol, notes, calibration)
    with writing_folder(made.folder, "run"):
        write_whole(made.folder / TABLES, render(made.tables(), Format.markdown))
    if out is None:
        weakref.finalize(made, shutil.rmtree, made.folder, ignore_errors=True)
    for text in dict.fromkeys(text for each in done.values() for text in each.result.warnings):
        warnings.warn(text, stacklevel=3)
    return made


def compare(
    *runs: Run | Path | str, protocol: str | None = None, dataset: str | None = None, most: int = 10
) -> Comparison:
    """Compare each run with the first one, pair by pair, on the same data.

    Parameters
    ----------
    *runs : Run, Path or str
        Runs, or their folders. Of a run on tracks, only its clean images are compared.
    protocol : str, optional
        By default the data set's first.
    dataset : str, optional
        The store's path, if it is not where the runs found it.
    most : int
        How many changed pairs to list at most.

    Raises
    ------
    InputError
        If there are fewer than two runs, or something is neither a run nor a folder.
    ResultError
        If the runs are on different data or splits.

    Examples
    --------
    >>> compare("results/a", "results/b").table()  # doctest: +SKIP
    """
    for one in runs:
        if not isinstance(one, Run | Path | str):
            fix = "give each run, or its folder, as an argument of its own: compare(*runs)"
            raise InputError("not a run", where="runs", got=type(one).__name__, fix=fix)
    if any(isinstance(one, Run) and one._on_tracks for one in runs):
        warnings.warn("of a run on tracks, only its clean images are compared", stacklevel=2)
    label = find_protocol(protocol).label if protocol else None
    opened = [one._first if isinstance(one, Run) else open_saved_run(one, dataset) for one in runs]
    return Comparison(opened, label, most, runs)


def open_run(path: Path | str, dataset: str | None = None) -> Run:
    """Open the run that ``dfdbench run`` or ``dfdbench tracks`` left in a folder.

    Parameters
    ----------
    path : Path or str
        A run's folder or its ``result.json``, or the folder of a run on tracks.
    dataset : str, optional
        The store's path, if it is not where the run found it.

    Returns
    -------
    Run
        Of a run on tracks, those of the same method, parameters and seed as on the clean images.

    Raises
    ------
    ResultError
        If there is no run there, or its result is damaged.

    Examples
    --------
    >>> open_run("results/demo-1-test/local").table()  # doctest: +SKIP
    """
    folder = Path(path)
    if (folder / CLEAN / RESULT).is_file():
        there = (label for label in evaluate.labels_of(None) if (folder / label / RESULT).is_file())
        runs = {label: open_saved_run(folder / label, dataset) for label in there}
        from dfdbench.board.submission import facts_of

        # On tracks that were not run again, an earlier run may be of another method.
        whose = facts_of(runs[CLEAN].result)
        return Run({label: run for label, run in runs.items() if facts_of(run.result) == whose})
    return Run({CLEAN: open_saved_run(path, dataset)})
