"""Read a captured set described by its manifest: pairs or stacks with a depth map each."""

import hashlib
import math
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from dfdbench.building.fetching import check_checksum, sha256
from dfdbench.building.sources import SceneError, SceneImages, Whole, gathered, laid_out
from dfdbench.building.sources import captured_images as made
from dfdbench.building.sources.captured_images import CapturedImages
from dfdbench.building.sources.image_files import SUFFIXES
from dfdbench.building.sources.image_table import number_in, read_table
from dfdbench.datasets.captured_files import ANY_ENDING, BY_IMAGE, IMAGE, fill, places_in
from dfdbench.datasets.captures import ROLES, ImageFacts, Role
from dfdbench.datasets.depth_scale import DepthScale
from dfdbench.datasets.manifest import Manifest, Pair
from dfdbench.errors import Problem, SourceError, reason_of
from dfdbench.system.files import LARGEST_ARRAY, leads_outside, read_whole
from dfdbench.tables.table import listed

# How many entries of a folder, and how many missing files of a scene, a message names.
_NAMED, _LACKED = 8, 3
_IMAGES_NAMED = 4
_MISSING = "a file is missing"
# A stack's focus is implausible if it is off by this factor: beyond the farthest depth, or nearer
# than the nearest.
_FAR_OFF = 10

Row = Mapping[str, str]


@dataclass(frozen=True)
class _Taken:
    """An image of a capture: its path, its role, and what is known of it, by `BY_IMAGE`."""

    path: str
    role: Role
    facts: dict[str, float]


class FolderScenes(Whole):
    """Scenes below a folder, found by the patterns in the manifest's section `files`.

    Parameters
    ----------
    manifest : Manifest
        With a section `files`.
    folder : Path
        The folder that the patterns are relative to.
    checksums : mapping of str to str, optional
        The SHA-256 of files, by ``SCENE/`` and their path below the folder.

    Raises
    ------
    SourceError
        If there is no such folder, or a pattern matches none of its files.
    """

    def __init__(
        self, manifest: Manifest, folder: Path, checksums: Mapping[str, str] | None = None
    ) -> None:
        assert manifest.files is not None  # reading the manifest checked that
        super().__init__(manifest)
        self.captures_defocus = manifest.recipe is None
        self._files = manifest.files
        self._folder = manifest.files.folder_in(folder)
        self._checksums = checksums or {}
        self._endings: dict[str, dict[str, list[str]]] = {}
        self._names = {scene.name: scene.names for scene in manifest.scenes}
        SourceError.raise_if(self._patterns_that_match_nothing())

    def signature(self, scene: str) -> str:
        """Return the SHA-256 over the scene's files."""
        digest = hashlib.sha256()
        problems: list[Problem] = []
        named: dict[str, None] = {}
        for pair in self._manifest.pairs(scene):
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
        SceneError.raise_if(_missing_together(dict.fromkeys(problems)))
        return digest.hexdigest()

    def read(self, scene: str) -> SceneImages:
        """Read one scene; its images are aligned and matched as the manifest asks."""
        captured: dict[Pair, CapturedImages] = {}
        taken: dict[Pair, list[_Taken]] = {}
        problems: list[Problem] = []
        for pair in self._manifest.pairs(scene):
            with gathered(problems):
                taken[pair] = self._taken(pair)
                photographs = [self._file(image.path) for image in taken[pair]]
                depth = self._named("depth", pair)
                truth = self._file(depth) if depth else None
                about = self._manifest.depth
                captured[pair] = made.captured_images(photographs, truth, self._files, about)
        kinds = {
            pair.id: (found.images.shape, found.images.dtype, [one.role for one in taken[pair]])
            for pair, found in captured.items()
        }
        if any(kind != next(iter(kinds.values())) for kind in kinds.values()):
            got = "; ".join(f"{name} {kind[0][:3]}, {kind[1]}" for name, kind in kinds.items())
            what = "captures of a scene differ in the number, size, bits or roles of their images"
            problems.append(Problem(what, where=scene, got=got))
        SceneError.raise_if(dict.fromkeys(problems))
        return self._gathered(captured, taken)

    def missing_help(self, missing: tuple[Pair, ...]) -> str:
        """Say what to do about scenes that were left out."""
        return "mend what is named above, or accept the rest: --allow-missing"

    def _gathered(
        self, captured: Mapping[Pair, CapturedImages], taken: Mapping[Pair, list[_Taken]]
    ) -> SceneImages:
        axes, depth = self._manifest.axes, self._manifest.depth
        extent = tuple(len(values) for values in axes.values())
        first = next(iter(captured.values()))
        images, available = laid_out(
            self._manifest, {pair: found.images for pair, found in captured.items()}
        )
        facts = {name: np.full((*extent, len(first.images)), np.nan) for name in BY_IMAGE}
        known = np.full((*(len(axes[axis]) for axis in depth.axes), *first.depth.shape), np.nan)
        seen = np.zeros(known.shape[:-2], bool)
        notes: dict[str, Any] = {}
        for pair, found in captured.items():
            at = tuple(axes[axis].index(value) for axis, value in pair.coordinates)
            for name, values in facts.items():
                values[at] = [image.facts[name] for image in taken[pair]]
            at = tuple(axes[axis].index(pair.at[axis]) for axis in depth.axes)
            # Pairs that share a depth map may cover different parts of it once they are aligned.
            known[at] = np.where(seen[at] & np.isnan(known[at]), np.nan, found.depth)
            seen[at] = True
            for number, how in enumerate(found.found, 1):
                if how:
                    notes[pair.id if len(found.found) == 1 else f"{pair.id}/image{number}"] = how
        warnings: tuple[str, ...] = ()
        for pair, found in captured.items():
            told = [image.facts for image in taken[pair]]
            rises = depth.kind == "metres" or depth.grows_with == "distance"
            odd = made.misordered(pair.id, found, told, rises)
            warnings += (*found.warnings, *odd)
        roles = tuple(image.role for image in next(iter(taken.values())))
        return SceneImages(
            images, known.astype(np.float32), available, ImageFacts(roles, **facts), notes, warnings
        )

    def _taken(self, pair: Pair) -> list[_Taken]:
        """Return a capture's images: in focus first, then from the farthest to the nearest focus.

        Raises
        ------
        SourceError
            With everything that is wrong: invalid numbers, images missing from the table or the
            folder, a focus that occurs twice or is nearer than the focal length, a single image.
        """
        files, values, table = self._files, self._values(pair), self._table(pair)
        taken: list[_Taken] = []
        if files.infocus is not None:
            path = fill(files.infocus, values)
            taken.append(_Taken(path, "infocus", dict.fromkeys(BY_IMAGE, math.nan)))
        where, problems = str(self._folder), list[Problem]()
        rows: Iterable[tuple[str, Row]] = (
            [(fill(files.defocus, values), {})] if files.defocus else ()
        )
        if files.images is not None:
            pattern = fill(files.images, values)
            where = table[1] if table else str(self._folder / pattern)
            there = _numbered(self._folder, pattern)
            for image in taken:
                there.pop(image.path, None)
            known = {image.path for image in taken}
            of_all = not places_in(files.metadata or "")
            found = _rows(pattern, table, there, problems, of_all)
            rows = [one for one in found if one[0] not in known]
        for path, row in rows:
            try:
                taken.append(self._image(path, {**values, **row}))
            except ValueError as error:
                problems.append(
                    Problem(str(error), where=where, got=f"{'row of ' * bool(table and row)}{path}")
                )
        # What was refused is not told as lacking, too.
        if self.captures_defocus and (len(taken) > 1 or not problems):
            problems += _odd_ones(taken, where, self._manifest.pair_images or ())
        problems += _in_another_unit(taken, where, self._manifest.depth.scale)
        SourceError.raise_if(problems)
        near, far = self._manifest.depth.ends
        return sorted(taken, key=lambda image: _place(image, 1 if near > far else -1))

    def _image(self, path: str, values: Row) -> _Taken:
        facts = {}
        for name in BY_IMAGE:
            stated = getattr(self._files, name)
            text = values.get(name, "") if stated is None else _filled(str(stated), values)
            may_be_0 = name == "focus_distance" and self._files.focus_unit == "dioptres"
            facts[name] = _number(name, text, may_be_0) if text else math.nan
        unit, told = self._files.focus_unit, facts["focus_distance"]
        metres = told * unit if unit != "dioptres" else 1 / told if told else math.inf
        facts["focus_distance"] = round(metres, 12)
        rig = self._manifest.rig
        focal_length = (rig and rig.focal_length) or 0.0
        if facts["focus_distance"] <= focal_length:
            focus = f"focus_distance {facts['focus_distance']:g} m"
            raise ValueError(f"{focus} is not beyond the focal length, {focal_length:g} m")
        focused = np.array(facts["focus_depth"])
        facts["focus_depth"] = float(made.in_unit_of(focused, self._files, self._manifest.depth))
        role = values.get("role") or "defocus"
        if role not in ROLES:
            raise ValueError(f"role {role} is neither {' nor '.join(ROLES)}")
        return _Taken(path, ROLES[ROLES.index(role)], facts)

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

    def _file(self, named: str) -> tuple[bytes, str]:
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
        """Return the files that a filled pattern may match."""
        _require_inside(self._folder, named)
        if not named.endswith(ANY_ENDING):
            return [named] if (self._folder / named).is_file() else []
        parent, _, stem = named.removesuffix(ANY_ENDING).rpartition("/")
        # List each folder only once: it may hold every scene.
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
                # These are checked with the table, scene by scene.
                continue
            paths = [self._named(what, pair) or "" for pair in self._manifest.pairs()]
            if paths and not any(self._fitting(path) for path in paths):
                what = f"no file matches files.{what}, {pattern}, as {paths[0]}"
                fix = "mend the pattern in the manifest, or name another folder"
                yield Problem(what, where=str(self._folder), got=what_is_in(self._folder), fix=fix)


def _missing_together(problems: Iterable[Problem]) -> Iterator[Problem]:
    """Yield a scene's problems; if it lacks many files, that is one problem."""
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
    """Return the endings of the readable files, by the rest of their names."""
    found: dict[str, list[str]] = {}
    for path in sorted(folder.iterdir()) if folder.is_dir() else ():
        if path.suffix.lower() in SUFFIXES and path.is_file():
            found.setdefault(path.stem, []).append(path.suffix)
    return found


def what_is_in(folder: Path) -> str:
    """Name some of a folder's files, first one from each kind of place."""
    kinds: dict[tuple[int, str], str] = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            inside = path.relative_to(folder)
            kinds.setdefault((len(inside.parts), inside.parts[0] + path.suffix), inside.as_posix())
    return listed(kinds.values(), _NAMED) or "nothing"


def _filled(pattern: str, values: Row) -> str:
    lacking = [name for name in places_in(pattern) if name not in values]
    if lacking:
        raise ValueError(f"the table has no column {lacking[0]}: it has {', '.join(values)}")
    return fill(pattern, values)


def _number(name: str, text: str, may_be_0: bool) -> float:
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    below = number < 0 or (number == 0 and not may_be_0)
    if math.isnan(number) or (name != "focus_depth" and below):
        raise ValueError(f"{name} is {text!r}, and not a number{' above 0' * (name[-1] != 'h')}")
    return number


def _rows(
    pattern: str,
    table: tuple[Sequence[Row], str] | None,
    there: Mapping[str, str],
    problems: list[Problem],
    of_all: bool,
) -> Iterator[tuple[str, Row]]:
    """Yield the files of a stack with their rows; add mismatches to `problems`.

    A table `of_all` scenes may have rows of other stacks, by their files' names.
    """
    numbered = IMAGE in places_in(pattern)
    if table is None:
        yield from ((path, {IMAGE: number}) for path, number in there.items())
        return
    rows, where = _with_files_as_images(table[0], there, of_all), table[1]
    if numbered and IMAGE not in rows[0] and len(rows) != len(there):
        what = f"the table has {len(rows)} rows, and there are {len(there)} images"
        problems.append(Problem(what, where=where, got=listed(there, _IMAGES_NAMED)))
        return
    in_order, by_number = list(there), {number_in(text): path for path, text in there.items()}
    # A missing image is named with as many digits as the others.
    place = f"{{{IMAGE}}}"
    least = min((len(PurePosixPath(path).stem) for path in there), default=0)
    stem = PurePosixPath(pattern).stem
    digits = least - len(stem) + len(place) if place in stem else 0
    named = set()
    for index, row in enumerate(rows):
        try:
            if not numbered:
                path = _filled(pattern, row)
            elif IMAGE in row:
                cell = row[IMAGE]
                path = pattern.replace(place, cell.zfill(digits))
                if (number := number_in(cell)) is None:
                    path = str(PurePosixPath(pattern).parent / cell)
                path = by_number.get(number, path)
            else:
                path = in_order[index]
        except ValueError as error:
            problems.append(Problem(str(error), where=where))
            continue
        if path in named:
            problems.append(Problem(f"the table tells of {path} twice", where=where))
        named.add(path)
        # What names the file's number wants it, also where the row has the file's name, or none.
        yield path, {**row, IMAGE: there[path]} if numbered and path in there else row
    lacking = [p for p in there if not {p, str(PurePosixPath(p).with_suffix(ANY_ENDING))} & named]
    if lacking:
        what = f"images that the table does not tell of: {listed(lacking, _IMAGES_NAMED)}"
        problems.append(Problem(what, where=where))


def _with_files_as_images(
    rows: Sequence[Row], there: Collection[str], of_all: bool
) -> Sequence[Row]:
    """Return a stack's rows with a column `image`, if one holds nothing but files' names."""
    names = {PurePosixPath(path).name for path in there}
    columns = [IMAGE] if IMAGE in rows[0] else [*rows[0]]
    fitting = []
    for column in columns if len(names) == len(there) else ():
        told = [{**row, IMAGE: row.get(column, "")} for row in rows]
        mine = [row for row in told if row[IMAGE] in names]
        distinct = {row[IMAGE] for row in mine}
        if len(mine) == len(distinct) and (mine == told or (of_all and distinct == names)):
            fitting.append(mine)
    # If several columns fit, one of them may name the image before or after.
    return fitting[0] if len(fitting) == 1 else rows


def _require_inside(folder: Path, named: str) -> None:
    """Raise if a filled pattern leads out of the folder, whatever a scene or a table filled in."""
    if leads_outside(named):
        what = f"the path leads outside the folder: {named}"
        fix = "mend the names in the manifest, or the table"
        raise SourceError(what, where=str(folder), fix=fix)


def _numbered(folder: Path, pattern: str) -> dict[str, str]:
    """Return the files that match a pattern, whatever replaces its braces, with their numbers."""
    _require_inside(folder, pattern)
    found = {"": "0"}
    for part in PurePosixPath(pattern).parts:
        found = dict(_matches(folder, part, found))
    there = {path: number for path, number in found.items() if (folder / path).is_file()}
    return dict(sorted(there.items(), key=lambda item: number_in(item[1]) or 0))


def _matches(folder: Path, part: str, above: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    """Yield what matches a part of a pattern in some folders, and the number in its path."""
    open_end = part.endswith(ANY_ENDING)
    expression = re.escape(part.removesuffix(ANY_ENDING))
    for place in places_in(part):
        number = "(?P=number)" if "(?P<" in expression else r"(?P<number>\d+(?:\.\d+)?)"
        group = number if place == IMAGE else ".+"
        expression = expression.replace(re.escape(f"{{{place}}}"), group, 1)
    for parent, number in above.items():
        if not (open_end or places_in(part)):
            yield f"{parent}/{part}".lstrip("/"), number
            continue
        for path in sorted((folder / parent).iterdir()) if (folder / parent).is_dir() else ():
            if open_end and path.suffix.lower() not in SUFFIXES:
                continue
            if match := re.fullmatch(expression, path.stem if open_end else path.name):
                told = match.groupdict().get("number") or number
                yield f"{parent}/{path.name}".lstrip("/"), told


def _odd_ones(taken: Sequence[_Taken], where: str, pair: Sequence[int]) -> Iterator[Problem]:
    if max(pair, default=0) >= len(taken) > 1:
        yield Problem(f"pair_images are {pair}, and there are {len(taken)} images", where=where)
    if len(taken) < 2:
        what = f"a stack of one image, {taken[0].path}" if taken else "no image fits the pattern"
        yield Problem(what, where=where)
    seen: dict[tuple[float, ...], str] = {}
    for image in taken:
        at = tuple(image.facts[name] for name in BY_IMAGE)
        if image.role == "infocus" or all(map(math.isnan, at[:2])):
            continue
        key = tuple(-1.0 if math.isnan(number) else number for number in at)
        other = seen.setdefault(key, image.path)
        if other != image.path:
            focus = at[1] if math.isnan(at[0]) else at[0]
            fix = f"leave {other} or {image.path} out of the table, or mend its focus"
            yield Problem(f"two images are focused at {focus:g}", where=where, fix=fix)


def _in_another_unit(
    taken: Sequence[_Taken], where: str, scale: DepthScale | None
) -> Iterator[Problem]:
    """Yield a problem if a stack is focused far from all depths: its table may be in mm."""
    found = sorted({d for image in taken if math.isfinite(d := image.facts["focus_distance"])})
    if scale is None or len(found) < 2:
        return
    if found[0] > _FAR_OFF * scale.far or found[-1] * _FAR_OFF < scale.near:
        what = f"focused at {found[0]:g} to {found[-1]:g} m, where depths are {scale.near:g} to"
        fix = "say their unit, focus_unit under [files], or mend near and far under [depth.scale]"
        yield Problem(f"{what} {scale.far:g} m", where=where, fix=fix)


def _place(image: _Taken, nearness: int) -> tuple[bool, float, float]:
    distance, depth = (image.facts[name] for name in BY_IMAGE[:2])
    return (
        image.role != "infocus",
        0.0 if math.isnan(distance) else -distance,
        0.0 if math.isnan(depth) else nearness * depth,
    )
