"""Take the sight of the disk from a process, where Linux lets an ordinary user: Landlock."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

# https://docs.kernel.org/userspace-api/landlock.html; the numbers are the same on all processors.
_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446
_BENEATH = 1
_READ_FILE, _READ_FOLDER = 1 << 2, 1 << 3
_NO_NEW_PRIVILEGES = 38
#: What every process needs of its own: as it sees it, so that it is opened there.
_OWN = (
    "/proc/self",
    "/proc/cpuinfo",
    "/proc/driver",
    "/proc/filesystems",
    "/proc/meminfo",
    "/proc/stat",
    "/proc/sys",
    "/proc/version",
)


class _Ruleset(ctypes.Structure):
    _fields_ = (("handled", ctypes.c_uint64),)


class _Beneath(ctypes.Structure):
    _pack_ = 1
    _fields_ = (("allowed", ctypes.c_uint64), ("folder", ctypes.c_int32))


def read_only_from(read: Iterable[str], listed: Iterable[str] = ()) -> bool:
    """Let this process, and those that it starts, read nothing any more but some places.

    It cannot be undone. What is open stays open; writing is not restricted. Threads that run
    already are not held to it, so it is called before any is started.

    Parameters
    ----------
    read : iterable of str
        Files, and folders with all that is in them; what is not there is left out.
    listed : iterable of str
        Folders whose files' names may be read, theirs and those of the folders in them.

    Returns
    -------
    bool
        False where the system cannot do it: nothing is restricted then.
    """
    if sys.platform != "linux":
        return False
    libc = ctypes.CDLL(None, use_errno=True)
    libc.syscall.restype = ctypes.c_long
    given = _Ruleset(_READ_FILE | _READ_FOLDER)
    size = ctypes.c_size_t(ctypes.sizeof(given))
    rules = libc.syscall(_CREATE_RULESET, ctypes.byref(given), size, 0)
    if rules < 0:
        return False
    try:
        for place in (*read, *_OWN):
            _allow(libc, rules, place, _READ_FILE | _READ_FOLDER)
        for place in listed:
            _allow(libc, rules, place, _READ_FOLDER)
        if libc.prctl(_NO_NEW_PRIVILEGES, 1, 0, 0, 0):
            return False
        return not libc.syscall(_RESTRICT_SELF, rules, 0)
    finally:
        os.close(rules)


def _allow(libc: ctypes.CDLL, rules: int, place: str, access: int) -> None:
    try:
        opened = os.open(place, os.O_PATH | os.O_CLOEXEC)
    except OSError:
        return
    try:
        # Of a file there is nothing to list.
        allowed = access if os.path.isdir(place) else access & _READ_FILE
        rule = _Beneath(allowed, opened)
        libc.syscall(_ADD_RULE, rules, _BENEATH, ctypes.byref(rule), 0)
    finally:
        os.close(opened)


def without(places: Iterable[Path], hidden: Sequence[Path]) -> tuple[list[str], list[str]]:
    """Return what may be read below some places so that others stay hidden.

    Parameters
    ----------
    places : iterable of Path
        Files and folders that may be read.
    hidden : sequence of Path
        Files and folders that may not. A folder that holds one is taken apart.

    Returns
    -------
    read, listed : list of str
        As `read_only_from` takes them: files and folders whole, and the folders taken apart, in
        which an import has to look for names.
    """
    unseen = [place.resolve() for place in hidden]
    read: list[str] = []
    listed: list[str] = []
    for place in dict.fromkeys(place.resolve() for place in places):
        for part, whole in _parts(place, unseen):
            (read if whole else listed).append(str(part))
    return read, listed


def _parts(place: Path, hidden: Sequence[Path]) -> Iterator[tuple[Path, bool]]:
    if any(place.is_relative_to(other) for other in hidden):
        return
    if not any(other.is_relative_to(place) for other in hidden):
        yield place, True
        return
    yield place, False
    try:
        inside = sorted(place.iterdir())
    except OSError:
        return
    for part in inside:
        # A link leads wherever it likes, into what is hidden too.
        if not part.is_symlink():
            yield from _parts(part, hidden)
