"""Where a built data set lies, found without opening it."""

from __future__ import annotations

import os
from pathlib import Path

from dfdbench.datasets.manifest import Manifest
from dfdbench.datasets.tracked import part_name
from dfdbench.system.cache import STORES, cache_folder


def default_store(manifest: Manifest, cache: Path | None = None) -> Path:
    """Return where the built data set lies unless a place is given."""
    return cache_folder(cache) / STORES / f"{manifest.stem}.zarr"


def is_place(name: str) -> bool:
    """Return whether a text names a store by its path or URL, not a data set.

    Examples
    --------
    >>> is_place("demo"), is_place("demo-1.zarr"), is_place("s3://bucket/demo")
    (False, True, True)
    """
    base, _ = part_name(name)
    return (base.endswith(".zarr") or os.sep in base) and not base.endswith(".toml")
