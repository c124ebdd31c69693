"""Load a method for a data set and run it; the data sets of all tracks."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path
from typing import Any

from dfdbench.blur.tracks import CLEAN, TRACKS
from dfdbench.building.build import build_store
from dfdbench.building.build_plan import plan_build
from dfdbench.building.obtaining import obtain
from dfdbench.building.sources import is_made
from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.dataset import Dataset, open_dataset
from dfdbench.datasets.manifest import Manifest
from dfdbench.errors import InputError, MethodError, StoreError, unknown_name
from dfdbench.evaluation.loading import depth_warnings, load_for, load_here
from dfdbench.evaluation.plan import RunOptions
from dfdbench.evaluation.run import RunDone, run_method
from dfdbench.methods.calibration import Calibration
from dfdbench.methods.method import Method
from dfdbench.methods.registry import entry_of
from dfdbench.system.files import write_whole
from dfdbench.system.parallel import Pool

#: Shows how far a step is: entered with what is done, it gives a callable (done, total).
Shown = Callable[[str], AbstractContextManager[Callable[[int, int], None] | None]]


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
    on_pair: Callable[[int, int], None] | None = None,
) -> tuple[RunDone, Calibration | None]:
    """Load a method for a data set and run it; return also what its fit measured of the blur.

    Parameters
    ----------
    method : str or callable
        As for `load_for`, or any callable; one that only this process knows is run anew.
    check : callable, optional
        Called with the loaded method and the data set before the run; it raises to stop.
    store, split, folder, options, pool, on_pair
        As for `run_method`.
    parameters, given_blur
        As for `load_for`.
    """
    loaded, found_again = _load(store, method, parameters, options.seed, given_blur)
    if check:
        check(loaded, store)
    if not found_again:
        options = replace(options, fresh=True)
    warnings = depth_warnings(loaded, store, split)
    done = run_method(store, loaded, split, folder, options, pool, warnings, on_pair)
    calibration = loaded.attribute("calibration")
    # Someone else's method may have something else of that name.
    if not isinstance(calibration, Calibration):
        return done, None
    write_whole(folder / "law.toml", calibration.law.as_toml())
    return done, calibration


def _load(
    store: Dataset,
    method: str | Callable[..., Any],
    parameters: Mapping[str, Any],
    seed: int,
    given_blur: bool,
) -> tuple[Method, bool]:
    """Return the method, and whether it can be found again by its name."""
    if not isinstance(method, str):
        try:
            entry_of(method)
        except MethodError:
            return load_here(store, method, parameters, seed), False
    return load_for(store, method, parameters, seed, given_blur), True


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


def built_track(
    plain: Manifest, dataset: str, label: str, source: Path | None, cache: Path | None, shown: Shown
) -> Dataset:
    """Open a data set on a track, or build it if its files are made or at hand.

    Raises
    ------
    StoreError
        If it is not built and cannot be built here.
    """
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
