"""A side of a comparison, training or test: its scenes' depth histograms, each map read once."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dfdbench.audit.depth_histogram import DepthHistogram, Mask, depth_histogram
from dfdbench.datasets.damage import scene_record
from dfdbench.datasets.fingerprint import array_digest
from dfdbench.datasets.folds import require_fold, training_of
from dfdbench.datasets.manifest import Manifest
from dfdbench.datasets.store import Store
from dfdbench.errors import InputError, StoreError


@dataclass(frozen=True)
class Side:
    """The training or the test side of a comparison.

    Parameters
    ----------
    store : Store
        What the depth maps come from.
    name : str
        Of the split: ``"train"``, ``"K03"``, ``"all but K03"``.
    scenes : dict of str to DepthHistogram
        By scene, levels in the sense of the training set.
    absent : tuple of str
        Scenes of the split that the store does not hold.
    inverted : bool
        True where levels were turned round (Eq. 7.1) to be compared with training.
    """

    store: Store
    name: str
    scenes: dict[str, DepthHistogram]
    absent: tuple[str, ...]
    inverted: bool = False

    @property
    def dataset(self) -> str:
        """The manifest's name and version."""
        return self.store.manifest.stem

    @property
    def label(self) -> str:
        """What tables and figures call the data set: captures that are none say so."""
        return self.store.manifest.label

    @property
    def histogram(self) -> DepthHistogram:
        """The histogram of all its scenes."""
        return DepthHistogram.total(self.scenes.values())


def scene_histograms(store: Store) -> dict[str, DepthHistogram]:
    """Count each scene's depth levels over the pairs that the manifest gives it.

    The weights are the manifest's pairs and not the store's, so that a store with one lighting
    a scene leads to the same verdicts as the whole set. A depth map without a known pixel
    stands for one that the store does not have, and is left out.

    Returns
    -------
    dict of str to DepthHistogram
        By scene, in the manifest's order; levels as stored.

    Raises
    ------
    StoreError
        Where a depth map is damaged: not readable, or not what was built.
    """
    axes = store.manifest.depth.axes
    uses = Counter(
        (pair.scene, tuple(pair.at[axis] for axis in axes)) for pair in store.manifest.pairs()
    )
    histograms = {}
    for scene in store.scenes:
        depth, valid = depth_maps(store, scene)
        extent = depth.shape[: len(axes)]
        histograms[scene] = DepthHistogram.total(
            depth_histogram(depth[place], valid[place], pairs)
            for place in np.ndindex(extent)
            if valid[place].any() and (pairs := uses[scene, _values(store.manifest, place)])
        )
    return histograms


def depth_maps(store: Store, scene: str) -> tuple[NDArray[np.uint8], Mask]:
    """Return a scene's depth maps and where they are known, shapes (depth axes, y, x).

    Raises
    ------
    StoreError
        Where they are damaged: not readable, or not what was built.
    """
    # Parts of an array that are lost read as zeros: only the digest tells them from depths.
    with store.reading(f"{scene}/depth or valid"):
        arrays = store.to_xarray(scene)
        found = {name: np.asarray(arrays[name].values) for name in ("depth", "valid")}
    recorded = scene_record(arrays.attrs, f"{store.path}, {scene}").array_digests
    for name, values in found.items():
        digest = array_digest(name, tuple(map(str, arrays[name].dims)), values)
        if digest != recorded.get(name):
            raise StoreError(
                "the store is damaged: an array holds other values than were built",
                where=f"{store.path}, {scene}/{name}",
                expected=recorded.get(name, "no such array"),
                got=digest,
                fix=f"dfdbench verify {store.path} tells all that is damaged",
            )
    return found["depth"], found["valid"]


def _values(manifest: Manifest, place: tuple[int, ...]) -> tuple[int, ...]:
    axes = manifest.depth.axes
    return tuple(manifest.axes[axis][index] for axis, index in zip(axes, place, strict=True))


def side_of(
    store: Store,
    histograms: dict[str, DepthHistogram],
    name: str,
    scenes: tuple[str, ...],
    inverted: bool = False,
) -> Side:
    """Return one side of a comparison: some scenes of a store under a name.

    Raises
    ------
    StoreError
        Where the store holds none of the scenes.
    """
    chosen = {
        scene: histograms[scene].inverted() if inverted else histograms[scene]
        for scene in scenes
        if scene in histograms
    }
    if not any(histogram.known for histogram in chosen.values()):
        raise StoreError(
            f"the store holds no depth of {name}",
            where=str(store.path),
            fix=f"build {store.manifest.short} with the scenes of that split",
        )
    absent = tuple(scene for scene in scenes if scene not in histograms)
    return Side(store, name, chosen, absent, inverted)


def all_but(store: Store, histograms: dict[str, DepthHistogram], fold: str) -> Side:
    """Return the training side that leaves out a fold, or a single scene.

    Raises
    ------
    UnknownNameError
        Where there is no such fold or scene.
    StoreError
        Where the store holds none of the other scenes.
    """
    manifest = store.manifest
    require_fold(manifest, fold)
    return side_of(store, histograms, f"all but {fold}", training_of(manifest, fold))


def sides_of(
    store: Store,
    train: str | None = None,
    test: str | None = None,
    fold: str | None = None,
    other: Store | None = None,
) -> tuple[Side, Side]:
    """Return the training and the test side of a comparison.

    Parameters
    ----------
    store : Store
        The data set that trains, and tests unless there is another.
    train, test : str, optional
        Splits; by default ``"train"`` and ``"test"``, of another data set ``"all"``.
    fold : str, optional
        Instead of both: a fold, or a scene, tests, and all other scenes train.
    other : Store, optional
        The data set that tests. Its levels are turned round (Eq. 7.1) where they grow the
        other way than those of `store`.

    Raises
    ------
    InputError
        Where a fold is asked for beside a split.
    UnknownNameError
        Where there is no such split, fold or scene.
    StoreError
        Where a store holds none of the scenes.
    """
    if fold is not None and (train or test or other):
        raise InputError(
            "a fold says both what trains and what tests",
            where="--fold",
            expected="no other split",
            fix="leave out --train, --test and --test-dataset",
        )
    histograms = scene_histograms(store)
    manifest = store.manifest
    if fold is not None:
        return (
            all_but(store, histograms, fold),
            side_of(store, histograms, fold, manifest.scenes_of(fold)),
        )
    tester, found = (store, histograms) if other is None else (other, scene_histograms(other))
    train, test = train or "train", test or ("test" if other is None else "all")
    inverted = manifest.depth.grows_with != tester.manifest.depth.grows_with
    return (
        side_of(store, histograms, train, manifest.scenes_of(train)),
        side_of(tester, found, test, tester.manifest.scenes_of(test), inverted),
    )
