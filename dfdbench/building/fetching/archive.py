"""Read files out of a zip archive that nobody vouches for; nothing is ever unpacked to disk."""

from __future__ import annotations

import stat
import zipfile
from collections.abc import Mapping
from pathlib import Path, PurePosixPath

from dfdbench.errors import Problem, SourceError
from dfdbench.system.array_files import UNREADABLE

_MOST_MEMBERS = 10_000
_LARGEST_MEMBER = 64 * 2**20  # bytes
_LARGEST_WHOLE = 512 * 2**20  # bytes


def archive_members(path: Path, where: str = "") -> Mapping[str, int]:
    """Return the names and sizes of an archive's files, once all of it was found harmless.

    Parameters
    ----------
    path : Path
        A zip file.
    where : str
        What messages call it; its path by default.

    Raises
    ------
    SourceError
        With every member whose name leads out of the archive, that is a link, is encrypted, is
        there twice, or is larger than any file of these data sets; or where it is no zip file.
    """
    where = where or str(path)
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
    except UNREADABLE as error:
        what = f"not a zip archive, or a damaged one: {str(error)[:200]}"
        raise SourceError(what, where=where, fix="fetch it again") from error
    total = sum(member.file_size for member in members)
    if total > _LARGEST_WHOLE or len(members) > _MOST_MEMBERS:
        what = f"the archive would unpack to too much: {total} bytes in {len(members)} files"
        raise SourceError(what, where=where)
    problems, before = [], set[str]()
    for member in members:
        if fault := _fault(member, before):
            what = f"the archive is not to be trusted: {fault}"
            problems.append(Problem(what, where=where, got=repr(member.filename)))
        before.add(member.filename)
    if problems:
        raise SourceError.of(problems)
    return {member.filename: member.file_size for member in members if not member.is_dir()}


def read_member(path: Path, name: str) -> bytes:
    """Return one file of an archive that `archive_members` found harmless.

    Raises
    ------
    SourceError
        Where its bytes do not decompress to what the archive says they are.
    """
    try:
        with zipfile.ZipFile(path) as archive, archive.open(name) as member:
            size = archive.getinfo(name).file_size
            # One byte more than stated is asked for: what goes on for ever is stopped there.
            content = member.read(size + 1)
    except UNREADABLE as error:
        raise _damaged(path, name, str(error)) from error
    if len(content) != size:
        raise _damaged(path, name, f"{len(content)} bytes where {size} are stated")
    return content


def _fault(member: zipfile.ZipInfo, before: set[str]) -> str:
    name = member.filename
    pure = PurePosixPath(name)
    if not name:
        return "it holds a file without a name"
    if pure.is_absolute() or ".." in pure.parts or "\\" in name or ":" in name:
        return "a name leads out of it"
    if stat.S_ISLNK(member.external_attr >> 16):
        return "it holds a link"
    if member.flag_bits & 0x1:
        return "it holds an encrypted file"
    if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        # Of the others some take as much memory as the file asks for.
        return f"it holds a file packed by method {member.compress_type}, and not deflated"
    if name in before:
        return "it holds the same name twice"
    if member.file_size > _LARGEST_MEMBER:
        return f"it holds a file of {member.file_size} bytes"
    return ""


def _damaged(path: Path, name: str, got: str) -> SourceError:
    return SourceError(
        f"a file in the archive is damaged: {got}", where=f"{path}, {name}", fix="fetch it again"
    )
