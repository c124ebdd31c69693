"""Find a manifest by the name that a user types."""

from __future__ import annotations

from functools import cache
from importlib import resources
from pathlib import Path

from dfdbench.datasets.manifest import Manifest
from dfdbench.datasets.manifest_file import parse_manifest, read_manifest, released_sha256
from dfdbench.datasets.rendered import FAMILIES, seeded, unseen_manifest
from dfdbench.datasets.tracked import part_name, with_track
from dfdbench.errors import InputError, ManifestError, UnknownNameError, unknown_name


@cache
def released_manifests() -> tuple[Manifest, ...]:
    """Return every manifest that travels with the package, sorted by name and version.

    Examples
    --------
    >>> [manifest.stem for manifest in released_manifests()]
    ['demo-1', 'dfd-indoor-1', 'dfd-outdoor-1', 'middlebury-default-1', 'middlebury-third-1', \
'realworld-1', 'realworld-sim-1', 'realworld-synthetic-1', 'unseen-0-1', 'unseen-stack-0-1', \
'zedd-1', 'zedd-test-1']
    """
    folder = resources.files("dfdbench.manifests")
    files = [entry for entry in folder.iterdir() if entry.name.endswith(".toml")]
    manifests = [parse_manifest(entry.read_bytes(), entry.name) for entry in files]
    manifests += [unseen_manifest(family, 0) for family in FAMILIES]
    return tuple(sorted(manifests, key=lambda manifest: (manifest.name, manifest.version)))


def find_manifest(name: str) -> Manifest:
    """Return the manifest with this name.

    Parameters
    ----------
    name : str
        A short name (``"middlebury"``), a full one (``"middlebury-third"``), one with its
        version (``"middlebury-third-1"``), or the path of a TOML file of one's own; with
        ``@TRACK-SEVERITY`` behind it, the data set on that track. ``unseen-7`` is the rendered set
        of seed 7.

    Raises
    ------
    UnknownNameError
        Where there is no such manifest, track or severity; near misses are named.
    ManifestError
        Where the file named is not a right manifest, or an edited released one.
    InputError
        Where a track is named of a set whose defocus images are captured.

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
        raise UnknownNameError(what)
    found = _find(base)
    return with_track(found, label) if base != name else found


def of_seed(name: str, seed: int | str | None) -> str:
    """Return the name of the rendered set of a seed; the name itself without one.

    Raises
    ------
    InputError
        If it is no seed, or the set is not drawn from one.

    Examples
    --------
    >>> of_seed("unseen", 7), of_seed("demo", None)
    ('unseen-7', 'demo')
    """
    if seed is None:
        return name
    if name not in FAMILIES:
        fix = f"leave out the seed, or name {' or '.join(FAMILIES)}"
        raise InputError("the data set is not drawn from a seed", where=name, fix=fix)
    if seeded(f"{name}-{seed}") is None:
        expected = "a whole number from 0 on, of at most 18 digits"
        raise InputError("not a seed", where="seed", expected=expected, got=str(seed))
    return f"{name}-{seed}"


def _find(name: str) -> Manifest:
    if name.endswith(".toml"):
        manifest = read_manifest(Path(name))
        if released_sha256(manifest) not in (None, manifest.sha256):
            what = f"the name of the released {manifest.file_stem}, and other content"
            raise ManifestError(what, where=name, fix="give it another name or version")
        return manifest
    if (drawn := seeded(name)) is not None:
        return unseen_manifest(*drawn)
    manifests = released_manifests()
    by_name: dict[str, Manifest] = {}
    for manifest in manifests:
        for key in (manifest.short, manifest.name, manifest.stem):
            by_name[key] = manifest
    if name not in by_name:
        fix = "`dfdbench list` shows them; one of your own is named by its manifest, NAME.toml"
        raise unknown_name("data set", name, by_name, fix)
    return by_name[name]
