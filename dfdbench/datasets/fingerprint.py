"""Hashes of arrays, whatever file they are in, and whether a store is as it was built."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BaseModel, Field, ValidationError
from upath import UPath
from zarr.abc.buffer import Buffer, BufferPrototype
from zarr.abc.store import ByteRequest, Store
from zarr.storage import WrapperStore

from dfdbench.errors import Problem, StoreError
from dfdbench.system.location import zarr_store
from dfdbench.system.parallel import Pool, Threads
from dfdbench.system.strict import problems_of

if TYPE_CHECKING:
    import xarray

    from dfdbench.datasets.dataset import Dataset

#: The attribute of a store that holds `attributes_digest`.
ATTRIBUTES_SHA256 = "attributes_sha256"


def array_digest(name: str, dimensions: tuple[str, ...], values: NDArray[Any]) -> str:
    """Return the SHA-256 of an array's name, dimensions, shape, type and values.

    The digest does not depend on byte order, memory layout, chunking or compression.

    Examples
    --------
    >>> rows = np.arange(6, dtype=">i8").reshape(2, 3)
    >>> columns = np.asfortranarray(rows.astype("<i8"))
    >>> array_digest("a", ("y", "x"), rows) == array_digest("a", ("y", "x"), columns)
    True
    """
    little = values.astype(values.dtype.newbyteorder("<"), copy=False)
    header = [name, list(dimensions), list(values.shape), little.dtype.str]
    digest = hashlib.sha256(json.dumps(header).encode())
    digest.update(np.ascontiguousarray(little).tobytes())
    return digest.hexdigest()


def scene_digests(scene: xarray.Dataset) -> dict[str, str]:
    """Return the digest of every variable and coordinate of a scene, by name, sorted."""
    return {name: variable_digest(scene[name]) for name in sorted(map(str, scene.variables))}


def variable_digest(variable: xarray.DataArray) -> str:
    """Return the digest of one variable or coordinate of a scene, by `array_digest`."""
    dimensions = tuple(map(str, variable.dims))
    return array_digest(str(variable.name), dimensions, np.asarray(variable.values))


def attributes_digest(attributes: Mapping[str, Any]) -> str:
    """Return the SHA-256 of a store's attributes, except this digest itself.

    A fingerprint covers arrays only. But recipe, manifest, track and options change scores too, and
    a method is given some of them.
    """
    others = {name: value for name, value in attributes.items() if name != ATTRIBUTES_SHA256}
    return hashlib.sha256(json.dumps(others, sort_keys=True).encode()).hexdigest()


def signed(attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Return a store's attributes together with their digest."""
    return {**attributes, ATTRIBUTES_SHA256: attributes_digest(attributes)}


def combine(digests: Mapping[str, str]) -> str:
    """Combine digests by name into one SHA-256, whatever their order in the mapping.

    Examples
    --------
    >>> combine({"b": "1", "a": "0"}) == combine({"a": "0", "b": "1"})
    True
    """
    return hashlib.sha256(json.dumps(sorted(digests.items())).encode()).hexdigest()


_Digest = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class SceneRecord(BaseModel):
    """What a store says about one scene.

    Attributes
    ----------
    array_digests : dict
        The digest of each array, by its name.
    source_sha256 : str
        The source's digest of the files that it was made from.
    digest : str
        The digest of the array digests together.
    found : dict
        What its source found out about it.
    """

    array_digests: dict[str, _Digest]
    source_sha256: str
    digest: _Digest
    found: dict[str, Any] = Field(default_factory=dict)


def scene_record(attributes: Mapping[Any, Any], where: str) -> SceneRecord:
    """Return a scene's attributes, checked.

    Raises
    ------
    StoreError
        With every field that is missing or wrong.
    """
    try:
        return SceneRecord.model_validate(attributes)
    except ValidationError as error:
        what, fix = "a scene's record is damaged", "`dfdbench build` writes the scene again"
        raise StoreError.of(problems_of(error, what, file=where, fix=fix)) from error


def _as_recipe(recipe: dict[str, Any]) -> dict[str, Any]:
    if not (isinstance(recipe.get("name"), str) and isinstance(recipe.get("parameters"), dict)):
        raise ValueError("a name and a table of parameters")
    return recipe


class _StoreRecord(BaseModel):
    """What a store says about itself: its attributes, as far as they are used."""

    dfdbench_version: str
    manifest: str
    manifest_sha256: str
    recipe: Annotated[dict[str, Any], AfterValidator(_as_recipe)]
    degradation: str
    options: dict[str, Any]
    fingerprint: _Digest
    missing_pairs: list[str] = Field(default_factory=list)


def check_attributes(attributes: Mapping[str, Any], where: str) -> None:
    """Refuse a store whose attributes are not as a build wrote them.

    Raises
    ------
    StoreError
        If their hash is different, or one is missing or of another type.
    """
    what = "the store's attributes are damaged, or were edited after it was built"
    fix = "delete it and build it again"
    if attributes_digest(attributes) != attributes.get(ATTRIBUTES_SHA256):
        raise StoreError(what, where=where, fix=fix)
    try:
        # Whoever edits them can hash them, too.
        _StoreRecord.model_validate(attributes)
    except ValidationError as error:
        raise StoreError.of(problems_of(error, what, file=where, fix=fix)) from error


class WholeArrays(WrapperStore[Store]):
    """Zarr's view of a store in which every chunk was written, so that a missing one is an error.

    Zarr itself reads a missing chunk as zeros: a lost file would become a black image.
    """

    async def get(
        self, key: str, prototype: BufferPrototype, byte_range: ByteRequest | None = None
    ) -> Buffer | None:
        """Return what lies under a key, None where there is no such group or array.

        Raises
        ------
        FileNotFoundError
            Where it is a chunk of an array, and is not there.
        """
        found = await super().get(key, prototype, byte_range)
        # As in Aloe/depth/c.0.0.0: scene, array, chunk; in an older store Aloe/depth/c/0/0/0.
        if found is None and [part.split(".")[0] for part in key.split("/")[2:3]] == ["c"]:
            raise FileNotFoundError(f"{key} is missing")
        return found


def open_scene(location: UPath, name: str) -> xarray.Dataset:
    """Return a scene of the store at a place, its arrays read lazily.

    Raises
    ------
    Exception
        Whatever zarr and xarray raise for damaged files: see `dfdbench.datasets.fingerprint`.
    """
    import xarray  # a run of pairs does not need it

    arrays = WholeArrays(zarr_store(location))
    scene: xarray.Dataset = xarray.open_zarr(
        arrays, group=name, consolidated=False, chunks=None, zarr_format=3
    )
    return scene


@dataclass(frozen=True)
class StoreDifference:
    """Something in a store that is not as it was built.

    Parameters
    ----------
    scene, array : str
        Where it is; `array` is empty if it concerns the whole scene.
    what : str
        What is wrong with it.
    """

    scene: str
    array: str
    what: str

    @property
    def place(self) -> str:
        """The scene, and the array if it is about one."""
        return f"{self.scene}/{self.array}".rstrip("/")


@dataclass(frozen=True)
class StoreVerification:
    """What a store holds, compared with what it says it holds.

    Parameters
    ----------
    recorded, recomputed : str
        The fingerprint in its attributes, and that of its arrays; the latter is empty if an array
        cannot be read.
    scenes, arrays : int
        How many were checked.
    differences : tuple of StoreDifference
        Everything that was found.
    """

    recorded: str
    recomputed: str
    scenes: int
    arrays: int
    differences: tuple[StoreDifference, ...]

    @property
    def sound(self) -> bool:
        """Whether the store holds what was built."""
        return not self.differences and self.recorded == self.recomputed


def verify_store(
    store: Dataset, pool: Pool | None = None, on_scene: Callable[[int, int], None] | None = None
) -> StoreVerification:
    """Recompute the fingerprint of a store from its arrays.

    Parameters
    ----------
    store : Dataset
        The store to check.
    pool : Pool, optional
        Where scenes are read, and how many at once.
    on_scene : callable, optional
        Called with (scenes done, total scenes).
    """
    looked_at = (pool or Threads()).map(partial(_verified, store), store.scenes, on_done=on_scene)
    left_out = set(store.attributes.get("missing_pairs", ()))
    expected = dict.fromkeys(p.scene for p in store.manifest.pairs() if p.id not in left_out)
    gone = [scene for scene in expected if scene not in store.scenes]
    missing = [StoreDifference(scene, "", "the scene is missing") for scene in gone]
    differences = [difference for scene in looked_at for difference in scene.differences]
    digests = dict(zip(store.scenes, (scene.recomputed for scene in looked_at), strict=True))
    return StoreVerification(
        store.fingerprint,
        combine(digests) if all(digests.values()) else "",
        len(looked_at),
        sum(scene.arrays for scene in looked_at),
        tuple(missing + differences),
    )


def require_sound(store: Dataset) -> None:
    """Refuse a store that does not hold what was built.

    Raises
    ------
    StoreError
        With everything that differs.
    """
    found = verify_store(store)
    items = found.differences
    if not found.sound and not items:
        items = (StoreDifference("fingerprint", "", f"{found.recomputed}, not the recorded one"),)
    what, fix = "the store does not hold what was built", "the dfdbench build that made it mends it"
    StoreError.raise_if(
        Problem(what, where=f"{store.path}, {item.place}", got=item.what, fix=fix) for item in items
    )


def _verified(store: Dataset, scene: str) -> StoreVerification:
    """Check one scene against what it says about itself."""
    try:
        dataset = store.stored(scene)
    except StoreError as error:
        why = f"cannot be opened: {error.problems[0].got}"
        return StoreVerification("", "", 1, 0, (StoreDifference(scene, "", why),))
    digests = dataset.attrs.get("array_digests")
    recorded: dict[str, Any] = digests if isinstance(digests, dict) else {}
    found: dict[str, str] = {}
    differences = []
    for name in sorted({*map(str, dataset.variables), *recorded}):
        try:
            found[name] = variable_digest(dataset[name])
            what = "" if found[name] == recorded.get(name) else "holds other values"
        except Exception as error:
            what = f"cannot be decoded: {error}"
        if (name in recorded) != (name in dataset.variables):
            what = "is missing" if name in recorded else "was not there when it was built"
        if what:
            differences.append(StoreDifference(scene, name, what))
    if found == recorded and combine(found) != dataset.attrs.get("digest"):
        differences.append(StoreDifference(scene, "", "its recorded digests contradict each other"))
    digest = combine(found) if len(found) == len(dataset.variables) else ""
    return StoreVerification("", digest, 1, len(found), tuple(differences))
