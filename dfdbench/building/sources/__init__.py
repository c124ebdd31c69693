"""Where images and depth maps come from: a module a data set, one interface."""

from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path

from dfdbench.building.sources.interface import SceneError, SceneImages, Source
from dfdbench.datasets.manifest import FOLDER, Manifest
from dfdbench.errors import SourceError
from dfdbench.system.packages import offered_as
from dfdbench.tables.table import listed

__all__ = ["ENTRY_POINT_GROUP", "SceneError", "SceneImages", "Source", "is_made", "open_source"]

#: Where packages offer readers of their own, called with the manifest and the folder or None.
ENTRY_POINT_GROUP = "dfdbench.sources"
#: Where a reader is defined. One is imported to be used: all together need a second for that.
_MADE: Mapping[str, str] = {
    "demo": "demo:DemoScenes",
    "realworld-sim": "simulated_rig:SimulatedRig",
    "unseen": "rendered_rooms:Rooms",
}
_READ = {
    FOLDER: "folder:FolderScenes",
    "middlebury": "middlebury:MiddleburyScenes",
    "realworld": "realworld:RealworldFolder",
}
#: What the folder of a reader's files looks like.
_LAYOUTS = {
    FOLDER: "the files of its manifest",
    "middlebury": "Aloe/Illum1/Exp0/view1.png, or Aloe-2views.zip",
    "realworld": "k33/left/exp_30/image_141_30.00.png and k33/lidar/..., or raw captures as "
    "dfdbench rig simulate realworld writes them: docs/realworld.md",
}


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
    if is_made(manifest):
        if folder:
            raise SourceError(f"{manifest.short} is made, not read", fix="leave out --source")
        return _reader(_MADE[manifest.reader])(manifest)
    if manifest.reader not in _LAYOUTS:
        return _offered(manifest, folder)
    if folder is None:
        layout = manifest.files.patterns.values() if manifest.files else [_LAYOUTS[manifest.reader]]
        what = f"{manifest.short} is read from a folder, and none is named"
        command = "" if manifest.files else f"dfdbench build {manifest.short} "
        fix = f"name the folder: {command}--source DIR"
        raise SourceError(what, expected=listed(layout), fix=fix)
    given = pair if manifest.reader == "realworld" else checksums
    return _reader(_READ[manifest.reader])(manifest, folder, given)


def _reader(place: str) -> Callable[..., Source]:
    module, _, name = place.partition(":")
    reader: Callable[..., Source] = getattr(import_module(f"{__name__}.{module}"), name)
    return reader


def _offered(manifest: Manifest, folder: Path | None) -> Source:
    offered = offered_as(ENTRY_POINT_GROUP)
    if manifest.reader not in offered:
        known = ", ".join(sorted({*_MADE, *_LAYOUTS, *offered}))
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
