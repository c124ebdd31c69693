"""What a store's files may not say: found before they are taken at their word."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

import zarr
from pydantic import BaseModel, Field, ValidationError

from dfdbench.datasets.fingerprint import ATTRIBUTES_SHA256, attributes_digest
from dfdbench.datasets.manifest import Manifest
from dfdbench.errors import StoreError
from dfdbench.system.strict import problems_of

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
    array: zarr.Array[Any], name: str, manifest: Manifest, images: tuple[int, ...]
) -> None:
    """Refuse an array that its manifest and its scene's images leave no room for.

    One of another shape would be read at the wrong places, or beyond its end.

    Parameters
    ----------
    array : zarr.Array
        Of a scene.
    name : str
        Which: ``images``, ``depth``, ``available``, or what is known of the images.
    manifest : Manifest
        The store's.
    images : tuple of int
        Shape of the scene's images, (axes..., image, y, x, channel).

    Raises
    ------
    ValueError
        If its shape or its type is another.
    """
    extent = tuple(map(len, manifest.axes.values()))
    count, *sides, _ = images[len(extent) :]
    depths = (len(manifest.axes[axis]) for axis in manifest.depth.axes)
    kinds: dict[str, tuple[tuple[int, ...], str]] = {
        "images": ((*extent, count, *sides, 3), "u1 u2"),
        "depth": ((*depths, *sides), "f4"),
        "available": (extent, "b1"),
        "role": ((count,), "u1"),
        **dict.fromkeys(("focus_distance", "focus_depth", "f_number"), ((*extent, count), "f8")),
        **dict.fromkeys(("focal_length", "pixel_pitch"), ((), "f8")),
    }
    wanted, types = kinds[name]
    if array.shape != wanted or array.dtype.str[1:] not in types.split():
        raise ValueError(f"{array.dtype}, shape {array.shape}, where {types}, {wanted} belongs")
