"""What a method says it was trained on, held against the depths that it is tested on."""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import StrEnum

from dfdbench.audit.coverage import Coverage
from dfdbench.audit.leaks import manifest_leaks
from dfdbench.audit.level_ranges import as_ranges
from dfdbench.audit.sides import Side, all_but, scene_histograms, side_of
from dfdbench.datasets.folds import training_of
from dfdbench.datasets.store import Store, open_store
from dfdbench.datasets.tracked import part_name
from dfdbench.errors import DfdbenchError, InputError
from dfdbench.tables.wording import percent

#: How `trained_on` names scenes: a manifest's name and version, then a split, or the fold or
#: scene that was left out.
FORM = '"MANIFEST, split NAME" or "MANIFEST, all but FOLD"'
_PATTERN = re.compile(r"(?P<manifest>[\w.@-]+), (?P<how>split|all but) (?P<name>[\w.-]+)(,.*)?")


class Training(StrEnum):
    """What is known of the scenes that a method was trained on."""

    known = "known"
    #: It was trained, but `trained_on` names no scenes.
    unknown = "unknown"
    #: It names no training at all.
    none = "none"


@dataclass(frozen=True)
class RunSides:
    """What a run's split is held against.

    Parameters
    ----------
    train, test : Side
        The training side, and the depths of the run's split.
    training : Training
        Whether `train` is what the method was trained on.
    """

    train: Side
    test: Side
    training: Training


def sides_of_run(
    store: Store,
    split: str,
    trained_on: str | None,
    train: str | None = None,
    fold: str | None = None,
) -> RunSides:
    """Return what a run was tested on, and what it was trained on as far as that is known.

    Parameters
    ----------
    store : Store
        The data set that was run on.
    split : str
        What of it was tested.
    trained_on : str or None
        What the method says of itself.
    train, fold : str, optional
        A split that trained, or a fold or scene that was left out: both outdo `trained_on`.

    Raises
    ------
    InputError
        Where no training is named and the run leaves no scene for it.
    UnknownNameError
        Where there is no such split, fold or scene.
    StoreError
        Where a store holds none of the scenes.

    Notes
    -----
    Without a name, the split ``"train"`` stands for training, or all other scenes where a fold
    was tested or one of the scenes in ``"train"``.
    """
    histograms, scenes_of = scene_histograms(store), store.manifest.scenes_of
    test = side_of(store, histograms, split, scenes_of(split))
    if fold:
        return RunSides(all_but(store, histograms, fold), test, Training.known)
    if train:
        return RunSides(side_of(store, histograms, train, scenes_of(train)), test, Training.known)
    if trained_on and (named := training_side(trained_on, store)):
        return RunSides(named, test, Training.known)
    name, scenes = _usual_training(store, split)
    training = Training.unknown if trained_on else Training.none
    return RunSides(side_of(store, histograms, name, scenes), test, training)


def _usual_training(store: Store, split: str) -> tuple[str, tuple[str, ...]]:
    manifest = store.manifest
    tested = set(manifest.scenes_of(split))
    folds = {item.name for item in manifest.folds}
    if split not in folds and "train" in {item.name for item in manifest.splits}:
        scenes = manifest.scenes_of("train")
        if tested.isdisjoint(scenes):
            return "train", scenes
    if not (others := training_of(manifest, split)):
        raise InputError(
            "the run tested every scene: none is left to hold it against",
            where=split,
            fix="run the method on one split, or name its training in trained_on",
        )
    return f"all but {split}", others


def training_side(trained_on: str, store: Store) -> Side | None:
    """Return the depths that a method was trained on, or None where the text names none.

    Parameters
    ----------
    trained_on : str
        In the form of `FORM`; what follows a further comma is left to the author.
    store : Store
        The data set in use; another one is looked for where `build` puts it.

    Raises
    ------
    DfdbenchError
        Where it names a data set or a split that is not there.
    """
    said = _PATTERN.fullmatch(trained_on.strip())
    if not said:
        return None
    # The depths of a set are the same on every track of it.
    own, base = store.manifest, part_name(said["manifest"])[0]
    known = (own.file_stem, own.name, part_name(own.short)[0])
    training = store if base in known else open_store(said["manifest"])
    scenes = training.manifest.scenes_of(said["name"])
    name = said["name"]
    if said["how"] == "all but":
        scenes, name = training_of(training.manifest, name), f"all but {name}"
    inverted = training.manifest.depth.grows_with != store.manifest.depth.grows_with
    return side_of(training, scene_histograms(training), name, scenes, inverted)


def coverage_warnings(trained_on: str | None, store: Store, split: str) -> list[str]:
    """Return what a result should say where training leaves levels of the test uncovered.

    Parameters
    ----------
    trained_on : str or None
        What the method says of itself; without it there is nothing to compare.
    store : Store
        The data set that it is tested on.
    split : str
        What it is tested on.
    """
    if not trained_on:
        return []
    try:
        train = training_side(trained_on, store)
        if train is None:
            return [f"depths not compared with training: trained_on is not {FORM}"]
        test = side_of(store, scene_histograms(store), split, store.manifest.scenes_of(split))
    except DfdbenchError as error:
        return [f"depths not compared with training: {error.problems[0].what}"]
    return _leak_warning(train, test) + _depth_warning(train, test)


def _leak_warning(train: Side, test: Side) -> list[str]:
    leaks = manifest_leaks(
        train.store.manifest,
        (*train.scenes, *train.absent),
        test.store.manifest,
        tuple(test.scenes),
    )
    if not leaks:
        return []
    names = ", ".join(dict.fromkeys(leak.test for leak in leaks))
    return [
        f"leak: {train.dataset}, {train.name}, trained on scenes or textures of the test: {names}"
    ]


def _depth_warning(train: Side, test: Side) -> list[str]:
    coverage = Coverage(train.histogram, test.histogram)
    levels = coverage.uncovered()
    if not levels.any():
        return []
    return [
        f"{percent(coverage.share(levels))} of the test's known pixels lie on depth levels that "
        f"{train.dataset}, {train.name}, leaves missing or scarce: {as_ranges(levels)}"
    ]
