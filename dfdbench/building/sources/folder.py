"""Read a captured set that its manifest describes: two photographs and a depth map a pair."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from dfdbench.building.fetching.checksums import check_checksum, sha256
from dfdbench.building.sources.captured_pair import CapturedPair, captured_pair
from dfdbench.building.sources.image_files import SUFFIXES
from dfdbench.building.sources.interface import SceneError, SceneImages
from dfdbench.datasets.captured_files import ANY_ENDING, ROLES, CapturedFiles, fill
from dfdbench.datasets.manifest import Manifest, Pair
from dfdbench.errors import Problem, SourceError, reason_of
from dfdbench.system.files import LARGEST_ARRAY, read_whole
from dfdbench.tables.table import listed

# Entries of a folder that a message names.
_NAMED = 8


class FolderScenes:
    """Scenes below a folder, found by the patterns of the manifest's section `files`.

    Parameters
    ----------
    manifest : Manifest
        With the section `files`.
    folder : Path
        What the patterns lead on from.
    checksums : mapping of str to str, optional
        The SHA-256 of files by ``SCENE/`` and their path below the folder.

    Raises
    ------
    SourceError
        Where there is no such folder, or a pattern matches none of its files.
    """

    options: Mapping[str, Any] = {}
    captures_defocus = True

    def __init__(
        self, manifest: Manifest, folder: Path, checksums: Mapping[str, str] | None = None
    ) -> None:
        if manifest.files is None:
            raise SourceError("section is missing", where=f"{manifest.stem}: files")
        self._manifest = manifest
        self._files: CapturedFiles = manifest.files
        inside = folder / (manifest.files.inside or "")
        self._folder = inside if inside.is_dir() else folder
        self._checksums = checksums or {}
        self._endings: dict[str, dict[str, list[str]]] = {}
        self._names = {scene.name: scene.names for scene in manifest.scenes}
        problems = tuple(self._patterns_that_match_nothing())
        if problems:
            raise SourceError.of(problems)

    def available_pairs(self) -> tuple[Pair, ...]:
        """Return every pair: scenes whose files are missing are told when they are read."""
        return self._manifest.pairs()

    def signature(self, scene: str) -> str:
        """Return the SHA-256 over the scene's files."""
        digest = hashlib.sha256()
        problems: list[Problem] = []
        pairs = self._manifest.pairs_of_scene(scene)
        for named in dict.fromkeys(self._named(role, pair) for pair in pairs for role in ROLES):
            try:
                path = self._path(named)
                content = self._content(path)
                check_checksum(f"{scene}/{path}", content, self._checksums, self._where(path))
                digest.update(f"{path}\n{sha256(content)}\n".encode())
            except SourceError as error:
                problems += error.problems
        if problems:
            raise SceneError.of(problems)
        return digest.hexdigest()

    def read(self, scene: str) -> SceneImages:
        """Read one scene; its images are aligned and matched as the manifest asks."""
        captured: dict[Pair, CapturedPair] = {}
        problems: list[Problem] = []
        for pair in self._manifest.pairs_of_scene(scene):
            try:
                paths = {role: self._path(self._named(role, pair)) for role in ROLES}
                captured[pair] = captured_pair(
                    {role: self._content(path) for role, path in paths.items()},
                    {role: self._where(path) for role, path in paths.items()},
                    self._files,
                    self._manifest.depth,
                )
            except SourceError as error:
                problems += error.problems
        sizes = {pair.id: found.levels.shape for pair, found in captured.items()}
        if len(set(sizes.values())) > 1:
            problems.append(Problem("pairs of a scene differ in size", where=scene, got=str(sizes)))
        if problems:
            raise SceneError.of(dict.fromkeys(problems))
        return self._gathered(captured)

    def missing_help(self, missing: tuple[Pair, ...]) -> str:
        """Return what to do about scenes that were left out."""
        return "mend what is named above, or accept the rest: --allow-missing"

    def _gathered(self, captured: Mapping[Pair, CapturedPair]) -> SceneImages:
        axes, depth = self._manifest.axes, self._manifest.depth
        extent = tuple(len(values) for values in axes.values())
        shape = next(iter(captured.values())).levels.shape
        infocus, defocus = (np.zeros((*extent, *shape, 3), np.uint8) for _ in range(2))
        available = np.zeros(extent, bool)
        levels = np.zeros((*(len(axes[axis]) for axis in depth.axes), *shape), np.uint8)
        valid = np.ones(levels.shape, bool)
        seen = np.zeros(levels.shape[:-2], bool)
        for pair, found in captured.items():
            at = tuple(axes[axis].index(value) for axis, value in pair.coordinates)
            infocus[at], defocus[at], available[at] = found.infocus, found.defocus, True
            at = tuple(axes[axis].index(pair.at[axis]) for axis in depth.axes)
            # Pairs that share a depth map may cover different parts of it once they are aligned.
            levels[at], valid[at], seen[at] = found.levels, valid[at] & found.known, True
        valid[~seen] = False
        levels[~valid] = depth.unknown
        told = {pair.id: found.found for pair, found in captured.items() if found.found}
        warnings = tuple(text for found in captured.values() for text in found.warnings)
        return SceneImages.of_pairs(infocus, levels, valid, available, defocus, told, warnings)

    def _named(self, role: str, pair: Pair) -> str:
        values = {**self._names[pair.scene], "scene": pair.scene}
        values |= {axis: str(value) for axis, value in pair.coordinates}
        return fill(self._files.pattern_of(role), values)

    def _path(self, named: str) -> str:
        found = self._fitting(named)
        if len(found) > 1:
            raise SourceError(
                "several files fit the pattern",
                where=self._where(named),
                got=listed(found, _NAMED),
                fix="remove all but one, or write the ending into the manifest's pattern",
            )
        return found[0] if found else named

    def _fitting(self, named: str) -> list[str]:
        """Return the files that a filled pattern may mean."""
        if not named.endswith(ANY_ENDING):
            return [named] if (self._folder / named).is_file() else []
        parent, _, stem = named.removesuffix(ANY_ENDING).rpartition("/")
        # Listed once: a folder may hold every scene.
        if parent not in self._endings:
            self._endings[parent] = _endings_in(self._folder / parent)
        endings = self._endings[parent].get(stem, ())
        return [f"{parent}/{stem}{end}".lstrip("/") for end in endings]

    def _where(self, path: str) -> str:
        return str(self._folder / path)

    def _content(self, path: str) -> bytes:
        try:
            return read_whole(self._folder / path, LARGEST_ARRAY)
        except OSError as error:
            lacking = isinstance(error, FileNotFoundError)
            raise SourceError(
                "a file is missing" if lacking else "cannot read the file",
                where=self._where(path),
                got="" if lacking else reason_of(error),
            ) from error

    def _patterns_that_match_nothing(self) -> Iterator[Problem]:
        if not self._folder.is_dir():
            yield Problem(
                "a file, and not a folder" if self._folder.exists() else "no such folder",
                where=str(self._folder),
                fix="name the folder that holds the scenes: --source DIR",
            )
            return
        for role in ROLES:
            paths = [self._named(role, pair) for pair in self._manifest.pairs()]
            if not any(self._fitting(path) for path in paths):
                yield Problem(
                    f"the pattern of files.{role} matches no file",
                    where=str(self._folder),
                    expected=f"{self._files.pattern_of(role)}, as {paths[0]}",
                    got=_what_is_in(self._folder),
                    fix=f"mend files.{role} in the manifest, or name another folder",
                )


def _endings_in(folder: Path) -> dict[str, list[str]]:
    """Return the endings of the files that can be read, by the rest of their names."""
    found: dict[str, list[str]] = {}
    for path in sorted(folder.iterdir()) if folder.is_dir() else ():
        if path.suffix.lower() in SUFFIXES and path.is_file():
            found.setdefault(path.stem, []).append(path.suffix)
    return found


def _what_is_in(folder: Path) -> str:
    """Return some of what lies in a folder, one file of each kind of place first."""
    kinds: dict[tuple[int, str], str] = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            inside = path.relative_to(folder)
            kinds.setdefault((len(inside.parts), inside.parts[0] + path.suffix), inside.as_posix())
    return listed(kinds.values(), _NAMED) or "nothing"
