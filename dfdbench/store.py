"""The built data set on disk: one zarr, a group a scene, put into place whole."""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import filelock
import numpy as np
import platformdirs
import xarray
import zarr
from numpy.typing import NDArray

from dfdbench.blur import BlurRecipe, find_recipe
from dfdbench.catalog import find_manifest
from dfdbench.errors import Problem, StoreError
from dfdbench.fingerprint import combine, scene_digests
from dfdbench.manifest import Manifest, Pair
from dfdbench.manifest_reader import parse_manifest

FORMAT = "dfdbench store"
FORMAT_VERSION = 1


@dataclass(frozen=True)
class PairImages:
    """What a pair holds: two images, the ground truth, and where it is known.

    Parameters
    ----------
    pair : Pair
        Which pair it is.
    infocus, defocus : ndarray of uint8, shape (y, x, channel)
        RGB.
    depth : ndarray of uint8, shape (y, x)
        Depth levels.
    valid : ndarray of bool, shape (y, x)
        True where the depth is known.
    """

    pair: Pair
    infocus: NDArray[np.uint8]
    defocus: NDArray[np.uint8]
    depth: NDArray[np.uint8]
    valid: NDArray[np.bool_]


def cache_folder() -> Path:
    """Return where data sets are kept: ``DFDBENCH_CACHE``, or the platform's cache folder."""
    return Path(os.environ.get("DFDBENCH_CACHE") or platformdirs.user_cache_dir("dfdbench"))


def default_store(manifest: Manifest) -> Path:
    """Return where the built data set lies unless a path is given."""
    return cache_folder() / "stores" / f"{manifest.stem}.zarr"


class Store:
    """A built data set, opened for reading.

    Parameters
    ----------
    path : Path
        The zarr folder.

    Raises
    ------
    StoreError
        Where there is none, or it is no dfdbench store, or it is incomplete.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._tree = _open_tree(path)
        attributes = self._tree.attrs
        if attributes.get("format") != FORMAT:
            raise StoreError(
                Problem("not a data set built by dfdbench", str(path), fix="dfdbench build NAME")
            )
        if attributes.get("format_version") != FORMAT_VERSION:
            raise StoreError(
                Problem(
                    "store of another version", str(path), str(FORMAT_VERSION),
                    str(attributes.get("format_version")), "build it again",
                )
            )  # fmt: skip
        self.manifest = parse_manifest(attributes["manifest"].encode(), path.name)

    @property
    def fingerprint(self) -> str:
        """The SHA-256 over everything that the store's arrays hold."""
        return str(self._tree.attrs["fingerprint"])

    @property
    def recipe_name(self) -> str:
        """The blur recipe's name; empty where the defocus images were captured."""
        return str(self._tree.attrs["recipe"]["name"])

    @property
    def recipe(self) -> BlurRecipe | None:
        """The blur recipe, None where the defocus images were captured."""
        parameters = self._tree.attrs["recipe"]["parameters"]
        return find_recipe(parameters) if parameters else None

    @property
    def attributes(self) -> dict[str, Any]:
        """Manifest hash, recipe, units, options, what is missing, package version."""
        return {str(name): value for name, value in self._tree.attrs.items()}

    @property
    def scenes(self) -> tuple[str, ...]:
        """The scenes that were built, in the manifest's order."""
        return tuple(name for name in self.manifest.scene_names if name in self._tree.children)

    def scene(self, name: str) -> xarray.Dataset:
        """Return one scene's arrays, read as they are used."""
        return self._tree[name].to_dataset()

    def pairs(self, split: str) -> tuple[Pair, ...]:
        """Return the pairs of a split that the store holds, in the manifest's order."""
        available = {name: self._tree[name]["available"].load() for name in self.scenes}
        return tuple(
            pair
            for pair in self.manifest.pairs(split)
            if pair.scene in available and bool(available[pair.scene].sel(pair.at))
        )

    def read(self, pair: Pair) -> PairImages:
        """Read one pair's images and ground truth."""
        depth, valid = self.read_depth(pair)
        scene = self._tree[pair.scene]
        return PairImages(
            pair,
            np.asarray(scene["infocus"].sel(pair.at).values),
            np.asarray(scene["defocus"].sel(pair.at).values),
            depth,
            valid,
        )

    def read_depth(self, pair: Pair) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
        """Read one pair's depth levels and where they are known."""
        scene = self._tree[pair.scene]
        place = {axis: pair.at[axis] for axis in self.manifest.depth.axes}
        depth, valid = scene["depth"].sel(place).values, scene["valid"].sel(place).values
        return np.asarray(depth), np.asarray(valid)


def open_store(name: str, path: Path | None = None) -> Store:
    """Open a built data set by its name or its path.

    Parameters
    ----------
    name : str
        A data set's name, or the path of a store.
    path : Path, optional
        Where the store lies, if not in the default place.

    Raises
    ------
    StoreError
        Where it is not built; the message says how to build it.
    """
    if path is None and (name.endswith(".zarr") or os.sep in name):
        path = Path(name)
    if path is not None:
        return Store(path)
    manifest = find_manifest(name)
    place = default_store(manifest)
    if not place.exists():
        other = "" if manifest.short == "demo" else ", or use the small one: --dataset demo"
        raise StoreError(
            Problem(
                f"data set {manifest.short} is not built", str(place),
                fix=f"dfdbench build {manifest.short}{other}",
            )
        )  # fmt: skip
    return Store(place)


class StoreWriter:
    """Builds a store beside its place, scene by scene, and moves it there when it is done.

    Use as a context manager: it holds a lock, so that two builds cannot mix.

    Parameters
    ----------
    path : Path
        Where the finished store goes.
    manifest : Manifest
        The data set; its text and hash are kept in the store.
    attributes : mapping
        What the store says of itself; a partial store with other attributes is not gone on with.
    """

    def __init__(self, path: Path, manifest: Manifest, attributes: Mapping[str, Any]) -> None:
        self.path = path
        self._partial = path.with_name(path.name + ".partial")
        self._lock = filelock.FileLock(path.with_name(f".{path.name}.lock"))
        self._attributes = {
            "format": FORMAT,
            "format_version": FORMAT_VERSION,
            "dfdbench_version": version("dfdbench"),
            "manifest_name": manifest.stem,
            "manifest_sha256": manifest.sha256,
            "manifest": manifest.toml,
            **attributes,
        }

    def __enter__(self) -> StoreWriter:
        with _disk_errors(self.path):
            self.path.parent.mkdir(parents=True, exist_ok=True)
            try:
                self._lock.acquire(timeout=0)
            except filelock.Timeout as error:
                raise StoreError(
                    Problem(
                        "another build is writing this store", str(self.path),
                        fix="wait for it, or build elsewhere with --store PATH",
                    )
                ) from error  # fmt: skip
            try:
                self._refuse_what_is_not_ours()
            except StoreError:
                self._lock.release()
                raise
            if self._partial.exists() and _attributes_of(self._partial) != self._attributes:
                shutil.rmtree(self._partial)
            zarr.open_group(self._partial, mode="a", zarr_format=3).attrs.update(self._attributes)
        return self

    def __exit__(self, *exception: object) -> None:
        self._lock.release()

    def _refuse_what_is_not_ours(self) -> None:
        # The store is replaced whole: a folder of photographs must not be what is replaced.
        for place in (self.path, self._partial):
            if not place.exists():
                continue
            found = _attributes_of(place) or {}
            if found.get("format") != FORMAT:
                raise StoreError(
                    Problem(
                        "the place is taken by something that is no dfdbench store", str(place),
                        fix="choose another with --store PATH; nothing was changed",
                    )
                )  # fmt: skip
        for key, what in (("manifest_name", "data set"), ("recipe", "blur recipe")):
            found = (_attributes_of(self.path) or {}) if self.path.exists() else {}
            if key in found and found[key] != self._attributes.get(key):
                raise StoreError(
                    Problem(
                        f"the store there holds another {what}", str(self.path),
                        str(self._attributes.get(key)), str(found[key]),
                        "choose another place with --store PATH, or delete that store",
                    )
                )  # fmt: skip

    def digest_of_finished(self, scene: str, signature: str) -> str | None:
        """Return a scene's digest if it was written whole from the same files, else None.

        The arrays are read back and hashed, so that a damaged scene is written again.
        """
        for place in (self._partial, self.path):
            digest = self._verified(place, scene, signature)
            if digest and place == self.path:
                shutil.copytree(place / scene, self._partial / scene, dirs_exist_ok=True)
            if digest:
                return digest
        return None

    def _verified(self, place: Path, scene: str, signature: str) -> str | None:
        if not (place / scene).is_dir() or _attributes_of(place, self._attributes) != (
            self._attributes
        ):
            return None
        try:
            dataset = xarray.open_zarr(place, group=scene, consolidated=False, chunks=None)
            attributes = dataset.attrs
            if attributes.get("source_sha256") != signature or "digest" not in attributes:
                return None
            digest = combine(scene_digests(dataset))
        except (OSError, ValueError, KeyError, RuntimeError):
            return None
        return digest if digest == attributes["digest"] else None

    def write(self, scene: str, dataset: xarray.Dataset, signature: str) -> str:
        """Write one scene; return its digest. A scene counts as written once it bears it."""
        folder = self._partial / scene
        digests = scene_digests(dataset)
        with _disk_errors(self.path):
            shutil.rmtree(folder, ignore_errors=True)
            dataset.to_zarr(
                self._partial,
                group=scene,
                mode="w",
                zarr_format=3,
                consolidated=False,
                encoding={
                    str(name): {"chunks": _image_chunks(variable)}
                    for name, variable in dataset.data_vars.items()
                },
            )
            group = zarr.open_group(self._partial, path=scene, mode="r+")
            group.attrs.update(
                {"array_digests": digests, "source_sha256": signature, "digest": combine(digests)}
            )
        return combine(digests)

    def finish(self, digests: Mapping[str, str], missing: list[str]) -> str:
        """Move the store into its place whole; return its fingerprint."""
        fingerprint = combine(digests)
        with _disk_errors(self.path):
            for stray in self._partial.iterdir():
                if stray.is_dir() and stray.name not in digests:
                    shutil.rmtree(stray)
            zarr.open_group(self._partial, mode="r+").attrs.update(
                {"fingerprint": fingerprint, "missing_pairs": missing}
            )
            old = self.path.with_name(self.path.name + ".old")
            shutil.rmtree(old, ignore_errors=True)
            if self.path.exists():
                self.path.rename(old)
            self._partial.rename(self.path)
            shutil.rmtree(old, ignore_errors=True)
        return fingerprint


def _image_chunks(variable: xarray.DataArray) -> tuple[int, ...]:
    whole = {"y", "x", "channel"} & set(map(str, variable.dims))
    if not whole:
        return variable.shape
    return tuple(
        variable.sizes[dimension] if dimension in whole else 1 for dimension in variable.dims
    )


def _attributes_of(place: Path, like: Mapping[str, Any] | None = None) -> dict[str, Any] | None:
    try:
        attributes = dict(zarr.open_group(place, mode="r").attrs)
    except (OSError, ValueError, KeyError):
        return None
    return attributes if like is None else {key: attributes.get(key) for key in like}


def _open_tree(path: Path) -> xarray.DataTree:
    if not path.exists():
        raise StoreError(
            Problem("no such store", str(path), fix="dfdbench build NAME --store PATH")
        )
    try:
        return xarray.open_datatree(path, engine="zarr", consolidated=False, chunks=None)
    except (OSError, ValueError, KeyError) as error:
        raise StoreError(
            Problem("cannot read the store", str(path), got=str(error), fix="build it again")
        ) from error


@contextlib.contextmanager
def _disk_errors(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise StoreError(
            Problem(
                "cannot write the store", str(path), got=error.strerror or str(error),
                fix="make room or choose another place with --store PATH; "
                "the same command goes on where it stopped",
            )
        ) from error  # fmt: skip
