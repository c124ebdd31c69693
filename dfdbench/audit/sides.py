"""One side of a comparison, training or test: how often each depth level occurs in its scenes."""

from __future__ import annotations

import functools
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.recipe import LEVELS
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.depth_scale import DepthScale
from dfdbench.datasets.fingerprint import scene_record, variable_digest
from dfdbench.datasets.manifest import require_fold, training_of
from dfdbench.errors import InputError, StoreError, refuse_both

#: Side in pixels of the crops that the thesis's networks train on (5.2.1) ...
CROP_SIZE = 32
#: ... and in how many orientations each is shown: four rotations, each mirrored.
ORIENTATIONS = 8

Counts = NDArray[np.int64]
Mask = NDArray[np.bool_]
Summed = TypeVar("Summed")


@dataclass(frozen=True)
class DepthHistogram:
    """How often each depth level occurs over some pairs; unknown pixels are counted separately.

    Parameters
    ----------
    counts : ndarray of int64, shape (256,)
        Known pixels of each level; a depth map counts once for each pair that uses it.
    expanded : ndarray of float64, shape (256,)
        How often training is expected to see a pixel of each level if it draws each pair once, as a
        random 32 x 32 crop in 8 orientations (thesis 5.2.1, Fig. 5.9).
    unknown : int
        Pixels without ground truth.
    pairs : int
        Pairs counted.
    """

    counts: Counts
    expanded: NDArray[np.float64]
    unknown: int
    pairs: int

    @property
    def known(self) -> int:
        """Pixels with ground truth."""
        return int(self.counts.sum())

    def inverted(self) -> DepthHistogram:
        """Return the histogram of 255 - depth (Eq. 7.1)."""
        return DepthHistogram(self.counts[::-1], self.expanded[::-1], self.unknown, self.pairs)

    @classmethod
    def total(cls, parts: Iterable[DepthHistogram]) -> DepthHistogram:
        """Return the sum of histograms."""
        return field_sums(cls(np.zeros(LEVELS, np.int64), np.zeros(LEVELS), 0, 0), *parts)


def field_sums(first: Summed, *others: Summed) -> Summed:
    """Return the record whose fields are the sums of those of several."""
    columns = zip(*(vars(record).values() for record in (first, *others)), strict=True)
    return type(first)(*(sum(column) for column in columns))


def depth_histogram(depth: NDArray[np.uint8], valid: Mask, pairs: int = 1) -> DepthHistogram:
    """Count the levels of a depth map, shape (y, x), once for each pair that uses it.

    Examples
    --------
    >>> depth = np.array([[7, 7], [0, 9]], np.uint8)
    >>> histogram = depth_histogram(depth, depth > 0, pairs=3)
    >>> histogram.counts[[7, 9]].tolist(), histogram.unknown
    ([6, 3], 3)
    """
    known = depth[valid]
    # A rotated or mirrored crop shows the same levels again.
    weights = ORIENTATIONS * expected_uses(depth.shape)[valid]
    return DepthHistogram(
        pairs * np.bincount(known, minlength=LEVELS).astype(np.int64),
        np.asarray(pairs * np.bincount(known, weights=weights, minlength=LEVELS), np.float64),
        pairs * int(valid.size - known.size),
        pairs,
    )


@functools.lru_cache(maxsize=64)
def expected_uses(shape: tuple[int, ...], crop_size: int = CROP_SIZE) -> NDArray[np.float64]:
    """Return the expected number of uses of each pixel in one random square crop of an image.

    Pixels near the border are in fewer crops. If an image is smaller than the crop, all of it is
    used.

    Examples
    --------
    >>> expected_uses((1, 4), crop_size=2).round(3).tolist()
    [[0.333, 0.667, 0.667, 0.333]]
    """
    uses = []
    for extent in shape:
        crop = min(crop_size, extent)
        starts = extent - crop + 1
        uses.append(np.convolve(np.ones(starts), np.ones(crop)) / starts)
    return np.outer(*uses)


def runs(keys: Sequence[object]) -> list[tuple[int, int]]:
    """Return the first and last index of each run of equal keys, skipping None.

    Examples
    --------
    >>> runs(["a", "a", None, "b"])
    [(0, 1), (3, 3)]
    """
    groups = [(key, list(of)) for key, of in groupby(range(len(keys)), key=keys.__getitem__)]
    return [(levels[0], levels[-1]) for key, levels in groups if key is not None]


def range_text(first: int, last: int, scale: DepthScale | None = None) -> str:
    """Format a range of levels, as ``36-38`` or ``9``, or what it is in metres by a scale."""
    ends = [str(first), str(last)]
    if scale:
        ends = [f"{metres:.3g}" for metres in sorted(scale.to_metres(np.array([first, last])))]
    return "-".join(dict.fromkeys(ends))


def as_ranges(levels: Mask, scale: DepthScale | None = None) -> str:
    """Format marked levels as ranges, or as those in metres by a scale.

    Examples
    --------
    >>> as_ranges(np.isin(np.arange(256), [9, 36, 37, 38]))
    '9, 36-38'
    >>> as_ranges(np.isin(np.arange(256), [9, 36, 37, 38]), DepthScale(near=0.5, far=5.0))
    '3.9, 2.16-2.23'
    """
    marked = runs([True if mark else None for mark in levels])
    return ", ".join(range_text(*run, scale) for run in marked)


@dataclass(frozen=True)
class Side:
    """The training or the test side of a comparison.

    Parameters
    ----------
    store : Dataset
        The store of the depth maps.
    name : str
        The split's name: ``"train"``, ``"K03"``, ``"all but K03"``.
    scenes : dict of str to DepthHistogram
        By scene, in the training set's sense of depth.
    absent : tuple of str
        Scenes of the split that the store does not hold.
    inverted : bool
        Whether levels were inverted (Eq. 7.1) to compare them with training.
    """

    store: Dataset
    name: str
    scenes: dict[str, DepthHistogram]
    absent: tuple[str, ...]
    inverted: bool = False

    @property
    def histogram(self) -> DepthHistogram:
        """The histogram of all its scenes."""
        return DepthHistogram.total(self.scenes.values())


@functools.lru_cache(maxsize=4)
def scene_histograms(store: Dataset) -> Mapping[str, DepthHistogram]:
    """Count each scene's depth levels over the pairs that the manifest gives it, once per store.

    The weights are the manifest's pairs, not the store's, so that a store with only one lighting
    per scene leads to the same verdicts as the whole set. A depth map without a known pixel is one
    that the store lacks, and is left out.

    Raises
    ------
    StoreError
        If a depth map is damaged.
    """
    manifest, axes = store.manifest, store.manifest.depth.axes
    uses = Counter((pair.scene, tuple(pair.at[axis] for axis in axes)) for pair in manifest.pairs())
    histograms = {}
    for scene in store.scenes:
        depth, valid = depth_maps(store, scene)
        found = []
        for place in np.ndindex(depth.shape[: len(axes)]):
            at = tuple(manifest.axes[axis][i] for axis, i in zip(axes, place, strict=True))
            if valid[place].any() and uses[scene, at]:
                found.append(depth_histogram(depth[place], valid[place], uses[scene, at]))
        histograms[scene] = DepthHistogram.total(found)
    return histograms


def depth_maps(store: Dataset, scene: str) -> tuple[NDArray[np.uint8], Mask]:
    """Return a scene's depth maps and where they are known, shapes (depth axes, y, x).

    Raises
    ------
    StoreError
        If they cannot be read, or are not as built.
    """
    # Missing parts of an array read as zeros: only the digest tells them from depths.
    with store.reading(f"{scene}/depth"):
        arrays = store.stored(scene)
        depth = arrays["depth"].load()
    recorded = scene_record(arrays.attrs, f"{store.path}, {scene}").array_digests
    if variable_digest(depth) != recorded["depth"]:
        what = "the store is damaged: an array holds other values than were built"
        fix = f"dfdbench verify {store.path} lists all that is damaged"
        raise StoreError(what, where=f"{store.path}, {scene}/depth", fix=fix)
    return store.manifest.depth.levels_of(depth.values), np.isfinite(depth.values)


def side_of(
    store: Dataset, name: str, scenes: tuple[str, ...] | None = None, inverted: bool = False
) -> Side:
    """Return one side of a comparison: some scenes of a store, under a name.

    Parameters
    ----------
    store : Dataset
        The store that holds the scenes.
    name : str
        The side's name.
    scenes : tuple of str, optional
        By default, those of the split of that name.
    inverted : bool
        Whether to invert levels (Eq. 7.1).

    Raises
    ------
    UnknownNameError
        If no scenes are given, and there is no such split.
    StoreError
        If the store holds none of the scenes.
    """
    scenes = store.manifest.scenes_of(name) if scenes is None else scenes
    histograms = scene_histograms(store)
    chosen = {
        scene: histograms[scene].inverted() if inverted else histograms[scene]
        for scene in scenes
        if scene in histograms
    }
    if not any(histogram.known for histogram in chosen.values()):
        fix = f"build {store.manifest.short} with the scenes of that split"
        raise StoreError(f"the store holds no depth of {name}", where=str(store.path), fix=fix)
    absent = tuple(scene for scene in scenes if scene not in histograms)
    return Side(store, name, chosen, absent, inverted)


def all_but(store: Dataset, fold: str) -> Side:
    """Return the training side that leaves out a fold, or a single scene.

    Raises
    ------
    UnknownNameError
        If there is no such fold or scene.
    InputError
        If the set has no other.
    StoreError
        If the store holds none of the others.
    """
    require_fold(store.manifest, fold)
    if not (others := training_of(store.manifest, fold)):
        raise InputError(f"no scene is left to train on without {fold}", where=store.manifest.stem)
    return side_of(store, f"all but {fold}", others)


def sides_of(
    store: Dataset,
    train: str | None = None,
    test: str | None = None,
    fold: str | None = None,
    other: Dataset | None = None,
) -> tuple[Side, Side]:
    """Return the training and the test side of a comparison.

    Parameters
    ----------
    store : Dataset
        The training data set; also the test's, unless there is another.
    train, test : str, optional
        Splits; by default ``"train"`` and ``"test"``, or ``"all"`` of another data set.
    fold : str, optional
        In place of both: test on this fold or scene, train on the others.
    other : Dataset, optional
        The data set of the test. Its levels are inverted (Eq. 7.1) if they grow the other way.

    Raises
    ------
    InputError
        If a fold is given together with a split.
    UnknownNameError
        If there is no such split, fold or scene.
    StoreError
        If a store holds none of the scenes.
    """
    refuse_both({"--fold": fold}, {"--train": train, "--test": test, "--test-dataset": other})
    if fold is not None:
        tested = side_of(store, fold)
        return all_but(store, fold), tested
    tester, test = (store, test or "test") if other is None else (other, test or "all")
    inverted = store.manifest.depth.grows_with != tester.manifest.depth.grows_with
    return side_of(store, train or "train"), side_of(tester, test, inverted=inverted)
