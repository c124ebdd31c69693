"""Read the Middlebury 2005 and 2006 scenes from disk, in the site's layout or its archives."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfdbench.building.fetching.archive import archive_members, read_member
from dfdbench.building.fetching.checksums import check_checksum, sha256
from dfdbench.building.sources.image_files import decode_image, decode_levels
from dfdbench.building.sources.interface import SceneImages, gathered
from dfdbench.datasets.manifest import Manifest, Pair
from dfdbench.errors import Problem, SourceError
from dfdbench.system.files import LARGEST_ARRAY, read_as

Levels = NDArray[np.uint8]

_FOLDERS = {"illumination": "Illum", "exposure": "Exp"}


class MiddleburyScenes:
    """Middlebury scenes on disk: ``SCENE/Illum1/Exp0/view1.png``, ``SCENE/disp1.png``.

    Of a set without lightings the images are ``SCENE/view1.png``, the site's default lighting.

    Parameters
    ----------
    manifest : Manifest
        The Middlebury manifest.
    folder : Path
        The folder that holds the scenes or the archives ``SCENE-2views.zip``, or one above it:
        ``ThirdSize``, ``scenes2005``, or their parent.
    checksums : mapping of str to str
        The SHA-256 of files by name; one that differs is refused.

    Raises
    ------
    SourceError
        Where the folder holds no scene of the manifest.
    """

    captures_defocus = False

    def __init__(
        self, manifest: Manifest, folder: Path, checksums: Mapping[str, str] | None = None
    ) -> None:
        self._manifest = manifest
        self._checksums = checksums or {}
        self._scenes = {
            scene.name: files
            for scene in manifest.scenes
            if (files := find_scene(scene.name, scene.source, folder))
        }
        if not self._scenes:
            what = "no scene found, such as Aloe, scenes2005/ThirdSize/Art or Aloe-2views.zip"
            raise SourceError(what, where=str(folder), got=_kind_of(folder))

    @property
    def options(self) -> Mapping[str, Any]:
        """Nothing: the files alone decide."""
        return {}

    def available_pairs(self) -> tuple[Pair, ...]:
        """Return the pairs whose image and depth map are there."""
        problems: list[Problem] = []
        available = []
        for scene in self._scenes:
            with gathered(problems):
                available += [
                    pair
                    for pair in self._manifest.pairs_of_scene(scene)
                    if self._has_image(pair) and self._scenes[scene].has(depth_name(pair.at))
                ]
        SourceError.raise_if(problems)
        return tuple(available)

    def signature(self, scene: str) -> str:
        """Return the SHA-256 over the scene's files that a build reads."""
        digest = hashlib.sha256()
        for name in self._names(scene):
            digest.update(name.encode())
            digest.update(bytes.fromhex(sha256(self._scenes[scene].read(name))))
        return digest.hexdigest()

    def read(self, scene: str) -> SceneImages:
        """Read one scene; every file that is damaged or does not fit is named at once."""
        problems: list[Problem] = []
        files, unknown = self._scenes[scene], self._manifest.depth.unknown
        read: dict[int, Levels] = {}
        for view in self._manifest.axes["view"]:
            name = depth_name({"view": view})
            if files.has(name):
                with gathered(problems):
                    read[view] = decode_levels(
                        self._content(scene, name), files.where(name), unknown
                    )
        shape = next(iter(read.values())).shape if read else None
        for view, depth in read.items():
            if depth.shape != shape:
                what = f"size {depth.shape} differs from the other view's, {shape}"
                problems.append(Problem(what, where=files.where(depth_name({"view": view}))))
        images: dict[Pair, Levels] = {}
        for pair in self._manifest.pairs_of_scene(scene):
            name = image_name(pair.at)
            if files.has(name) and files.has(depth_name(pair.at)):
                with gathered(problems):
                    images[pair] = decode_image(
                        self._content(scene, name), files.where(name), shape
                    )
        SourceError.raise_if(problems)
        return self._assemble(read, images, shape or (0, 0))

    def missing_help(self, missing: tuple[Pair, ...]) -> str:
        """Return where the files that are missing can be had, and what they are called."""
        urls = {source.name: source.url for source in self._manifest.sources}
        source_of = {scene.name: scene.source for scene in self._manifest.scenes}
        first = missing[0]
        address = f"{urls[source_of[first.scene]]}/{first.scene}/{image_name(first.at)}"
        default = self._manifest.default_lighting and any(
            pair.scene in self._scenes
            and self._scenes[pair.scene].has(image_name({"view": pair.at["view"]}))
            for pair in missing
        )
        hint = "; of SCENE/view1.png alone, which is there, consists the set middlebury-default"
        return (
            f"fetch them into the same layout, the first from {address}"
            f"{hint if default else ''}; --allow-missing accepts what is there"
        )

    def _has_image(self, pair: Pair) -> bool:
        return self._scenes[pair.scene].has(image_name(pair.at))

    def _names(self, scene: str) -> list[str]:
        depths = [depth_name({"view": view}) for view in self._manifest.axes["view"]]
        images = [image_name(pair.at) for pair in self._manifest.pairs_of_scene(scene)]
        return [name for name in depths + images if self._scenes[scene].has(name)]

    def _content(self, scene: str, name: str) -> bytes:
        files = self._scenes[scene]
        content = files.read(name)
        check_checksum(f"{scene}/{name}", content, self._checksums, files.where(name))
        return content

    def _assemble(
        self, depths: Mapping[int, Levels], images: Mapping[Pair, Levels], shape: tuple[int, ...]
    ) -> SceneImages:
        axes = self._manifest.axes
        extent = tuple(len(values) for values in axes.values())
        infocus = np.zeros((*extent, *shape, 3), np.uint8)
        available = np.zeros(extent, bool)
        for pair, image in images.items():
            place = tuple(axes[axis].index(value) for axis, value in pair.coordinates)
            infocus[place] = image
            available[place] = True
        unknown = self._manifest.depth.unknown
        empty = np.full(shape, unknown, np.uint8)
        depth = np.stack([depths.get(view, empty) for view in axes["view"]])
        return SceneImages.of_pairs(infocus, depth, depth != unknown, available)


def image_name(at: Mapping[str, int]) -> str:
    """Return an in-focus image's file name below its scene, as the site has it.

    Without a lighting it is that of the site's default one.

    Examples
    --------
    >>> image_name({"view": 5, "illumination": 3, "exposure": 0})
    'Illum3/Exp0/view5.png'
    >>> image_name({"view": 5})
    'view5.png'
    """
    lighting = [f"{folder}{at[axis]}/" for axis, folder in _FOLDERS.items() if axis in at]
    return f"{''.join(lighting)}view{at['view']}.png"


def depth_name(at: Mapping[str, int]) -> str:
    """Return the file name of a view's depth map below its scene."""
    return f"disp{at['view']}.png"


def _kind_of(folder: Path) -> str:
    if folder.is_dir():
        return "none"
    return "a file" if folder.exists() else "no such folder"


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
            If the archive has to be looked into and is none.
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
        if self.folder and (self.folder / name).is_file():
            return read_as(SourceError, self.folder / name, "the file", LARGEST_ARRAY)
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
