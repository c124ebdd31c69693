"""Let one process at a time write a folder, and say why the disk refuses it."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

import filelock

from dfdbench.errors import DfdbenchError, ResultError, reason_of, room_or


@contextlib.contextmanager
def hold(path: Path, taken: DfdbenchError) -> Iterator[None]:
    """Lock a file while the block runs; raise `taken` if another process has it locked.

    The lock ends with its process, and the file is removed with it.
    """
    # Absolute: the block may change the working directory.
    place = os.path.abspath(path)
    lock = filelock.FileLock(place, timeout=0)
    try:
        lock.acquire()
    except filelock.Timeout as error:
        raise taken from error
    try:
        yield
    finally:
        # Before the lock ends: afterwards the name may be another's. Whoever opened the file before
        # finds it without a name and tries again. Windows removes no open file.
        with contextlib.suppress(OSError):
            os.unlink(place)
        lock.release()


@contextlib.contextmanager
def writing_folder(folder: Path, what: str) -> Iterator[None]:
    """Lock an output folder for one writer, and turn OSErrors into ResultErrors.

    Parameters
    ----------
    folder : Path
        What is written; the lock is beside it.
    what : str
        What it is the folder of, as in "cannot write the run".

    Raises
    ------
    ResultError
        If another process is writing it, or it cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as place, writing_folder(Path(place) / "a", "run"):
    ...     (Path(place) / "a").mkdir()
    """
    fix = "wait for it, or choose another with --out DIR"
    taken = ResultError(f"another {what} is writing this folder", where=str(folder), fix=fix)
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with hold(folder.with_name(f".{folder.name}.lock"), taken):
            yield
    except OSError as error:
        fix = room_or("choose another place with --out DIR", error)
        raise ResultError(
            f"cannot write the {what}",
            where=str(folder),
            got=reason_of(error),
            fix=f"{fix}; the same command goes on where it stopped",
        ) from error
