"""The folder for downloads and built data sets, and its contents."""

import contextlib
import os
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import platformdirs

from dfdbench.errors import InputError, Problem, StoreError, reason_of
from dfdbench.system.files import hold, is_address

DOWNLOADS = "downloads"
STORES = "stores"
#: What the cache holds, by the name of its folder.
KINDS = (DOWNLOADS, STORES)
_REMOVED = ".removed"


@dataclass(frozen=True)
class CacheEntry:
    """One entry of the cache.

    Parameters
    ----------
    kind : str
        ``"downloads"`` or ``"stores"``.
    name : str
        The data set's name, or the store's.
    files, size : int
        How many files it has, and their total bytes.
    path : Path
        Where it is.
    """

    kind: str
    name: str
    files: int
    size: int
    path: Path

    @property
    def stem(self) -> str:
        """Its name without what a build, or a removal that was interrupted, adds to it."""
        return self.name.removeprefix(".").partition(".zarr")[0]


def cache_folder(folder: Path | str | None = None) -> Path:
    """Return `folder` if given, else ``DFDBENCH_CACHE``, else the platform's cache folder.

    ``~`` is the home folder, even if no shell has expanded it.

    Raises
    ------
    InputError
        If it is a URL: downloads and builds go to this machine first; or if ``~`` leads nowhere.

    Examples
    --------
    >>> cache_folder("mine") == Path("mine")
    True
    """
    named = folder or os.environ.get("DFDBENCH_CACHE") or platformdirs.user_cache_dir("dfdbench")
    found = Path(os.path.expanduser(named))
    where = "--cache" if folder else "DFDBENCH_CACHE"
    if str(found).startswith("~"):
        what = f"there is no such home folder: {named}"
        raise InputError(what, where=where, fix="write the whole path")
    if is_address(found):
        fix = "name a folder; `dfdbench build NAME --store URL` builds a store elsewhere"
        what = f"the cache is no folder of this machine: {named}"
        raise InputError(what, where=where, fix=fix)
    return found


def cache_entries(folder: Path) -> tuple[CacheEntry, ...]:
    """Return the contents of a cache folder, by kind and name.

    An interrupted build leaves ``NAME.zarr.partial``, which the next one continues; an interrupted
    removal leaves ``.NAME.removed``.

    Raises
    ------
    InputError
        If it is something other than a folder.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError("the cache is no folder", where=str(folder), fix="--cache DIR")
    entries = []
    for kind in KINDS:
        place = folder / kind
        for path in sorted(place.iterdir()) if place.is_dir() else ():
            if path.is_dir():
                sizes = list(_sizes_in(path))
                entries.append(CacheEntry(kind, path.name, len(sizes), sum(sizes), path))
    return tuple(entries)


def _sizes_in(folder: Path) -> Iterator[int]:
    # A build or a removal may go on beside this: what it takes away is passed over, and so is what
    # cannot be read, as os.walk does with folders.
    for place, _, names in os.walk(folder):
        for name in names:
            with contextlib.suppress(OSError):
                yield os.stat(os.path.join(place, name)).st_size


def remove_entries(entries: tuple[CacheEntry, ...]) -> None:
    """Remove entries that `cache_entries` found.

    Raises
    ------
    StoreError
        If a build is writing some, or some cannot be removed; the others are removed.
    """
    problems: list[Problem] = []
    for entry in entries:
        store = entry.path.with_name(f"{entry.stem}.zarr")
        fix = "wait for it; all others are removed"
        taken = StoreError("a build is writing this store", where=str(store), fix=fix)
        try:
            with hold(store.with_name(f".{store.name}.lock"), taken):
                _remove(entry.path)
        except StoreError as error:
            problems += error.problems
        except OSError as error:
            problems.append(Problem(f"cannot remove it: {reason_of(error)}", where=str(entry.path)))
    # A store and what is written beside it have one lock.
    StoreError.raise_if(dict.fromkeys(problems))


def _remove(path: Path) -> None:
    if path.is_symlink():
        path.unlink()  # what it leads to is not the cache's
        return
    # What a stopped removal leaves must not lie where a store is looked for.
    gone = path
    if path.suffix != _REMOVED:
        gone = path.with_name(f".{path.name}{_REMOVED}")
        shutil.rmtree(gone, ignore_errors=True)
        path.rename(gone)
    shutil.rmtree(gone)
