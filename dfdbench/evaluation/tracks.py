"""Run a method over the tracks of a data set: the same scenes, made harder."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from types import MappingProxyType
from typing import Any

from dfdbench.blur.tracks import CLEAN, TRACKS
from dfdbench.building.build import build_store
from dfdbench.building.obtaining import obtain
from dfdbench.building.plan import plan_build
from dfdbench.building.sources import is_made
from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.dataset import Dataset, open_dataset
from dfdbench.datasets.manifest import Manifest
from dfdbench.errors import InputError, StoreError, unknown_name
from dfdbench.evaluation.loading import load_for
from dfdbench.evaluation.plan import RunOptions
from dfdbench.evaluation.run import run_method
from dfdbench.methods.method import Method
from dfdbench.methods.registry import find_entry
from dfdbench.results.record import Result
from dfdbench.results.record_file import RESULT
from dfdbench.results.saved_run import SavedRun

#: Shows how far a step is: entered with what is done, it gives a callable (done, total).
Shown = Callable[[str], AbstractContextManager[Callable[[int, int], None] | None]]


def without_track(dataset: str) -> Manifest:
    """Return the manifest of a data set that has tracks.

    Raises
    ------
    InputError
        If the name has a track already, or the defocus images were captured.
    """
    manifest = find_manifest(dataset)
    if manifest.on_track:
        raise InputError(
            "this runs over all tracks of a data set",
            where=dataset,
            fix=f"name {dataset.rpartition('@')[0]}; --track NAME chooses among its tracks",
        )
    if manifest.recipe is None:
        raise InputError(
            "there are no tracks: the defocus images are captured, and a track makes them",
            where=dataset,
            fix="name a data set with synthetic blur: `dfdbench list`",
        )
    return manifest


def labels_of(tracks: Sequence[str] | None) -> list[str]:
    """Return ``clean`` and ``TRACK-SEVERITY`` of some tracks, by default of all.

    Raises
    ------
    UnknownNameError
        If there is no such track.
    """
    for name in tracks or ():
        if name not in TRACKS:
            raise unknown_name("track", name, TRACKS)
    chosen = [TRACKS[name] for name in dict.fromkeys(tracks or TRACKS)]
    return [
        CLEAN,
        *(f"{track.name}-{n}" for track in chosen for n in range(1, len(track.severities) + 1)),
    ]


def run_over_tracks(
    method: str | Callable[..., Any],
    dataset: str,
    folder: Path,
    split: str = "test",
    *,
    parameters: Mapping[str, Any] = MappingProxyType({}),
    tracks: Sequence[str] | None = None,
    given_blur: bool = False,
    source: Path | None = None,
    seed: int = 0,
    cache: Path | None = None,
    check: Callable[[Method, Dataset], None] = lambda method, store: None,
    on_result: Callable[[str, Result], None] = lambda label, result: None,
    shown: Shown = lambda what: nullcontext(),
) -> dict[str, SavedRun]:
    """Run a method on the clean images and on every track and severity.

    Parameters
    ----------
    method : str or callable
        As for `load_for`.
    dataset : str
        A data set's name, without a track.
    folder : Path
        Where the runs go, a folder each; runs that are there go on.
    split : str
        A split, a fold or a scene.
    parameters : mapping
        The method's.
    tracks : sequence of str, optional
        Which; by default all.
    given_blur : bool
        Give the method each track's blur.
    source : Path, optional
        The data set's files, to build what is not built.
    seed : int
        For methods that draw random numbers.
    cache : Path, optional
        The cache folder.
    check : callable
        Called with the method and a data set before each run; it raises to stop.
    on_result : callable
        Called with each label and its result.
    shown : callable
        Shows progress.

    Returns
    -------
    dict of str to SavedRun
        By ``clean`` and ``TRACK-SEVERITY``.

    Raises
    ------
    StoreError
        If a data set is not built and cannot be made here.
    DfdbenchError
        As of `load_for` and `run_method`.
    """
    plain = without_track(dataset)
    plain.scenes_of(split)
    labels = labels_of(tracks)
    # What cannot be run is said before anything is built or run for long.
    if isinstance(method, str):
        find_entry(method)
    stores = {CLEAN: _built(plain, dataset, CLEAN, source, cache, shown)}
    load_for(stores[CLEAN], method, parameters, seed, given_blur)
    for label in labels[1:]:
        stores[label] = _built(plain, dataset, label, source, cache, shown)
    runs = {}
    for label, store in stores.items():
        loaded = load_for(store, method, parameters, seed, given_blur)
        check(loaded, store)
        options = RunOptions(keep_predictions=False, seed=seed)
        with shown(f"running {loaded.name} on {label}") as step:
            done = run_method(store, loaded, split, folder / label, options, on_pair=step)
        runs[label] = SavedRun(folder / label / RESULT, done.result, store, "")
        on_result(label, done.result)
    return runs


def _built(
    plain: Manifest, dataset: str, label: str, source: Path | None, cache: Path | None, shown: Shown
) -> Dataset:
    name = dataset if label == CLEAN else f"{dataset}@{label}"
    try:
        return open_dataset(name, cache=cache)
    except StoreError:
        if source is None and not is_made(plain):
            raise
    plan = plan_build(find_manifest(name), cache=cache)
    files = obtain(plan, source, cache=cache).source
    with shown(f"building {name}") as step:
        build_store(plan.manifest, files, plan.place, on_scene=step)
    return open_dataset(name, cache=cache)
