"""What a method says it was trained on, compared with the depths that it is tested on."""

from enum import StrEnum

from dfdbench.audit.coverage import USUAL, Criterion, share_of
from dfdbench.audit.leaks import FORM, NAMED, is_called, scenes_said, scenes_seen
from dfdbench.audit.sides import Side, all_but, as_ranges, side_of
from dfdbench.datasets.dataset import Dataset, open_dataset
from dfdbench.datasets.manifest import training_of
from dfdbench.errors import DfdbenchError, InputError
from dfdbench.system.text import TRAININGS
from dfdbench.tables.table import percent


class Training(StrEnum):
    """What is known of the scenes that a method was trained on."""

    known = "known"
    #: It was trained, but `trained_on` names no scenes.
    unknown = "unknown"
    #: It does not say that it was trained.
    none = "none"


def sides_of_run(
    store: Dataset, split: str, trained_on: str | None, train: str | None, fold: str | None
) -> tuple[Side, Side, Training]:
    """Return what a run was tested on and, as far as known, what it was trained on.

    Parameters
    ----------
    store : Dataset
        The data set that was run on.
    split : str
        The split that was tested.
    trained_on : str or None
        What the method says about itself.
    train, fold : str, optional
        A split for training, or a fold or scene that was left out: both override `trained_on`.

    Returns
    -------
    tuple of Side, Side, Training
        Training, test, and whether the first is the method's own.

    Raises
    ------
    InputError
        If no training is named and the run leaves no scene for it.
    UnknownNameError
        If there is no such split, fold or scene.
    StoreError
        If a store holds none of the scenes.

    Notes
    -----
    If none is named, the split ``"train"`` is taken for training, or the others if a fold or
    a scene in ``"train"`` was tested.
    """
    test = side_of(store, split)
    if fold:
        return all_but(store, fold), test, Training.known
    if train:
        return side_of(store, train), test, Training.known
    if trained_on and (named := training_side(trained_on, store)):
        return named, test, Training.known
    name, scenes = _usual_training(store, split)
    training = Training.unknown if trained_on else Training.none
    return side_of(store, name, scenes), test, training


def _usual_training(store: Dataset, split: str) -> tuple[str, tuple[str, ...]]:
    manifest = store.manifest
    tested = set(manifest.scenes_of(split))
    folds = {item.name for item in manifest.folds}
    if split not in folds and "train" in {item.name for item in manifest.splits}:
        scenes = manifest.scenes_of("train")
        if tested.isdisjoint(scenes):
            return "train", scenes
    if not (others := training_of(manifest, split)):
        fix = "run the method on one split, or name its training in trained_on"
        raise InputError("the run tested every scene: none is left to compare with", fix=fix)
    return f"all but {split}", others


def training_side(trained_on: str, store: Dataset) -> Side | None:
    """Return the depths that a method was trained on, or None if the text names none.

    Parameters
    ----------
    trained_on : str
        As in `dfdbench.audit.leaks.scenes_seen`; the first one, which is the last training, counts.
    store : Dataset
        The data set in use; another one is looked for where `build` puts it.

    Raises
    ------
    DfdbenchError
        If it names a data set or a split that does not exist.
    """
    if not (said := NAMED.fullmatch(trained_on.split(TRAININGS)[0].strip())):
        return None
    # A set's depths are the same on all its tracks.
    own = store.manifest
    training = store if is_called(own, said["manifest"]) else open_dataset(said["manifest"])
    name = f"all but {said['name']}" if said["how"] == "all but" else said["name"]
    inverted = training.manifest.depth.grows_with != own.depth.grows_with
    scenes = scenes_said(training.manifest, said)
    return side_of(training, name, scenes, inverted)


def coverage_warnings(trained_on: str | None, store: Dataset, split: str) -> list[str]:
    """Return a warning for a result if training leaves levels of the tested split uncovered.

    `trained_on` is what the method says about itself; without it there is nothing to compare.
    """
    if not trained_on:
        return []
    seen = scenes_seen(trained_on, store.manifest, split)
    leak = f"leak: trained on scenes or textures of the test: {', '.join(seen)}"
    warnings = [leak] if seen else []
    try:
        train = training_side(trained_on, store)
        if train is None:
            said = trained_on.split(TRAININGS)[0]
            what = f'depths not compared with training, "{said}": only {FORM} can be looked up'
            return [*warnings, what]
        test = side_of(store, split)
    except DfdbenchError as error:
        return [*warnings, f"depths not compared with training: {error.problems[0].what}"]
    # Whether they grow with nearness or with distance makes none: a side is inverted.
    scales = (each.manifest.depth.scale for each in (train.store, store))
    ends = [f"{one.near:g} to {one.far:g} m ({one.law})" for one in scales if one]
    if len({*ends}) > 1:
        other = f"levels of {train.store.manifest.stem} are other distances"
        warnings.append(f"{other}: {ends[0]}, here {ends[1]}")
    counts = test.histogram.counts
    # Counts, the thesis's criterion, are for sets smaller than their training.
    levels = USUAL.uncovered(train.histogram.counts, counts, Criterion.density)
    if levels.any():
        trained, about = f"{train.store.manifest.stem}, {train.name}", store.manifest.depth
        scale = about.scale if about.kind == "metres" else None
        what, metres = ("distances", " m") if scale else ("depth levels", "")
        warnings.append(
            f"{percent(share_of(counts, levels))} of the test's known pixels lie on {what} "
            f"that {trained}, leaves missing or scarce: {as_ranges(levels, scale)}{metres}"
        )
    return warnings
