"""Look into a folder's captures: which images are in focus, what the depth files hold."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from dfdbench.building.folder_layout import SUFFIXES, Group, Key, Layout, unread_files
from dfdbench.building.sources.image_files import (
    decode_file,
    likely_bits,
    orientation_of,
    read_photograph,
)
from dfdbench.building.sources.matching import find_gain, find_placement
from dfdbench.errors import InputError, SourceError
from dfdbench.optics.sharpness import laplacian_energy

_DEPTH = re.compile(r"depth|disp|dist|range|lidar|tof|kinect|xtion|truth|(?<![a-z])gt(?![a-z])")
# Scenes that are decoded, spread over all: enough to tell a unit and which image is sharper.
_LOOKED_AT, _ALIGNED = 12, 4
# Bounds have to hold every scene: more depth maps are read, and of each some of its pixels.
_DEPTH_MAPS, _PIXELS = 200, 20_000
# Moves (pixels), turns (degrees) and gains below these need no correction.
_STILL, _LEVEL, _UNGAINED = 0.25, 0.02, 0.01
# Depths of a camera's scenes, in metres: a median in between is taken for metres.
_PLAUSIBLE = (0.05, 100.0)
_SHARE = 0.5  # per cent of the depths that bounds leave out at each end

Align = Literal["none", "translation", "euclidean"]


@dataclass
class Facts:
    """What was found in a folder, and what could not be told.

    Parameters
    ----------
    roles : dict of str to Group
        The files of ``infocus``, ``defocus`` and ``depth``.
    shapes : dict
        Rows and columns of the photographs of each scene that was looked at.
    depth_unit, near, far : float or None
        How many metres one unit of a depth file seems to be, and the distances between which
        almost all depths lie; None where the files hold levels.
    missing : list of int
        Values that stand for no depth.
    image_bits : int or None
        How many of 16 bits are used, where it is less.
    align, match_gain : str, bool
        What the images seem to need.
    found, open : list of str
        In words: what was found, and what a person has to say.
    """

    roles: dict[str, Group]
    shapes: dict[Key, tuple[int, ...]] = field(default_factory=dict)
    depth_unit: float | None = None
    near: float | None = None
    far: float | None = None
    missing: list[int] = field(default_factory=list)
    image_bits: int | None = None
    align: Align = "none"
    match_gain: bool = False
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
    samples = {group.pattern: _first(folder, group) for group in layout.groups}
    depths = [g for g in layout.groups if _is_depth(g.pattern, samples[g.pattern])]
    # Photographs may be grey and have 16 bits, too: a name says more.
    depths = [g for g in depths if _DEPTH.search(g.pattern.lower())] or depths
    photographs = [g for g in layout.groups if g not in depths]
    if not depths or len(photographs) < 2:
        raise InputError(
            "no depth map and two photographs a scene can be told",
            where=str(folder),
            expected="two photographs, and a depth file that is grey and says so in its name, or "
            f"has 16 or 32 bits ({', '.join(SUFFIXES)})",
            got="; ".join(filter(None, (_patterns(layout), unread_files(folder)))),
            fix="rename them, or write the manifest by hand: docs/your_own_data.md",
        )
    facts = Facts({"depth": depths[0]})
    keys = _spread(layout.scenes, _LOOKED_AT)
    _tell_photographs(folder, photographs, keys, facts)
    _tell_focus(folder, photographs, keys, facts)
    if len(depths) > 1:
        others = ", ".join(group.pattern for group in depths[1:])
        facts.open.append(f"depth is read from {depths[0].pattern}; also there: {others}")
    _tell_depth(folder, _spread(layout.scenes, _DEPTH_MAPS), facts)
    _tell_matching(folder, keys, facts)
    return facts


def _patterns(layout: Layout) -> str:
    return ", ".join(group.pattern for group in layout.groups)


def _first(folder: Path, group: Group) -> NDArray[Any]:
    path = folder / next(iter(group.files.values()))
    return decode_file(path.read_bytes(), str(path))


def _is_depth(pattern: str, image: NDArray[Any]) -> bool:
    flat = image.ndim == 2 or bool((image[..., :3] == image[..., :1]).all())
    return flat and (bool(_DEPTH.search(pattern.lower())) or image.dtype != np.uint8)


def _spread(keys: tuple[Key, ...], most: int) -> list[Key]:
    step = max(1, math.ceil(len(keys) / most))
    return list(keys[::step])


def _decoded(
    folder: Path, group: Group, keys: list[Key]
) -> Iterator[tuple[Key, bytes, NDArray[Any]]]:
    # One after the other: a camera's images are large.
    for key in keys:
        if key in group.files:
            path = folder / group.files[key]
            content = path.read_bytes()
            yield key, content, decode_file(content, str(path))


def _photograph(folder: Path, group: Group, key: Key, facts: Facts) -> NDArray[np.uint8]:
    path = folder / group.files[key]
    return read_photograph(path.read_bytes(), str(path), facts.image_bits or 16, "ignore")


def _tell_photographs(folder: Path, groups: list[Group], keys: list[Key], facts: Facts) -> None:
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
    there = [key for key in keys if all(key in group.files for group in groups)]
    energies = {
        group.pattern: [laplacian_energy(_photograph(folder, group, key, facts)) for key in there]
        for group in groups
    }
    order = sorted(groups, key=lambda group: -float(np.median(energies[group.pattern])))
    sharp, blurred = order[0], order[-1]
    facts.roles = {"infocus": sharp, "defocus": blurred, **facts.roles}
    pairs = zip(energies[sharp.pattern], energies[blurred.pattern], strict=True)
    sharper = sum(first > second for first, second in pairs)
    facts.found.append(
        f"in focus {sharp.pattern}, defocus {blurred.pattern}: the first is sharper in {sharper} "
        f"of {len(there)} scenes looked at"
    )
    if sharper < len(there):
        facts.open.append("which photographs are in focus: sharpness does not tell in every scene")
    if len(order) > 2:
        others = ", ".join(group.pattern for group in order[1:-1])
        facts.open.append(f"other photographs lie there, of less blur: {others}")


def _tell_depth(folder: Path, keys: list[Key], facts: Facts) -> None:
    group = facts.roles["depth"]
    some: list[NDArray[Any]] = []
    sizes: dict[Key, tuple[int, ...]] = {}
    for key, _, image in _decoded(folder, group, keys):
        flat = (image if image.ndim == 2 else image[..., 0]).ravel()
        some.append(flat[:: max(1, flat.size // _PIXELS)].copy())
        sizes[key] = image.shape[:2]
    kind = some[0].dtype
    values = np.concatenate(some).astype(np.float64)
    last = np.iinfo(kind).max if kind.kind == "u" else None
    stand = [0] if (values == 0).any() else []
    stand += [last] if last and last > 255 and (values == last).any() else []
    facts.missing = stand
    told = values[np.isfinite(values) & ~np.isin(values, stand)]
    if not told.size:
        raise SourceError("depth maps tell no depths", where=str(folder / group.pattern))
    share = 100 * (1 - told.size / values.size)
    facts.found.append(f"depth {group.pattern}, {kind}, {share:.1f} % of it missing")
    _tell_sizes(sizes, facts)
    if kind == np.uint8:
        facts.open.append("8-bit depth is taken for levels: whether brighter is nearer, and what")
        return
    median = float(np.median(told))
    facts.depth_unit = next(u for u in (1.0, 0.001, 1e-6) if median * u < _PLAUSIBLE[1])
    ends = np.percentile(told * facts.depth_unit, [_SHARE, 100 - _SHARE])
    facts.near, facts.far = _rounded(float(ends[0]), False), _rounded(float(ends[1]), True)
    facts.open.append(
        f"whether one unit of depth is {facts.depth_unit:g} m: the median is "
        f"{median * facts.depth_unit:.3g} m then"
    )
    facts.open.append(
        f"whether near {facts.near:g} m and far {facts.far:g} m are right: they hold "
        f"{100 - 2 * _SHARE:g} % of the depths of {len(some)} scenes"
    )


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


def _tell_matching(folder: Path, keys: list[Key], facts: Facts) -> None:
    moves, turns, gains, failed = [0.0], [0.0], [0.0], 0
    for key in keys[:_ALIGNED]:
        sharp, blurred = (
            _photograph(folder, facts.roles[role], key, facts) for role in ("infocus", "defocus")
        )
        if sharp.shape != blurred.shape:
            facts.open.append(f"photographs of {key[1]} differ in size")
            continue
        try:
            found = find_placement(sharp, blurred, "euclidean")
            everywhere = np.ones(sharp.shape[:2], bool)
            gains.append(find_gain(sharp.astype(float), blurred.astype(float), everywhere) - 1)
        except InputError:
            failed += 1
            continue
        moves.append(max(abs(found.right), abs(found.down)))
        turns.append(abs(found.degrees))
    if failed:
        facts.open.append(f"{failed} of {_ALIGNED} pairs tried cannot be laid on each other")
    if max(moves) > _STILL:
        facts.align = "euclidean" if max(turns) > _LEVEL else "translation"
    elif max(turns) > _LEVEL:
        facts.align = "euclidean"
    facts.match_gain = max(map(abs, gains)) > _UNGAINED
    facts.found.append(
        f"photographs moved by up to {max(moves):.2f} pixels, turned by {max(turns):.3f} degrees, "
        f"brighter by {100 * max(map(abs, gains)):.1f} %"
    )
