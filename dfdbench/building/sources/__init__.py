"""Where images and depth maps come from: a module a data set, one interface."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from dfdbench.building.sources.demo import DemoScenes
from dfdbench.building.sources.folder import FolderScenes
from dfdbench.building.sources.interface import SceneError, SceneImages, Source
from dfdbench.building.sources.middlebury import MiddleburyScenes
from dfdbench.building.sources.middlebury_download import Download, download_middlebury
from dfdbench.building.sources.realworld import RealworldFolder
from dfdbench.building.sources.rooms import Rooms
from dfdbench.building.sources.simulated_rig import SimulatedRig
from dfdbench.datasets.manifest import FOLDER, Manifest
from dfdbench.errors import SourceError
from dfdbench.system.packages import offered_as

__all__ = [
    "ENTRY_POINT_GROUP",
    "Download",
    "SceneError",
    "SceneImages",
    "Source",
    "download_middlebury",
    "is_made",
    "open_source",
]

#: Where packages offer readers of their own, called with the manifest and the folder or None.
ENTRY_POINT_GROUP = "dfdbench.sources"
_MADE: Mapping[str, Callable[[Manifest], Source]] = {
    "demo": DemoScenes,
    "realworld-sim": SimulatedRig,
    "unseen": Rooms,
}
_BUILT_IN = (*_MADE, FOLDER, "middlebury", "realworld")


def is_made(manifest: Manifest) -> bool:
    """Return whether a data set is made by the package itself, of no files."""
    return manifest.reader in _MADE


def open_source(
    manifest: Manifest,
    folder: Path | None = None,
    checksums: Mapping[str, str] | None = None,
    pair: tuple[int, int] | None = None,
) -> Source:
    """Return the source that a manifest names as its `reader`.

    A package offers a reader in the entry-point group ``dfdbench.sources``: a callable that is
    given the manifest and the folder, or None, and returns a `Source`.

    Parameters
    ----------
    manifest : Manifest
        The data set.
    folder : Path, optional
        Where its files lie, for a data set that is read from disk.
    checksums : mapping of str to str, optional
        See `MiddleburyScenes`.
    pair : tuple of int, optional
        Two voltage steps; see `RealworldFolder`.

    Raises
    ------
    SourceError
        Where the data set needs a folder, takes none, or cannot be built by this version.
    """
    if pair and manifest.reader != "realworld":
        raise SourceError(f"{manifest.short} has no voltage steps", where="--pair")
    if manifest.reader == "realworld":
        if folder is None:
            raise SourceError(
                f"{manifest.short} is read from a folder, and none is named",
                expected="k33/left/exp_30/image_141_30.00.png and k33/lidar/..., or raw "
                "captures: docs/realworld.md",
                fix=f"dfdbench build {manifest.short} --source DIR; to see the layout: "
                "dfdbench rig simulate realworld --out DIR --scenes k00-k07",
            )
        return RealworldFolder(manifest, folder, pair)
    if manifest.reader == FOLDER:
        if folder is None:
            raise SourceError(
                f"{manifest.short} is read from a folder, and none is named",
                expected=", ".join(manifest.files.patterns.values()) if manifest.files else "",
                fix="name the folder: --source DIR",
            )
        return FolderScenes(manifest, folder, checksums)
    if is_made(manifest):
        if folder:
            raise SourceError(f"{manifest.short} is made, not read", fix="leave out --source")
        return _MADE[manifest.reader](manifest)
    if manifest.reader == "middlebury":
        if folder is None:
            raise SourceError(f"{manifest.short} is read from a folder: name one")
        return MiddleburyScenes(manifest, folder, checksums)
    return _offered(manifest, folder)


def _offered(manifest: Manifest, folder: Path | None) -> Source:
    offered = offered_as(ENTRY_POINT_GROUP)
    if manifest.reader not in offered:
        known = ", ".join(sorted({*_BUILT_IN, *offered}))
        what = f"no reader {manifest.reader} for the files of {manifest.stem}; there are {known}"
        raise SourceError(what)
    point = offered[manifest.reader]
    try:
        reader = point.load()
    except (Exception, SystemExit) as error:
        where = f"{ENTRY_POINT_GROUP}: {point.name} = {point.value}"
        got = str(error) or type(error).__name__
        raise SourceError("the reader cannot be imported", where=where, got=got) from error
    source: Source = reader(manifest, folder)
    return source
