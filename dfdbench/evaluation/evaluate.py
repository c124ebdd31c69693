"""Run a method on a data set and its tracks, tune its parameters, or score maps made elsewhere."""

import copy
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pandas as pd
from pydantic import TypeAdapter, ValidationError

from dfdbench.blur.tracks import CLEAN, TRACKS
from dfdbench.building.sources import is_made
from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.dataset import Captures, Dataset, open_dataset
from dfdbench.datasets.manifest import Manifest, Pair
from dfdbench.errors import InputError, MethodError, StoreError, UnknownNameError, unknown_name
from dfdbench.evaluation.fitting import TRAINING
from dfdbench.evaluation.loading import depth_warnings, load_for
from dfdbench.evaluation.map_files import find_predictions
from dfdbench.evaluation.pair import PairEvaluator, blank_record, record_of
from dfdbench.evaluation.plan import RunOptions, protocol_on, protocols_on, require_scorable
from dfdbench.evaluation.run import OnPair, RunDone, compose, run_method
from dfdbench.methods.measured_law import Calibration
from dfdbench.methods.method import Method, Prediction, teach
from dfdbench.metrics.metric import find_metric
from dfdbench.metrics.protocol import SURE, Unit, find_protocol, ranked_by
from dfdbench.results.record import (
    RESULT,
    SCORED,
    MethodRecord,
    PairResult,
    Parameters,
    save_result,
)
from dfdbench.results.run_folder import Predictions, keep_store_place, open_run_folder
from dfdbench.results.wording import plain, score_text, without_folders
from dfdbench.system.files import write_whole, writing_folder
from dfdbench.system.parallel import Pool, Shown, one_by_one
from dfdbench.tables.table import Table, grouped


def evaluate(
    method: str | Callable[..., Any],
    store: Dataset,
    split: str,
    folder: Path,
    parameters: Mapping[str, Any],
    options: RunOptions,
    given_blur: bool = False,
    pool: Pool | None = None,
    check: Callable[[Method, Dataset], None] | None = None,
    on_pair: OnPair | None = None,
) -> tuple[RunDone, Calibration | None]:
    """Load a method for a data set and run it; also return the blur that its fit measured.

    Parameters
    ----------
    method : str or callable
        As for `load_for`. If only this process knows it, an earlier run is not resumed.
    check : callable, optional
        Called with the loaded method and the data set before the run; raises to stop it.
    store, split, folder, options, pool, on_pair
        As for `run_method`.
    parameters, given_blur
        As for `load_for`.
    """
    loaded = load_for(store, method, parameters, options.seed, given_blur, split)
    if check:
        check(loaded, store)
    for key, value in loaded.parameters.items():
        try:
            TypeAdapter(Parameters).validate_python({key: without_folders(value)})
        except ValidationError as error:
            what, where, got = "no result can keep this", f"parameter {key}", f"{value!r:.80}"
            fix = "give numbers, texts or lists, or the name of a file that the method reads"
            raise MethodError(what, where=where, got=got, fix=fix) from error
    if loaded.source_sha256 is None:
        options = replace(options, fresh=True)
    warnings = depth_warnings(loaded, store, split, options.fitted)
    done = run_method(store, loaded, split, folder, options, pool, warnings, on_pair)
    # Someone else's method may have something else of that name.
    measured = loaded.attribute("calibrations")
    measured = measured if isinstance(measured, tuple) else ()
    found = [one for one in measured if isinstance(one, Calibration)]
    for number, one in enumerate(found, 1):
        name = "law.toml" if len(found) == 1 else f"law-{number}.toml"
        write_whole(folder / name, f"# {one.change.words()}\n{one.law.as_toml()}")
    return done, found[0] if len(found) == 1 else None


def without_track(dataset: str, cache: Path | str | None = None) -> Manifest:
    """Return the manifest of a data set that has tracks.

    Raises
    ------
    InputError
        If the name already includes a track or is a store's, or the defocus images were captured.
    """
    try:
        manifest, is_name = find_manifest(dataset), True
    except UnknownNameError:
        manifest, is_name = open_dataset(dataset, cache=cache).manifest, False
    if manifest.on_track:
        fix = f"name {dataset.rpartition('@')[0]}; --track NAME chooses among its tracks"
        raise InputError("this runs over all tracks of a data set", where=dataset, fix=fix)
    if manifest.recipe is None:
        what = "there are no tracks: the defocus images are captured, and a track makes them"
        fix = "name a data set with synthetic blur: `dfdbench list`"
        raise InputError(what, where=dataset, fix=fix)
    if not is_name:
        what = (
            "this is a store, and tracks are built from a set's manifest, each into its own store"
        )
        raise InputError(what, where=dataset, fix=by_name(manifest))
    return manifest


def by_name(manifest: Manifest) -> str:
    """Say how to name a data set of which a store is open."""
    try:
        find_manifest(manifest.short)
    except UnknownNameError:
        return "name its TOML file"
    return f"name {manifest.short}"


def labels_of(tracks: Iterable[str] | None) -> list[str]:
    """Return ``clean`` and each ``TRACK-SEVERITY`` of some tracks, by default of all.

    Raises
    ------
    UnknownNameError
        If there is no such track.
    """
    tracks = [tracks] if isinstance(tracks, str) else tracks
    names = list(TRACKS if tracks is None else dict.fromkeys(tracks))
    for name in names:
        if name not in TRACKS:
            raise unknown_name("track", name, TRACKS)
    chosen = [TRACKS[name] for name in names]
    return [CLEAN, *(label for track in chosen for label in track.labels)]


def built_track(
    dataset: str, label: str, source: Path | str | None, cache: Path | str | None, shown: Shown
) -> Dataset:
    """Open a data set on a track, or build it if its files are generated or at hand.

    Raises
    ------
    StoreError
        If it is not built and cannot be built here.
    """
    name = dataset if label == CLEAN else f"{dataset}@{label}"
    try:
        return open_dataset(name, cache=cache)
    except StoreError:
        if source is None and not is_made(find_manifest(dataset)):
            raise
    # Imported here: a run on a built set does not need it.
    from dfdbench.building.obtaining import build_dataset

    build_dataset(name, Path(source) if source else None, cache=cache, shown=shown)
    return open_dataset(name, cache=cache)


def score_predictions(
    predictions: Path,
    store: Dataset,
    split: str,
    folder: Path,
    name: str,
    unit: Unit = "levels",
    on_pair: Callable[[int, int], None] | None = None,
) -> RunDone:
    """Score a folder of depth maps, and write the same files as a run.

    Parameters
    ----------
    predictions : Path
        The depth maps, see `dfdbench.evaluation.map_files.find_predictions`.
    store : Dataset
        The data set.
    split : str
        The pairs to score.
    folder : Path
        Where result and depth levels go; previous content is set aside.
    name : str
        The method's name in tables.
    unit : {"levels", "metres"}
        The unit of the depth maps.
    on_pair : callable, optional
        Called with (pairs done, pairs to do).

    Returns
    -------
    RunDone
        Its result says ``scored``, and has no source hash and no seconds.

    Raises
    ------
    InputError
        If the name is invalid.
    UnknownNameError
        If the unit is unknown.
    StoreError
        If there is no depth to score against, or the store has lost something that was built.
    ResultError
        If files are invalid (it lists every problem, before anything is written), or the folder
        cannot be written.
    """
    method = _method_record(name, unit)
    require_scorable(store, split)
    found = find_predictions(predictions, store, split, unit)
    with writing_folder(folder, "run"):
        identity = {"scored": name, "fingerprint": store.fingerprint, "split": split, "unit": unit}
        set_aside = open_run_folder(folder, identity, goes_on=False)
        keep_store_place(folder, store.path)
        records: dict[str, PairResult] = {}
        kept = Predictions(folder, store.manifest)
        for pair in one_by_one(found.files, on_pair):
            images = store.read(pair)
            depth, sigma, beyond = found.read(pair, store.shape_of(pair.scene))
            answer = Prediction(depth, 0.0, sigma=sigma)
            record = record_of(store, images, answer, protocols_on(store), unit, beyond)
            records[pair.id] = record.model_copy(update={"seconds": None})
            kept.keep(pair, depth, sigma)
        wanted = store.manifest.pairs(split)
        pairs = [records.get(pair.id) or blank_record(pair, "missing") for pair in wanted]
        others = f"{found.others} files are of other pairs of the set, and were not scored"
        warnings = [others] * bool(found.others)
        result = compose(store, split, method, pairs, warnings=warnings)
        save_result(result, folder / RESULT)
    return RunDone(result, folder, 0, set_aside)


def _method_record(name: str, unit: Unit) -> MethodRecord:
    if unit not in get_args(Unit):
        raise unknown_name("unit", str(unit), get_args(Unit))
    unknown: dict[str, Any] = dict.fromkeys(("source_sha256", "trained_on", "paper"))
    try:
        return MethodRecord(name=name, entry=SCORED, parameters={}, uses=[], scored=unit, **unknown)
    except ValidationError as error:
        what = f"no name for a method, which is one line of text: {name!r:.80}"
        raise InputError(what, fix="--method NAME") from error


#: The number of folds of training captures; captures of a group stay together.
FOLDS = 4


def cross_validate(
    store: Dataset,
    method: str | Callable[..., Any],
    ranges: Mapping[str, Sequence[Any]] | None,
    parameters: Mapping[str, Any],
    protocol: str | None,
    limit: int | None,
    seed: int,
    on_pair: Callable[[int, int], None] | None,
) -> pd.DataFrame:
    """Score every combination of parameters on training captures that it was not fitted on.

    The captures are divided into four folds; captures of a group stay together. For each fold the
    method is fitted on the other three, if it has a fit, and scored on the fold. Parameters, return
    value and errors are those of `dfdbench.tune`.
    """

    def loaded(trial: Mapping[str, Any]) -> Method:
        return load_for(store, _forgetful(method), {**parameters, **trial}, seed)

    ranges = _values_of(ranges or {})
    # A parameter to try may have no default.
    first = loaded({name: values[0] for name, values in ranges.items()})
    ranges = ranges or _values_of(first.attribute("ranges") or {})
    if not ranges:
        what = "nothing to try: the method states no ranges of its own"
        raise InputError(what, where=first.name, fix="name some: --range window=7,31,91")
    rule = find_protocol(protocol_on(store.manifest, protocol))
    folds = folds_of(store)
    trials = [dict(zip(ranges, values, strict=True)) for values in product(*ranges.values())]
    # Invalid parameters fail before anything is run.
    methods = [loaded(trial) for trial in trials]
    every = [pair for fold in folds for pair in fold]
    # At random: every n-th capture may be of one illumination.
    scored = {every[n] for n in np.random.default_rng(seed).permutation(len(every))[:limit]}
    rows, done = list[dict[str, Any]](), 0
    for trial, ready in zip(trials, methods, strict=True):
        found = []
        for fold in filter(scored.intersection, folds):
            if ready.learner is not None:
                # Anew for each fold: it may keep in itself what it learned.
                ready = loaded(trial)
                others = tuple(pair for pair in every if pair not in fold)
                two = ready.two_images(store.manifest.pair_images)
                teach(ready, Captures(store, others, two), seed)
            evaluator = PairEvaluator(store, ready, seed, [rule])
            for pair in (pair for pair in fold if pair in scored):
                record, _ = evaluator(pair)
                found.append(_scores_of(record, rule.label, trial))
                done += 1
                if on_pair:
                    on_pair(done, len(scored) * len(trials))
        rows.append({**trial, **pd.DataFrame(found).mean()})
    # As they were given: a column of whole numbers and others would make all of them fractions.
    tried = pd.DataFrame(rows).assign(**pd.DataFrame(trials, dtype=object)).set_index([*ranges])
    return tried.sort_values(list(ranked_by(rule.label)), kind="stable")


def _forgetful(method: str | Callable[..., Any]) -> str | Callable[..., Any]:
    """Return a method to load anew: an object may keep what it learned from captures to score."""
    if isinstance(method, str | type | Method) or not hasattr(method, "fit"):
        return method
    try:
        return copy.deepcopy(method)
    except Exception as error:  # what it holds may refuse in any way
        what = f"the method cannot be copied for each fold: {error}"
        raise MethodError(what, where=type(method).__name__, fix="give its class") from error


def _scores_of(record: PairResult, label: str, trial: Mapping[str, Any]) -> dict[str, float | None]:
    where = " ".join((record.id, "with", *settings(trial)))
    if record.error:
        raise MethodError(record.error, where=where)
    if record.lacks_answers(label, ranked_by(label)[0]):
        what = f"too many pixels have no answer for a score by protocol {label}"
        fix = "leave these values out" if label == SURE else f"--protocol {SURE}"
        raise MethodError(what, where=where, fix=fix)
    return record.scores[label]


def _values_of(ranges: Mapping[str, Any]) -> dict[str, list[Any]]:
    for name, values in ranges.items():
        # A text is iterable too, but nobody wants to try its letters.
        if isinstance(values, str) or not isinstance(values, Iterable):
            fix = f"give a list: {{{name!r}: [{values!r}]}}"
            raise InputError("the values to try are no list", where=name, fix=fix)
    found = {
        name: [value.item() if isinstance(value, np.generic) else value for value in values]
        for name, values in ranges.items()
    }
    if empty := [name for name, values in found.items() if not values]:
        fix = "name some, or leave the parameter out"
        raise InputError("the list of values to try is empty", where=empty[0], fix=fix)
    return found


def tried_table(tried: pd.DataFrame, title: str) -> Table:
    """Return the findings of `cross_validate` as a table."""
    metrics = {name: find_metric(name) for name in map(str, tried)}
    names = [str(name) for name in tried.index.names]
    trials = list(zip(_parameters(tried), tried.to_numpy().tolist(), strict=True))
    rows = [(*map(plain, given.values()), *map(score_text, scores)) for given, scores in trials]
    records = tuple(given | dict(zip(metrics, scores, strict=True)) for given, scores in trials)
    columns = (*names, *(metric.heading for metric in metrics.values()))
    return Table(title, columns, tuple(rows), "l" * len(names), records=records)


def best_settings(tried: pd.DataFrame) -> list[str]:
    """Return the best parameters as ``--param`` takes them."""
    return settings(_parameters(tried)[0])


def _parameters(tried: pd.DataFrame) -> list[dict[str, Any]]:
    shown = tried.index.to_frame(index=False).astype(object)
    rows = shown.where(shown.notna(), None).to_dict("records")
    return [{str(name): value for name, value in row.items()} for row in rows]


def folds_of(store: Dataset) -> list[list[Pair]]:
    """Divide the training captures into folds of similar size, keeping groups together.

    Raises
    ------
    InputError
        If there are fewer groups than folds.
    """
    group_of = store.manifest.groups
    groups = grouped((group_of.get(p.scene, p.scene), p) for p in store.pairs(TRAINING))
    if len(groups) < FOLDS:
        what = f"{len(groups)} groups of training captures are too few for {FOLDS} folds"
        raise InputError(what, where=store.manifest.stem, fix="build it with more training scenes")
    folds: list[list[Pair]] = [[] for _ in range(FOLDS)]
    # Largest group first, each into the smallest fold.
    for group in sorted(groups.values(), key=len, reverse=True):
        min(folds, key=len).extend(group)
    return folds


def settings(parameters: Mapping[str, Any]) -> list[str]:
    """Return parameters as ``--param`` takes them.

    Examples
    --------
    >>> settings({"window": 31, "smoothing": 0.5})
    ['window=31', 'smoothing=0.5']
    """
    return [f"{name}={plain(value)}" for name, value in parameters.items()]
