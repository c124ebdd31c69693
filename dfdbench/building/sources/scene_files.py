"""A scene's files by name, wherever they lie: in a folder, in the site's zip archive, in both."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from dfdbench.building.fetching.archive import archive_members, read_member
from dfdbench.errors import SourceError, reason_of
from dfdbench.system.files import LARGEST_ARRAY, read_whole


@dataclass(frozen=True)
class SceneFiles:
    """The files of one scene; a folder's come before an archive's.

    Parameters
    ----------
    scene : str
        The scene's name.
    folder : Path, optional
        The folder that holds ``view1.png``, ``Illum1/Exp0/view1.png`` and so on.
    archive : Path, optional
        A zip archive that holds the same below ``SCENE/``.
    """

    scene: str
    folder: Path | None
    archive: Path | None

    def has(self, name: str) -> bool:
        """Return whether there is a file of this name.

        Raises
        ------
        SourceError
            Where the archive has to be looked into and is not to be trusted.
        """
        if self.folder and (self.folder / name).is_file():
            return True
        return name in self._members

    def where(self, name: str) -> str:
        """Return where a file lies, for messages."""
        if self.folder and ((self.folder / name).exists() or not self.archive):
            return str(self.folder / name)
        return f"{self.archive}, {name}"

    def read(self, name: str) -> bytes:
        """Return a file's bytes.

        Raises
        ------
        SourceError
            Where it cannot be read.
        """
        try:
            if self.folder and (self.folder / name).is_file():
                return read_whole(self.folder / name, LARGEST_ARRAY)
        except OSError as error:
            raise SourceError(
                "cannot read the file", where=self.where(name), got=reason_of(error)
            ) from error
        if self.archive is None or name not in self._members:
            raise SourceError("no such file", where=self.where(name))
        return read_member(self.archive, self._members[name])

    @cached_property
    def _members(self) -> Mapping[str, str]:
        # The archive may hold the scene's folder at its top, or below one of its own name.
        if self.archive is None:
            return {}
        return {
            member.rpartition(f"{self.scene}/")[2]: member
            for member in archive_members(self.archive)
            if f"/{self.scene}/" in f"/{member}"
        }


def find_scene(name: str, source: str, place: Path) -> SceneFiles | None:
    """Return a scene's files below a place, or None where it has none.

    Parameters
    ----------
    name : str
        The scene.
    source : str
        The site's folder that it is served from, such as ``scenes2005``.
    place : Path
        A folder of scenes or of archives, or one above: ``ThirdSize``, ``scenes2005``, or their
        parent.
    """
    above = (place, place / "ThirdSize", place / source / "ThirdSize")
    archive_name = f"{name}-2views.zip"
    folder = next((p for base in above if (p := base / name).is_dir()), None)
    archive = next(
        (
            p
            for base in above
            for p in (base / archive_name, base / "zip-2views" / archive_name)
            if p.is_file()
        ),
        None,
    )
    return SceneFiles(name, folder, archive) if folder or archive else None
