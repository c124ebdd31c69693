"""A data set on a track, by the name that a user types: ``demo@camera-2``."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import PurePath
from typing import Any

from dfdbench.blur.tracks import CLEAN, find_degradation
from dfdbench.datasets.manifest import Manifest
from dfdbench.datasets.manifest_file import parse_manifest, released_sha256
from dfdbench.datasets.rendered import seeded, unseen_manifest
from dfdbench.errors import DfdbenchError, InputError, StoreError, UnknownNameError

#: What stands between a data set's name and its track's.
AT = "@"
_NAME = re.compile(rf"(?P<base>.+){AT}(?P<label>[^{AT}/\\]*)")
_FILES = (".toml", ".zarr")


def part_name(name: str) -> tuple[str, str]:
    """Return a data set's name and its track with the severity, empty where none is named.

    Examples
    --------
    >>> part_name("demo@camera-2"), part_name("demo"), part_name("me@home/mine.toml")
    (('demo', 'camera-2'), ('demo', ''), ('me@home/mine.toml', ''))
    >>> part_name("mine.toml@noise-1"), part_name("demo@camera")
    (('mine.toml', 'noise-1'), ('demo', 'camera'))
    """
    parts = None if name.endswith(_FILES) else _NAME.fullmatch(name)
    return (parts["base"], parts["label"]) if parts else (name, "")


def with_track(manifest: Manifest, label: str) -> Manifest:
    """Return a data set as a track makes it: the same but for its images, and its name.

    Parameters
    ----------
    manifest : Manifest
        The data set, without a track.
    label : str
        ``TRACK-SEVERITY``; severity 0 is the data set itself.

    Raises
    ------
    UnknownNameError
        Where there is no such track or severity; near misses are named.
    InputError
        Where the data set's defocus images are captured.

    Examples
    --------
    >>> from dfdbench.datasets.catalog import find_manifest
    >>> demo = find_manifest("demo")
    >>> with_track(demo, "camera-2").stem, with_track(demo, "camera-0").stem
    ('demo-1@camera-2', 'demo-1')
    """
    if not label:
        what = f"unknown track: nothing follows the @ of {manifest.short}{AT}"
        fix = f"{manifest.short} for the clean images, {manifest.short}{AT}noise-1 for a track"
        raise UnknownNameError(what, fix=fix)
    found = find_degradation(label)
    if manifest.recipe is None:
        what = (
            f"{manifest.short} has no tracks: a track makes defocus images, and these are captured"
        )
        fix = f"leave out {AT}{label}, or name a synthetic set: `dfdbench list`"
        raise InputError(what, where=f"{manifest.short}{AT}{label}", fix=fix)
    if found.label == CLEAN:
        return manifest
    return manifest.model_copy(
        update={"degradation": found.label, "short": f"{manifest.short}{AT}{found.label}"}
    )


def manifest_in(attributes: Mapping[str, Any], where: str) -> Manifest:
    """Return the manifest that a store's attributes hold, on the track that they name.

    Parameters
    ----------
    attributes : mapping
        Of the store.
    where : str
        The store's place, for messages.

    Raises
    ------
    ManifestError
        Where the manifest is damaged.
    StoreError
        If it was built from another manifest than the released one of that name, or on a track
        that this version does not know.
    """
    manifest = parse_manifest(attributes["manifest"].encode(), PurePath(where).name)
    drawn = seeded(manifest.name)
    released = unseen_manifest(*drawn).sha256 if drawn else released_sha256(manifest)
    if released not in (None, manifest.sha256):
        what = f"built from another manifest than {manifest.file_stem}, whose name it has"
        raise StoreError(what, where=where, fix="delete it and build it again")
    degradation = str(attributes.get("degradation", manifest.degradation))
    if degradation == manifest.degradation:
        return manifest
    try:
        return with_track(manifest, degradation)
    except DfdbenchError as error:
        what = f"the store is on a track that this version does not know: {degradation}"
        fix = "use the version of dfdbench that built it, or build it again"
        raise StoreError(what, where=where, fix=fix) from error
