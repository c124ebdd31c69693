"""Read a built data set: one zarr store with a group for each scene."""

from __future__ import annotations

import operator
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np
import zarr
from numpy.typing import NDArray
from upath import UPath
from zarr.errors import GroupNotFoundError

from dfdbench import errors
from dfdbench.blur.recipe import BlurRecipe, find_recipe
from dfdbench.datasets.captured_files import BY_IMAGE, OF_CAMERA
from dfdbench.datasets.captures import ROLES, Capture, ImageFacts
from dfdbench.datasets.catalog import default_store, find_manifest, manifest_in, place_of
from dfdbench.datasets.fingerprint import WholeArrays, check_attributes, open_scene, verify_store
from dfdbench.datasets.manifest import ALL_PAIRS, Manifest, Pair
from dfdbench.system.location import Place, as_location, exists, is_local, zarr_store
from dfdbench.system.thumbnails import gallery, heading
from dfdbench.tables.table import Table, as_html

if TYPE_CHECKING:
    import xarray

    from dfdbench.datasets.fingerprint import StoreVerification

FORMAT = "dfdbench store"
FORMAT_VERSION = 1
#: Rows and columns of an image.
Region = tuple[slice, slice]
WHOLE: Region = (slice(None), slice(None))
# How much of a library's error message we quote, in characters.
_LONGEST = 300
#: A notebook shows the first pair of this many scenes.
_SHOWN = 4
_REMOTE = "check the address, the network, and what the server knows you by"


class Dataset:
    """A built data set, opened for reading.

    Parameters
    ----------
    place : str, Path or UPath
        The zarr folder: a local path or a URL.

    Raises
    ------
    StoreError
        If there is no store, it is not a dfdbench store or is incomplete, its attributes were
        edited, or it was built from a manifest that differs from the released one of that name.
    """

    def __init__(self, place: Place) -> None:
        self.path = as_location(place)
        self._root, groups = _open_root(self.path)
        self.attributes: dict[str, Any] = dict(self._root.attrs)
        if self.attributes.get("format") != FORMAT:
            raise _not_ours(self.path)
        if self.attributes.get("format_version") != FORMAT_VERSION:
            what = f"store of version {self.attributes.get('format_version')}, not {FORMAT_VERSION}"
            raise errors.StoreError(what, where=str(self.path), fix="build it again")
        if "fingerprint" not in self.attributes:
            fix = "run the dfdbench build that began it again: it goes on from there"
            raise errors.StoreError("the store is not finished", where=str(self.path), fix=fix)
        check_attributes(self.attributes, str(self.path))
        self.manifest = manifest_in(self.attributes, str(self.path))
        self._arrays: dict[str, zarr.Array[Any]] = {}
        self._known: dict[str, dict[str, NDArray[Any]]] = {}
        self._pairs = frozenset(self.manifest.pairs())
        #: The scenes that were built, in the manifest's order.
        self.scenes = tuple(name for name in self.manifest.scene_names if name in groups)

    def __repr__(self) -> str:
        # Read nothing: a store may be damaged, or far away.
        pairs = len(self.manifest.pairs()) - len(self.attributes.get("missing_pairs", ()))
        return f"<{self.manifest.stem}: {pairs} pairs of {len(self.scenes)} scenes>"

    def captures(self, split: str = ALL_PAIRS) -> Captures:
        """Return the pairs of a split; each is read when you ask for it.

        Raises
        ------
        UnknownNameError
            If there is no such split, fold or scene.
        """
        return Captures(self, self.pairs(split))

    def verify(self) -> StoreVerification:
        """Read everything again and compare it with the fingerprint."""
        return verify_store(self)

    @property
    def fingerprint(self) -> str:
        """The SHA-256 over everything that the store's arrays hold."""
        return str(self.attributes["fingerprint"])

    @property
    def recipe_name(self) -> str:
        """The blur recipe's name; ``of track NAME-SEVERITY`` on a track, empty if captured."""
        if self.manifest.on_track:
            return f"of track {self.manifest.degradation}"
        return str(self.attributes["recipe"]["name"])

    @property
    def recipe(self) -> BlurRecipe | None:
        """The blur recipe; None if the defocus images were captured, and on a track."""
        parameters = self.attributes["recipe"]["parameters"]
        return find_recipe(parameters) if parameters else None

    def to_xarray(self, name: str) -> xarray.Dataset:
        """Return one scene's arrays, read lazily.

        Its attributes give the digest of each array and of the source files.
        """
        scene = self.stored(name)
        with self.reading(f"{name}/role"):
            roles = [ROLES[number] for number in scene["role"].values]
        return scene.assign_coords(role=("image", roles))

    def stored(self, name: str) -> xarray.Dataset:
        """Return one scene's arrays as they are stored: roles are numbers."""
        if name not in self.scenes:
            raise errors.unknown_name("scene of the store", name, self.scenes)
        with self.reading(name):
            return open_scene(self.path, name)

    def pairs(self, split: str) -> tuple[Pair, ...]:
        """Return the pairs of a split that the store holds, in the manifest's order."""
        wanted = self.manifest.pairs(split)
        scenes = {pair.scene for pair in wanted} & set(self.scenes)
        there = {name: self._part(name, "available", ...) for name in scenes}
        return tuple(
            pair
            for pair in wanted
            if pair.scene in there and there[pair.scene][self._index(pair, self.manifest.axes)]
        )

    def some_pairs(self, split: str) -> tuple[Pair, ...]:
        """Return the pairs of a split as `pairs` does, but at least one.

        Raises
        ------
        StoreError
            If there is none.
        """
        if not (found := self.pairs(split)):
            what = f"the store holds no pair of split {split}"
            fix = f"build {self.manifest.short} with the scenes of that split"
            raise errors.StoreError(what, where=str(self.path), fix=fix)
        return found

    def read(self, pair: Pair, region: Region = WHOLE) -> Capture:
        """Read one pair's images and ground truth, or a region of them.

        Parameters
        ----------
        pair : Pair
            Which pair.
        region : pair of slice
            Rows and columns; by default all. Only this pair's images and depth map are decoded.

        Raises
        ------
        InputError
            If the pair is not of this data set.
        StoreError
            If an array cannot be decoded.
        """
        at, depth = self._index(pair, self.manifest.axes), self.manifest.depth
        return Capture(
            pair,
            self._part(pair.scene, "images", (*at, slice(None), *region)),
            self._part(pair.scene, "depth", (*self._index(pair, depth.axes), *region)),
            self._facts(pair.scene, at),
            depth,
            self.manifest.groups.get(pair.scene, pair.scene),
        )

    def read_depth(self, pair: Pair) -> NDArray[np.float32]:
        """Read one pair's depth in the set's unit, NaN where it is not known."""
        return self._part(pair.scene, "depth", self._index(pair, self.manifest.depth.axes))

    def read_levels(self, pair: Pair) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
        """Read one pair's depth as whole levels, and where it is known."""
        depth = self.read_depth(pair)
        return self.manifest.depth.levels_of(depth), np.isfinite(depth)

    def _facts(self, scene: str, at: tuple[int, ...]) -> ImageFacts:
        if scene not in self._known:
            names = ("role", *BY_IMAGE, *OF_CAMERA)
            self._known[scene] = {name: self._part(scene, name, ...) for name in names}
        known = self._known[scene]
        # Copies, since a method may write into what it gets.
        return ImageFacts(
            tuple(ROLES[number] for number in known["role"]),
            **{name: known[name][at].copy() for name in BY_IMAGE},
            **{name: known[name].copy() for name in OF_CAMERA},
        )

    def shape_of(self, scene: str) -> tuple[int, int]:
        """Return the rows and columns of a scene's images."""
        with self.reading(f"{scene}/depth"):
            rows, columns = self._array(scene, "depth").shape[-2:]
        return rows, columns

    def _index(self, pair: Pair, axes: Iterable[str]) -> tuple[int, ...]:
        if pair not in self._pairs:
            what, fix = f"no pair of {self.manifest.stem}", "take one of dataset.pairs(split)"
            raise errors.InputError(what, where=pair.id, fix=fix)
        return tuple(self.manifest.axes[axis].index(pair.at[axis]) for axis in axes)

    def _array(self, scene: str, name: str) -> zarr.Array[Any]:
        key = f"{scene}/{name}"
        if key not in self._arrays:
            if scene not in self.scenes:
                raise errors.unknown_name("scene of the store", scene, self.scenes)
            array = self._root[key]
            if not isinstance(array, zarr.Array):
                raise TypeError("not an array")
            images = array if name == "images" else self._array(scene, "images")
            _require_fit(array, name, self.manifest, images.shape)
            self._arrays[key] = array
        return self._arrays[key]

    def _part(self, scene: str, name: str, selection: Any) -> NDArray[Any]:
        with self.reading(f"{scene}/{name}"):
            return np.asarray(self._array(scene, name)[selection])

    @contextmanager
    def reading(self, what: str) -> Iterator[None]:
        """Report any error in the block, which reads arrays of the store, as damage.

        Raises
        ------
        StoreError
            If an array is missing or cannot be decoded.
        """
        try:
            yield
        except errors.DfdbenchError:
            raise
        except Exception as error:
            # Depending on where the damage is, a damaged file can raise any exception.
            got, where = str(error)[:_LONGEST], f"{self.path}, {what}"
            fix = f"dfdbench verify {self.path} finds what is damaged, `dfdbench build` mends it"
            raise errors.StoreError(
                "an array of the store cannot be read", where=where, got=got, fix=fix
            ) from error

    def _repr_html_(self) -> str:
        splits = ", ".join(f"{split.name} ({split.pairs} pairs)" for split in self.manifest.splits)
        facts = (
            ("splits", splits or "none"),
            ("defocus", self.recipe_name or "captured"),
            ("fingerprint", self.fingerprint),
            ("place", str(self.path)),
        )
        table = Table(self.manifest.title, ("fact", "value"), facts, "ll")
        return as_html(table) + self.captures()._repr_html_()

    def __reduce__(self) -> tuple[type[Dataset], tuple[UPath]]:
        # Another process opens it anew, perhaps in another working directory.
        return Dataset, (self.path.absolute() if is_local(self.path) else self.path,)


def _require_fit(
    array: zarr.Array[Any], name: str, manifest: Manifest, images: tuple[int, ...]
) -> None:
    """Refuse an array whose shape or type does not fit its manifest and its scene's images.

    Otherwise we would read the wrong places, or beyond its end.

    Parameters
    ----------
    array : zarr.Array
        An array of a scene.
    name : str
        Its name: ``images``, ``depth``, ``available``, or a fact about the images.
    manifest : Manifest
        The store's.
    images : tuple of int
        Shape of the scene's images, (axes..., image, y, x, channel).

    Raises
    ------
    ValueError
        If its shape or its type is different.
    """
    extent = tuple(map(len, manifest.axes.values()))
    count, *sides, _ = images[len(extent) :]
    depths = (len(manifest.axes[axis]) for axis in manifest.depth.axes)
    kinds: dict[str, tuple[tuple[int, ...], str]] = {
        "images": ((*extent, count, *sides, 3), "u1 u2"),
        "depth": ((*depths, *sides), "f4"),
        "available": (extent, "b1"),
        "role": ((count,), "u1"),
        **dict.fromkeys(BY_IMAGE, ((*extent, count), "f8")),
        **dict.fromkeys(OF_CAMERA, ((), "f8")),
    }
    wanted, types = kinds[name]
    if array.shape != wanted or array.dtype.str[1:] not in types.split():
        raise ValueError(f"{array.dtype}, shape {array.shape}, where {types}, {wanted} belongs")


class Captures(Sequence[Capture]):
    """The pairs of a split; each is read when you ask for it, and none is kept.

    Parameters
    ----------
    dataset : Dataset
        The data set.
    pairs : tuple of Pair
        Which of its captures.
    images : sequence of int, optional
        Two images of each capture, to be read as a pair.
    """

    def __init__(
        self, dataset: Dataset, pairs: tuple[Pair, ...], images: Sequence[int] | None = None
    ) -> None:
        self.dataset = dataset
        self.pairs = pairs
        self._images = images

    def __len__(self) -> int:
        return len(self.pairs)

    @overload
    def __getitem__(self, index: int) -> Capture: ...

    @overload
    def __getitem__(self, index: slice) -> Captures: ...

    def __getitem__(self, index: int | slice) -> Capture | Captures:
        if isinstance(index, slice):
            return Captures(self.dataset, self.pairs[index], self._images)
        return self.dataset.read(self.pair_at(index)).two_of(self._images)

    def __repr__(self) -> str:
        return f"<{len(self)} pairs of {self.dataset.path}>"

    def _repr_html_(self) -> str:
        first: dict[str, Pair] = {}
        for pair in self.pairs:
            first.setdefault(pair.scene, pair)
        shown = list(first.values())[:_SHOWN]
        more = f", of which {len(shown)} are shown" if len(first) > len(shown) else ""
        rows = []
        for pair in shown:
            (infocus, _), *others = self.dataset.read(pair).thumbnails()
            rows.append([(infocus, f"{pair.id}, in-focus"), *others])
        facts = f"{len(self.pairs)} pairs of {len(first)} scenes{more}"
        return heading(self.dataset.manifest.stem, facts) + gallery(rows)

    def pair_at(self, index: int) -> Pair:
        """Return the pair at an index, without reading it.

        Raises
        ------
        IndexError
            If there are fewer pairs.
        TypeError
            If the index is not a whole number.
        """
        try:
            place = operator.index(index)
        except TypeError:
            what = f"a pair is found by its place, as data[0]; got {index!r}. Names: data.pairs"
            raise TypeError(what) from None
        try:
            return self.pairs[place]
        except IndexError:
            raise IndexError(f"no pair {index}: {self!r} has 0 to {len(self) - 1}") from None

    def crop(self, index: int, region: Region = WHOLE) -> Capture:
        """Return a region of one pair, without decoding the images of any other.

        Parameters
        ----------
        index : int
            Which pair.
        region : pair of slice
            Rows and columns, within the image.

        Raises
        ------
        InputError
            If the region is not two slices, extends beyond the image, or holds no pixel.
        IndexError
            If there are fewer pairs.
        """
        parts = region if isinstance(region, tuple) else ()
        if [type(part) for part in parts] != [slice, slice]:
            raise errors.InputError(f"not two slices, rows and columns: {region!r}", where="region")
        pair = self.pair_at(index)
        _check_region(region, self.dataset.shape_of(pair.scene))
        return self.dataset.read(pair, region).two_of(self._images)


def _check_region(region: Region, shape: tuple[int, int]) -> None:
    # Python clips slices at the end, and empties those that start before 0; stores have no steps.
    what = "the crop does not lie within the image, or has a step"
    errors.InputError.raise_if(
        errors.Problem(f"{what}: {part.start} to {part.stop} of {size} pixels", where=axis)
        for axis, part, size in zip(("rows", "columns"), region, shape, strict=True)
        if any(end is not None and not -size <= end <= size for end in (part.start, part.stop))
        or not range(*part.indices(size))
        or part.step not in (None, 1)
    )


def open_dataset(
    name: Place, place: Place | None = None, cache: Path | str | None = None
) -> Dataset:
    """Open a built data set: by its name, or by the path or URL of its store.

    Parameters
    ----------
    name : str, Path or UPath
        A data set's name, a manifest's path, or the path or URL of a store.
    place : str, Path or UPath, optional
        Where the store is, if not in the default place.
    cache : Path or str, optional
        The cache folder that holds the default place; see `dfdbench.system.cache.cache_folder`.

    Raises
    ------
    StoreError
        If it is not built, or was built before its manifest was edited; the message says how to
        build it.
    UnknownNameError
        If there is no such data set.

    Examples
    --------
    >>> data = open_dataset("demo")  # doctest: +SKIP
    >>> data.captures("test")[0].infocus.shape  # doctest: +SKIP
    (240, 320, 3)
    """
    name = str(name)
    if place is None:
        place = place_of(name, cache)
    if place is not None:
        return Dataset(place)
    try:
        manifest = find_manifest(name)
    except errors.UnknownNameError:
        if not Path(name).exists():
            raise
        kind = "folder" if Path(name).is_dir() else "file"
        fix = "`dfdbench list` shows the names of data sets; stores end in .zarr"
        raise errors.StoreError(f"a {kind}, and not a data set", where=name, fix=fix) from None
    more = " --source DIR" * bool(manifest.files)
    if not (default := default_store(manifest, cache)).exists():
        typed = name if name.endswith(".toml") else manifest.short
        if manifest.short != "demo":
            more += ", or start with the small set: `dfdbench build demo`, then `--dataset demo`"
        what = f"data set {manifest.short} is not built"
        raise errors.StoreError(what, where=str(default), fix=f"dfdbench build {typed}{more}")
    found = Dataset(default)
    if found.manifest.substance != manifest.substance:
        what = f"the built set {manifest.short} was made from another manifest: edited, or another "
        what += "set of that name"
        raise errors.StoreError(what, where=str(default), fix=f"dfdbench build {name}{more}")
    return found


def _not_ours(location: UPath) -> errors.StoreError:
    fix = "dfdbench build NAME; a store whose zarr.json was lost has to be deleted first"
    return errors.StoreError("not a data set built by dfdbench", where=str(location), fix=fix)


def _open_root(location: UPath) -> tuple[zarr.Group, frozenset[str]]:
    """Return a store's root and the names of its groups."""
    try:
        if not exists(location):
            fix = "dfdbench build NAME --store PATH" if is_local(location) else _REMOTE
            raise errors.StoreError("no such store", where=str(location), fix=fix)
        root = zarr.open_group(WholeArrays(zarr_store(location)), mode="r", zarr_format=3)
        return root, frozenset(root.group_keys())
    except errors.DfdbenchError:
        raise
    except GroupNotFoundError as error:
        raise _not_ours(location) from error
    except Exception as error:
        if not __debug__ and isinstance(error, TypeError):
            what, fix = "zarr cannot read a store without assertions", "start Python without -O"
            raise errors.StoreError(what, where=str(location), fix=fix) from error
        # An object store may be unreachable or forbidden, or its bucket may not exist.
        what = f"cannot read the store: {str(error)[:_LONGEST]}"
        fix = "build it again" if is_local(location) else _REMOTE
        fix = "allow more memory and threads" if "new thread" in str(error) else fix
        raise errors.StoreError(what, where=str(location), fix=fix) from error
