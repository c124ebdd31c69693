"""Write files whole or not at all, and lock a folder for one writer."""

import contextlib
import errno
import os
import re
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path

from dfdbench.errors import DfdbenchError, ResultError, reason_of, room_or

#: The largest file that is text: results, lists, configurations. Results have some 30 KB.
LARGEST_TEXT = 64 * 2**20
#: The largest file of numbers that is read at once: an image, the ranges of a laser scanner.
LARGEST_ARRAY = 2**30
_UNFINISHED = ".unfinished"
# What travels with the package lies beside its code; in a clone, in these folders of the root.
_IN_A_CLONE = {"manifests": "manifests", "rows": "leaderboard"}


def shipped(name: str) -> Path:
    """Return the folder of data files that travels with the package, installed or in a clone.

    Examples
    --------
    >>> (shipped("manifests") / "demo-1.toml").is_file()
    True
    """
    code = Path(__file__).parents[1]
    beside = code / name
    return beside if beside.is_dir() else code.parent / _IN_A_CLONE[name]


def is_address(place: str | Path) -> bool:
    """Return whether a text is a URL, even if a Path has swallowed one of its slashes.

    Examples
    --------
    >>> is_address(Path("s3://bucket/folder")), is_address("results/s3")
    (True, False)
    """
    return bool(re.match(r"[A-Za-z][A-Za-z0-9+.-]+:/", str(place)))


def require_file(path: Path) -> None:
    """Do nothing where a path names a file: opening a pipe may never end, nor reading a device.

    Raises
    ------
    OSError
        Where it names none; `strerror` says what it is.

    Examples
    --------
    >>> require_file(Path("/dev/zero"))
    Traceback (most recent call last):
    OSError: [Errno 22] not a regular file: '/dev/zero'
    """
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not stat.S_ISREG(path.stat().st_mode):
        raise OSError(errno.EINVAL, "not a regular file", str(path))


def read_whole(path: Path, largest: int = LARGEST_TEXT) -> bytes:
    """Return what a file holds, provided that it is one and holds no more than a bound.

    Parameters
    ----------
    path : Path
        The file; a link to one is followed.
    largest : int
        In bytes.

    Raises
    ------
    OSError
        Where it cannot be read, is no regular file or is larger; `strerror` says which.

    Examples
    --------
    >>> read_whole(Path("/dev/zero"))
    Traceback (most recent call last):
    OSError: [Errno 22] not a regular file: '/dev/zero'
    """
    require_file(path)
    with path.open("rb") as file:
        # Not read(largest + 1), which takes that much memory before the first byte is read.
        if os.fstat(file.fileno()).st_size > largest:
            raise OSError(errno.EFBIG, f"larger than {largest / 2**20:g} MB", str(path))
        return file.read()


def read_as(
    kind: type[DfdbenchError], path: Path, what: str, largest: int = LARGEST_TEXT, fix: str = ""
) -> bytes:
    """Return what a file holds; raise an error of a kind, "cannot read WHAT", if it cannot be."""
    try:
        return read_whole(path, largest)
    except OSError as error:
        raise kind(f"cannot read {what}: {reason_of(error)}", where=str(path), fix=fix) from error


def read_text(path: Path) -> str:
    """Return what a file of text in UTF-8 says, with every line end as a newline.

    Raises
    ------
    OSError
        As of `read_whole`.
    UnicodeDecodeError
        Where it is no such text.
    """
    text = read_whole(path).decode("utf-8")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def read_text_as(kind: type[DfdbenchError], path: Path, what: str, fix: str = "") -> str:
    """Return what a file of text says; raise an error as `read_as` does."""
    try:
        return read_text(path)
    except (OSError, UnicodeDecodeError) as error:
        raise kind(f"cannot read {what}: {reason_of(error)}", where=str(path), fix=fix) from error


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file so that a reader sees the old one or the new one, never a part.

    Raises
    ------
    OSError
        Where it cannot be written; `filename` is that of the file itself.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_whole(Path(folder) / "a.txt", "whole")
    ...     (Path(folder) / "a.txt").read_text()
    'whole'
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        _replace(path, content)
    except OSError as error:
        # Nobody knows the name that it has until it is whole.
        error.filename, error.filename2 = str(path), None
        raise


def whole_files(folder: Path) -> list[Path]:
    """Return what lies in a folder, without what `write_whole` left where it was killed."""
    if not folder.exists():
        return []
    return [path for path in folder.iterdir() if path.suffix != _UNFINISHED]


def _replace(path: Path, content: str | bytes) -> None:
    handle, temporary = tempfile.mkstemp(_UNFINISHED, f".{path.name}.", path.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content.encode() if isinstance(content, str) else content)
            file.flush()
            os.fsync(file.fileno())
        Path(temporary).chmod(0o644)
        Path(temporary).replace(path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


@contextlib.contextmanager
def hold(path: Path, taken: DfdbenchError) -> Iterator[None]:
    """Lock a file while the block runs; raise `taken` if another process has it locked.

    The lock ends with its process, and the file is removed with it.
    """
    # Absolute: the block may change the working directory.
    place = os.path.abspath(path)
    # Here: it takes longer to import than most verbs to say what they know.
    import filelock

    lock = filelock.FileLock(place, timeout=0)
    try:
        lock.acquire()
    except filelock.Timeout as error:
        # Where no file can be made, as below /proc, it times out as well: then this raises.
        with tempfile.TemporaryFile(dir=os.path.dirname(place)):
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
def writing_folder(
    folder: Path, what: str, again: str = "the same command goes on where it stopped"
) -> Iterator[None]:
    """Lock an output folder for one writer, and turn OSErrors into ResultErrors.

    Parameters
    ----------
    folder : Path
        What is written; the lock is beside it.
    what : str
        What it is the folder of, as in "cannot write the run".
    again : str
        What goes on once there is room.

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
        elsewhere = "choose another place with --out DIR"
        fix = room_or(elsewhere, error)
        if fix != elsewhere:
            fix += f"; {again}"
        raise ResultError(
            f"cannot write the {what}", where=str(folder), got=reason_of(error), fix=fix
        ) from error
