"""What a store's files may not say: found before they are taken at their word."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
import zarr
from pydantic import BaseModel, Field, ValidationError

from dfdbench.datasets.fingerprint import ATTRIBUTES_SHA256, attributes_digest
from dfdbench.datasets.manifest import Manifest
from dfdbench.errors import StoreError
from dfdbench.system.record import problems_of

#: What zarr and xarray come to where files are damaged, by where they are.
DAMAGED: tuple[type[Exception], ...] = (
    ArithmeticError,
    AssertionError,
    AttributeError,
    EOFError,
    LookupError,
    MemoryError,
    OSError,
    RuntimeError,
    TypeError,
    ValueError,
)
#: Characters of what a library says of damage.
LONGEST = 300


class _Recipe(BaseModel):
    name: str
    parameters: dict[str, Any]


class _Attributes(BaseModel):
    """What a store says of itself, as far as it is read; there may be more."""

    manifest: str
    manifest_sha256: str
    fingerprint: str
    attributes_sha256: str
    dfdbench_version: str
    degradation: str = ""
    recipe: _Recipe
    options: dict[str, Any]
    missing_pairs: list[str] = Field(default_factory=list)


_Digest = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class SceneRecord(BaseModel):
    """What a store says of one scene.

    Attributes
    ----------
    array_digests : dict
        The digest of each array, by its name.
    source_sha256 : str
        What its source says of the files that it was made from.
    digest : str
        Of the array digests together.
    found : dict
        What its source found out about it.
    """

    array_digests: dict[str, _Digest]
    source_sha256: str
    digest: _Digest
    found: dict[str, Any] = Field(default_factory=dict)


def scene_record(attributes: Mapping[Any, Any], where: str) -> SceneRecord:
    """Return a scene's attributes as a build writes them.

    Raises
    ------
    StoreError
        With every field that is absent or wrong.
    """
    try:
        return SceneRecord.model_validate(attributes)
    except ValidationError as error:
        fix = "`dfdbench build` writes the scene again"
        raise StoreError.of(
            problems_of(error, "a scene's record is damaged", file=where, fix=fix)
        ) from error


def check_attributes(attributes: Mapping[str, Any], where: str) -> None:
    """Refuse a store whose attributes are not those that a build wrote.

    Raises
    ------
    StoreError
        With every field that is absent or wrong; if the attributes were edited.
    """
    try:
        _Attributes.model_validate(attributes)
    except ValidationError as error:
        problems = problems_of(
            error, "the store's attributes are damaged", file=where, fix="build it again"
        )
        raise StoreError.of(problems) from error
    if attributes_digest(attributes) != attributes[ATTRIBUTES_SHA256]:
        raise StoreError(
            "the store's attributes were edited after it was built",
            where=where,
            expected=f"SHA-256 {attributes[ATTRIBUTES_SHA256]}",
            got=attributes_digest(attributes),
            fix="delete it and build it again",
        )


def require_fit(
    array: zarr.Array[Any], name: str, manifest: Manifest, sides: tuple[int, ...]
) -> None:
    """Refuse an array that its manifest and its scene's depth map leave no room for.

    One of another shape would be read at the wrong places, or beyond its end.

    Parameters
    ----------
    array : zarr.Array
        Of a scene.
    name : str
        ``infocus``, ``defocus``, ``depth``, ``valid`` or ``available``.
    manifest : Manifest
        The store's.
    sides : tuple of int
        Rows and columns of the scene's depth map.

    Raises
    ------
    ValueError
        Where its shape or its type is another.
    """
    axes = manifest.depth.axes if name in ("depth", "valid") else manifest.axes
    image = {"available": (), "infocus": (*sides, 3), "defocus": (*sides, 3)}.get(name, sides)
    wanted = (*(len(manifest.axes[axis]) for axis in axes), *image)
    kind = np.dtype(bool if name in ("valid", "available") else np.uint8)
    if array.shape != wanted or array.dtype != kind:
        raise ValueError(f"{array.dtype}, shape {array.shape}, where {kind}, {wanted} belongs")
