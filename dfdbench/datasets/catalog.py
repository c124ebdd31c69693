"""Find a manifest by the name that a user types."""

import hashlib
import os
import re
from collections.abc import Mapping
from functools import cache
from pathlib import Path, PurePath
from typing import Any

from pydantic import BaseModel

from dfdbench import errors
from dfdbench.blur.tracks import CLEAN, find_degradation
from dfdbench.datasets.manifest import Manifest
from dfdbench.datasets.manifest_file import parse_manifest, read_manifest
from dfdbench.datasets.rendered import FAMILIES, seeded, unseen_manifest, unseen_text
from dfdbench.system.cache import STORES, cache_folder
from dfdbench.system.files import shipped
from dfdbench.system.text import parse_toml

#: What separates a data set's name from its track's.
AT = "@"
_NAME = re.compile(rf"(?P<base>.+){AT}(?P<label>[^{AT}/\\]*)")
_FILES = (".toml", ".zarr")


def part_name(name: str) -> tuple[str, str]:
    """Split a name into data set and track with severity; the latter is empty if there is none.

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
    """Return a data set on a track: the same but for its images and its name.

    Parameters
    ----------
    manifest : Manifest
        The data set, without a track.
    label : str
        ``TRACK-SEVERITY``; severity 0 is the data set itself.

    Raises
    ------
    UnknownNameError
        If there is no such track or severity; near misses are named.
    InputError
        If the data set's defocus images are captured.

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
        raise errors.UnknownNameError(what, fix=fix)
    found = find_degradation(label)
    if manifest.recipe is None:
        what = f"{manifest.short} has no tracks: a track makes defocus images"
        fix = f"leave out {AT}{label}, or name a synthetic set: `dfdbench list`"
        where = f"{manifest.short}{AT}{label}"
        raise errors.InputError(f"{what}, and these are captured", where=where, fix=fix)
    if found.label == CLEAN:
        return manifest
    return manifest.model_copy(
        update={"degradation": found.label, "short": f"{manifest.short}{AT}{found.label}"}
    )


def manifest_in(attributes: Mapping[str, Any], where: str) -> Manifest:
    """Return the manifest in a store's attributes, on the track that they name.

    Parameters
    ----------
    attributes : mapping
        Of the store.
    where : str
        The store's place, for messages.

    Raises
    ------
    ManifestError
        If the manifest is damaged.
    StoreError
        If it was built from a manifest that differs from the released one of that name, or on a
        track that this version does not know.
    """
    manifest = parse_manifest(attributes["manifest"].encode(), PurePath(where).name)
    if _released_sha256(manifest) not in (None, manifest.written_sha256):
        what = f"built from another manifest than {manifest.file_stem}, whose name it has"
        raise errors.StoreError(what, where=where, fix="delete it and build it again")
    degradation = str(attributes.get("degradation", manifest.degradation))
    if degradation == manifest.degradation:
        return manifest
    try:
        return with_track(manifest, degradation)
    except errors.DfdbenchError as error:
        what = f"the store is on a track that this version does not know: {degradation}"
        fix = "use the version of dfdbench that built it, or build it again"
        raise errors.StoreError(what, where=where, fix=fix) from error


class Heading(BaseModel, frozen=True):
    """The top of a released manifest, above its sections; fields as in `Manifest`."""

    name: str
    short: str
    version: int
    title: str
    scene_count: int
    pair_count: int
    recipe: str | None = None

    @property
    def stem(self) -> str:
        """Name and version."""
        return f"{self.name}-{self.version}"

    @property
    def names(self) -> tuple[str, ...]:
        """The names by which a user may call it."""
        return self.short, self.name, self.stem


@cache
def released_headings() -> tuple[Heading, ...]:
    """Return the heading of every manifest that the package ships, sorted.

    Parsing the manifests completely would take as long as importing numpy.

    Examples
    --------
    >>> [heading.short for heading in released_headings()][:3]
    ['demo', 'dfd-indoor', 'dfd-outdoor']
    """
    files = shipped("manifests").glob("*.toml")
    texts = [*(entry.read_text("utf-8") for entry in files), *(unseen_text(f, 0) for f in FAMILIES)]
    headings = (Heading.model_validate(parse_toml(text.partition("\n[")[0])) for text in texts)
    return tuple(sorted(headings, key=lambda heading: (heading.name, heading.version)))


def released_manifests() -> tuple[Manifest, ...]:
    """Return every manifest that the package ships, sorted by name and version.

    Examples
    --------
    >>> [manifest.stem for manifest in released_manifests()]
    ['demo-1', 'dfd-indoor-1', 'dfd-outdoor-1', 'idfd-1', 'middlebury-default-1', \
'middlebury-third-1', 'realworld-1', 'realworld-sim-1', 'realworld-synthetic-1', 'unseen-0-1', \
'unseen-stack-0-1', 'zedd-1', 'zedd-test-1']
    """
    return tuple(_released(heading.stem) for heading in released_headings())


@cache
def _released(stem: str) -> Manifest:
    if (drawn := seeded(stem)) is not None:
        return unseen_manifest(*drawn)
    file = shipped("manifests") / f"{stem}.toml"
    return parse_manifest(file.read_bytes(), file.name)


def find_manifest(name: str) -> Manifest:
    """Return the manifest with this name.

    Parameters
    ----------
    name : str
        A short name (``"middlebury"``), a full one (``"middlebury-third"``), one with its version
        (``"middlebury-third-1"``), or the path of your own TOML file. With ``@TRACK-SEVERITY``
        appended, it is the data set on that track. ``unseen-7`` is the rendered set of seed 7.

    Raises
    ------
    UnknownNameError
        If there is no such manifest, track or severity; near misses are named.
    ManifestError
        If the file is not a valid manifest, or is an edited released one.
    InputError
        If a track is named for a set whose defocus images are captured.

    Examples
    --------
    >>> find_manifest("middlebury").stem
    'middlebury-third-1'
    >>> find_manifest("demo@camera-2").stem
    'demo-1@camera-2'
    """
    base, label = part_name(name)
    own, other = part_name(base)
    if other and label:
        what = f"unknown data set {name}: it is on one track at a time, as {base} or {own}@{label}"
        raise errors.UnknownNameError(what)
    found = _find(base)
    return with_track(found, label) if base != name else found


def of_seed(name: str, seed: int | str | None) -> str:
    """Return the name of the rendered set of a seed; without a seed, the name itself.

    Raises
    ------
    InputError
        If the seed is invalid, or the set is not drawn from a seed.

    Examples
    --------
    >>> of_seed("unseen", 7), of_seed("demo", None)
    ('unseen-7', 'demo')
    """
    if seed is None:
        return name
    if name not in FAMILIES:
        what = "the name has a seed" if seeded(name) else "the data set is not drawn from a seed"
        fix = f"leave out the seed, or name {' or '.join(FAMILIES)}"
        raise errors.InputError(what, where=name, fix=fix)
    if seeded(f"{name}-{seed}") is None:
        expected = "a whole number from 0 on, of at most 18 digits"
        raise errors.InputError("not a seed", where="seed", expected=expected, got=str(seed))
    return f"{name}-{seed}"


def _find(name: str) -> Manifest:
    if name.endswith(".toml"):
        manifest = read_manifest(Path(name))
        if _released_sha256(manifest) not in (None, manifest.sha256):
            what = f"the name of the released {manifest.file_stem}, and other content"
            raise errors.ManifestError(what, where=name, fix="give it another name or version")
        return manifest
    by_name = {known: heading.stem for heading in released_headings() for known in heading.names}
    if name not in by_name and seeded(name) is None:
        fix = "`dfdbench list` shows them; one of your own is named by its manifest, NAME.toml"
        raise errors.unknown_name("data set", name, by_name, fix)
    return _released(by_name.get(name, name))


def _released_sha256(manifest: Manifest) -> str | None:
    if (drawn := seeded(manifest.name)) is not None:
        return unseen_manifest(*drawn).sha256
    # Not from `released_manifests`: every worker opens stores, and parsing them all takes long.
    file = shipped("manifests") / f"{manifest.file_stem}.toml"
    return hashlib.sha256(file.read_bytes()).hexdigest() if file.is_file() else None


def default_store(manifest: Heading | Manifest, cache: Path | str | None = None) -> Path:
    """Return the default place of the built data set."""
    return cache_folder(cache) / STORES / f"{manifest.stem}.zarr"


def is_place(name: str) -> bool:
    """Return whether a text is a store's path or URL rather than a data set's name.

    Examples
    --------
    >>> is_place("demo"), is_place("demo-1.zarr"), is_place("s3://bucket/demo")
    (False, True, True)
    """
    base, _ = part_name(name)
    return (base.endswith(".zarr") or os.sep in base) and not base.endswith(".toml")


def own_stores(cache: Path | str | None = None) -> dict[str, Path]:
    """Return the user's own sets that are built in the cache, by name.

    Each has two names, as released sets have: ``NAME-VERSION``, and ``NAME`` for the newest
    version. The names of released sets are left out.
    """
    taken = {name for known in released_headings() for name in known.names}
    found: dict[str, Path] = {}
    newest: dict[str, int] = {}
    for path in sorted((cache_folder(cache) / STORES).glob("*.zarr")):
        stem, label = part_name(path.stem)
        if stem in taken:
            continue
        found[path.stem] = path
        base, _, version = stem.rpartition("-")
        name = f"{base}@{label}" if label else base
        if base not in taken and version.isdecimal() and int(version) > newest.get(name, -1):
            newest[name] = int(version)
            found[name] = path
    return found


def place_of(name: str, cache: Path | str | None = None) -> str | Path | None:
    """Return the store that a text names: by its place, or by the name of a user's own set.

    Return None for any other name, which belongs to a released set, a manifest or nothing.
    """
    return name if is_place(name) else own_stores(cache).get(name)
