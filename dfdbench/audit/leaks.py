"""What is in the training set and in the test set as well: scenes, textures, images."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum

import imagehash
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from dfdbench.audit.sides import Side
from dfdbench.datasets.manifest import Manifest
from dfdbench.datasets.store import Store
from dfdbench.errors import DfdbenchError, Problem

_HASH_SIDE = 16
#: Bits of 256 in which two images may differ and still count as one. Other exposures, sizes and
#: narrow crops of one image stay below; images of different scenes differ in about 128.
NEAR_DUPLICATE_BITS = 48

#: The hash of each image of a scene, by the image's name.
Hashes = Mapping[str, NDArray[np.bool_]]


class LeakError(DfdbenchError):
    """Something of the test is in the training set as well."""


class LeakKind(StrEnum):
    """What two splits share."""

    scene = "scene"
    texture = "texture"
    image = "near-duplicate image"


@dataclass(frozen=True)
class Leak:
    """One thing that two splits share.

    Parameters
    ----------
    kind : LeakKind
        What sort of thing.
    train, test : str
        The scene or the image on either side.
    detail : str
        What is alike.
    """

    kind: LeakKind
    train: str
    test: str
    detail: str

    def as_problem(self) -> Problem:
        """Return the leak as a problem that a user can mend."""
        return Problem(
            f"leak: the same {self.kind} in training and test",
            where=f"{self.train} and {self.test}",
            got=self.detail,
            fix="put both into the same split, or train without the one",
        )


def image_hash(image: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Return the perceptual hash of an image: 256 signs of its lowest frequencies.

    Parameters
    ----------
    image : ndarray of uint8, shape (y, x, 3)
        RGB.

    Examples
    --------
    >>> image = np.random.default_rng(0).integers(0, 256, (40, 40, 3)).astype(np.uint8)
    >>> darker = (image * 0.5).astype(np.uint8)
    >>> int((image_hash(image) != image_hash(darker)).sum()) < NEAR_DUPLICATE_BITS
    True
    """
    found = imagehash.phash(Image.fromarray(image), hash_size=_HASH_SIDE)
    return np.asarray(found.hash.ravel(), bool)


def scene_hashes(store: Store, scenes: Iterable[str]) -> dict[str, Hashes]:
    """Hash one image for each depth map of some scenes; its name is the scene and the view.

    The lightings of a view show one picture; the last that the store holds stands for all.
    """
    hashes: dict[str, Hashes] = {}
    for scene in scenes:
        with store.reading(f"{scene}/infocus or available"):
            hashes[scene] = _hashes_of(store, scene)
    return hashes


def _hashes_of(store: Store, scene: str) -> Hashes:
    manifest = store.manifest
    views = len(manifest.depth.axes)
    # Depth axes need not be the first of the pair's axes.
    others = [axis for axis in manifest.axes if axis not in manifest.depth.axes]
    order = [*manifest.depth.axes, *others]
    arrays = store.to_xarray(scene)
    last = {
        tuple(place[:views]): place
        for place in map(tuple, np.argwhere(arrays["available"].transpose(*order).values))
    }
    infocus = arrays["infocus"].transpose(*order, "y", "x", "channel")
    return {
        _image_name(manifest, scene, view): image_hash(infocus[place].values)
        for view, place in last.items()
    }


def _image_name(manifest: Manifest, scene: str, view: tuple[int, ...]) -> str:
    axes = manifest.depth.axes
    places = [f"{axis}{manifest.axes[axis][i]}" for axis, i in zip(axes, view, strict=True)]
    return "/".join([scene, *places])


def textures(manifest: Manifest) -> dict[str, int]:
    """Return each scene's texture, where the manifest tells it."""
    return {s.name: s.texture for s in manifest.scenes if s.texture is not None}


def manifest_leaks(
    train: Manifest, train_scenes: tuple[str, ...], test: Manifest, test_scenes: tuple[str, ...]
) -> list[Leak]:
    """Return the scenes and textures that both sides have.

    The views of a scene go with it: a split has a scene whole or not at all. Data sets made
    from the same files share scenes, whatever their names: a scene is one where its name and
    the address that it comes from are.
    """
    origin_of_train, origin_of_test = _origins(train), _origins(test)
    of_train, of_test = textures(train), textures(test)
    leaks = [
        Leak(LeakKind.scene, scene, scene, "the scene and all its views")
        for scene in train_scenes
        if scene in test_scenes and origin_of_train[scene] == origin_of_test.get(scene)
    ]
    for scene in train_scenes:
        for other in test_scenes:
            alike = scene in of_train and of_train[scene] == of_test.get(other)
            if scene != other and alike and origin_of_train[scene] == origin_of_test.get(other):
                leaks.append(Leak(LeakKind.texture, scene, other, f"texture {of_train[scene]}"))
    return leaks


def _origins(manifest: Manifest) -> dict[str, str]:
    url_of = {origin.name: origin.url for origin in manifest.sources}
    return {scene.name: url_of[scene.source] for scene in manifest.scenes}


def image_leaks(train: Mapping[str, Hashes], test: Mapping[str, Hashes]) -> list[Leak]:
    """Return the images of one side that are near-duplicates of one of the other.

    Parameters
    ----------
    train, test : mapping of str to Hashes
        By scene, from `scene_hashes`.
    """
    left = [item for images in train.values() for item in images.items()]
    right = [item for images in test.values() for item in images.items()]
    if not left or not right:
        return []
    here, there = (np.stack([bits for _, bits in side]) for side in (left, right))
    distances = (here[:, np.newaxis] != there[np.newaxis]).sum(axis=2)
    return [
        Leak(
            LeakKind.image,
            left[i][0],
            right[j][0],
            f"{distances[i, j]} of {_HASH_SIDE**2} bits of their perceptual hashes differ",
        )
        for i, j in np.argwhere(distances <= NEAR_DUPLICATE_BITS)
    ]


def find_leaks(
    train: Manifest,
    train_hashes: Mapping[str, Hashes],
    test: Manifest,
    test_hashes: Mapping[str, Hashes],
) -> list[Leak]:
    """Return everything that both sides share; the hashes say which scenes are on which side."""
    leaks = manifest_leaks(train, tuple(train_hashes), test, tuple(test_hashes))
    shared = {leak.test for leak in leaks if leak.kind is LeakKind.scene}
    rest = {scene: images for scene, images in test_hashes.items() if scene not in shared}
    return leaks + image_leaks(train_hashes, rest)


def leaks_between(train: Side, test: Side) -> tuple[Leak, ...]:
    """Return everything that the two sides of a comparison share."""
    found = find_leaks(
        train.store.manifest,
        scene_hashes(train.store, train.scenes),
        test.store.manifest,
        scene_hashes(test.store, test.scenes),
    )
    return tuple(found)


def scenes_alike(manifest: Manifest, hashes: Mapping[str, Hashes]) -> list[tuple[str, ...]]:
    """Group scenes that must not be parted: of one texture or with near-duplicate images.

    Parameters
    ----------
    manifest : Manifest
        Names textures.
    hashes : mapping of str to Hashes
        The scenes to group, in order.

    Returns
    -------
    list of tuple of str
        Each scene once, in the order of each group's first.
    """
    names = list(hashes)
    group = {name: name for name in names}

    def first_of(name: str) -> str:
        while group[name] != name:
            name = group[name]
        return name

    chosen = tuple(names)
    alike = [(leak.train, leak.test) for leak in manifest_leaks(manifest, chosen, manifest, chosen)]
    alike += [
        (leak.train.split("/")[0], leak.test.split("/")[0]) for leak in image_leaks(hashes, hashes)
    ]
    for one, other in alike:
        a, b = sorted((first_of(one), first_of(other)), key=names.index)
        group[b] = a
    return [
        tuple(name for name in names if first_of(name) == head)
        for head in names
        if first_of(head) == head
    ]
