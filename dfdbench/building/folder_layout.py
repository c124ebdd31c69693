"""Guess from file names how a folder of captures is laid out: which files belong to a scene."""

import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import product, zip_longest
from pathlib import Path, PurePosixPath

from dfdbench.building.sources.image_files import ARRAYS, SUFFIXES
from dfdbench.building.sources.image_table import number_in, read_table
from dfdbench.datasets.captured_files import ANY_ENDING, IMAGE
from dfdbench.errors import InputError, SourceError, reason_of

#: Words in the path of a depth file.
DEPTH = re.compile(
    r"depth|(?<![^/])dpt|disp|dist|range|lidar|tof|kinect|xtion|truth|(?<![a-z])gt(?![a-z])"
)
_SPLITS = ("train", "training", "test", "testing", "val", "validation")
# The guess is wrong if there are more kinds of depth than this or, without depth, kinds of files.
_MOST_GROUPS, _ROLES = 10, 3
# Scenes with two photographs are few if there are more than so many times as many with one.
_FEW = 4
# How many kinds of files we name that are not read.
_NAMED = 6
# A word beside the scene's name, which may hold a number with a fraction: f2.8.
_WORD = r"[A-Za-z](?:[^ _\-./]|(?<=\d)\.(?=\d))*"
# The scene's name is a whole file name, its start or its end, or a folder's name at some depth.
_FORMS = tuple(
    rf"(?:.*/)?{form}\.[^./]+"
    for form in (
        r"(?P<scene>[^/]*)",
        rf"(?P<scene>[^/]*[^ _\-./])[ _\-.]{_WORD}",
        rf"{_WORD}[ _\-.](?P<scene>[^/]+)",
    )
)
# A number in a file's name, in one piece unless it is an f-number.
_NUMBER = re.compile(r"(?P<number>(?<![fF])(?<![fF][ _-])\d+\.\d+|\d+)")
# Images f4, f8, f16 differ in aperture; f1, f2, f3 are frames.
_F, _STOPS = re.compile(rf"(?<![A-Za-z])[fF][ _-]?\{{{IMAGE}\}}"), {1, 2, 4, 8, 11, 16, 22, 32}
# One of a scene's files may have nothing but the scene's name.
_BARE = rf"(?:.*/)?(?P<scene>[^/]+?)(?:[ _\-.]{_WORD})?\.[^./]+"
# Of a photograph and its depth map: in folders of any depth, or with several words before a number.
_BESIDE = (
    rf"(?P<scene>.+?)([ _\-.](?i:{DEPTH.pattern})[^/]*)?\.[^./]+",
    r"(?:.*/)?([A-Za-z][^ _\-./]*[ _\-.])+(?P<scene>\d[^/]*)\.[^./]+",
)
_FOLDER = r"(?:[^/]+/){%d}(?P<scene>[^/]+)/.*"
# Of several frames a place, the scene is the place's folder and the frame's name or folder.
_FRAMES = (
    r"(?:[^/]+/){%d}[^/{}]+/(?P<scene>[^/]+/.+)\.[^./]+",
    r"(?:[^/]+/){%d}(?P<scene>[^/{}]+/[^/]+)/[^/]+",
    r"(?:[^/]+/){%d}(?P<scene>[^/{}]+/[^/]*[^ _\-./])[ _\-.][A-Za-z][^ _\-./]*\.[^./]+",
    r"(?:[^/]+/){%d}(?P<place>[^/{}]+)/(?:.*/)?[^/\d]*(?P<scene>\d+)[^/\d]*\.[^./]+",
    r"(?:[^/]+/){%d}(?P<place>[^/{}]+)/[^/{}]+/(?P<scene>[^/]+)\.[^./]+",
)
# How many photographs that differ only by a number, or by rows of a table, make a stack.
_FEWEST = 3
#: What to do where files do not tell how they belong together.
BY_HAND = "rename them, or write the manifest by hand: docs/your_own_data.md"
_FRACTION = re.compile(
    r"(?P<word>((foc|dist)[a-z]*|(?<![a-z])fd)[ _-]?)?"
    r"(?P<number>\d+\.\d+)(?P<unit>[ _]?(mm|cm|m)(?![a-z]))?",
    re.I,
)
_TABLES = (".json", ".csv", ".tsv", ".txt")
_MOST_COLUMNS = 16
#: The images of each stack, by its name in a group.
Stacks = Mapping[str, tuple[str, ...]]
_NO_STACK: Stacks = {}

#: The part of a set that a scene is in, "" if there are none, and the scene's name.
Key = tuple[str, str]
#: Each scene's file, by the pattern of its kind.
Kinds = dict[str, dict[Key, str]]


@dataclass(frozen=True)
class Group:
    """Files of one kind, one per scene.

    Parameters
    ----------
    pattern : str
        Where they are, with ``{scene}``, and with ``{split}`` if folders are named after splits; it
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
    """How a folder's files belong together.

    Parameters
    ----------
    groups : tuple of Group
        Kinds of files, each with the same scenes; the largest kinds first.
    scenes : tuple of Key
        The scenes that at least three groups have, in order.
    by_order : bool
        Whether files can be matched only by their order, because their names differ.
    left : tuple of str
        Image files that belong to no scene.
    images : mapping of str to tuple of str
        The images of each stack in the order of their numbers, by the name that stands for them in
        a group: it has ``{image}`` for the number, or columns of a table.
    """

    groups: tuple[Group, ...]
    scenes: tuple[Key, ...]
    by_order: bool
    left: tuple[str, ...]
    images: Stacks

    @property
    def stacks(self) -> tuple[Group, ...]:
        """The stacks that every scene has."""
        return tuple(
            group
            for group in self.groups
            if len(group.files) == len(self.scenes)
            and all(path in self.images for path in group.files.values())
        )


def image_files(folder: Path) -> tuple[str, ...]:
    """Return the images and depth arrays below a folder, sorted, without hidden ones."""
    return tuple(sorted(p.as_posix() for p in shown_files(folder) if _is_read(p)))


def _is_read(path: PurePosixPath) -> bool:
    end = path.suffix.lower()
    return end in SUFFIXES or (end in ARRAYS and bool(DEPTH.search(path.as_posix().lower())))


def unread_files(folder: Path) -> str:
    """Name the other files below a folder by their endings; return "" if there are none.

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
    """Yield the files below a folder, as relative paths, without hidden ones."""
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
    """Return how files belong together, by the names that most scenes have in common.

    A scene is named by a folder, a file, or the start or end of a file's name. If file names have
    nothing in common, folders with the same number of files are matched by their order.

    Parameters
    ----------
    paths : tuple of str
        Image files below the folder.

    Returns
    -------
    Layout or None
        None if no scene has three files, or a photograph and a depth map.

    Examples
    --------
    >>> layout = find_layout(("d/1.png", "d/2.png", "f2/1.jpg", "f2/2.jpg", "f8/1.jpg", "f8/2.jpg"))
    >>> [group.pattern for group in layout.groups], layout.scenes
    (['d/{scene}.png', 'f2/{scene}.jpg', 'f8/{scene}.jpg'], (('', '1'), ('', '2')))
    """
    forms = (*_folders(paths), *_FORMS, *_folders(paths, _FRAMES))
    whole, with_depth = _best_of(paths, (*forms, _BARE), _ROLES)
    # Photographs with a depth map each are better than three files without, or than few scenes.
    single, with_one = _best_of(paths, (*forms, *_BESIDE), _ROLES - 1)
    if with_depth > 1 and _FEW * with_depth >= with_one:
        return whole
    # If as many others are left over, they may be the sharp photographs.
    if not single or not with_one or len(single.left) >= len(single.scenes):
        return whole or _by_order(paths)
    # Files that have names in common are not matched by their order.
    in_order = _by_order(paths)
    if in_order and len(in_order.scenes) <= 2 * len(single.scenes):
        in_order = None
    either = (whole if with_depth else None, single, in_order)
    return max(filter(None, either), key=lambda layout: len(layout.scenes))


def _best_of(
    paths: tuple[str, ...], forms: tuple[str, ...], least: int
) -> tuple[Layout | None, int]:
    """Return the best layout with so many files a scene, and how many scenes have a depth file."""
    laid_out = [layout for form in forms if (layout := _layout(paths, form, least))]
    # Several scenes without a kind in common do not belong to one set.
    found = [o for o in laid_out if len(o.scenes) == 1 or len(o.groups[0].files) > 1]
    # Prefer scenes with a depth file and enough others: they cannot be a misread kind of files.
    order = [(_with_depth(o.groups, least - 1), len(o.scenes), -len(o.groups)) for o in found]
    return (found[order.index(max(order))], max(order)[0]) if found else (None, 0)


def find_stacks(folder: Path, paths: tuple[str, ...]) -> Layout | None:
    """Return how the files of focal stacks belong together.

    Parameters
    ----------
    folder : Path
        The folder, which names a single scene.
    paths : tuple of str
        Image files and depth arrays below it.

    Returns
    -------
    Layout or None
        None if no photographs form a stack, or depth maps do too: then the numbers are scenes.
    """
    families: dict[str, dict[float, str]] = defaultdict(dict)
    for path in paths:
        for template, number in _templates(PurePosixPath(path)):
            families[template][number] = path
    families = {t: f for t, f in families.items() if not (_F.search(t) and f.keys() <= _STOPS)}
    if any(len(f) > 1 and DEPTH.search(template.lower()) for template, f in families.items()):
        return None
    # Tables take precedence over numbers: two columns may belong together, such as run and motor.
    by_table: dict[str, dict[float, str]] = {}
    for table in tables_below(folder):
        by_table |= _named_by(table.rows, [path for path in paths if table.is_above(path)])
    images: dict[str, tuple[str, ...]] = {}
    taken: set[str] = set()
    for template, found in sorted(
        (by_table or families).items(), key=lambda item: (-len(item[1]), item[0])
    ):
        members = tuple(found[number] for number in sorted(found))
        if len(members) >= _FEWEST and not taken & set(members):
            images[template] = members
            taken.update(members)
    left = tuple(sorted({*paths, *images} - taken))
    layouts = [one for form in _folders(left) if (one := _layout(left, form, 1, images))]
    if len(images) == 1:
        layouts.insert(0, one_scene(folder, left, images))
    return max((o for o in layouts if o.stacks), key=lambda o: len(o.scenes), default=None)


def one_scene(folder: Path, paths: tuple[str, ...], images: Stacks = _NO_STACK) -> Layout:
    """Return a single scene, named after the folder, with one file of each kind."""
    key = ("", folder.resolve().name)
    groups = tuple(Group(path, {key: path}) for path in paths)
    return Layout(groups, (key,), False, (), images)


def _templates(place: PurePosixPath) -> Iterator[tuple[str, float]]:
    for match in distances_in(place) or _NUMBER.finditer(place.stem):
        start, end = match.span("number")
        stem = f"{place.stem[:start]}{{{IMAGE}}}{place.stem[end:]}"
        yield str(place.with_name(stem + place.suffix)), number_in(match["number"]) or 0


def distances_in(place: PurePosixPath) -> list[re.Match[str]]:
    """Return the numbers with a fraction in a file's name that have a unit or follow "focus"."""
    return [found for found in _FRACTION.finditer(place.stem) if found["word"] or found["unit"]]


def _named_by(rows: list[dict[str, str]], paths: list[str]) -> dict[str, dict[float, str]]:
    """Return families of files by name, with columns in braces in place of the row's cells."""
    names = {path: PurePosixPath(path) for path in paths}
    stems = "\n".join({place.stem for place in names.values()})

    def word(row: dict[str, str], column: str) -> str:
        # Only as a whole word between _ and - in a name.
        return rf"(?<![^_\n-]){re.escape(row[column])}(?![^_\n-])"

    columns = [
        name
        for name in rows[0]
        if len({row.get(name) for row in rows}) == len(rows)
        and all(row.get(name) and re.search(word(row, name), stems) for row in rows)
    ]
    families: dict[str, dict[float, str]] = defaultdict(dict)
    for path, place in names.items() if columns else ():
        for number, row in enumerate(rows):
            stem = place.stem
            for name in columns:
                stem = re.sub(word(row, name), f"{{{name}}}", stem, count=1)
            if all(f"{{{name}}}" in stem for name in columns):
                families[str(place.with_name(stem + place.suffix))][number] = path
    return {name: found for name, found in families.items() if len(found) == len(rows)}


@dataclass(frozen=True)
class Table:
    """A table that may describe images: its path, its rows, and its columns without a heading."""

    path: PurePosixPath
    rows: list[dict[str, str]]
    columns: list[str]

    @property
    def numeric(self) -> list[str]:
        """The columns that hold a number in every row."""
        numbers = [
            {n for n, cell in row.items() if number_in(cell) is not None} for row in self.rows
        ]
        return [n for n in self.rows[0] if all(n in row for row in numbers)]

    def is_above(self, path: str) -> bool:
        """Whether a file is in the table's folder, or below it."""
        return self.path.parent in PurePosixPath(path).parents


def tables_below(folder: Path) -> Iterator[Table]:
    """Yield the tables below a folder with enough rows for a stack, the deepest first."""
    for path in sorted(shown_files(folder), key=lambda each: (-len(each.parts), str(each))):
        table = _table(folder, path) if path.suffix.lower() in _TABLES else None
        if table and len(table.rows) >= _FEWEST:
            yield table


def _table(folder: Path, path: PurePosixPath) -> Table | None:
    try:
        content = (folder / path).read_bytes()
    except OSError:
        return None
    for count in range(_MOST_COLUMNS) if path.suffix != ".json" else (0,):
        columns = [f"column_{number}" for number in range(1, count + 1)]
        try:
            rows = read_table(content, path.name, columns)
        except SourceError:
            continue
        # A heading consists of words.
        if columns or all(number_in(name) is None for name in rows[0]):
            return Table(path, rows, columns)
    return None


def _folders(paths: tuple[str, ...], forms: tuple[str, ...] = (_FOLDER,)) -> tuple[str, ...]:
    """Return forms with the folder that they name at every depth."""
    depth = max((path.count("/") for path in paths), default=0)
    return tuple(form % level for level in range(depth) for form in forms)


def _with_depth(groups: tuple[Group, ...], others_each: int = _ROLES - 1) -> int:
    depths, others = set[Key](), Counter[Key]()
    for group in groups:
        (depths if group.is_depth else others).update(list(group.files))
    return sum(others[key] >= others_each for key in depths)


def _split_of(path: str) -> tuple[str, str]:
    parts = path.split("/")
    for level, part in enumerate(parts[:-1]):
        if part.lower() in _SPLITS:
            parts[level] = "{split}"
            return "/".join(parts), part
    return path, ""


def _layout(
    paths: tuple[str, ...], form: str, least: int = _ROLES, images: Stacks = _NO_STACK
) -> Layout | None:
    found = _kinds(paths, form)
    times = Counter(key for files in found.values() for key in files)
    scenes = tuple(sorted(key for key, count in times.items() if count >= least))
    stacked = {key for files in found.values() for key in scenes if files.get(key) in images}
    if 2 * len(stacked) > len(scenes):
        # If most have a stack, the others are not scenes.
        scenes = tuple(key for key in scenes if key in stacked)
    groups = {
        pattern: {key: files[key] for key in scenes if key in files}
        for pattern, files in found.items()
        if any(key in files for key in scenes)
    }
    layout = _sorted(groups, scenes, False, paths, images)
    depths = [group for group in layout.groups if group.is_depth]
    limited = depths if _with_depth(layout.groups) else layout.groups
    fits = scenes and len(limited) <= _MOST_GROUPS and not _has_frames(layout)
    return layout if fits else None


def _has_frames(layout: Layout) -> bool:
    """Return whether a scene has several frames, or what seem kinds are several places."""
    groups, single = layout.groups, len(layout.scenes) == 1
    numbers: dict[tuple[bool, str], set[tuple[str, ...]]] = defaultdict(set)
    for group in groups:
        found = tuple(re.findall(r"\d+", group.pattern))
        numbers[group.is_depth, re.sub(r"\d+", "0", group.pattern)].add(found)
    told = [[one for (deep, _), one in numbers.items() if deep is kind] for kind in (True, False)]
    # Apertures of photographs are no numbers of depth maps, but time stamps may differ.
    if any(
        len(depth & other) > 1 or (single and min(len(depth), len(other)) >= _FEWEST)
        for depth, other in product(*told)
    ):
        return True
    # Photographs and depth maps lie in folders of the same names.
    depths, others = (
        zip_longest(*(g.pattern.split("/")[:-1] for g in groups if g.is_depth is depth))
        for depth in (True, False)
    )
    return any(set(a) == set(b) and len(set(a)) > 1 for a, b in zip(depths, others, strict=False))


def _kinds(paths: tuple[str, ...], form: str) -> Kinds:
    """Return the files by pattern and scene, as far as a form gives both."""
    found: Kinds = defaultdict(dict)
    for path in paths:
        told, split = _split_of(path)
        match = re.fullmatch(form, told, re.DOTALL)
        if match and match["scene"] != "{split}":
            start, end = match.span("scene")
            scene, before = match["scene"].replace("{split}", split), told[:start]
            if place := match.groupdict().get("place"):
                first, last = match.span("place")
                scene, before = f"{place}/{scene}", f"{told[:first]}{{place}}{told[last:start]}"
            found[f"{before}{{scene}}{told[end:]}"][split, scene] = path
    return _endings_joined(found)


def _endings_joined(found: Kinds) -> Kinds:
    """Join kinds of images that differ only in their endings and share no scene."""
    alike: dict[str, list[str]] = defaultdict(list)
    for pattern in found:
        is_array = pattern.lower().endswith(ARRAYS)
        alike[pattern if is_array else str(PurePosixPath(pattern).with_suffix(""))].append(pattern)
    joined: Kinds = {}
    for base, patterns in alike.items():
        together = {key: file for pattern in patterns for key, file in found[pattern].items()}
        if len(patterns) > 1 and len(together) == sum(len(found[each]) for each in patterns):
            joined[base + ANY_ENDING] = together
        else:
            joined |= {pattern: found[pattern] for pattern in patterns}
    return joined


def _by_order(paths: tuple[str, ...]) -> Layout | None:
    found = _kinds(paths, _FORMS[0])
    sizes = Counter(map(_sizes, found.values())).most_common(1)
    common, times = sizes[0] if sizes else ((), 0)
    if not _ROLES <= times <= _MOST_GROUPS:
        return None
    scenes = tuple(
        (split, f"{number:0{len(str(count))}}")
        for split, count in common
        for number in range(1, count + 1)
    )
    groups = {
        pattern: dict(zip(scenes, _in_order(files), strict=True))
        for pattern, files in found.items()
        if _sizes(files) == common
    }
    return _sorted(groups, scenes, True, paths, _NO_STACK)


def _sizes(files: dict[Key, str]) -> tuple[tuple[str, int], ...]:
    return tuple(sorted(Counter(split for split, _ in files).items()))


def _in_order(files: dict[Key, str]) -> list[str]:
    """Return a kind's files by split, then in natural order: 2 comes before 10."""

    def place(item: tuple[Key, str]) -> tuple[str, list[tuple[int, str]]]:
        (split, _), path = item
        parts = re.findall(r"\d+|\D+", path)
        return split, [(int(part), "") if part.isdigit() else (-1, part) for part in parts]

    return [path for _, path in sorted(files.items(), key=place)]


def _sorted(
    groups: Kinds, scenes: tuple[Key, ...], by_order: bool, paths: tuple[str, ...], images: Stacks
) -> Layout:
    kinds = [Group(pattern, files) for pattern, files in groups.items()]
    kinds.sort(key=lambda group: (-len(group.files), group.pattern))
    used = {path for group in kinds for path in group.files.values()}
    left = tuple(path for path in paths if path not in used)
    return Layout(tuple(kinds), scenes, by_order, left, images)
