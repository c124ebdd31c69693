"""Find what training and test share: scenes, textures, images."""

from __future__ import annotations

import contextlib
import functools
import re
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from dfdbench.datasets.captures import eight_bits
from dfdbench.datasets.catalog import find_manifest, part_name
from dfdbench.datasets.manifest import Manifest, training_of
from dfdbench.errors import DfdbenchError, Problem
from dfdbench.system.strict import Record
from dfdbench.system.text import TRAININGS
from dfdbench.tables.table import grouped

if TYPE_CHECKING:
    from dfdbench.audit.sides import Side
    from dfdbench.datasets.dataset import Dataset

#: How `trained_on` names scenes: a manifest's name and version, then a split, or the fold or scene
#: that was left out.
FORM = '"MANIFEST, split NAME" or "MANIFEST, all but FOLD"'
NAMED = re.compile(r"(?P<manifest>[\w.@-]+), (?P<how>split|all but) (?P<name>[\w.-]+)(,.*)?")
_HASH_SIDE = 16
#: How many of 256 bits may differ between two images that count as one. Darker, smaller, noisier
#: and blurred copies stay below, and most with clipped highlights; none that are mirrored or cut by
#: 5 % on each side. Images of different scenes differ in about 128, in 60 at least.
NEAR_DUPLICATE_BITS = 48

#: The hash of each image of a scene, by the image's name.
Hashes = Mapping[str, NDArray[np.bool_]]


def is_called(own: Manifest, name: str) -> bool:
    """Return whether a name is a data set's own, on any track of it."""
    return part_name(name)[0] in (own.file_stem, own.name, part_name(own.short)[0])


def scenes_seen(trained_on: str, test: Manifest, split: str) -> list[str]:
    """Return the scenes of a split that share a scene or texture with any of the named trainings.

    Parameters
    ----------
    trained_on : str
        In the form of `FORM`, to which the author may add anything after another comma; several are
        joined by `TRAININGS`. Those that name no scenes of a known data set are ignored.

    Examples
    --------
    >>> scenes_seen("mine; demo-1, split train", find_manifest("demo-1"), "Barn")
    ['Barn']
    """
    seen: dict[str, None] = {}
    for said in filter(None, map(NAMED.fullmatch, map(str.strip, trained_on.split(TRAININGS)))):
        # We cannot look into a user's own training data.
        with contextlib.suppress(DfdbenchError):
            own = is_called(test, said["manifest"])
            train = test if own else find_manifest(said["manifest"])
            leaks = manifest_leaks(train, scenes_said(train, said), test, test.scenes_of(split))
            seen |= dict.fromkeys(leak.test for leak in leaks)
    return list(seen)


def scenes_said(manifest: Manifest, said: re.Match[str]) -> tuple[str, ...]:
    """Return the scenes of a manifest that a text names, given a match of `NAMED`."""
    scenes = training_of if said["how"] == "all but" else Manifest.scenes_of
    return scenes(manifest, said["name"])


class LeakError(DfdbenchError):
    """The test and the training set have something in common."""


class Leak(Record):
    """One thing that both sides share: the scene or image on either side, and what is alike."""

    kind: Literal["scene", "texture", "near-duplicate image"]
    train: str
    test: str
    detail: str

    def as_problem(self) -> Problem:
        """Return the leak as a problem that a user can fix."""
        what = f"leak: the same {self.kind} in training and test: {self.detail}"
        fix = "put both into the same split, or train without the one"
        return Problem(what, where=f"{self.train} and {self.test}", fix=fix)


def image_hash(image: NDArray[np.uint8 | np.uint16]) -> NDArray[np.bool_]:
    """Return the perceptual hash of an RGB image: 256 signs of its lowest frequencies.

    Examples
    --------
    >>> image = np.random.default_rng(0).integers(0, 256, (40, 40, 3)).astype(np.uint8)
    >>> darker = (image * 0.5).astype(np.uint8)
    >>> int((image_hash(image) != image_hash(darker)).sum()) < NEAR_DUPLICATE_BITS
    True
    """
    import imagehash
    from PIL import Image

    found = imagehash.phash(Image.fromarray(eight_bits(image)), hash_size=_HASH_SIDE)
    return np.asarray(found.hash.ravel(), bool)


def scene_hashes(store: Dataset, scenes: Iterable[str]) -> dict[str, Hashes]:
    """Hash one image for each depth map of some scenes, named by its scene and view.

    All lightings of a view show the same picture; the last one in the store is hashed.
    """
    return {scene: _hashes_of(store, scene) for scene in scenes}


# One scene is on many sides if each is tested against all others.
@functools.lru_cache(maxsize=1024)
def _hashes_of(store: Dataset, scene: str) -> Hashes:
    views = store.manifest.depth.axes
    last = {
        "/".join([scene, *(f"{axis}{pair.at[axis]}" for axis in views)]): pair
        for pair in store.pairs(scene)
    }
    # Lazily read: of each view only one image is decoded.
    infocus = store.stored(scene)["images"][{"image": 0}]
    with store.reading(f"{scene}/images"):
        return {name: image_hash(infocus.sel(pair.at).values) for name, pair in last.items()}


def manifest_leaks(
    train: Manifest, train_scenes: tuple[str, ...], test: Manifest, test_scenes: tuple[str, ...]
) -> list[Leak]:
    """Return the scenes and textures that both sides have.

    Data sets made from the same files share scenes, whatever the sets' names: two scenes are the
    same if both their names and their origins' addresses are. A split has all views of a scene or
    none.
    """
    from_train, from_test = _origins(train), _origins(test)
    of_train, of_test = _textures(train), _textures(test)
    leaks = []
    for scene in train_scenes:
        if scene in test_scenes and from_train[scene] == from_test.get(scene):
            detail = "the scene and all its views"
            leaks.append(Leak(kind="scene", train=scene, test=scene, detail=detail))
    for scene in train_scenes:
        for other in test_scenes:
            alike = scene in of_train and of_train[scene] == of_test.get(other)
            if scene != other and alike and from_train[scene] == from_test.get(other):
                detail = f"texture {of_train[scene]}"
                leaks.append(Leak(kind="texture", train=scene, test=other, detail=detail))
    return leaks


def _textures(manifest: Manifest) -> dict[str, int]:
    return {s.name: s.texture for s in manifest.scenes if s.texture is not None}


def _origins(manifest: Manifest) -> dict[str, str]:
    url_of = {origin.name: origin.url for origin in manifest.sources}
    return {scene.name: url_of[scene.source] for scene in manifest.scenes}


def image_leaks(train: Mapping[str, Hashes], test: Mapping[str, Hashes]) -> list[Leak]:
    """Return the near-duplicates between the images of two sides, from `scene_hashes`."""
    left = [item for images in train.values() for item in images.items()]
    right = [item for images in test.values() for item in images.items()]
    if not left or not right:
        return []
    here, there = (np.stack([bits for _, bits in side]) for side in (left, right))
    distances = (here[:, np.newaxis] != there[np.newaxis]).sum(axis=2)
    return [
        Leak(
            kind="near-duplicate image",
            train=left[i][0],
            test=right[j][0],
            detail=f"{distances[i, j]} of {_HASH_SIDE**2} bits of their perceptual hashes differ",
        )
        for i, j in np.argwhere(distances <= NEAR_DUPLICATE_BITS)
    ]


def leaks_between(train: Side, test: Side) -> tuple[Leak, ...]:
    """Return everything that the two sides of a comparison share."""
    one, other = train.store.manifest, test.store.manifest
    leaks = manifest_leaks(one, tuple(train.scenes), other, tuple(test.scenes))
    shared = {leak.test for leak in leaks if leak.kind == "scene"}
    rest = [scene for scene in test.scenes if scene not in shared]
    hashes = scene_hashes(train.store, train.scenes), scene_hashes(test.store, rest)
    return (*leaks, *image_leaks(*hashes))


def scenes_alike(manifest: Manifest, hashes: Mapping[str, Hashes]) -> list[tuple[str, ...]]:
    """Group the scenes of `hashes` that share a texture or a near-duplicate image.

    Returns
    -------
    list of tuple of str
        Each scene once, in the order of each group's first.
    """
    from scipy.sparse.csgraph import connected_components

    names = tuple(hashes)
    alike = np.eye(len(names), dtype=bool)
    for leak in manifest_leaks(manifest, names, manifest, names) + image_leaks(hashes, hashes):
        one, other = (names.index(name.split("/")[0]) for name in (leak.train, leak.test))
        alike[one, other] = True
    groups = grouped(zip(connected_components(alike)[1].tolist(), names, strict=True))
    return [tuple(group) for group in groups.values()]
