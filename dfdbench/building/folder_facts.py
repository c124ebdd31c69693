"""Inspect a folder's captures: which images are in focus, what the depth files hold."""

import json
import math
import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import zip_longest
from pathlib import Path, PurePosixPath
from typing import Any, get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from dfdbench.building import folder_layout
from dfdbench.building.folder_layout import Group, Key, Layout, Table
from dfdbench.building.sources import image_files
from dfdbench.building.sources.matching import Matching, matching_of
from dfdbench.datasets.captured_files import BY_IMAGE, IMAGE, Align, places_in
from dfdbench.errors import InputError, SourceError
from dfdbench.optics.sharpness import laplacian_energy, to_grey
from dfdbench.tables.table import counted, listed

# Frames are numbered f01, f02; an f-number has no 0 before another digit (f0.95 is one).
_F_NUMBER = re.compile(r"(?<![a-z])f[_/]?((?!0\d)\d+(?:\.\d+)?)")
# How many scenes to decode, spread over all: enough to detect the unit and the sharper image; fewer
# if each has many photographs.
_LOOKED_AT, _FEWEST, _PHOTOGRAPHS, _ALIGNED = 12, 3, 120, 4
_NAMED = 4
_IN_FOCUS = re.compile(r"all.?in.?focus|aif|in.?focus|sharp|rgb")
#: Words in the names of what comes with RGB-D images, but is no photograph.
_OTHERS = re.compile(r"label|mask|(?<![a-z])seg|segment|semantic|instance|confidence|albedo")
_INVERSE = re.compile(r"disp|inverse|inv[_-]?depth")
_DIOPTRES = re.compile(r"diop|(?<![a-z])dpt")
# Words, and numbers after a word, that tell views of one scene apart.
_SIDE = re.compile(r"(?<![a-z])(left|right|l|r)(?![a-z])")
_VIEW = re.compile(r"(?<![a-z])((im|image|cam|camera|view)[ _-]?)0*[0-3](?![0-9])")
_AS_SHARP = 1.3
_NORMALS = re.compile(r"normals|normal_(cam|world|map)|surface_?normal")
_STACKS, _STACKS_NAMED = 4, 3
# Bounds must hold for every scene, so more depth maps are read, but only some pixels of each.
_DEPTH_MAPS, _PIXELS = 200, 20_000
# Plausible depths of a camera's scenes, in metres: a median in this range is taken for metres.
_PLAUSIBLE = (0.05, 100.0)
_SMALL, _ALIKE = (16, 16), 0.5  # photographs of one scene correlate, whatever their focus
_SIDEWAYS = 5  # EXIF orientations from 5 on swap rows and columns
_SHARE = 0.5  # per cent of the depths that the bounds leave out at each end


@dataclass
class Facts:
    """What was found in a folder, and what could not be found out.

    Parameters
    ----------
    folder : Path
        The folder with the files.
    roles : dict of str to Group
        The files of ``infocus``, ``defocus`` and ``depth``; for stacks ``images`` and ``metadata``.
    shapes : dict
        Rows and columns of the photographs of each scene that was inspected.
    files : dict of str to str
        Further fields of the manifest's section `files`, each as TOML.
    unit : str
        The unit of the set's depth.
    scale : tuple of float or None
        The distances between which almost all depths are; None if the files hold levels.
    turned : set
        The scenes whose photographs are all on their side, according to their EXIF data.
    found, open : list of str
        In words: what was found, and what a person has to fill in.
    """

    folder: Path
    roles: dict[str, Group] = field(default_factory=dict)
    shapes: dict[Key, tuple[int, ...]] = field(default_factory=dict)
    files: dict[str, str] = field(default_factory=dict)
    unit: str = "none is known"
    scale: tuple[float, float] | None = None
    turned: set[Key] = field(default_factory=set)
    found: list[str] = field(default_factory=list)
    open: list[str] = field(default_factory=list)


def look_into(folder: Path, layout: Layout) -> Facts:
    """Return what a folder's pairs seem to be.

    Parameters
    ----------
    folder : Path
        The folder with the files.
    layout : Layout
        How they belong together.

    Raises
    ------
    InputError
        If no depth files, or no photographs, can be found.
    SourceError
        If an inspected file is damaged.
    """
    depths, photographs = _kinds_of(folder, layout)
    depth, fitting = _of_one_size(folder, depths, photographs, layout.scenes)
    facts, scenes = Facts(folder, {"depth": depth}), _shared(layout.scenes, depth)
    keys = _spread(scenes, max(_FEWEST, min(_LOOKED_AT, _PHOTOGRAPHS // len(fitting))))
    _tell_photographs(fitting, keys, facts)
    if len(fitting) > 1:
        _tell_focus(fitting, keys, facts)
    else:
        _tell_sharp(fitting[0], facts)
    if len(depths) > 1:
        facts.open.append(f"depth is read from {depth.pattern}; {_also(depths, [depth])}")
    if len(photographs) > len(fitting):
        facts.open.append(f"photographs of the depth's size; {_also(photographs, fitting)}")
    _tell_depth(scenes, facts)
    if "defocus" not in facts.roles:
        return facts
    sharp, soft = facts.roles["infocus"], facts.roles["defocus"]
    matching = matching_of(
        (key[1], _photograph(sharp, key, facts), _photograph(soft, key, facts))
        for key in _shared(tuple(keys), *facts.roles.values())[:_ALIGNED]
    )
    _tell_matching(matching, facts)
    return facts


def _kinds_of(folder: Path, layout: Layout) -> tuple[list[Group], list[Group]]:
    """Return the kinds of depth maps and of photographs."""
    depths = _depths_of(folder, layout.groups)
    others = [group for group in layout.groups if group not in depths]
    images = [g for g in others if not g.pattern.lower().endswith(image_files.ARRAYS)]
    photographs = [group for group in images if not _is_other(folder, group)] or images
    if depths and photographs:
        return depths, photographs
    there = ", ".join(group.pattern for group in layout.groups)
    endings = ", ".join((*image_files.SUFFIXES, *image_files.ARRAYS))
    what = "no photographs are found"
    if not depths:
        what = "no depth map is found: its file is grey and says so in its name, as depth.png"
        what += f" does, or has 16 or 32 bits ({endings})"
    found = "; ".join(filter(None, (there, folder_layout.unread_files(folder))))
    fix = folder_layout.BY_HAND
    fix += "" if depths else "; photographs without depth are for `dfdbench predict`"
    raise InputError(what, where=str(folder), got=found, fix=fix)


def look_into_stacks(folder: Path, layout: Layout) -> Facts:
    """Return what a folder's stacks seem to be.

    Raises
    ------
    SourceError
        If an inspected file is damaged.
    """
    stack, *more = layout.stacks
    others = [group for group in layout.groups if group not in layout.stacks]
    # Scenes that lack the depth map that most have are left out, and named.
    named = [g for g in others if _IN_FOCUS.search(PurePosixPath(g.pattern).name.lower())]
    told = _depths_of(folder, [g for g in others if g.is_depth or g not in named])
    depths = [g for g in told if 2 * len(g.files) > len(layout.scenes)]
    sharp = [g for g in others if g not in told and len(g.files) == len(layout.scenes)]
    named = [g for g in sharp if g in named]
    likely = (named or (sharp if len(sharp) == 1 else []))[:1]
    facts = Facts(folder, dict(zip(("infocus",), likely, strict=False)) | {"images": stack})
    keys = _spread(layout.scenes, _STACKS)
    images = {key: layout.images[stack.files[key]] for key in layout.scenes}
    first = Group(stack.pattern, {key: images[key][0] for key in keys})
    _tell_photographs([*likely, first], keys, facts)
    _tell_images(stack.pattern, images, keys, facts)
    if named:
        facts.found.append(f"in focus all over {named[0].pattern}")
    elif likely:
        facts.open.append(f"whether {likely[0].pattern} is in focus all over")
    else:
        facts.open.append("whether an image is in focus all over: infocus")
    if depths:
        facts.roles["depth"] = depths[0]
        _tell_depth(_shared(layout.scenes, depths[0]), facts, metres=True)
    else:
        facts.open.append(f"depth: {_some_depth(folder, layout)}, so that nothing can be scored")
    whole = _shared(layout.scenes, *facts.roles.values())
    _tell_table(layout, stack, images[(whole or layout.scenes)[0]], facts)
    if more:
        named_more = listed((group.pattern for group in more), _STACKS_NAMED)
        facts.open.append(f"whether these stacks are values of an axis: {named_more}")
    left = [g.pattern for g in layout.groups if g not in (*facts.roles.values(), *more)]
    if left:
        kinds, names = counted(len(left), "kind"), listed(left, _STACKS_NAMED)
        facts.open.append(f"{kinds} of files belong to no stack: {names}")
    # Not measured: in a small image, the blur of the last passes for a movement.
    what = "whether the images of a stack are in register and equally bright: align, match_gain"
    _tell_matching(Matching(open=(what,)), facts)
    return facts


def _tell_images(
    pattern: str, images: dict[Key, tuple[str, ...]], keys: list[Key], facts: Facts
) -> None:
    counts = sorted(set(map(len, images.values())))
    told = " to ".join(map(str, dict.fromkeys((counts[0], counts[-1]))))
    facts.found.append(f"stacks {pattern} of {told} images")
    usual = Counter(map(len, images.values())).most_common(1)[0][0]
    if odd := [f"{key[1]} ({len(of)})" for key, of in images.items() if len(of) != usual]:
        facts.open.append(f"scenes without {usual} images: {listed(odd, _NAMED)}")
    if unlike := [key[1] for key in keys if not _show_one_scene(key, images[key], facts)]:
        facts.open.append(f"whether photographs are a stack: they look unlike in {listed(unlike)}")


def _show_one_scene(key: Key, images: tuple[str, ...], facts: Facts) -> bool:
    some = images[:: math.ceil(len(images) / _STACKS)]
    grey = (to_grey(_photograph(Group(name, {key: name}), key, facts)) for name in some)
    small = [cv2.resize(each, _SMALL, interpolation=cv2.INTER_AREA).ravel() for each in grey]
    with np.errstate(invalid="ignore", divide="ignore"):  # an image of one grey is like none
        return float(np.corrcoef(small).min()) > _ALIKE


def _some_depth(folder: Path, layout: Layout) -> str:
    some = max((len(group.files) for group in layout.groups if group.is_depth), default=0)
    if some:
        return f"in {some} of {counted(len(layout.scenes), 'scene')}"
    return "; ".join(filter(None, ("none was found", folder_layout.unread_files(folder))))


def _also(kinds: list[Group], chosen: list[Group]) -> str:
    others = [group.pattern for group in kinds if group not in chosen]
    return f"also there: {listed(others, _NAMED)}"


def _shared(keys: tuple[Key, ...], *groups: Group) -> tuple[Key, ...]:
    return tuple(key for key in keys if all(key in group.files for group in groups))


def _of_one_size(
    folder: Path, depths: list[Group], photographs: list[Group], scenes: tuple[Key, ...]
) -> tuple[Group, list[Group]]:
    """Return a kind of depth maps and the photographs of its size, or all photographs."""
    # A kind that only few scenes have plays no role.
    counts = sorted(len(group.files) for group in photographs)
    enough = max(counts[-2:][0] / 2, counts[-1] / 8)
    photographs = [group for group in photographs if len(group.files) >= enough]
    for depth in depths:
        fitting = []
        for group in photographs:
            for key in _shared(scenes, depth, group)[:1]:
                sizes = (_read(folder, each, key)[1].shape[:2] for each in (depth, group))
                if len(set(sizes)) == 1:
                    fitting.append(group)
        if len(fitting) >= min(2, len(photographs)):
            return depth, fitting
    return depths[0], photographs


def _read(folder: Path, group: Group, key: Key) -> tuple[bytes, NDArray[Any]]:
    path = folder / group.files[key]
    content = path.read_bytes()
    return content, image_files.decode_depth(content, str(path))


def _depths_of(folder: Path, groups: Sequence[Group]) -> list[Group]:
    depths = [group for group in groups if _is_depth(folder, group)]
    # Photographs may be grey with 16 bits, too; a name says more.
    return [group for group in depths if group.is_depth] or depths


def _is_depth(folder: Path, group: Group) -> bool:
    image = _read(folder, group, next(iter(group.files)))[1]
    return _is_grey(image) and (group.is_depth or image.dtype != np.uint8)


def _is_other(folder: Path, group: Group) -> bool:
    name = group.pattern.lower()
    if _NORMALS.search(name) or not _OTHERS.search(name):
        return bool(_NORMALS.search(name))
    return _is_grey(_read(folder, group, next(iter(group.files)))[1])


def _is_grey(image: NDArray[Any]) -> bool:
    return image.ndim == 2 or bool((image[..., :3] == image[..., :1]).all())


def _spread(keys: Sequence[Key], most: int) -> list[Key]:
    """Return at most `most` scenes, spread evenly."""
    return list(keys[:: max(1, math.ceil(len(keys) / most))])


def _decoded(
    folder: Path, group: Group, keys: list[Key]
) -> Iterator[tuple[Key, bytes, NDArray[Any]]]:
    # Read one at a time: a camera's images are large.
    return ((key, *_read(folder, group, key)) for key in keys if key in group.files)


def _photograph(group: Group, key: Key, facts: Facts) -> NDArray[np.uint8]:
    path = facts.folder / group.files[key]
    bits = int(facts.files.get("image_bits", 16))
    return image_files.read_photograph(path.read_bytes(), str(path), bits, "ignore")


def _tell_photographs(groups: list[Group], keys: list[Key], facts: Facts) -> None:
    """Add the photographs' sizes, bits and rotation."""
    greatest, deep, turned, count = 0, True, 0, 0
    orientations = defaultdict[Key, list[int]](list)
    for group in groups:
        for key, content, image in _decoded(facts.folder, group, keys):
            facts.shapes[key] = image.shape[:2]
            greatest, deep = max(greatest, int(image.max())), deep and image.dtype == np.uint16
            orientations[key].append(image_files.orientation_of(content))
            turned, count = turned + (orientations[key][-1] > 1), count + 1
    if deep and (bits := image_files.likely_bits(greatest)):
        facts.files["image_bits"] = str(bits)
        facts.found.append(f"16-bit photographs that hold {bits} bits")
    facts.turned = {key for key, found in orientations.items() if min(found) >= _SIDEWAYS}
    if turned:
        facts.open.append(
            f"{turned} of {count} photographs are to be turned by their EXIF data: exif_rotation"
        )
    sizes = sorted(set(facts.shapes.values()))
    facts.found.append(f"photographs of {', '.join(map(_size, sizes))} pixels")


def _tell_focus(groups: list[Group], keys: list[Key], facts: Facts) -> None:
    energies: dict[str, dict[Key, float]] = {group.pattern: {} for group in groups}
    for group in groups:
        for key in _shared(tuple(keys), group):
            energies[group.pattern][key] = laplacian_energy(_photograph(group, key, facts))
    seen = [group for group in groups if energies[group.pattern]]
    if len(seen) < 2:
        what = "no scene has two photographs beside its depth map"
        fix = "put photographs of another blur beside them, named alike in every scene"
        raise InputError(what, where=facts.roles["depth"].pattern, fix=fix)
    sharpness = {g.pattern: float(np.median([*energies[g.pattern].values()])) for g in seen}
    order = sorted(seen, key=lambda each: -sharpness[each.pattern])
    order = _smallest_aperture_first(_one_view(order, sharpness, facts))
    if len(order) == 1:
        _tell_sharp(order[0], facts)
        return
    # Of several lightings, the blurred image of the same one; another sharp image is none.
    sharp, least = order[0], sharpness[order[-1].pattern]
    most = max(least, math.sqrt(least * sharpness[sharp.pattern]))
    blurry = [group for group in order[:0:-1] if sharpness[group.pattern] <= most]
    blurred = min(blurry, key=lambda each: _differing(each.pattern, sharp.pattern))
    both = [key for key in energies[sharp.pattern] if key in energies[blurred.pattern]]
    sharper = sum(energies[sharp.pattern][key] > energies[blurred.pattern][key] for key in both)
    first, last = (_IN_FOCUS.search(group.pattern.lower()) for group in (sharp, blurred))
    # In doubt, the names tell.
    if last and not first and sharper < len(both):
        sharp, blurred, sharper = blurred, sharp, len(both) - sharper
    facts.roles = {"infocus": sharp, "defocus": blurred, **facts.roles}
    facts.found.append(
        f"in focus {sharp.pattern}, defocus {blurred.pattern}: the first is sharper in {sharper} "
        f"of {len(both)} scenes looked at"
    )
    if sharper < len(both):
        facts.open.append("which photographs are in focus: sharpness does not tell in every scene")
    if len(order) > 2:
        others = [group.pattern for group in order if group not in (sharp, blurred)]
        facts.open.append(
            f"which defocus image to take: {len(others)} more kinds of photographs are there: "
            f"{listed(others, _NAMED)}; if they differ in focus, they are a stack: images with "
            f"{{{IMAGE}}}"
        )


def _differing(*patterns: str) -> int:
    words = (re.findall(r"[a-z]+|[\d.]+", pattern.lower()) for pattern in patterns)
    return sum(one != other for one, other in zip_longest(*words))


def _tell_sharp(sharp: Group, facts: Facts) -> None:
    facts.roles = {"infocus": sharp, **facts.roles}
    facts.found.append(f"in focus {sharp.pattern}, and no other: a recipe blurs it")


def _one_view(order: list[Group], sharpness: dict[str, float], facts: Facts) -> list[Group]:
    """Leave out what shows another view, not another blur: the right image of a stereo pair."""
    first: dict[str, Group] = {}
    others = []
    for group in sorted(order, key=lambda each: each.pattern.lower()):
        name = _VIEW.sub(r"\1", _SIDE.sub("", group.pattern.lower()))
        one = first.setdefault(name, group)
        ends = sorted(sharpness[each.pattern] for each in (one, group))
        if one is not group and ends[1] < _AS_SHARP * ends[0]:
            others.append(group)
    if others:
        names = listed((group.pattern for group in others), _NAMED)
        facts.open.append(f"whether these are other views, as sharp, and not other blur: {names}")
    return [group for group in order if group not in others]


def _smallest_aperture_first(order: list[Group]) -> list[Group]:
    """Of more than two kinds, move the one with the largest f-number to the front, if unique."""
    told = {group.pattern: _F_NUMBER.findall(Path(group.pattern).name.lower()) for group in order}
    largest = max((float(n) for numbers in told.values() for n in numbers), default=0.0)
    first = [g for g in order if largest in map(float, told[g.pattern])]
    rest = [group for group in order if group not in first]
    # A sharper one that tells none, such as sharp.png, may have a larger one.
    sure = len(first) == 1 and told[order[0].pattern]
    return first + rest if sure and len(rest) > 1 else order


def _tell_depth(keys: Sequence[Key], facts: Facts, metres: bool = False) -> None:
    """Add what the depth files hold; `metres` keeps those in metres as they are."""
    group = facts.roles["depth"]
    some: list[NDArray[Any]] = []
    sizes: dict[Key, tuple[int, ...]] = {}
    for key, _, image in _decoded(facts.folder, group, _spread(keys, _DEPTH_MAPS)):
        flat = (image if image.ndim == 2 else image[..., 0]).ravel()
        some.append(flat[:: max(1, flat.size // _PIXELS)].copy())
        sizes[key] = image.shape[:2]
    kind = some[0].dtype
    values = np.concatenate(some).astype(np.float64)
    stand = image_files.stand_for_none(values, kind)
    facts.files["depth_missing"], facts.unit = str(stand), "levels, as in the files"
    finite = values[np.isfinite(values) & ~np.isin(values, stand)]
    signed = kind.kind == "f" and (finite < 0).any()
    if signed or (kind != np.uint8 and _INVERSE.search(group.pattern.lower())):
        _tell_ends(values[np.isfinite(values)], facts, [] if signed else stand)
        return
    told = finite[finite > 0]
    if not told.size:
        raise SourceError("depth maps tell no depths", where=str(facts.folder / group.pattern))
    share = 100 * (1 - told.size / values.size)
    facts.found.append(f"depth {group.pattern}, {kind}, {share:.1f} % of it missing")
    _tell_sizes(sizes, facts)
    if kind == np.uint8:
        facts.open.append(
            "8-bit depth: check that these are depth levels, and whether brighter is nearer"
        )
        return
    median = float(np.median(told))
    unit = next(u for u in (1.0, 0.001, 1e-6) if median * u < _PLAUSIBLE[1])
    ends = np.percentile(told * unit, [_SHARE, 100 - _SHARE])
    near, far = _rounded(float(ends[0]), False), _rounded(float(ends[1]), True)
    facts.files["depth_unit"], facts.scale = f"{unit} # metres", (near, far)
    facts.unit = "metres" if metres else "linear in 1/z"
    facts.open.append(
        f"whether one unit of depth is {unit:g} m: the median is {median * unit:.3g} m then"
    )
    facts.open.append(
        f"whether near {near:g} m and far {far:g} m are right: they hold "
        f"{100 - 2 * _SHARE:g} % of the depths of {counted(len(some), 'scene')}"
    )


def _tell_ends(values: NDArray[np.float64], facts: Facts, missing: list[float]) -> None:
    """Add the ends of depth in neither metres nor levels, such as disparity."""
    values = values[~np.isin(values, missing)]
    if not values.size:
        raise SourceError("depth maps tell no depths", where=facts.roles["depth"].pattern)
    room = 0.01 * float(np.ptp(values)) or 1.0
    low, high = float(values.min()) - room, float(values.max()) + room
    ends = [float(f"{high:.4g}"), float(f"{low:.4g}")]
    facts.files["depth_ends"] = f"{ends} # the nearest, the farthest"
    facts.files["depth_missing"] = str(missing)
    facts.unit = "levels, linear in the files' values"
    facts.found.append(
        f"depth {facts.roles['depth'].pattern}, neither metres nor levels: {low + room:.4g} to "
        f"{high - room:.4g}"
    )
    facts.open.append("whether greater depth values are nearer, as in disparity: depth_ends")


def _tell_matching(matching: Matching, facts: Facts) -> None:
    others = ", ".join(f'"{name}"' for name in get_args(Align) if name != matching.align)
    facts.files["align"] = f'"{matching.align}" # or {others}'
    facts.files["match_gain"] = str(matching.match_gain).lower()
    if matching.flat_field:
        curves = [[round(factor, 4) for factor in curve] for curve in matching.flat_field]
        facts.files["flat_field"] = str(curves)
    facts.found += matching.found
    facts.open += matching.open


def _tell_table(layout: Layout, stack: Group, images: tuple[str, ...], facts: Facts) -> None:
    """Add the table with a row per image, in the scenes' folders or above them."""
    tables = list(folder_layout.tables_below(facts.folder))
    names = {PurePosixPath(path).name for path in images}
    for table in tables:
        # A table of all scenes has rows of other stacks, too.
        own = [row for row in table.rows if names.intersection(row.values())] or table.rows
        if len(own) == len(images) and table.is_above(images[0]):
            # Down to the table's own folder, the pattern has the same folders as the stack's.
            folders = PurePosixPath(stack.pattern).parts[: len(table.path.parts) - 1]
            pattern = str(PurePosixPath(*folders, table.path.name))
            facts.roles["metadata"] = Group(pattern, dict.fromkeys(layout.scenes, ""))
            facts.found.append(f"a table with a row per image: {pattern}")
            read = {str(each.path) for each in tables}
            name, depth = table.path.name, len(table.path.parts)
            alike = (p for p in folder_layout.shown_files(facts.folder) if p.name == name)
            below = sorted(str(path) for path in alike if len(path.parts) == depth)
            if unread := [path for path in below if path not in read]:
                facts.open.append(f"no tables with a row per image: {listed(unread, _NAMED)}")
            _tell_columns(table, stack, facts)
            return
    name = PurePosixPath(stack.pattern).name
    unit = re.search(rf"{{{IMAGE}}}[ _]?(mm|cm|m)(?![a-z])", name.lower())
    counted_from_0 = unit and re.search(rf"(?<!\d)0+[ _]?{unit[1]}", images[0].lower())
    fractions = all(folder_layout.distances_in(PurePosixPath(path)) for path in images)
    if fractions or (unit and not counted_from_0):
        _tell_distance(IMAGE, unit[1] if unit else "m", facts)
        return
    sizes = [f"{table.path} with {counted(len(table.rows), 'row')}" for table in tables]
    found = f" ({listed(sizes, _STACKS_NAMED)} for {len(images)} images)" * bool(sizes)
    what = f"focus distances: no table with a row per image was found{found}"
    facts.open.append(f"{what}; metadata, or [[files.image]]")


def _tell_distance(name: str, unit: str, facts: Facts) -> None:
    """Add that a column, or the number of images, is the focus distance in some unit."""
    facts.files["focus_distance"] = f'"{{{name}}}"' + " # in metres" * (unit == "m")
    if unit != "m":
        units = {"mm": "0.001 # metres", "cm": "0.01 # metres", "dioptres": '"dioptres"'}
        facts.files["focus_unit"] = units[unit]
    facts.open.append(f"whether {name} is the focus in {'metres' if unit == 'm' else unit}")


def _tell_columns(table: Table, stack: Group, facts: Facts) -> None:
    rows = table.rows
    if table.columns:
        facts.files["columns"] = json.dumps(table.columns)
    if set(BY_IMAGE[:2]) & set(rows[0]):
        return
    in_names = places_in(stack.pattern)
    numeric = [name for name in table.numeric if name not in in_names]
    told = [name for name in numeric if re.search("foc|dist|disp|depth", name.lower())]
    others = [name for name in numeric if len({row[name] for row in rows}) == len(rows)]
    # A heading that says something else is not the focus.
    dioptres = [name for name in numeric if _DIOPTRES.search(name.lower())]
    told = dioptres or told or (others[-1:] if table.columns else [])
    if not told:
        words = listed((name for name in rows[0] if name not in table.numeric), _NAMED)
        what = "which column tells the focus: focus_distance and its unit, or focus_depth"
        facts.open.append(what + f"; not a number in every row: {words}" * bool(words))
        return
    name = told[0]
    positive = dioptres or (
        all(float(row[name]) > 0 for row in rows) and "disp" not in name.lower()
    )
    if positive:
        unit = re.search("(?<![a-z])(mm|cm)(?![a-z])", name.lower())
        _tell_distance(name, "dioptres" if dioptres else unit[1] if unit else "m", facts)
        return
    facts.files["focus_depth"] = f'"{{{name}}}" # in the unit of the depth files'
    facts.open.append(f"whether {name} is the focus in the unit of the depth files")


def _tell_sizes(sizes: dict[Key, tuple[int, ...]], facts: Facts) -> None:
    both = [key for key in facts.shapes if key in sizes]
    others = [key for key in both if sizes[key] != facts.shapes[key]]
    if (
        others
        and facts.turned.intersection(both) == set(others)
        and all(sizes[key] == facts.shapes[key][::-1] for key in others)
    ):
        facts.files["exif_rotation"] = '"apply"'
        facts.found.append("depth has the photographs' size once these are turned by EXIF data")
    elif others:
        facts.open.append(
            f"in {len(others)} of {len(both)} scenes looked at depth has another size than the "
            f"photographs (in {others[0][1]} {_size(sizes[others[0]])}, not "
            f"{_size(facts.shapes[others[0]])}): resample it onto them"
        )


def _size(shape: tuple[int, ...]) -> str:
    return f"{shape[1]} × {shape[0]}"


def _rounded(metres: float, up: bool) -> float:
    step = 10.0 ** (math.floor(math.log10(metres)) - 1)
    return float(f"{(math.ceil if up else math.floor)(metres / step) * step:.6g}")
