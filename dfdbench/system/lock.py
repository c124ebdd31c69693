"""Hold a place so that no other process writes there, on disk or in an object store."""

from __future__ import annotations

import contextlib
import errno
import json
import os
import socket
import threading
import time
import uuid
from collections.abc import Callable, Iterator
from typing import Any

import filelock
from upath import UPath

from dfdbench.errors import DfdbenchError
from dfdbench.system.json_text import parse_json
from dfdbench.system.location import exists, is_local

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

#: Seconds after which a lease that nobody renews has ended.
LEASE = 60.0

#: Raises if the place is no longer ours.
Check = Callable[[], None]


@contextlib.contextmanager
def hold(location: UPath, taken: DfdbenchError, lease: float = LEASE) -> Iterator[Check]:
    """Hold a place while the block runs; give it free at its end, however it ends.

    On disk this is a file lock, which ends with its process, and whose file goes with the work.
    Object stores have none: there an object is created that must not exist yet, and renewed while
    it is held. One that its holder left behind is taken over when its lease has ended, or at once
    where the holder was a process of this machine that is no more.

    Parameters
    ----------
    location : UPath
        The lock's own file, beside what it guards.
    taken : DfdbenchError
        Raised where another process holds the place.
    lease : float
        Seconds for which an object in an object store holds without being renewed.

    Yields
    ------
    callable
        Raises `taken` if the place was lost to another process.
    """
    if is_local(location):
        # Absolute: the block may change the working directory.
        with _locked_file(os.path.abspath(location.path), taken):
            yield lambda: None
        return
    with _leased(location, taken, lease) as check:
        yield check


@contextlib.contextmanager
def _locked_file(path: str, taken: DfdbenchError) -> Iterator[None]:
    try:
        handle = _lock(path, taken)
    except OSError as error:
        if error.errno != errno.ENOSYS:
            raise
        with _locked_without_flock(path, taken):
            yield
        return
    try:
        yield
    finally:
        # First the file, then the lock: who waits with the old file open sees that it is gone.
        # Afterwards the name may be another's.
        with contextlib.suppress(FileNotFoundError):
            os.unlink(path)
        fcntl.flock(handle, fcntl.LOCK_UN)
        os.close(handle)


def _lock(path: str, taken: DfdbenchError) -> int:
    if fcntl is None:
        raise OSError(errno.ENOSYS, os.strerror(errno.ENOSYS), path)
    while True:
        handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o644)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            # Between opening and locking, its holder may have ended and removed the file: a lock
            # on what has no name any more holds off nobody.
            with contextlib.suppress(FileNotFoundError):
                if os.path.samestat(os.fstat(handle), os.stat(path)):
                    return handle
        except BlockingIOError as error:
            os.close(handle)
            raise taken from error
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)


@contextlib.contextmanager
def _locked_without_flock(path: str, taken: DfdbenchError) -> Iterator[None]:
    # Windows, and network file systems without locks.
    try:
        with filelock.FileLock(path, timeout=0):
            yield
    except filelock.Timeout as error:
        raise taken from error


@contextlib.contextmanager
def _leased(location: UPath, taken: DfdbenchError, lease: float) -> Iterator[Check]:
    owner = uuid.uuid4().hex
    _acquire(location, owner, taken, lease)
    stop = threading.Event()

    def check() -> None:
        if _content(location).get("owner") != owner:
            raise taken

    def renew() -> None:
        while not stop.wait(lease / 4):
            # A renewal that fails is tried again; check() tells if the lease was lost.
            with contextlib.suppress(Exception):
                check()
                location.fs.pipe_file(location.path, _lease(owner))

    keeper = threading.Thread(target=renew, daemon=True)
    keeper.start()
    try:
        yield check
    finally:
        stop.set()
        keeper.join()
        if _content(location).get("owner") == owner:
            location.fs.rm_file(location.path)


def _acquire(location: UPath, owner: str, taken: DfdbenchError, lease: float) -> None:
    for _ in range(2):
        try:
            location.fs.pipe_file(location.path, _lease(owner), mode="create")
            return
        except FileExistsError as error:
            if _is_held(_content(location), lease):
                raise taken from error
            if exists(location):
                location.fs.rm_file(location.path)
    raise taken


def _is_held(content: dict[str, Any], lease: float) -> bool:
    if not content:
        return False
    if content["host"] == socket.gethostname() and os.name == "posix":
        return _is_running(content["process"])
    return bool(time.time() - content["renewed"] < lease)


def _is_running(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True


def _lease(owner: str) -> bytes:
    content = {
        "owner": owner,
        "host": socket.gethostname(),
        "process": os.getpid(),
        "renewed": time.time(),
    }
    return json.dumps(content).encode()


def _content(location: UPath) -> dict[str, Any]:
    location.fs.invalidate_cache()
    try:
        content = parse_json(location.fs.cat_file(location.path))
    except (FileNotFoundError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}
