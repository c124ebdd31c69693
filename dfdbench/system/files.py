"""Write files as a whole or not at all, and lock a folder for one writer."""

import contextlib
import errno
import os
import re
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

from dfdbench.errors import DfdbenchError, ResultError, reason_of, room_or

#: The size limit of text files: results, lists, configurations. Results have some 30 KB.
LARGEST_TEXT = 64 * 2**20
#: The size limit of number files that are read at once: an image, the ranges of a laser scanner.
LARGEST_ARRAY = 2**30
_UNFINISHED = ".unfinished"
# The package's data files are beside its code; in a clone, they are in these folders of the root.
_IN_A_CLONE = {"manifests": "manifests", "rows": "leaderboard"}


def shipped(name: str) -> Path:
    """Return a folder of data files that the package ships, installed or in a clone.

    Examples
    --------
    >>> (shipped("manifests") / "demo-1.toml").is_file()
    True
    """
    code = Path(__file__).parents[1]
    beside = code / name
    return beside if beside.is_dir() else code.parent / _IN_A_CLONE[name]


def is_address(place: str | Path) -> bool:
    """Return whether a text is a URL, even if Path has removed one of its slashes.

    Examples
    --------
    >>> is_address(Path("s3://bucket/folder")), is_address("results/s3")
    (True, False)
    """
    return bool(re.match(r"[A-Za-z][A-Za-z0-9+.-]+:/", str(place)))


def leads_outside(path: str) -> bool:
    """Return whether a path, or a pattern of paths, may leave the folder that it is below.

    Examples
    --------
    >>> leads_outside("desk/sharp.png"), leads_outside("../desk/sharp.png")
    (False, True)
    """
    whole = PurePosixPath(path)
    # Windows has other separators, and drives.
    return whole.is_absolute() or ".." in whole.parts or bool(re.match(r".*\\|\w:", path))


def require_file(path: Path) -> None:
    """Raise unless a path is a regular file: opening a pipe or reading a device may never end.

    Raises
    ------
    OSError
        If it is not a file; `strerror` says what it is.

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
    """Return the contents of a regular file, up to a size limit.

    Parameters
    ----------
    path : Path
        The file; links are followed.
    largest : int
        The limit in bytes.

    Raises
    ------
    OSError
        If it cannot be read, is not a regular file or is larger; `strerror` says which.

    Examples
    --------
    >>> read_whole(Path("/dev/zero"))
    Traceback (most recent call last):
    OSError: [Errno 22] not a regular file: '/dev/zero'
    """
    require_file(path)
    with path.open("rb") as file:
        # Not read(largest + 1), which allocates that much memory before it reads the first byte.
        if os.fstat(file.fileno()).st_size > largest:
            raise OSError(errno.EFBIG, f"larger than {largest / 2**20:g} MB", str(path))
        return file.read()


def read_as(
    kind: type[DfdbenchError], path: Path, what: str, largest: int = LARGEST_TEXT, fix: str = ""
) -> bytes:
    """Return the contents of a file; if it cannot be read, raise `kind` with "cannot read WHAT"."""
    try:
        return read_whole(path, largest)
    except OSError as error:
        raise kind(f"cannot read {what}: {reason_of(error)}", where=str(path), fix=fix) from error


def read_text(path: Path) -> str:
    """Return a UTF-8 text file without its byte-order mark, with every line end as a newline.

    Raises
    ------
    OSError
        As in `read_whole`.
    UnicodeDecodeError
        If it is not UTF-8 text.
    """
    text = read_whole(path).decode("utf-8-sig")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def read_text_as(kind: type[DfdbenchError], path: Path, what: str, fix: str = "") -> str:
    """Return the contents of a text file; raise errors as `read_as` does."""
    try:
        return read_text(path)
    except (OSError, UnicodeDecodeError) as error:
        raise kind(f"cannot read {what}: {reason_of(error)}", where=str(path), fix=fix) from error


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file so that a reader sees either the old or the new one, never a part.

    Raises
    ------
    OSError
        If it cannot be written; `filename` is the final path.

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
        # Report the final path, not the temporary one.
        error.filename, error.filename2 = str(path), None
        raise


def whole_files(folder: Path) -> list[Path]:
    """Return the files in a folder, except those that `write_whole` left when it was killed."""
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
    """Lock a file while the block runs; raise `taken` if another process has locked it.

    The lock ends with its process, and the file is removed with the lock.
    """
    # Absolute, because the block may change the working directory.
    place = os.path.abspath(path)
    # Imported here, because most commands would spend longer on it than on their work.
    import filelock

    lock = filelock.FileLock(place, timeout=0)
    try:
        lock.acquire()
    except filelock.Timeout as error:
        # If no file can be created, as below /proc, the lock also times out; this line raises then.
        with tempfile.TemporaryFile(dir=os.path.dirname(place)):
            raise taken from error
    try:
        yield
    finally:
        # Remove it before the lock ends: afterwards the name may be another's. Whoever opened the
        # file before finds it without a name and tries again. Windows cannot remove open files.
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
        The folder to write; the lock is beside it.
    what : str
        What the folder holds, as in "cannot write the run".
    again : str
        What continues the work once there is room.

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
        # "." has no name of its own.
        place = Path(os.path.abspath(folder))
        place.parent.mkdir(parents=True, exist_ok=True)
        with hold(place.with_name(f".{place.name}.lock"), taken):
            yield
    except OSError as error:
        elsewhere = "choose another place with --out DIR"
        fix = room_or(elsewhere, error)
        if fix != elsewhere:
            fix += f"; {again}"
        raise ResultError(
            f"cannot write the {what}", where=str(folder), got=reason_of(error), fix=fix
        ) from error
