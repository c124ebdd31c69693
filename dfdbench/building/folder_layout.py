"""Guess how a folder of captures is laid out: which files belong to one scene, by their names."""

import re
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import chain
from pathlib import Path, PurePosixPath

from dfdbench.building.sources.image_files import ARRAYS, SUFFIXES
from dfdbench.datasets.captured_files import ANY_ENDING
from dfdbench.errors import InputError, reason_of

#: What a depth file's path says.
DEPTH = re.compile(r"depth|disp|dist|range|lidar|tof|kinect|xtion|truth|(?<![a-z])gt(?![a-z])")
_SPLITS = ("train", "training", "test", "testing", "val", "validation")
# With more kinds of files than this, or more kinds of depth if there is any, the guess is wrong.
_MOST_GROUPS = 10
_ROLES = 3
# Kinds of files that are named where they are not read.
_NAMED = 6
# A file's whole name is the scene's, or its start, or its end.
_FORMS = (
    r"(?P<scene>.*)",
    r"(?P<scene>.+[^_\-.])[_\-.][A-Za-z][^_\-.]*",
    r"[A-Za-z][^_\-.]*[_\-.](?P<scene>.+)",
)

#: The part of a set that a scene lies in, "" where there are none, and the scene's name.
Key = tuple[str, str]


@dataclass(frozen=True)
class Group:
    """Files of one kind, one a scene.

    Parameters
    ----------
    pattern : str
        Where they are, with ``{scene}``, and ``{split}`` if folders are named after splits; it
        ends in ``.*`` if their endings differ.
    files : dict
        Each scene's file below the folder, by split and scene.
    """

    pattern: str
    files: dict[Key, str]

    @property
    def is_depth(self) -> bool:
        """Whether their names say that they are depth maps."""
        return bool(DEPTH.search(self.pattern.lower()))


@dataclass(frozen=True)
class Layout:
    """How a folder's files go together.

    Parameters
    ----------
    groups : tuple of Group
        Kinds of files, each with the same scenes; those with most first.
    scenes : tuple of Key
        The scenes that three groups or more have, in order.
    by_order : bool
        Whether files go together by their order alone, since their names differ.
    left : tuple of str
        Image files that belong to no scene.
    """

    groups: tuple[Group, ...]
    scenes: tuple[Key, ...]
    by_order: bool
    left: tuple[str, ...]

    def of_scenes(self, scenes: tuple[Key, ...]) -> "Layout":
        """Return the layout of some of the scenes; the files of others are left."""
        kept = [
            Group(group.pattern, {key: group.files[key] for key in scenes if key in group.files})
            for group in self.groups
        ]
        others = {path for group in self.groups for path in group.files.values()}
        others -= {path for group in kept for path in group.files.values()}
        left = tuple(sorted({*self.left, *others}))
        return Layout(tuple(g for g in kept if g.files), scenes, self.by_order, left)


def image_files(folder: Path) -> tuple[str, ...]:
    """Return the images and depth arrays below a folder, sorted, hidden ones left out."""
    return tuple(sorted(p.as_posix() for p in shown_files(folder) if _is_read(p)))


def _is_read(path: PurePosixPath) -> bool:
    end = path.suffix.lower()
    return end in SUFFIXES or (end in ARRAYS and bool(DEPTH.search(path.as_posix().lower())))


def unread_files(folder: Path) -> str:
    """Say which other files lie below a folder, by how their names end; empty where none do.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as place:
    ...     for name in ("a.png", "a.npy", "b.npy", "notes"):
    ...         Path(place, name).touch()
    ...     unread_files(Path(place))
    'not read: 2 .npy, 1 without an ending'
    """
    ends = Counter(path.suffix.lower() for path in shown_files(folder) if not _is_read(path))
    others = ends.most_common(_NAMED)
    named = ", ".join(f"{count} {end or 'without an ending'}" for end, count in others)
    return f"not read: {named}" if named else ""


def shown_files(folder: Path) -> Iterator[PurePosixPath]:
    """Yield the files below a folder, as paths below it, hidden ones left out."""
    try:
        for path in folder.rglob("*"):
            below = path.relative_to(folder)
            if path.is_file() and not any(part.startswith(".") for part in below.parts):
                yield PurePosixPath(below)
    except OSError as error:
        what = f"cannot look into the folder: {reason_of(error)}"
        fix = "name the folder of the captures alone"
        raise InputError(what, where=str(error.filename or folder), fix=fix) from error


def find_layout(paths: tuple[str, ...]) -> Layout | None:
    """Return how files go together, by the names that most scenes have in common.

    Scenes are told by a folder's name, a file's name, its start or its end; where file names have
    nothing in common, folders with the same number of files go together by their order.

    Parameters
    ----------
    paths : tuple of str
        Image files below the folder.

    Returns
    -------
    Layout or None
        None where no scene has three files.

    Examples
    --------
    >>> layout = find_layout(("d/1.png", "d/2.png", "f2/1.jpg", "f2/2.jpg", "f8/1.jpg", "f8/2.jpg"))
    >>> [group.pattern for group in layout.groups], layout.scenes
    (['d/{scene}.png', 'f2/{scene}.jpg', 'f8/{scene}.jpg'], (('', '1'), ('', '2')))
    """
    layouts = [_layout(paths, partial(_by_name, form)) for form in _FORMS]
    whole = [*folder_layouts(paths), *(layout for layout in layouts if layout)]
    # A scene with a depth file and two others cannot be a kind of files read as a scene.
    order = [(_with_depth(each.groups), len(each.scenes), -len(each.groups)) for each in whole]
    return whole[order.index(max(order))] if whole else _by_order(paths)


def folder_layouts(paths: tuple[str, ...], least: int = _ROLES) -> list[Layout]:
    """Return how files go together if a folder's name tells the scene, of `least` files or more."""
    depth = max((path.count("/") for path in paths), default=0)
    layouts = [_layout(paths, partial(_by_folder, level), least) for level in range(depth)]
    return [layout for layout in layouts if layout]


def single_scene(paths: tuple[str, ...], name: str) -> Layout:
    """Return a layout of one scene that all files belong to."""
    key = ("", name)
    return Layout(tuple(Group(path, {key: path}) for path in paths), (key,), False, ())


def _with_depth(groups: tuple[Group, ...]) -> int:
    depths: set[Key] = set()
    others: Counter[Key] = Counter()
    for group in groups:
        (depths if group.is_depth else others).update(list(group.files))
    return sum(others[key] >= _ROLES - 1 for key in depths)


def _by_folder(level: int, path: PurePosixPath) -> tuple[str, str] | None:
    """Return a file's pattern and its scene, told by a folder's name; None if it has none."""
    parts = list(path.parts)
    if level >= len(parts) - 1 or parts[level] == "{split}":
        return None
    scene, parts[level] = parts[level], "{scene}"
    return "/".join(parts), scene


def _by_name(form: str, path: PurePosixPath) -> tuple[str, str] | None:
    """Return a file's pattern and its scene, told by its own name."""
    match = re.fullmatch(form, path.stem, re.DOTALL)
    if match is None:
        return None
    start, end = match.span("scene")
    stem = f"{path.stem[:start]}{{scene}}{path.stem[end:]}"
    return str(path.with_name(stem + path.suffix)), match["scene"]


def _split_of(path: str) -> tuple[PurePosixPath, str]:
    parts = list(PurePosixPath(path).parts)
    for level, part in enumerate(parts[:-1]):
        if part.lower() in _SPLITS:
            parts[level] = "{split}"
            return PurePosixPath(*parts), part
    return PurePosixPath(path), ""


def _layout(
    paths: tuple[str, ...],
    reading: Callable[[PurePosixPath], tuple[str, str] | None],
    least: int = _ROLES,
) -> Layout | None:
    found: dict[str, dict[Key, str]] = defaultdict(dict)
    for path in paths:
        told, split = _split_of(path)
        read = reading(told)
        if read:
            found[read[0]][split, read[1]] = path
    found = _endings_joined(found)
    times = Counter(key for files in found.values() for key in files)
    scenes = tuple(sorted(key for key, count in times.items() if count >= least))
    groups = {
        pattern: {key: files[key] for key in scenes if key in files}
        for pattern, files in found.items()
        if any(key in files for key in scenes)
    }
    layout = _sorted(groups, scenes, False, paths)
    depths = [group for group in layout.groups if group.is_depth]
    limited = depths if _with_depth(layout.groups) else layout.groups
    return layout if scenes and len(limited) <= _MOST_GROUPS else None


def _endings_joined(found: dict[str, dict[Key, str]]) -> dict[str, dict[Key, str]]:
    """Join kinds of images that differ in nothing but their endings and have no scene in common."""
    alike: dict[str, list[str]] = defaultdict(list)
    for pattern in found:
        is_array = pattern.lower().endswith(ARRAYS)
        alike[pattern if is_array else str(PurePosixPath(pattern).with_suffix(""))].append(pattern)
    joined: dict[str, dict[Key, str]] = {}
    for base, patterns in alike.items():
        together = {key: file for pattern in patterns for key, file in found[pattern].items()}
        if len(patterns) > 1 and len(together) == sum(len(found[each]) for each in patterns):
            joined[base + ANY_ENDING] = together
        else:
            joined |= {pattern: found[pattern] for pattern in patterns}
    return joined


def _by_order(paths: tuple[str, ...]) -> Layout | None:
    named: dict[str, dict[Key, str]] = defaultdict(dict)
    for path in paths:
        told, split = _split_of(path)
        named[str(told.with_name("{scene}" + told.suffix))][split, told.stem] = path
    folders: dict[str, dict[str, list[str]]] = defaultdict(lambda: defaultdict(list))
    for pattern, files in _endings_joined(named).items():
        for (split, _), path in files.items():
            folders[pattern][split].append(path)
    sizes = Counter(_sizes(files) for files in folders.values())
    common, times = max(sizes.items(), key=lambda item: item[1], default=((), 0))
    if times < _ROLES:
        return None
    scenes = tuple(
        (split, f"{number:0{len(str(count))}}")
        for split, count in common
        for number in range(1, count + 1)
    )
    groups = {
        pattern: dict(zip(scenes, chain(*(in_order(files[s]) for s in sorted(files))), strict=True))
        for pattern, files in folders.items()
        if _sizes(files) == common
    }
    return _sorted(groups, scenes, True, paths)


def _sizes(files: dict[str, list[str]]) -> tuple[tuple[str, int], ...]:
    return tuple(sorted((split, len(found)) for split, found in files.items()))


def in_order(paths: Iterable[str]) -> list[str]:
    """Return paths as cameras count: 2 comes before 10."""

    def key(path: str) -> list[tuple[int, str]]:
        parts = re.findall(r"\d+|\D+", path)
        return [(int(part), "") if part.isdigit() else (-1, part) for part in parts]

    return sorted(paths, key=key)


def _sorted(
    groups: dict[str, dict[Key, str]],
    scenes: tuple[Key, ...],
    by_order: bool,
    paths: tuple[str, ...],
) -> Layout:
    kinds = [Group(pattern, files) for pattern, files in groups.items()]
    kinds.sort(key=lambda group: (-len(group.files), group.pattern))
    used = {path for group in kinds for path in group.files.values()}
    return Layout(tuple(kinds), scenes, by_order, tuple(p for p in paths if p not in used))
