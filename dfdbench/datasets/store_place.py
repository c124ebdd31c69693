"""Where a built data set lies, found without opening it."""

from __future__ import annotations

import os
from pathlib import Path

from dfdbench.datasets.catalog import released_manifests
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


def own_stores(cache: Path | None = None) -> dict[str, Path]:
    """Return the sets of one's own that are built in the cache, by name.

    Each has two names, as released sets have: ``NAME-VERSION``, and for the newest version
    ``NAME``. No released set's name is among them.
    """
    released = released_manifests()
    taken = {name for known in released for name in (known.short, known.name, known.stem)}
    found: dict[str, Path] = {}
    newest: dict[str, int] = {}
    for path in sorted((cache_folder(cache) / STORES).glob("*.zarr")):
        if part_name(path.stem)[0] in taken:
            continue
        found[path.stem] = path
        name, _, version = path.stem.rpartition("-")
        if name not in taken and version.isdecimal() and int(version) > newest.get(name, -1):
            newest[name] = int(version)
            found[name] = path
    return found


def place_of(name: str, cache: Path | None = None) -> str | Path | None:
    """Return the store that a text names by its place or, of one's own, by its name.

    None for every other name: that is a released set's, a manifest's, or nothing's.
    """
    return name if is_place(name) else own_stores(cache).get(name)
