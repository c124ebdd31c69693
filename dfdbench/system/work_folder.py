"""A folder while it is written: one writer, and the disk's refusals told; nothing goes on here."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from dfdbench.errors import ResultError, reason_of, room_or
from dfdbench.system.location import as_location
from dfdbench.system.lock import hold


@contextmanager
def writing_folder(folder: Path, what: str) -> Iterator[None]:
    """Keep a folder for the block alone, and tell what the disk does not take.

    Parameters
    ----------
    folder : Path
        What is written; the lock lies beside it.
    what : str
        What it is the folder of, as in "cannot write the run".

    Raises
    ------
    ResultError
        Where another process is writing it, or it cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as place, writing_folder(Path(place) / "a", "run"):
    ...     (Path(place) / "a").mkdir()
    """
    taken = ResultError(
        f"another {what} is writing this folder",
        where=str(folder),
        fix="wait for it, or choose another with --out DIR",
    )
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with hold(as_location(folder.with_name(f".{folder.name}.lock")), taken):
            yield
    except OSError as error:
        raise ResultError(
            f"cannot write the {what}",
            where=str(folder),
            got=reason_of(error),
            fix=room_or("choose another place with --out DIR", error)
            + "; the same command goes on where it stopped",
        ) from error
