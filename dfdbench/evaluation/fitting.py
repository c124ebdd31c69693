"""Fit a method to training pairs before a run, and keep what it learned beside the run."""

import hashlib
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.formation import given_law
from dfdbench.blur.recipe import BlurRecipe
from dfdbench.blur.tracks import Formation
from dfdbench.datasets.dataset import Captures, Dataset
from dfdbench.datasets.manifest import ALL_PAIRS, Manifest, training_of
from dfdbench.errors import MethodError, ResultError, StoreError
from dfdbench.methods.fitted import Blur, evenly_spread
from dfdbench.methods.method import Learned, Method, TrainingPair, check_learned, restore, teach
from dfdbench.methods.readout import Chosen
from dfdbench.results.record import RESULT, MethodRecord, load_result
from dfdbench.system.array_files import UNREADABLE, load_arrays
from dfdbench.system.files import LARGEST_ARRAY, read_whole, write_whole

#: The file in a run's folder that holds what was learned.
FIT = "fit.npz"
TRAINING = "train"
# NumPy takes array names as keyword arguments, some of which it uses itself.
_PREFIX = "learned."
# A misfit this many times larger means another camera; how many captures of each are compared.
_OTHER_CAMERA, _LOOKED_AT = 1.6, 6


@dataclass(frozen=True)
class Fit:
    """How a method was fitted.

    Parameters
    ----------
    fitted_on : str
        The pairs it saw, in the form of a result's `trained_on`.
    seconds : float
        How long the fit took.
    learned : dict or None
        What it learned; None if the method keeps that in itself.
    """

    fitted_on: str
    seconds: float
    learned: Learned | None


def training_pairs(
    store: Dataset, split: str, images: Sequence[int] | None = None
) -> tuple[str, Captures]:
    """Return the pairs that a method may be fitted on before it is run on a split.

    They are the split ``train`` or, if a fold or a single scene is run, the others. `images`
    are the two images of each capture to use as a pair.

    Returns
    -------
    str
        The name of these pairs, in the form of a result's `trained_on`.
    Captures
        The pairs, which are read on demand.

    Raises
    ------
    MethodError
        If the run would test on pairs that it was fitted on.
    StoreError
        If there is no training split, or the store holds no pair of it.
    """
    name, scenes = training_scenes(store.manifest, split)
    pairs = tuple(pair for pair in store.pairs(ALL_PAIRS) if pair.scene in scenes)
    if not pairs:
        what = f"the method is to be fitted, and the store holds no pair of {name}"
        fix = f"build {store.manifest.short} with its training scenes too"
        raise StoreError(what, where=str(store.path), fix=fix)
    return name, Captures(store, pairs, images)


def training_scenes(manifest: Manifest, split: str) -> tuple[str, frozenset[str]]:
    """Return the name and the scenes of the data that a method is fitted on before a split is run.

    Raises
    ------
    MethodError
        If the run would test on scenes that it was fitted on.
    StoreError
        If there is no training split.

    Examples
    --------
    >>> from dfdbench.datasets.catalog import find_manifest
    >>> training_scenes(find_manifest("demo"), "test")[0]
    'demo-1, split train'
    """
    if _is_left_out(manifest, split):
        return f"{manifest.stem}, all but {split}", frozenset(training_of(manifest, split))
    splits = [item.name for item in manifest.splits]
    if TRAINING not in splits:
        what = f"the method is to be fitted, and there is no split {TRAINING}"
        fix = "run a fold or a single scene, --split NAME: the others train"
        fix = fix if len(manifest.scene_names) > 1 else "a method with a fit needs more scenes"
        raise StoreError(what, where=manifest.stem, fix=fix)
    train = frozenset(manifest.scenes_of(TRAINING))
    both = [scene for scene in manifest.scenes_of(split) if scene in train]
    if both:
        what = f"the method would be tested on what it was fitted on: {', '.join(both)}"
        # Name the folds, or single scenes if there are none: the others then train.
        fair = [item.name for item in manifest.splits if train.isdisjoint(item.scenes)]
        fair += [fold.name for fold in manifest.folds] or list(manifest.scene_names)
        fix = f"--split NAME, one of: {', '.join(fair)}"
        raise MethodError(what, where=f"split {split} of {manifest.stem}", fix=fix)
    return f"{manifest.stem}, split {TRAINING}", train


def mean_scenes(manifest: Manifest, split: str) -> tuple[str, frozenset[str]]:
    """Return the name and the scenes of the data whose mean depth methods get for a split.

    That is the training split; if the split is a fold or a scene of it, the others.

    Raises
    ------
    StoreError
        If there is no training split.
    """
    if TRAINING in {item.name for item in manifest.splits}:
        train = frozenset(manifest.scenes_of(TRAINING))
        if not _is_left_out(manifest, split) or train.isdisjoint(manifest.scenes_of(split)):
            return f"{manifest.stem}, split {TRAINING}", train
    elif not _is_left_out(manifest, split):
        what = "the method asks for the depth of the training split, and there is no split train"
        fix = "--param training_mean=LEVEL, 0 to 255, or build from a manifest that has one"
        raise StoreError(what, where=manifest.stem, fix=fix)
    return training_scenes(manifest, split)


def _is_left_out(manifest: Manifest, split: str) -> bool:
    # In the order of `Manifest.scenes_of`: a fold before a split before a scene.
    if split in {fold.name for fold in manifest.folds}:
        return True
    splits = {item.name for item in manifest.splits}
    return split in manifest.scene_names and split not in splits and split != ALL_PAIRS


def fit_method(store: Dataset, method: Method, split: str, seed: int) -> Fit | None:
    """Fit a method to the training pairs that belong to a split; return None if it has no fit.

    Raises
    ------
    MethodError, StoreError
        As for `training_pairs`; or if the fit raises or returns something that cannot be kept.
    """
    if method.learner is None:
        return None
    two = method.two_images(store.manifest.pair_images)
    fitted_on, pairs = training_pairs(store, split, two)
    try:
        learned, seconds = teach(method, pairs, seed)
    except KeyboardInterrupt as stopped:
        # The command line shows this instead of "goes on from here".
        stopped.add_note(f"{method.name} was being fitted: the same command begins the fit anew")
        raise
    return Fit(fitted_on, seconds, learned)


def fit_sha256(folder: Path) -> str:
    """Return the SHA-256 of what a run's fit learned.

    Raises
    ------
    MethodError
        If the run kept no fit.
    """
    try:
        return hashlib.sha256((folder / FIT).read_bytes()).hexdigest()
    except OSError as error:
        fix = "name the folder of a run of a method that is fitted"
        what = "the run kept nothing that a method learned"
        raise MethodError(what, where=str(folder), fix=fix) from error


def fit_from(method: Method, folder: Path, stem: str) -> Fit:
    """Give a method what it learned for another run, on the same camera or another.

    What its fit chose depends on the depths and the noise of that run's data set. So on another
    data set, `stem`, it gets only what the fit measured.

    Raises
    ------
    MethodError
        If the method has no fit, or if the run is of another method or kept no fit that this one
        takes back.
    """
    if method.learner is None:
        raise MethodError("the method has no fit", where=method.entry, fix="leave out --fitted")
    fit_sha256(folder)
    if (folder / RESULT).is_file():
        require_run_of(method.name, method.entry, load_result(folder / RESULT).method, folder)
    fit = fit_again(method, folder)
    assert fit is not None  # its file is there
    chosen = isinstance(method.attribute("chosen"), Chosen)
    if chosen and fit.learned and not fit.fitted_on.startswith(f"{stem},"):
        fit = replace(fit, learned=Chosen.left_out_of(fit.learned))
        restore(method, dict(fit.learned or {}))
    return fit


def require_run_of(name: str, entry: str, ran: MethodRecord, folder: Path) -> None:
    """Raise if a run is of another method: a method can only take back its own fit.

    Raises
    ------
    MethodError
        If the run is of another method.
    """
    # The same file may be given from another folder, and our own modules may move.
    if name != ran.name and Path(entry).name != Path(ran.entry).name:
        what, fix = f"this run is of {ran.name}, not of {name}", "name a run of the same method"
        raise MethodError(what, where=str(folder), fix=fix)


def fit_again(method: Method, folder: Path) -> Fit | None:
    """Give a method what it learned when its run began; return None if nothing was kept.

    Raises
    ------
    MethodError
        If the method does not take it back.
    ResultError
        If the file is damaged.
    """
    if method.learner is None or not (folder / FIT).is_file():
        return None
    fit = read_fit(folder)
    assert fit.learned is not None  # `keep_fit` writes nothing else
    restore(method, fit.learned)
    return fit


def camera_note(
    blur: Blur, test: Sequence[TrainingPair], training: Sequence[TrainingPair] = ()
) -> str | None:
    """Return a note if a blur explains test pairs much worse, or better, than training pairs.

    They were then taken by another camera, or with other settings. Without training pairs, the
    residuals are compared with the blur's own noise. There is no note on stacks, since we do not
    know here which of their images the blur describes.
    """
    if not all(pairs[0].is_pair for pairs in (test, training) if pairs):
        return None
    from dfdbench.methods.law_cost import misfit  # compiles; most methods fit no law

    law = given_law(blur, Formation()) if isinstance(blur, BlurRecipe) else blur

    def median(pairs: Sequence[TrainingPair]) -> float:
        some = [pairs[place] for place in evenly_spread(len(pairs), _LOOKED_AT)]
        return float(np.median([misfit(law, one.infocus, one.defocus) for one in some]))

    there, own = median(test), median(training) if training else 1.0
    times = max(own, there) / max(min(own, there), 1e-6)
    # The best of many levels leaves less than the noise.
    if times < _OTHER_CAMERA or (there < own and not training):
        return None
    how, noise = ("worse", "more") if there > own else ("better", "less")
    than = "the training's" if training else "its own noise allows"
    what = f"the method's blur explains the images {times:.1f} times {how} than {than}"
    return f"{what}: {noise} noise or compression, another camera, or other settings?"


def keep_fit(folder: Path, fit: Fit) -> None:
    """Write what a method learned beside its run, unless the method keeps it in itself."""
    if fit.learned is not None:
        facts = {"fitted_on": np.array(fit.fitted_on), "seconds": np.array(fit.seconds)}
        write_whole(folder / FIT, pack(fit.learned, facts))


def read_fit(folder: Path) -> Fit:
    """Read what a method learned for a run.

    Raises
    ------
    ResultError
        If the file is damaged.
    """
    path = folder / FIT
    try:
        content = read_whole(path, LARGEST_ARRAY)
        with load_arrays(io.BytesIO(content)) as arrays:
            seconds = float(arrays["seconds"])
            learned = check_learned(unpack(content), str(path))
            if not 0 <= seconds < math.inf:
                raise ValueError(f"it took {seconds} seconds")
            return Fit(str(arrays["fitted_on"]), seconds, learned)
    except MethodError as error:
        raise _damaged(path, "; ".join(problem.what for problem in error.problems)) from error
    except UNREADABLE as error:
        raise _damaged(path, "a file that is damaged, or another kind of file") from error


def _damaged(path: Path, got: str) -> ResultError:
    fix = "run it again with --fresh: the method is fitted anew"
    return ResultError(f"what the method learned cannot be read: {got}", where=str(path), fix=fix)


def pack(learned: Learned, facts: dict[str, NDArray[Any]] | None = None) -> bytes:
    """Return what was learned as a NumPy archive, with other facts beside it.

    Examples
    --------
    >>> unpack(pack({"file": 0.5, "levels": np.arange(3)}))
    {'file': 0.5, 'levels': array([0, 1, 2])}
    """
    file = io.BytesIO()
    arrays = {_PREFIX + name: np.asarray(value) for name, value in learned.items()}
    np.savez(file, **(facts or {}), **arrays)  # type: ignore[arg-type]
    return file.getvalue()


def unpack(content: bytes) -> Learned:
    """Return what `pack` put into an archive."""
    with load_arrays(io.BytesIO(content)) as arrays:
        return {
            name.removeprefix(_PREFIX): array if array.ndim else array.item()
            for name, array in arrays.items()
            if name.startswith(_PREFIX)
        }
