"""Read a captured set that its manifest describes: pairs or stacks, and a depth map each."""

import hashlib
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from dfdbench.building.fetching import check_checksum, sha256
from dfdbench.building.sources import SceneError, SceneImages, Whole, gathered
from dfdbench.building.sources.captured_images import CapturedImages, File, captured_images
from dfdbench.building.sources.image_files import SUFFIXES
from dfdbench.building.sources.image_table import TakenImage, read_table, taken_images
from dfdbench.datasets.captured_files import ANY_ENDING, BY_IMAGE, CapturedFiles, fill
from dfdbench.datasets.captures import ImageFacts
from dfdbench.datasets.manifest import Manifest, Pair
from dfdbench.errors import Problem, SourceError, reason_of
from dfdbench.system.files import LARGEST_ARRAY, read_whole
from dfdbench.tables.table import listed

# Entries of a folder that a message names, and files that a scene lacks.
_NAMED, _LACKED = 8, 3
_MISSING = "a file is missing"


class FolderScenes(Whole):
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

    captures_defocus = True

    def __init__(
        self, manifest: Manifest, folder: Path, checksums: Mapping[str, str] | None = None
    ) -> None:
        assert manifest.files is not None  # reading the manifest checked that
        super().__init__(manifest)
        self._files: CapturedFiles = manifest.files
        inside = folder / (manifest.files.inside or "")
        self._folder = inside if inside.is_dir() else folder
        self._checksums = checksums or {}
        self._endings: dict[str, dict[str, list[str]]] = {}
        self._names = {scene.name: scene.names for scene in manifest.scenes}
        SourceError.raise_if(self._patterns_that_match_nothing())

    def signature(self, scene: str) -> str:
        """Return the SHA-256 over the scene's files."""
        digest = hashlib.sha256()
        problems: list[Problem] = []
        named: dict[str, None] = {}
        for pair in self._manifest.pairs_of_scene(scene):
            with gathered(problems):
                others = (self._named(what, pair) for what in ("depth", "metadata"))
                images = (image.path for image in self._taken(pair))
                named |= dict.fromkeys((*images, *filter(None, others)))
        for name in named:
            with gathered(problems):
                path = self._path(name)
                content = self._content(path)
                check_checksum(f"{scene}/{path}", content, self._checksums, self._where(path))
                digest.update(f"{path}\n{sha256(content)}\n".encode())
        if problems:
            raise SceneError.of(_missing_together(dict.fromkeys(problems)))
        return digest.hexdigest()

    def read(self, scene: str) -> SceneImages:
        """Read one scene; its images are aligned and matched as the manifest asks."""
        captured: dict[Pair, CapturedImages] = {}
        taken: dict[Pair, list[TakenImage]] = {}
        problems: list[Problem] = []
        for pair in self._manifest.pairs_of_scene(scene):
            with gathered(problems):
                taken[pair] = self._taken(pair)
                photographs = [self._file(image.path) for image in taken[pair]]
                depth = self._named("depth", pair)
                truth = self._file(depth) if depth else None
                about = self._manifest.depth
                captured[pair] = captured_images(photographs, truth, self._files, about)
        kinds = {
            pair.id: (found.images.shape, found.images.dtype, [one.role for one in taken[pair]])
            for pair, found in captured.items()
        }
        if any(kind != next(iter(kinds.values())) for kind in kinds.values()):
            got = "; ".join(f"{name} {kind[0][:3]}, {kind[1]}" for name, kind in kinds.items())
            what = "captures of a scene differ in the number, size, bits or roles of their images"
            problems.append(Problem(what, where=scene, got=got))
        if problems:
            raise SceneError.of(dict.fromkeys(problems))
        return self._gathered(captured, taken)

    def missing_help(self, missing: tuple[Pair, ...]) -> str:
        """Return what to do about scenes that were left out."""
        return "mend what is named above, or accept the rest: --allow-missing"

    def _gathered(
        self, captured: Mapping[Pair, CapturedImages], taken: Mapping[Pair, list[TakenImage]]
    ) -> SceneImages:
        axes, depth = self._manifest.axes, self._manifest.depth
        extent = tuple(len(values) for values in axes.values())
        first = next(iter(captured.values()))
        images = np.zeros((*extent, *first.images.shape), first.images.dtype)
        available = np.zeros(extent, bool)
        facts = {name: np.full((*extent, len(first.images)), np.nan) for name in BY_IMAGE}
        known = np.full((*(len(axes[axis]) for axis in depth.axes), *first.depth.shape), np.nan)
        seen = np.zeros(known.shape[:-2], bool)
        notes: dict[str, Any] = {}
        for pair, found in captured.items():
            at = tuple(axes[axis].index(value) for axis, value in pair.coordinates)
            images[at], available[at] = found.images, True
            for name, values in facts.items():
                values[at] = [image.facts.get(name, np.nan) for image in taken[pair]]
            at = tuple(axes[axis].index(pair.at[axis]) for axis in depth.axes)
            # Pairs that share a depth map may cover different parts of it once they are aligned.
            known[at] = np.where(seen[at] & np.isnan(known[at]), np.nan, found.depth)
            seen[at] = True
            for number, how in enumerate(found.found, 1):
                if how:
                    notes[pair.id if len(found.found) == 1 else f"{pair.id}/image{number}"] = how
        warnings = tuple(text for found in captured.values() for text in found.warnings)
        roles = tuple(image.role for image in next(iter(taken.values())))
        return SceneImages(
            images, known.astype(np.float32), available, ImageFacts(roles, **facts), notes, warnings
        )

    def _taken(self, pair: Pair) -> list[TakenImage]:
        return taken_images(self._manifest, self._values(pair), self._table(pair), self._folder)

    def _table(self, pair: Pair) -> tuple[list[dict[str, str]], str] | None:
        named = self._named("metadata", pair)
        if named is not None:
            content, where = self._file(named)
            return read_table(content, where, self._files.columns), where
        rows = [{name: str(cell) for name, cell in row.items()} for row in self._files.image]
        return (rows, f"{self._manifest.stem}: files.image") if rows else None

    def _values(self, pair: Pair) -> dict[str, str]:
        return self._files.values_of(pair.scene, self._names[pair.scene], pair.at)

    def _named(self, what: str, pair: Pair) -> str | None:
        pattern = self._files.patterns.get(what)
        return None if pattern is None else fill(pattern, self._values(pair))

    def _file(self, named: str) -> File:
        path = self._path(named)
        return self._content(path), self._where(path)

    def _path(self, named: str) -> str:
        found = self._fitting(named)
        if len(found) > 1:
            what = f"several files fit the pattern: {listed(found, _NAMED)}"
            fix = "remove all but one, or write the ending into the manifest's pattern"
            raise SourceError(what, where=self._where(named), fix=fix)
        return found[0] if found else named

    def _fitting(self, named: str) -> list[str]:
        """Return the files that a filled pattern may mean."""
        if not named.endswith(ANY_ENDING):
            return [named] if (self._folder / named).is_file() else []
        parent, _, stem = named.removesuffix(ANY_ENDING).rpartition("/")
        # Listed once: a folder may hold every scene.
        if parent not in self._endings:
            self._endings[parent] = _endings_in(self._folder / parent)
        return [f"{parent}/{stem}{end}".lstrip("/") for end in self._endings[parent].get(stem, ())]

    def _where(self, path: str) -> str:
        return str(self._folder / path)

    def _content(self, path: str) -> bytes:
        try:
            return read_whole(self._folder / path, LARGEST_ARRAY)
        except OSError as error:
            lacking = isinstance(error, FileNotFoundError)
            what = _MISSING if lacking else f"cannot read the file: {reason_of(error)}"
            raise SourceError(what, where=self._where(path)) from error

    def _patterns_that_match_nothing(self) -> Iterator[Problem]:
        if not self._folder.is_dir():
            what = "a file, and not a folder" if self._folder.exists() else "no such folder"
            fix = "name the folder that holds the scenes: --source DIR"
            yield Problem(what, where=str(self._folder), fix=fix)
            return
        for what, pattern in self._files.patterns.items():
            if what == "images":
                # They are checked with the table, scene by scene.
                continue
            paths = [self._named(what, pair) or "" for pair in self._manifest.pairs()]
            if paths and not any(self._fitting(path) for path in paths):
                what = f"no file matches files.{what}, {pattern}, as {paths[0]}"
                fix = "mend the pattern in the manifest, or name another folder"
                yield Problem(what, where=str(self._folder), got=what_is_in(self._folder), fix=fix)


def _missing_together(problems: Iterable[Problem]) -> Iterator[Problem]:
    """Yield what is wrong with a scene; many files that it lacks are one problem."""
    found = list(problems)
    lacking = [problem for problem in found if problem.what == _MISSING]
    if len(lacking) > _LACKED:
        paths = [Path(problem.where) for problem in lacking]
        named = listed((path.name for path in paths), _LACKED)
        lacking = [
            Problem(f"{len(paths)} files are missing", where=str(paths[0].parent), got=named)
        ]
    yield from (*lacking, *(problem for problem in found if problem.what != _MISSING))


def _endings_in(folder: Path) -> dict[str, list[str]]:
    """Return the endings of the files that can be read, by the rest of their names."""
    found: dict[str, list[str]] = {}
    for path in sorted(folder.iterdir()) if folder.is_dir() else ():
        if path.suffix.lower() in SUFFIXES and path.is_file():
            found.setdefault(path.stem, []).append(path.suffix)
    return found


def what_is_in(folder: Path) -> str:
    """Return some of what lies in a folder, one file of each kind of place first."""
    kinds: dict[tuple[int, str], str] = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            inside = path.relative_to(folder)
            kinds.setdefault((len(inside.parts), inside.parts[0] + path.suffix), inside.as_posix())
    return listed(kinds.values(), _NAMED) or "nothing"
