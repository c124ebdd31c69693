"""Read files out of a zip archive; nothing is ever unpacked to disk."""

from __future__ import annotations

import zipfile
from pathlib import Path

from dfdbench.errors import SourceError
from dfdbench.system.array_files import UNREADABLE

_LARGEST = 64 * 2**20  # bytes
# Other methods may take as much memory as the file asks for.
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)


def archive_members(path: Path, where: str = "") -> tuple[str, ...]:
    """Return the names of an archive's files.

    Parameters
    ----------
    path : Path
        A zip file.
    where : str
        What messages call it; its path by default.

    Raises
    ------
    SourceError
        If it is no zip file.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            return tuple(member.filename for member in archive.infolist() if not member.is_dir())
    except UNREADABLE as error:
        what = f"not a zip archive, or a damaged one: {str(error)[:200]}"
        raise SourceError(what, where=where or str(path), fix="fetch it again") from error


def read_member(path: Path, name: str) -> bytes:
    """Return one file of an archive.

    Raises
    ------
    SourceError
        If it is larger than any file of these data sets, is packed in another way than theirs, or
        its bytes do not decompress to what the archive says they are.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            member = archive.getinfo(name)
            if member.file_size > _LARGEST or member.compress_type not in _METHODS:
                raise ValueError(f"{member.file_size} bytes, method {member.compress_type}")
            with archive.open(member) as file:
                # One byte more than stated is asked for: what goes on for ever is stopped there.
                content = file.read(member.file_size + 1)
        if len(content) != member.file_size:
            raise ValueError(f"{len(content)} bytes, and {member.file_size} are stated")
    except UNREADABLE as error:
        what, where = f"a file in the archive is damaged: {error}", f"{path}, {name}"
        raise SourceError(what, where=where, fix="fetch the archive again") from error
    return content
