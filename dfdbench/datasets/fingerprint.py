"""Hashes of what arrays hold, whatever file they lie in."""

import hashlib
import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray
from numpy.typing import NDArray

#: The attribute of a store that holds `attributes_digest`.
ATTRIBUTES_SHA256 = "attributes_sha256"


def array_digest(name: str, dimensions: tuple[str, ...], values: NDArray[Any]) -> str:
    """Return the SHA-256 of an array's name, dimensions, shape, type and values.

    Byte order and memory layout do not enter; chunking and compression cannot.

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
    return {
        str(name): array_digest(
            str(name), tuple(map(str, scene[name].dims)), np.asarray(scene[name].values)
        )
        for name in sorted(map(str, scene.variables))
    }


def attributes_digest(attributes: Mapping[str, Any]) -> str:
    """Return the SHA-256 of a store's attributes, without that of this digest itself.

    A fingerprint covers arrays only. Recipe, manifest, track and options change scores too, and a
    method is given some of them.
    """
    others = {name: value for name, value in attributes.items() if name != ATTRIBUTES_SHA256}
    return hashlib.sha256(json.dumps(others, sort_keys=True).encode()).hexdigest()


def combine(digests: Mapping[str, str]) -> str:
    """Return one SHA-256 for digests by name; their order in the mapping does not matter.

    Examples
    --------
    >>> combine({"b": "1", "a": "0"}) == combine({"a": "0", "b": "1"})
    True
    """
    return hashlib.sha256(json.dumps(sorted(digests.items())).encode()).hexdigest()
