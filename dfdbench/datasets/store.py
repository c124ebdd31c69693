"""The built data set, read: one zarr, a group a scene."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray
import zarr
from numpy.typing import NDArray
from upath import UPath
from zarr.errors import GroupNotFoundError

from dfdbench.blur.recipe import BlurRecipe, find_recipe
from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.damage import DAMAGED, LONGEST, check_attributes, require_fit
from dfdbench.datasets.manifest import ALL_PAIRS, Manifest, Pair
from dfdbench.datasets.pair_images import PairImages
from dfdbench.datasets.store_place import default_store, place_of
from dfdbench.datasets.tracked import manifest_in
from dfdbench.datasets.whole_arrays import WholeArrays, open_scene
from dfdbench.errors import DfdbenchError, StoreError, UnknownNameError, unknown_name
from dfdbench.system.location import Place, as_location, exists, is_local, zarr_store

if TYPE_CHECKING:
    from dfdbench.datasets.integrity import StoreVerification
    from dfdbench.datasets.pair_sequence import PairSequence

FORMAT = "dfdbench store"
FORMAT_VERSION = 1
#: Rows and columns of an image.
Region = tuple[slice, slice]
WHOLE: Region = (slice(None), slice(None))


class Store:
    """A built data set, opened for reading.

    Parameters
    ----------
    place : str, Path or UPath
        The zarr folder: a local path or a URL.

    Raises
    ------
    StoreError
        If there is none, or it is no dfdbench store, or it is incomplete, or its attributes were
        edited, or it was built from another manifest than the released one of that name.
    """

    def __init__(self, place: Place) -> None:
        self.path = as_location(place)
        self._root = _open_root(self.path)
        self.attributes: dict[str, Any] = dict(self._root.attrs)
        if self.attributes.get("format") != FORMAT:
            raise _not_ours(self.path)
        if self.attributes.get("format_version") != FORMAT_VERSION:
            raise StoreError(
                "store of another version",
                where=str(self.path),
                expected=str(FORMAT_VERSION),
                got=str(self.attributes.get("format_version")),
                fix="build it again",
            )
        if "fingerprint" not in self.attributes:
            raise StoreError(
                "the store is not finished",
                where=str(self.path),
                fix="run the dfdbench build that began it again: it goes on from there",
            )
        check_attributes(self.attributes, str(self.path))
        self.manifest = manifest_in(self.attributes, str(self.path))
        self._arrays: dict[str, zarr.Array[Any]] = {}
        groups = set(_group_names(self.path, self._root))
        #: The scenes that were built, in the manifest's order.
        self.scenes = tuple(name for name in self.manifest.scene_names if name in groups)

    def __repr__(self) -> str:
        return (
            f"<{self.manifest.stem}: {self.manifest.pair_count} pairs of {len(self.scenes)} scenes>"
        )

    def captures(self, split: str = ALL_PAIRS) -> PairSequence:
        """Return the pairs of a split; each is read when it is asked for.

        Raises
        ------
        UnknownNameError
            If there is no such split, fold or scene.
        """
        from dfdbench.datasets.pair_sequence import PairSequence  # it imports this module

        return PairSequence(self, self.pairs(split))

    def verify(self) -> StoreVerification:
        """Read everything again and compare it with the fingerprint."""
        from dfdbench.datasets.integrity import verify_store  # it imports this module

        return verify_store(self)

    @property
    def fingerprint(self) -> str:
        """The SHA-256 over everything that the store's arrays hold."""
        return str(self.attributes["fingerprint"])

    @property
    def recipe_name(self) -> str:
        """The blur recipe's name; ``of track NAME-SEVERITY`` on a track, empty where captured."""
        if self.manifest.on_track:
            return f"of track {self.manifest.degradation}"
        return str(self.attributes["recipe"]["name"])

    @property
    def recipe(self) -> BlurRecipe | None:
        """The blur recipe; None where the defocus images were captured, and on a track."""
        parameters = self.attributes["recipe"]["parameters"]
        return find_recipe(parameters) if parameters else None

    def to_xarray(self, name: str) -> xarray.Dataset:
        """Return one scene's arrays, read as they are used.

        Its attributes tell the digest of each array and of the files that it was made from.
        """
        if name not in self.scenes:
            raise unknown_name("scene of the store", name, self.scenes)
        with self.reading(name):
            return open_scene(self.path, name)

    def pairs(self, split: str) -> tuple[Pair, ...]:
        """Return the pairs of a split that the store holds, in the manifest's order."""
        wanted = self.manifest.pairs(split)
        there = {}
        for name in {pair.scene for pair in wanted} & set(self.scenes):
            with self.reading(f"{name}/available"):
                there[name] = np.asarray(self._array(name, "available")[...])
        return tuple(
            pair
            for pair in wanted
            if pair.scene in there and there[pair.scene][self._index(pair, self.manifest.axes)]
        )

    def read(self, pair: Pair, region: Region = WHOLE) -> PairImages:
        """Read one pair's images and ground truth, or a region of them.

        Parameters
        ----------
        pair : Pair
            Which pair.
        region : pair of slice
            Rows and columns; the whole image by default. Two images, a depth map and its mask
            are decoded, whatever else the scene holds.

        Raises
        ------
        StoreError
            Where an array cannot be decoded.
        """
        depth, valid = self.read_depth(pair, region)
        index = self._index(pair, self.manifest.axes)
        infocus = self._part(pair.scene, "infocus", index, region)
        defocus = self._part(pair.scene, "defocus", index, region)
        return PairImages(pair, infocus, defocus, depth, valid)

    def read_depth(
        self, pair: Pair, region: Region = WHOLE
    ) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
        """Read one pair's depth levels and where they are known, or a region of them."""
        index = self._index(pair, self.manifest.depth.axes)
        depth = self._part(pair.scene, "depth", index, region)
        return depth, self._part(pair.scene, "valid", index, region)

    def shape_of(self, scene: str) -> tuple[int, int]:
        """Return the rows and columns of a scene's images."""
        with self.reading(f"{scene}/depth"):
            rows, columns = self._array(scene, "depth").shape[-2:]
        return rows, columns

    def _index(self, pair: Pair, axes: Iterable[str]) -> tuple[int, ...]:
        return tuple(self.manifest.axes[axis].index(pair.at[axis]) for axis in axes)

    def _array(self, scene: str, name: str) -> zarr.Array[Any]:
        key = f"{scene}/{name}"
        if key not in self._arrays:
            array = self._root[key]
            if not isinstance(array, zarr.Array):
                raise TypeError("not an array")
            depth = array if name in ("depth", "available") else self._array(scene, "depth")
            require_fit(array, name, self.manifest, depth.shape[-2:])
            self._arrays[key] = array
        return self._arrays[key]

    def _part(self, scene: str, name: str, index: tuple[int, ...], region: Region) -> NDArray[Any]:
        with self.reading(f"{scene}/{name}"):
            selection: Any = (*index, *region)
            return np.asarray(self._array(scene, name)[selection])

    @contextmanager
    def reading(self, what: str) -> Iterator[None]:
        """Tell what goes wrong in the block, which reads arrays of the store, as damage.

        Raises
        ------
        StoreError
            Where an array is absent or cannot be decoded.
        """
        try:
            yield
        except DAMAGED as error:
            if isinstance(error, DfdbenchError):
                raise
            raise StoreError(
                "an array of the store cannot be read",
                where=f"{self.path}, {what}",
                got=str(error)[:LONGEST],
                fix=f"dfdbench verify {self.path} tells what is damaged, `dfdbench build` mends it",
            ) from error

    def _repr_html_(self) -> str:
        from dfdbench.datasets.notebook import store_html

        return store_html(self)

    def __reduce__(self) -> tuple[type[Store], tuple[UPath]]:
        # Another process opens it anew.
        return Store, (self.path,)


def open_store(name: str, place: Place | None = None, cache: Path | None = None) -> Store:
    """Open a built data set by its name or its place.

    Parameters
    ----------
    name : str
        A data set's name, a manifest's path, or the path or URL of a store.
    place : str, Path or UPath, optional
        Where the store lies, if not in the default place.
    cache : Path, optional
        The cache folder in which the default place is; see `dfdbench.system.cache.cache_folder`.

    Raises
    ------
    StoreError
        Where it is not built; the message says how to build it.
    """
    if place is None:
        place = place_of(name, cache)
    if place is not None:
        return Store(place)
    manifest = _manifest_of(name)
    if not (default := default_store(manifest, cache)).exists():
        typed = name if name.endswith(".toml") else manifest.short
        more = " --source DIR" * bool(manifest.files)
        if manifest.short != "demo":
            more += ", or start with the small set: `dfdbench build demo`, then `--dataset demo`"
        raise StoreError(
            f"data set {manifest.short} is not built",
            where=str(default),
            fix=f"dfdbench build {typed}{more}",
        )
    return Store(default)


def _manifest_of(name: str) -> Manifest:
    try:
        return find_manifest(name)
    except UnknownNameError:
        if not Path(name).exists():
            raise
        kind = "folder" if Path(name).is_dir() else "file"
        raise StoreError(
            f"a {kind}, and not a data set",
            where=name,
            expected="a data set's name, or a store's path",
            fix="`dfdbench list` shows the names; stores end in .zarr",
        ) from None


def _group_names(location: UPath, root: zarr.Group) -> tuple[str, ...]:
    try:
        return tuple(root.group_keys())
    except DAMAGED as error:
        raise _unreadable(location, error) from error


def _unreadable(location: UPath, error: Exception) -> StoreError:
    return StoreError(
        "cannot read the store",
        where=str(location),
        expected="metadata of Zarr, version 3, as `dfdbench build` wrote it",
        got=str(error)[:LONGEST],
        fix="allow more memory and threads" if "new thread" in str(error) else "build it again",
    )


def _not_ours(location: UPath) -> StoreError:
    return StoreError(
        "not a data set built by dfdbench",
        where=str(location),
        fix="dfdbench build NAME; a store whose zarr.json was lost has to be deleted first",
    )


def _open_root(location: UPath) -> zarr.Group:
    try:
        if not exists(location):
            raise StoreError(
                "no such store", where=str(location), fix="dfdbench build NAME --store PATH"
            )
        return zarr.open_group(WholeArrays(zarr_store(location)), mode="r", zarr_format=3)
    except DfdbenchError:
        raise
    except GroupNotFoundError as error:
        raise _not_ours(location) from error
    except Exception as error:
        # What an object store's library raises is its own: unreachable, forbidden, no bucket.
        if is_local(location) and not isinstance(error, DAMAGED):
            raise
        raise _unreadable(location, error) from error
