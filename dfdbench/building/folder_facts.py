"""Look into a folder's captures: which images are in focus, what the depth files hold."""

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfdbench.building.folder_layout import Group, Key, Layout, unread_files
from dfdbench.building.sources.image_files import (
    ARRAYS,
    SUFFIXES,
    decode_depth,
    likely_bits,
    orientation_of,
    read_photograph,
)
from dfdbench.building.sources.matching import Matching, matching_of
from dfdbench.errors import InputError, SourceError
from dfdbench.optics.sharpness import laplacian_energy
from dfdbench.tables.table import counted, listed

# Frames are counted f01, f02; apertures are not.
_F_NUMBER = re.compile(r"(?<![a-z])f[_/]?((?!0\d)\d+(?:\.\d+)?)")
# Scenes that are decoded, spread over all: enough to tell a unit and which image is sharper; fewer
# if each has many photographs.
_LOOKED_AT, _FEWEST, _PHOTOGRAPHS, _ALIGNED = 12, 3, 120, 4
_NAMED = 4
# Bounds have to hold every scene: more depth maps are read, and of each some of its pixels.
_DEPTH_MAPS, _PIXELS = 200, 20_000
# Depths of a camera's scenes, in metres: a median in between is taken for metres.
_PLAUSIBLE = (0.05, 100.0)
_SHARE = 0.5  # per cent of the depths that bounds leave out at each end


@dataclass
class Facts:
    """What was found in a folder, and what could not be told.

    Parameters
    ----------
    roles : dict of str to Group
        The files of ``infocus``, ``defocus`` and ``depth``; of stacks ``images``, ``metadata``.
    shapes : dict
        Rows and columns of the photographs of each scene that was looked at.
    depth_unit, near, far : float or None
        How many metres one unit of a depth file seems to be, and the distances between which
        almost all depths lie; None where the files hold levels.
    missing : list of int
        Values that stand for no depth.
    depth_ends : tuple of float or None
        The nearest and the farthest value of files that hold neither metres nor levels.
    metres : bool
        Whether the set keeps metres, and does not turn them into levels.
    more : list of str
        Lines for the section `files`.
    image_bits : int or None
        How many of 16 bits are used, where it is less.
    matching : Matching
        What the photographs seem to need.
    found, open : list of str
        In words: what was found, and what a person has to say.
    """

    roles: dict[str, Group]
    shapes: dict[Key, tuple[int, ...]] = field(default_factory=dict)
    depth_unit: float | None = None
    near: float | None = None
    far: float | None = None
    missing: list[int] = field(default_factory=list)
    depth_ends: tuple[float, float] | None = None
    metres: bool = False
    more: list[str] = field(default_factory=list)
    image_bits: int | None = None
    matching: Matching = field(default_factory=Matching)
    found: list[str] = field(default_factory=list)
    open: list[str] = field(default_factory=list)


def look_into(folder: Path, layout: Layout) -> Facts:
    """Return what a folder's files seem to be.

    Parameters
    ----------
    folder : Path
        Holds the files.
    layout : Layout
        How they go together.

    Raises
    ------
    InputError
        Where no depth files, or less than two kinds of photographs, can be told.
    SourceError
        Where a file that is looked at is damaged.
    """
    depths = [group for group in layout.groups if _is_depth(folder, group)]
    # Photographs may be grey and have 16 bits, too: a name says more.
    depths = [group for group in depths if group.is_depth] or depths
    others = [group for group in layout.groups if group not in depths]
    photographs = [group for group in others if not group.pattern.lower().endswith(ARRAYS)]
    if not depths or len(photographs) < 2:
        there = ", ".join(group.pattern for group in layout.groups)
        what = "no depth map and two photographs a scene are found: a depth file is grey "
        what += f"and says so in its name, or has 16 or 32 bits ({', '.join((*SUFFIXES, *ARRAYS))})"
        found = "; ".join(filter(None, (there, unread_files(folder))))
        fix = "rename them, or write the manifest by hand: docs/your_own_data.md"
        raise InputError(what, where=str(folder), got=found, fix=fix)
    depth, fitting = _of_one_size(folder, depths, photographs, layout.scenes)
    facts, scenes = Facts({"depth": depth}), _shared(layout.scenes, depth)
    keys = spread(scenes, max(_FEWEST, min(_LOOKED_AT, _PHOTOGRAPHS // len(fitting))))
    tell_photographs(folder, fitting, keys, facts)
    _tell_focus(folder, fitting, keys, facts)
    if len(depths) > 1:
        facts.open.append(f"depth is read from {depth.pattern}; {_also(depths, [depth])}")
    if len(photographs) > len(fitting):
        facts.open.append(f"photographs of the depth's size; {_also(photographs, fitting)}")
    tell_depth(folder, scenes, facts)
    sharp, soft = facts.roles["infocus"], facts.roles["defocus"]
    facts.matching = matching_of(
        (key[1], _photograph(folder, sharp, key, facts), _photograph(folder, soft, key, facts))
        for key in _shared(tuple(keys), *facts.roles.values())[:_ALIGNED]
    )
    facts.found += facts.matching.found
    facts.open += facts.matching.open
    return facts


def _also(kinds: list[Group], chosen: list[Group]) -> str:
    others = [group.pattern for group in kinds if group not in chosen]
    return f"also there: {listed(others, _NAMED)}"


def _shared(keys: tuple[Key, ...], *groups: Group) -> tuple[Key, ...]:
    return tuple(key for key in keys if all(key in group.files for group in groups))


def _of_one_size(
    folder: Path, depths: list[Group], photographs: list[Group], scenes: tuple[Key, ...]
) -> tuple[Group, list[Group]]:
    """Return a kind of depth maps and the photographs of its size, or all photographs."""
    # A kind that few scenes have is no role.
    enough = sorted(len(group.files) for group in photographs)[-2] / 2
    photographs = [group for group in photographs if len(group.files) >= enough]
    for depth in depths:
        fitting = []
        for group in photographs:
            for key in _shared(scenes, depth, group)[:1]:
                sizes = (_read(folder, each, key)[1].shape[:2] for each in (depth, group))
                if len(set(sizes)) == 1:
                    fitting.append(group)
        if len(fitting) > 1:
            return depth, fitting
    return depths[0], photographs


def _read(folder: Path, group: Group, key: Key) -> tuple[bytes, NDArray[Any]]:
    path = folder / group.files[key]
    content = path.read_bytes()
    return content, decode_depth(content, str(path))


def _is_depth(folder: Path, group: Group) -> bool:
    image = _read(folder, group, next(iter(group.files)))[1]
    flat = image.ndim == 2 or bool((image[..., :3] == image[..., :1]).all())
    return flat and (group.is_depth or image.dtype != np.uint8)


def spread(keys: Sequence[Key], most: int) -> list[Key]:
    """Return some of the scenes, so many at most, spread over all."""
    return list(keys[:: max(1, math.ceil(len(keys) / most))])


def _decoded(
    folder: Path, group: Group, keys: list[Key]
) -> Iterator[tuple[Key, bytes, NDArray[Any]]]:
    # One after the other: a camera's images are large.
    return ((key, *_read(folder, group, key)) for key in keys if key in group.files)


def _photograph(folder: Path, group: Group, key: Key, facts: Facts) -> NDArray[np.uint8]:
    path = folder / group.files[key]
    return read_photograph(path.read_bytes(), str(path), facts.image_bits or 16, "ignore")


def tell_photographs(folder: Path, groups: list[Group], keys: list[Key], facts: Facts) -> None:
    """Add the photographs' sizes, bits and rotation."""
    greatest, deep, turned, count = 0, True, 0, 0
    for group in groups:
        for key, content, image in _decoded(folder, group, keys):
            facts.shapes[key] = image.shape[:2]
            greatest, deep = max(greatest, int(image.max())), deep and image.dtype == np.uint16
            turned, count = turned + (orientation_of(content) > 1), count + 1
    facts.image_bits = likely_bits(greatest) if deep else None
    if facts.image_bits:
        facts.found.append(f"16-bit photographs that hold {facts.image_bits} bits")
    if turned:
        facts.open.append(
            f"{turned} of {count} photographs are to be turned by their EXIF data: exif_rotation"
        )
    sizes = sorted(set(facts.shapes.values()))
    facts.found.append(f"photographs of {', '.join(map(_size, sizes))} pixels")


def _tell_focus(folder: Path, groups: list[Group], keys: list[Key], facts: Facts) -> None:
    energies: dict[str, dict[Key, float]] = {group.pattern: {} for group in groups}
    for group in groups:
        for key in _shared(tuple(keys), group):
            energies[group.pattern][key] = laplacian_energy(_photograph(folder, group, key, facts))
    seen = [group for group in groups if energies[group.pattern]]
    if len(seen) < 2:
        what = "no scene has two photographs beside its depth map"
        fix = "put photographs of another blur beside them, named alike in every scene"
        raise InputError(what, where=facts.roles["depth"].pattern, fix=fix)
    order = sorted(seen, key=lambda each: -float(np.median([*energies[each.pattern].values()])))
    order = _smallest_aperture_first(order)
    sharp, blurred = order[0], order[-1]
    facts.roles = {"infocus": sharp, "defocus": blurred, **facts.roles}
    both = [key for key in energies[sharp.pattern] if key in energies[blurred.pattern]]
    sharper = sum(energies[sharp.pattern][key] > energies[blurred.pattern][key] for key in both)
    facts.found.append(
        f"in focus {sharp.pattern}, defocus {blurred.pattern}: the first is sharper in {sharper} "
        f"of {len(both)} scenes looked at"
    )
    if sharper < len(both):
        facts.open.append("which photographs are in focus: sharpness does not tell in every scene")
    if len(order) > 2:
        others = listed([group.pattern for group in order[1:-1]], _NAMED)
        facts.open.append(
            f"which defocus image to take: {len(order) - 2} more kinds of photographs are there: "
            f"{others}"
        )


def _smallest_aperture_first(order: list[Group]) -> list[Group]:
    """Move the one kind whose name has the largest f-number to the front, of more than two."""
    told = {group.pattern: _F_NUMBER.findall(Path(group.pattern).name.lower()) for group in order}
    largest = max((float(n) for numbers in told.values() for n in numbers), default=0.0)
    first = [g for g in order if largest in map(float, told[g.pattern])]
    rest = [group for group in order if group not in first]
    return first + rest if len(first) == 1 and len(rest) > 1 else order


def tell_depth(folder: Path, keys: Sequence[Key], facts: Facts, metres: bool = False) -> None:
    """Add what the depth files hold; `metres` keeps those in metres as they are."""
    group = facts.roles["depth"]
    some: list[NDArray[Any]] = []
    sizes: dict[Key, tuple[int, ...]] = {}
    for key, _, image in _decoded(folder, group, spread(keys, _DEPTH_MAPS)):
        flat = (image if image.ndim == 2 else image[..., 0]).ravel()
        some.append(flat[:: max(1, flat.size // _PIXELS)].copy())
        sizes[key] = image.shape[:2]
    kind = some[0].dtype
    values = np.concatenate(some).astype(np.float64)
    last = np.iinfo(kind).max if kind.kind == "u" else None
    stand = [0] if (values == 0).any() else []
    stand += [last] if last and last > 255 and (values == last).any() else []
    facts.missing = stand
    if kind.kind == "f" and ("disp" in group.pattern.lower() or (values < 0).any()):
        _tell_ends(values[np.isfinite(values)], facts)
        return
    told = values[np.isfinite(values) & (values > 0) & ~np.isin(values, stand)]
    if not told.size:
        raise SourceError("depth maps tell no depths", where=str(folder / group.pattern))
    share = 100 * (1 - told.size / values.size)
    facts.found.append(f"depth {group.pattern}, {kind}, {share:.1f} % of it missing")
    _tell_sizes(sizes, facts)
    if kind == np.uint8:
        facts.open.append("8-bit depth is taken for levels: whether brighter is nearer, and what")
        return
    median = float(np.median(told))
    facts.metres = metres
    facts.depth_unit = next(u for u in (1.0, 0.001, 1e-6) if median * u < _PLAUSIBLE[1])
    ends = np.percentile(told * facts.depth_unit, [_SHARE, 100 - _SHARE])
    facts.near, facts.far = _rounded(float(ends[0]), False), _rounded(float(ends[1]), True)
    facts.open.append(
        f"whether one unit of depth is {facts.depth_unit:g} m: the median is "
        f"{median * facts.depth_unit:.3g} m then"
    )
    facts.open.append(
        f"whether near {facts.near:g} m and far {facts.far:g} m are right: they hold "
        f"{100 - 2 * _SHARE:g} % of the depths of {counted(len(some), 'scene')}"
    )


def _tell_ends(values: NDArray[np.float64], facts: Facts) -> None:
    """Add the ends of what is neither metres nor levels, such as disparity."""
    if not values.size:
        raise SourceError("depth maps tell no depths", where=facts.roles["depth"].pattern)
    room = 0.01 * float(np.ptp(values)) or 1.0
    low, high = float(values.min()) - room, float(values.max()) + room
    facts.depth_ends, facts.missing = (float(f"{high:.4g}"), float(f"{low:.4g}")), []
    facts.found.append(
        f"depth {facts.roles['depth'].pattern}, neither metres nor levels: {low + room:.4g} to "
        f"{high - room:.4g}"
    )
    facts.open.append("whether greater depth values are nearer, as in disparity: depth_ends")


def _tell_sizes(sizes: dict[Key, tuple[int, ...]], facts: Facts) -> None:
    both = [key for key in facts.shapes if key in sizes]
    others = [key for key in both if sizes[key] != facts.shapes[key]]
    if others:
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
