"""A place that holds a data set: a local folder, or the URL of an object store."""

import contextlib
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import zarr.abc.store
import zarr.storage
from upath import UPath
from zarr.abc.buffer import Buffer, BufferPrototype
from zarr.abc.store import ByteRequest

from dfdbench.errors import InputError, reason_of
from dfdbench.system.files import require_file

#: The types that a place may be given as.
Place = str | Path | UPath

#: How zarr names an array's chunks: in one folder, where the default has a folder level per axis.
CHUNK_KEYS: dict[str, Any] = {"name": "default", "configuration": {"separator": "."}}

_LOCAL = ("", "file", "local")


def as_location(place: Place) -> UPath:
    """Return a place as a path that fsspec can reach.

    Parameters
    ----------
    place : str, Path or UPath
        A local path, or a URL such as ``s3://bucket/folder/demo.zarr``.

    Raises
    ------
    InputError
        If no installed library handles this kind of place, or the host does not answer.

    Examples
    --------
    >>> as_location("memory://folder/demo.zarr").name
    'demo.zarr'
    >>> is_local(as_location("folder/demo.zarr"))
    True
    """
    try:
        location = UPath(place)
        _ = location.fs
    except (ImportError, ValueError, TypeError, AttributeError) as error:
        # TypeError and AttributeError: kinds such as reference:// that need more than a URL.
        fix = "install what fsspec needs for it; for s3:// that is dfdbench[s3]"
        what = "cannot reach places of this kind"
        raise InputError(what, where=str(place), got=str(error), fix=fix) from error
    except OSError as error:
        # Some libraries connect immediately.
        what = f"cannot reach the host: {reason_of(error)}"
        raise InputError(what, where=str(place), fix="check the URL and the network") from error
    if location.protocol in _LOCAL:
        return UPath(location.path)
    if not location.name:
        what = "the URL names no folder"
        raise InputError(what, where=str(place), expected="such as s3://bucket/demo.zarr")
    return location


def is_local(location: UPath) -> bool:
    """Return whether a place is on a file system of this machine."""
    return location.protocol in _LOCAL


class _RegularFiles(zarr.storage.LocalStore):
    """A local store that refuses a pipe or a device in place of a file: reading may never end."""

    async def get(
        self,
        key: str,
        prototype: BufferPrototype | None = None,
        byte_range: ByteRequest | None = None,
    ) -> Buffer | None:
        """Return what lies under a key, None where there is no file."""
        with contextlib.suppress(FileNotFoundError, NotADirectoryError, IsADirectoryError):
            require_file(self.root / key)
        return await super().get(key, prototype, byte_range)


def zarr_store(location: UPath) -> zarr.abc.store.Store:
    """Return the store object through which zarr reads and writes a place."""
    if is_local(location):
        return _RegularFiles(Path(location.path))
    # Do not cache listings: another process may have written since this one last looked.
    options = {**location.storage_options, "use_listings_cache": False}
    return zarr.storage.FsspecStore.from_url(str(location), storage_options=options)


def exists(location: UPath) -> bool:
    """Return whether a file or a folder exists at a place now."""
    location.fs.invalidate_cache()
    return location.exists()


def folders_in(location: UPath) -> tuple[str, ...]:
    """Return the names of the folders at a place, sorted."""
    location.fs.invalidate_cache()
    return tuple(sorted(place.name for place in location.iterdir() if place.is_dir()))


def size_of(location: UPath) -> int:
    """Return the total bytes of all files below a place, as far as their sizes are known."""
    location.fs.invalidate_cache()
    found = location.fs.find(location.path, detail=True).values()
    return sum(item["size"] or 0 for item in found)


def remove(location: UPath) -> None:
    """Remove a folder and everything in it, if it exists."""
    if is_local(location):
        shutil.rmtree(location.path, ignore_errors=True)
    elif exists(location):
        location.fs.rm(location.path, recursive=True)


def write_folder(folder: UPath, files: Mapping[str, bytes], last: str) -> None:
    """Write files below a folder, given by relative path, the file `last` after all others.

    Parameters
    ----------
    folder : UPath
        Created if missing.
    files : mapping of str to bytes
        Their contents.
    last : str
        The file without which the folder counts as incomplete.
    """
    for names in ([name for name in files if name != last], [last]):
        if not is_local(folder):
            root = folder.path.rstrip("/")
            folder.fs.pipe({f"{root}/{name}": files[name] for name in names})
            continue
        for path, name in ((Path(folder.path) / name, name) for name in names):
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(files[name])


def copy_folder(source: UPath, target: UPath, last: str = "") -> None:
    """Copy a folder's files; the file `last`, directly in it, after all others.

    Parameters
    ----------
    source, target : UPath
        Folders on the same file system.
    last : str
        The file without which the copy counts as incomplete.
    """
    if is_local(source):
        shutil.copytree(source.path, target.path, dirs_exist_ok=True)
        return
    source.fs.invalidate_cache()
    root = source.path.rstrip("/")
    names = [path[path.index(root) + len(root) :] for path in source.fs.find(source.path)]
    early = [name for name in names if name != f"/{last}"]
    for chosen in (early, [name for name in names if name not in early]):
        if chosen:
            source.fs.copy(
                [root + name for name in chosen],
                [target.path.rstrip("/") + name for name in chosen],
            )


def move_folder(source: UPath, target: UPath, last: str) -> None:
    """Move a folder over another; a reader sees the old one, none, or the new one.

    A local folder is renamed. Object stores cannot rename: the old folder's file `last` is removed
    first and the new one's is written last, and a folder without this file counts as incomplete.
    """
    if is_local(source):
        old = target.with_name(target.name + ".old")
        remove(old)
        if exists(target):
            Path(target.path).rename(old.path)
        Path(source.path).rename(target.path)
        remove(old)
        return
    if exists(target / last):
        (target / last).unlink()
    remove(target)
    copy_folder(source, target, last)
    remove(source)
