"""Read the Middlebury 2005 and 2006 scenes, in the site's layout or its archives; download them."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfdbench.building import fetching
from dfdbench.building.sources import SceneImages, gathered, laid_out
from dfdbench.building.sources.image_files import decode_file, decode_image, decode_levels
from dfdbench.datasets.manifest import Manifest, Pair, Scene
from dfdbench.errors import Problem, SourceError
from dfdbench.system.files import LARGEST_ARRAY, hold, read_as
from dfdbench.tables.table import counted, listed

Levels = NDArray[np.uint8]

_FOLDERS = {"illumination": "Illum", "exposure": "Exp"}
# Where archives are, below the scenes' folder: once downloaded, and on the site.
_ZIPPED = ("", "zip-2views")


class MiddleburyScenes:
    """Middlebury scenes on disk: ``SCENE/Illum1/Exp0/view1.png``, ``SCENE/disp1.png``.

    In a set without lightings the images are ``SCENE/view1.png``, the site's default lighting.

    Parameters
    ----------
    manifest : Manifest
        The Middlebury manifest.
    folder : Path
        The folder that holds the scenes or the archives ``SCENE-2views.zip``, or one above it:
        ``ThirdSize``, ``scenes2005``, or their parent.
    checksums : mapping of str to str
        The SHA-256 of files by name; a file that differs is refused.

    Raises
    ------
    SourceError
        If the folder holds no scene of the manifest.
    """

    options: Mapping[str, Any] = {}
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
            there = "a file, not a folder" if folder.exists() else "no such folder"
            got = "" if folder.is_dir() else there
            raise SourceError(what, where=str(folder), got=got)

    def available_pairs(self) -> tuple[Pair, ...]:
        """Return the pairs whose image and depth map are there."""
        problems: list[Problem] = []
        available = []
        for scene, files in self._scenes.items():
            with gathered(problems):
                available += [
                    pair
                    for pair in self._manifest.pairs(scene)
                    if files.has(image_name(pair.at)) and files.has(depth_name(pair.at))
                ]
        SourceError.raise_if(problems)
        return tuple(available)

    def signature(self, scene: str) -> str:
        """Return the SHA-256 over the scene's files that a build reads."""
        digest = hashlib.sha256()
        for name in self._names(scene):
            digest.update(name.encode())
            digest.update(bytes.fromhex(fetching.sha256(self._scenes[scene].read(name))))
        return digest.hexdigest()

    def read(self, scene: str) -> SceneImages:
        """Read one scene; the error names every file that is damaged or does not fit."""
        problems: list[Problem] = []
        files, unknown = self._scenes[scene], self._manifest.depth.unknown
        read: dict[int, Levels] = {}
        shape: tuple[int, ...] | None = None
        for view in self._manifest.axes["view"]:
            name = depth_name({"view": view})
            if files.has(name):
                with gathered(problems):
                    content = self._content(scene, name)
                    read[view] = decode_levels(content, files.where(name), unknown, shape)
                    shape = read[view].shape
        images: dict[Pair, Levels] = {}
        for pair in self._manifest.pairs(scene):
            name = image_name(pair.at)
            if files.has(name) and files.has(depth_name(pair.at)):
                with gathered(problems):
                    content = self._content(scene, name)
                    images[pair] = decode_image(content, files.where(name), shape)
        SourceError.raise_if(problems)
        infocus, available = laid_out(self._manifest, images)
        empty = np.full(infocus.shape[-3:-1], unknown, np.uint8)
        depth = np.stack([read.get(view, empty) for view in self._manifest.axes["view"]])
        return SceneImages.of_pairs(infocus, depth, depth != unknown, available)

    def missing_help(self, missing: tuple[Pair, ...]) -> str:
        """Say where to get the missing files, and what they are called."""
        urls = {source.name: source.url for source in self._manifest.sources}
        source_of = {scene.name: scene.source for scene in self._manifest.scenes}
        first = missing[0]
        address = f"{urls[source_of[first.scene]]}/{first.scene}/{image_name(first.at)}"
        return (
            f"fetch them into the same layout, the first from {address}; "
            "--allow-missing accepts what is there"
        )

    def _names(self, scene: str) -> list[str]:
        depths = [depth_name({"view": view}) for view in self._manifest.axes["view"]]
        images = [image_name(pair.at) for pair in self._manifest.pairs(scene)]
        return [name for name in depths + images if self._scenes[scene].has(name)]

    def _content(self, scene: str, name: str) -> bytes:
        files = self._scenes[scene]
        content = files.read(name)
        fetching.check_checksum(f"{scene}/{name}", content, self._checksums, files.where(name))
        return content


def image_name(at: Mapping[str, int]) -> str:
    """Return an in-focus image's file name below its scene, as on the site.

    Without an illumination, it is the image in the site's default lighting.

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


@dataclass(frozen=True)
class SceneFiles:
    """The files of one scene; files in a folder take precedence over an archive's.

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
            If the archive is needed and is invalid.
        """
        if self.folder and (self.folder / name).is_file():
            return True
        return name in self._members

    def where(self, name: str) -> str:
        """Return a file's location, for messages."""
        if self.folder and ((self.folder / name).exists() or not self.archive):
            return str(self.folder / name)
        return f"{self.archive}, {name}"

    def read(self, name: str) -> bytes:
        """Return a file's bytes.

        Raises
        ------
        SourceError
            If it cannot be read.
        """
        if self.folder and (self.folder / name).is_file():
            return read_as(SourceError, self.folder / name, "the file", LARGEST_ARRAY)
        if self.archive is None or name not in self._members:
            raise SourceError("no such file", where=self.where(name))
        return fetching.read_member(self.archive, self._members[name])

    @cached_property
    def _members(self) -> Mapping[str, str]:
        # The archive may hold the scene's folder at its top, or below one of its own name.
        if self.archive is None:
            return {}
        return {
            member.rpartition(f"{self.scene}/")[2]: member
            for member in fetching.archive_members(self.archive)
            if f"/{self.scene}/" in f"/{member}"
        }


def find_scene(name: str, source: str, place: Path) -> SceneFiles | None:
    """Return a scene's files below a place, or None if there are none.

    Parameters
    ----------
    name : str
        The scene.
    source : str
        The site's folder for the scene, such as ``scenes2005``.
    place : Path
        A folder of scenes or of archives, or one above: ``ThirdSize``, ``scenes2005``, or their
        parent.
    """
    above = (place, place / "ThirdSize", place / source / "ThirdSize")
    archives = (base / below / f"{name}-2views.zip" for base in above for below in _ZIPPED)
    folder = next((there for base in above if (there := base / name).is_dir()), None)
    archive = next((file for file in archives if file.is_file()), None)
    return SceneFiles(name, folder, archive) if folder or archive else None


_NAMES_SHOWN = 10

#: Called with a file, its contents and where it came from.
_Inspection = Callable[[Path, bytes, str], None]


@dataclass(frozen=True)
class Download:
    """What a download did.

    Parameters
    ----------
    folder : Path
        Where the files are, in the site's layout.
    new, kept : int
        Files downloaded now, and complete ones kept from before.
    lock : Path or None
        The lock file, if this call was the first to complete the set.
    lacking : tuple of Problem
        One for each mirror that lacks files it was asked for.
    refused : int
        How many files were damaged and set aside.
    """

    folder: Path
    new: int
    kept: int
    lock: Path | None
    lacking: tuple[Problem, ...] = ()
    refused: int = 0


def download_middlebury(
    manifest: Manifest,
    folder: Path,
    mirrors: Sequence[str] = (),
    offline: bool = False,
    on_progress: fetching.Progress | None = None,
) -> Download:
    """Download a data set's files into a folder; check all that are there.

    A set in the site's default lighting comes as one archive per scene. Scenes whose archive is not
    available, and all other sets, come file by file.

    Parameters
    ----------
    manifest : Manifest
        The Middlebury manifest.
    folder : Path
        Where the files go, as ``SCENE/Illum1/Exp0/view1.png`` or ``SCENE-2views.zip``.
    mirrors : sequence of str
        Addresses to ask before the site itself; each stands for ``.../stereo/data``.
    offline : bool
        Ask no server; only check what is there.
    on_progress : callable, optional
        Called with (files done, total files, bytes received).

    Raises
    ------
    SourceError
        With every file that is damaged or could not be reached; missing ones are only counted. What
        was downloaded is kept.
    """
    what = "another download into this folder is running"
    taken = SourceError(what, where=str(folder), fix="wait for it")
    fetcher = fetching.Fetcher(folder, on_progress, offline)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with hold(folder / f".{fetching.lock_name(manifest)}.lock", taken):
            known = fetching.known_checksums(manifest, folder)
            site = _Site(manifest, folder, tuple(mirrors), known)
            # The site's archives hold only the default lighting.
            if set(manifest.axes) == {"view"}:
                fates = _bring_default(site, fetcher)
            else:
                fates = _bring_each(site, fetcher, manifest.scenes)
            lock = _write_lock(manifest, folder, fates)
        lacking = fetching.mirrors_lacking(fates, mirrors)
        _refuse(fates, folder, lacking)
    except OSError as error:
        raise fetching.cannot_keep(error.filename or folder, error) from error
    except SourceError as error:
        if not fetcher.refused:
            raise
        kept = f"{counted(fetcher.refused, 'file')} set aside in {folder / fetching.SET_ASIDE}"
        raise SourceError.of([*error.problems, Problem(kept)]) from error
    return Download(
        folder,
        sum(fate.kind == "new" for fate in fates),
        sum(fate.kind == "kept" for fate in fates),
        lock,
        lacking,
        fetcher.refused,
    )


@dataclass(frozen=True)
class _Site:
    """Which files there are, where to get them, and how to check each."""

    manifest: Manifest
    folder: Path
    mirrors: tuple[str, ...]
    known: Mapping[str, str]

    def depths(self, scene: Scene) -> list[fetching.WantedFile]:
        names = [depth_name({"view": view}) for view in self.manifest.axes["view"]]
        return [self._file(scene, f"{scene.name}/{name}", self._inspect_depth) for name in names]

    def images(self, scene: Scene) -> list[fetching.WantedFile]:
        names = [image_name(pair.at) for pair in self.manifest.pairs(scene.name)]
        return [self._file(scene, f"{scene.name}/{name}", self._inspect_image) for name in names]

    def archive(self, scene: Scene) -> fetching.WantedFile:
        name = f"{scene.name}-2views.zip"
        return self._file(scene, name, _inspect_archive, f"zip-2views/{name}")

    def _file(
        self, scene: Scene, name: str, inspect: _Inspection, address: str = ""
    ) -> fetching.WantedFile:
        url = next(s.url for s in self.manifest.sources if s.name == scene.source).rstrip("/")
        below = "/".join(url.split("/")[-2:])
        bases = [*(f"{mirror.rstrip('/')}/{below}" for mirror in self.mirrors), url]

        def check(file: Path, where: str) -> None:
            content = file.read_bytes()
            fetching.check_checksum(name, content, self.known, where)
            if name not in self.known:
                inspect(file, content, where)

        return fetching.WantedFile(
            name, tuple(f"{base}/{address or name}" for base in bases), check
        )

    def _inspect_depth(self, file: Path, content: bytes, where: str) -> None:
        decode_levels(content, where, self.manifest.depth.unknown)

    def _inspect_image(self, file: Path, content: bytes, where: str) -> None:
        view = file.name.removeprefix("view").split(".")[0]
        scene = file.relative_to(self.folder).parts[0]
        depth = self.folder / scene / depth_name({"view": int(view)})
        size = decode_file(depth.read_bytes(), str(depth)).shape[:2] if depth.exists() else None
        decode_image(content, where, size)


def _inspect_archive(file: Path, content: bytes, where: str) -> None:
    fetching.archive_members(file, where)


def _bring_each(
    site: _Site, fetcher: fetching.Fetcher, scenes: Sequence[Scene]
) -> list[fetching.Fate]:
    # Depth maps first: an image's size is checked against its depth map's.
    depths = [file for scene in scenes for file in site.depths(scene)]
    images = [file for scene in scenes for file in site.images(scene)]
    fates = fetcher.bring(depths, len(images))
    if all(fate.kind == "unreachable" for fate in fates):
        return fates
    return fates + fetcher.bring(images)


def _bring_default(site: _Site, fetcher: fetching.Fetcher) -> list[fetching.Fate]:
    packed, alone = list[Scene](), list[Scene]()
    for scene in site.manifest.scenes:
        single = [*site.depths(scene), *site.images(scene)]
        whole = all((site.folder / file.name).exists() for file in single)
        (alone if whole else packed).append(scene)
    fates = fetcher.bring([site.archive(scene) for scene in packed])
    had = [fate for fate in fates if fate.is_there]
    alone = [scene for scene, fate in zip(packed, fates, strict=True) if fate not in had] + alone
    return had + _bring_each(site, fetcher, alone)


def _write_lock(manifest: Manifest, folder: Path, fates: list[fetching.Fate]) -> Path | None:
    path = folder / fetching.lock_name(manifest)
    had = {fate.name for fate in fates if fate.is_there}
    locked = fetching.read_checksums(path)
    if len(had) < len(fates) or had <= set(locked):
        return None
    found = {name: fetching.sha256((folder / name).read_bytes()) for name in had - set(locked)}
    fetching.write_checksums(path, locked | found)
    return path


def _refuse(fates: list[fetching.Fate], folder: Path, lacking: tuple[Problem, ...]) -> None:
    damaged = [fate for fate in fates if fate.kind == "damaged"]
    problems = [problem for fate in damaged for problem in fate.problems]
    problems += _first_few([fate for fate in fates if fate.kind == "unreachable"])
    if damaged:
        whole = sum(fate.is_there for fate in fates)
        what = (
            f"{len(damaged)} damaged files in all, set aside; the other {whole} are whole and kept"
        )
        fix = "the same command asks for them again, here or with another --mirror"
        problems.append(Problem(what, where=str(folder / fetching.SET_ASIDE), fix=fix))
    missing = [fate.name for fate in fates if fate.kind == "missing"]
    if problems and missing:
        what = f"no address has these {len(missing)} files: {listed(missing, _NAMES_SHOWN)}"
        problems.append(Problem(what, where=str(folder)))
    if problems:
        raise SourceError.of([*problems, *lacking])


def _first_few(fates: list[fetching.Fate]) -> list[Problem]:
    # If a server is down, every file fails alike: naming the first few is enough.
    problems = [problem for fate in fates for problem in fate.problems]
    if len(problems) <= _NAMES_SHOWN:
        return problems
    names = [fate.name for fate in fates]
    what = f"{len(fates)} files in all could not be had: {listed(names, _NAMES_SHOWN)}"
    rest = Problem(what, fix="the same command goes on from here")
    return [*problems[:3], rest]
