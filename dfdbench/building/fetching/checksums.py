"""The known SHA-256 of a data set's files: in its manifest, and in a lock file beside them."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from importlib import resources
from pathlib import Path

from dfdbench.datasets.manifest import Manifest
from dfdbench.errors import Problem, SourceError, reason_of
from dfdbench.system.files import read_text, write_whole

_LINE = re.compile(r"([0-9a-f]{64})  (\S.*)")


def sha256(content: bytes) -> str:
    """Return the SHA-256 of some bytes, in hexadecimal."""
    return hashlib.sha256(content).hexdigest()


def lock_name(manifest: Manifest) -> str:
    """Return the name of a data set's lock file, such as ``middlebury-third-1.lock``."""
    return f"{manifest.file_stem}.lock"


def known_checksums(manifest: Manifest, folder: Path | None = None) -> dict[str, str]:
    """Return the SHA-256 of files by their names, ``SCENE/...``.

    The manifest's own come first, then those of the lock file released with it, then those of
    the lock file that the first complete download wrote.

    Parameters
    ----------
    manifest : Manifest
        The data set.
    folder : Path, optional
        Where its downloads lie.

    Raises
    ------
    SourceError
        Where a lock file is damaged.
    """
    known: dict[str, str] = {}
    if folder is not None:
        known |= read_checksums(folder / lock_name(manifest))
    released = resources.files("dfdbench.manifests") / lock_name(manifest)
    if released.is_file():
        known |= parse_checksums(released.read_text(encoding="utf-8"), lock_name(manifest))
    return known | manifest.checksums


def read_checksums(path: Path) -> dict[str, str]:
    """Return the SHA-256 by name of a lock file; none where there is no such file.

    Raises
    ------
    SourceError
        Where it is damaged.
    """
    if not path.exists():
        return {}
    try:
        text = read_text(path)
    except (OSError, UnicodeDecodeError) as error:
        what = f"cannot read the lock file: {reason_of(error)}"
        raise SourceError(what, where=str(path), fix="delete it") from error
    return parse_checksums(text, str(path))


def parse_checksums(text: str, where: str) -> dict[str, str]:
    """Return the SHA-256 by name from text as ``sha256sum`` writes it.

    Raises
    ------
    SourceError
        With every line that is not of that form.

    Examples
    --------
    >>> parse_checksums("0" * 64 + "  Art/disp1.png", "here")["Art/disp1.png"][:4]
    '0000'
    """
    known, problems = {}, []
    for number, line in enumerate(text.splitlines(), 1):
        if match := _LINE.fullmatch(line):
            known[match[2]] = match[1]
        else:
            what = f"not SHA-256, two blanks and a name: {line[:80]}"
            problems.append(
                Problem(what, where=f"{where}, line {number}", fix="delete the lock file")
            )
    SourceError.raise_if(problems)
    return known


def write_checksums(path: Path, checksums: Mapping[str, str]) -> None:
    """Write a lock file; ``sha256sum --check`` reads it."""
    lines = [f"{digest}  {name}\n" for name, digest in sorted(checksums.items())]
    write_whole(path, "".join(lines))


def check_checksum(name: str, content: bytes, known: Mapping[str, str], where: str) -> None:
    """Refuse a file that is not the one that is known by its name.

    Raises
    ------
    SourceError
        Where its SHA-256 is known and another.
    """
    expected = known.get(name)
    if expected is not None and sha256(content) != expected:
        got = f"SHA-256 {sha256(content)}, not {expected}"
        fix = "fetch the site's own file again; pixels encoded anew do not count"
        raise SourceError("not the file of this data set", where=where, got=got, fix=fix)
