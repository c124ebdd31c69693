"""Bring the Middlebury scenes from their site, or a mirror of it, into a folder."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from dfdbench.building.fetching import checksums, download
from dfdbench.building.fetching.archive import archive_members
from dfdbench.building.sources.image_files import decode_file, decode_image, decode_levels
from dfdbench.building.sources.middlebury import depth_name, image_name
from dfdbench.datasets.manifest import Manifest, Scene
from dfdbench.errors import Problem, SourceError, reason_of, room_or
from dfdbench.system.files import hold
from dfdbench.tables.table import listed

_NAMES_SHOWN = 10

_Check = Callable[[str, Path, str], None]


@dataclass(frozen=True)
class Download:
    """What a download did.

    Parameters
    ----------
    folder : Path
        Where the files lie, in the site's layout.
    new, kept : int
        Files fetched now, and found whole from before.
    missing : tuple of str
        Files that no address has, or that are not there where nobody may be asked.
    lock : Path or None
        The lock file, where this call was the first that was complete.
    lacking : tuple of Problem
        One for each mirror that was asked for files that it does not have.
    """

    folder: Path
    new: int
    kept: int
    missing: tuple[str, ...]
    lock: Path | None
    lacking: tuple[Problem, ...] = ()


def download_middlebury(
    manifest: Manifest,
    folder: Path,
    mirrors: Sequence[str] = (),
    offline: bool = False,
    on_progress: download.Progress | None = None,
    patience: download.Patience | None = None,
) -> Download:
    """Bring a data set's files into a folder; check all that are there.

    A set in the site's default lighting comes as one archive a scene; scenes whose archive cannot
    be had, and any other set, come file by file.

    Parameters
    ----------
    manifest : Manifest
        The Middlebury manifest.
    folder : Path
        Where the files go, as ``SCENE/Illum1/Exp0/view1.png`` or ``SCENE-2views.zip``.
    mirrors : sequence of str
        Addresses to ask before the site itself; each stands for ``.../stereo/data``.
    offline : bool
        Ask nobody; only check what is there.
    on_progress : callable, optional
        Told of (files done, files in all, bytes received).
    patience : Patience, optional
        With slow and failing servers.

    Raises
    ------
    SourceError
        With every file that is damaged or could not be reached; the missing are counted beside
        them. What came is kept.
    """
    what = "another download into this folder is running"
    taken = SourceError(what, where=str(folder), fix="wait for it")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with hold(folder / f".{checksums.lock_name(manifest)}.lock", taken):
            known = checksums.known_checksums(manifest, folder)
            site = _Site(manifest, folder, tuple(mirrors), known)
            fetcher = download.Fetcher(folder, on_progress, patience, offline)
            # The site's archives hold the default lighting and no other.
            default_lighting = set(manifest.axes) == {"view"}
            fates = _bring_default(site, fetcher) if default_lighting else _bring_all(site, fetcher)
            lock = _write_lock(manifest, folder, fates)
    except OSError as error:
        what = f"cannot keep the download: {reason_of(error)}"
        fix = room_or("choose another place with --cache DIR", error)
        raise SourceError(what, where=str(error.filename or folder), fix=fix) from error
    lacking = download.mirrors_lacking(fates, mirrors)
    _refuse(fates, folder, lacking)
    return Download(
        folder,
        sum(fate.kind == "new" for fate in fates),
        sum(fate.kind == "kept" for fate in fates),
        tuple(fate.name for fate in fates if fate.kind == "missing"),
        lock,
        lacking,
    )


@dataclass(frozen=True)
class _Site:
    """Which files there are, where they may be had, and how each is checked."""

    manifest: Manifest
    folder: Path
    mirrors: tuple[str, ...]
    known: Mapping[str, str]

    def depths(self, scene: Scene) -> list[download.WantedFile]:
        names = [depth_name({"view": view}) for view in self.manifest.axes["view"]]
        return [self._file(scene, name, self._check_depth) for name in names]

    def images(self, scene: Scene) -> list[download.WantedFile]:
        return [
            self._file(scene, image_name(pair.at), self._check_image)
            for pair in self.manifest.pairs_of_scene(scene.name)
        ]

    def archive(self, scene: Scene) -> download.WantedFile:
        name = f"{scene.name}-2views.zip"
        addresses = self._addresses(scene, f"zip-2views/{name}")
        return download.WantedFile(name, addresses, partial(self._check_archive, name))

    def _file(self, scene: Scene, name: str, check: _Check) -> download.WantedFile:
        full = f"{scene.name}/{name}"
        addresses = self._addresses(scene, full)
        return download.WantedFile(full, addresses, partial(check, full))

    def _addresses(self, scene: Scene, path: str) -> tuple[str, ...]:
        url = next(s.url for s in self.manifest.sources if s.name == scene.source).rstrip("/")
        below = "/".join(url.split("/")[-2:])
        bases = [*(f"{mirror.rstrip('/')}/{below}" for mirror in self.mirrors), url]
        return tuple(f"{base}/{path}" for base in bases)

    def _check_depth(self, name: str, path: Path, where: str) -> None:
        content = path.read_bytes()
        if not self._is_known(name, content, where):
            decode_levels(content, where, self.manifest.depth.unknown)

    def _check_image(self, name: str, path: Path, where: str) -> None:
        content = path.read_bytes()
        if self._is_known(name, content, where):
            return
        view = path.name.removeprefix("view").split(".")[0]
        depth = self.folder / name.split("/")[0] / depth_name({"view": int(view)})
        size = decode_file(depth.read_bytes(), str(depth)).shape[:2] if depth.exists() else None
        decode_image(content, where, size)

    def _check_archive(self, name: str, path: Path, where: str) -> None:
        if not self._is_known(name, path.read_bytes(), where):
            archive_members(path, where)

    def _is_known(self, name: str, content: bytes, where: str) -> bool:
        checksums.check_checksum(name, content, self.known, where)
        return name in self.known


def _bring_all(site: _Site, fetcher: download.Fetcher) -> list[download.Fate]:
    # Depth maps first: an image is checked against the size of its own.
    scenes = site.manifest.scenes
    depths = [file for scene in scenes for file in site.depths(scene)]
    images = [file for scene in scenes for file in site.images(scene)]
    fates = fetcher.bring(depths, len(images))
    if all(fate.kind == "unreachable" for fate in fates):
        return fates
    return fates + fetcher.bring(images)


def _bring_default(site: _Site, fetcher: download.Fetcher) -> list[download.Fate]:
    single = {
        scene.name: (site.depths(scene), site.images(scene)) for scene in site.manifest.scenes
    }
    whole = [
        scene.name
        for scene in site.manifest.scenes
        if all((site.folder / file.name).exists() for kind in single[scene.name] for file in kind)
    ]
    archives = [scene for scene in site.manifest.scenes if scene.name not in whole]
    fates = fetcher.bring([site.archive(scene) for scene in archives])
    had = {fate.name for fate in fates if fate.kind in ("new", "kept")}
    alone = [scene.name for scene in archives if site.archive(scene).name not in had] + whole
    depths = [file for name in alone for file in single[name][0]]
    images = [file for name in alone for file in single[name][1]]
    later = fetcher.bring(depths, len(images)) + fetcher.bring(images)
    return [fate for fate in fates if fate.name in had] + later


def _write_lock(manifest: Manifest, folder: Path, fates: list[download.Fate]) -> Path | None:
    path = folder / checksums.lock_name(manifest)
    had = {fate.name for fate in fates if fate.kind in ("new", "kept")}
    locked = checksums.read_checksums(path)
    if len(had) < len(fates) or had <= set(locked):
        return None
    found = {name: checksums.sha256((folder / name).read_bytes()) for name in had - set(locked)}
    checksums.write_checksums(path, locked | found)
    return path


def _refuse(fates: list[download.Fate], folder: Path, lacking: tuple[Problem, ...]) -> None:
    problems = [
        problem
        for kind in ("damaged", "unreachable")
        for problem in _first_few([fate for fate in fates if fate.kind == kind], kind)
    ]
    damaged = sum(fate.kind == "damaged" for fate in fates)
    if damaged:
        whole = sum(fate.kind in ("new", "kept") for fate in fates)
        what = f"{damaged} damaged files in all, set aside; the other {whole} are whole and kept"
        fix = "the same command asks for them again, here or with another --mirror"
        problems.append(Problem(what, where=str(folder / download.SET_ASIDE), fix=fix))
    missing = [fate.name for fate in fates if fate.kind == "missing"]
    if problems and missing:
        what = f"no address has these {len(missing)} files: {listed(missing, _NAMES_SHOWN)}"
        problems.append(Problem(what, where=str(folder)))
    if problems:
        raise SourceError.of([*problems, *lacking])


def _first_few(fates: list[download.Fate], kind: str) -> list[Problem]:
    # A server that is down fails every file alike: the first few tell enough.
    problems = [problem for fate in fates for problem in fate.problems]
    if kind == "damaged" or len(problems) <= _NAMES_SHOWN:
        return problems
    names = [fate.name for fate in fates]
    what = f"{len(fates)} files in all could not be had: {listed(names, _NAMES_SHOWN)}"
    rest = Problem(what, fix="the same command goes on from here")
    return [*problems[:3], rest]
