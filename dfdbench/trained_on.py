"""What a method says it was trained on, held against the depths that it is tested on."""

from __future__ import annotations

import re

from dfdbench.coverage import Coverage, as_ranges
from dfdbench.depths import Side, scene_histograms, side_of, training_of
from dfdbench.errors import DfdbenchError
from dfdbench.store import Store, open_store
from dfdbench.tables import percent

#: How `trained_on` names scenes: a manifest's name and version, then a split, or the fold or
#: scene that was left out.
FORM = '"MANIFEST, split NAME" or "MANIFEST, all but FOLD"'
_PATTERN = re.compile(r"(?P<manifest>[\w.-]+), (?P<how>split|all but) (?P<name>[\w.-]+)(,.*)?")


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
    known = (store.manifest.stem, store.manifest.name, store.manifest.short)
    training = store if said["manifest"] in known else open_store(said["manifest"])
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
    coverage = Coverage(train.histogram, test.histogram)
    levels = coverage.uncovered()
    if not levels.any():
        return []
    return [
        f"{percent(coverage.share(levels))} of the test's known pixels lie on depth levels that "
        f"{train.dataset}, {train.name}, leaves missing or scarce: {as_ranges(levels)}"
    ]
