"""A manifest: what a data set consists of, frozen."""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field

from dfdbench.blur.tracks import CLEAN
from dfdbench.datasets.captured_files import CapturedFiles
from dfdbench.datasets.depth_scale import DepthScale, Rig
from dfdbench.errors import InputError, unknown_name
from dfdbench.system.strict import StrictRecord

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from dfdbench.blur.recipe import BlurRecipe
    from dfdbench.metrics.protocol import Unit

ALL_PAIRS = "all"
_INFINITY = 1e9  # metres
#: Precedes the found scenes in a manifest's text.
FOUND = "\n# Found where the set was built.\n\n"
#: The reader of sets that are described by their manifest alone.
FOLDER = "folder"

#: What may become part of a path: no separator, no dot in front, short.
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$", max_length=100)]
Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
Count = Annotated[int, Field(ge=1)]


class Origin(StrictRecord):
    """Where files come from, under which terms, and what to cite."""

    name: Name
    url: str
    licence: str
    citations: list[str]


class Scene(StrictRecord):
    """A scene; `geometry` and `texture` where the data set tells them apart.

    Scenes of one family or room have one `group`: they are alike, and means are only as sure as
    there are groups. `names` are what its files are called by, where patterns of `CapturedFiles`
    ask for more than the scene's name.
    """

    name: Name
    source: str
    geometry: str | None = None
    texture: int | None = None
    group: Name | None = None
    names: dict[str, str] = Field(default_factory=dict)


class Depth(StrictRecord):
    """What a depth level means.

    `axes` are the pair axes along which the depth map changes, `unknown` the level that marks
    a pixel without ground truth. `scale` says what levels are in metres, where that is known.
    """

    axes: list[str]
    unknown: Annotated[int, Field(ge=0, le=255)]
    grows_with: Literal["nearness", "distance"]
    unit: str
    scale: DepthScale | None = None

    @property
    def kind(self) -> Unit:
        """What the depth is in: levels 0 to 255, or metres, with their ends in `scale`."""
        return "metres" if self.unit == "metres" else "levels"

    @property
    def ends(self) -> tuple[float, float]:
        """The nearest and the farthest depth, in levels or metres."""
        if self.kind == "metres" and self.scale is not None:
            return self.scale.near, self.scale.far
        return (255.0, 0.0) if self.grows_with == "nearness" else (0.0, 255.0)

    @property
    def span(self) -> float:
        """How far apart the ends are: 255 levels, or a distance in metres."""
        return abs(self.ends[0] - self.ends[1])

    def own_recipe(self, name: str) -> BlurRecipe:
        """Return a blur recipe for these levels: a build turns those that grow with distance."""
        from dfdbench.blur.recipe import find_recipe  # numpy

        made = find_recipe(name)
        return made if self.grows_with == "nearness" else replace(made, invert=not made.invert)

    def of_metres(self, distance: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return distances in metres as depths of this kind; NaN stays, and without a scale all."""
        import numpy as np

        if self.kind == "metres":
            return distance
        if self.scale is None:
            return np.full_like(distance, np.nan)
        known = np.where(np.isnan(distance), 1.0, np.minimum(distance, _INFINITY))
        return np.where(np.isnan(distance), np.nan, self.scale.to_exact_levels(known))

    def of_unit(self, depth: NDArray[np.float32], unit: Unit) -> NDArray[np.float32]:
        """Return depth in levels or metres in this kind; `scale` says how, if they differ.

        Metres beyond the scale's ends become the end.
        """
        if self.scale is None or unit == self.kind == "levels":
            return depth
        if unit == self.kind:
            return depth.clip(self.scale.near, self.scale.far)
        if unit == "levels":
            return self.scale.to_metres(depth).astype("float32")
        return self._levels_of_metres(depth)

    def beyond(self, depth: NDArray[Any], unit: Unit) -> float:
        """Return the share of depth in metres that is beyond the scale's ends; NaN is not."""
        if self.scale is None or unit == "levels":
            return 0.0
        return float(((depth < self.scale.near) | (depth > self.scale.far)).mean())

    def answer_of_unit(
        self, depth: NDArray[np.float32], sigma: NDArray[np.float32] | None, unit: Unit
    ) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
        """Return depth as `of_unit` does, and its standard deviation by the scale's mean slope.

        It is taken over a standard deviation to either side, at least a thousandth of the range, as
        far as the scale reaches: an inverse scale is anything but straight.
        """
        found = self.of_unit(depth, unit)
        if sigma is None or unit == self.kind or self.scale is None:
            return found, sigma
        scale = self.scale
        ends = (scale.near_level, scale.far_level) if unit == "levels" else (scale.near, scale.far)
        first, last = sorted(map(float, ends))
        import numpy as np

        step = np.float32((last - first) / 1000)
        reach = np.maximum(sigma, step)
        low = np.clip(depth - reach, first, last - step)
        high = np.clip(depth + reach, low + step, last)
        rise = np.abs(self.of_unit(high, unit) - self.of_unit(low, unit))
        return found, np.asarray(sigma * rise / (high - low), np.float32)

    def exact_levels(self, depth: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return depth of this kind as levels that are not rounded; NaN stays."""
        if self.kind == "levels" or self.scale is None:
            return depth
        return self._levels_of_metres(depth)

    def _levels_of_metres(self, depth: NDArray[np.float32]) -> NDArray[np.float32]:
        assert self.scale is not None
        held = depth.astype("float64").clip(self.scale.near, self.scale.far)
        return self.scale.to_exact_levels(held).astype("float32")

    def levels_of(self, depth: NDArray[np.float32]) -> NDArray[np.uint8]:
        """Return depth of this kind, NaN where unknown, as levels; `unknown` where unknown."""
        import numpy as np

        if self.kind == "metres" and self.scale is not None:
            return self.scale.to_levels(depth, self.unknown)
        levels = np.where(np.isfinite(depth), np.rint(depth), self.unknown)
        return np.clip(levels, 0, 255).astype(np.uint8)

    def scored(self, depth: NDArray[np.float32]) -> NDArray[Any]:
        """Return what protocols score: metres as they are, levels with their fractions, if any."""
        import numpy as np

        if self.kind == "metres" or not (np.rint(depth) != depth)[np.isfinite(depth)].any():
            return depth if self.kind == "metres" else self.levels_of(depth)
        return np.where(np.isfinite(depth), depth, np.float32(self.unknown))

    @property
    def direction(self) -> str:
        """Which way the levels go, in words."""
        return "nearer" if self.grows_with == "nearness" else "farther"

    @property
    def text(self) -> str:
        """The unit and its ends, and of levels which way they go, in words."""
        text = self.unit if self.kind == "metres" else f"brighter is {self.direction}; {self.unit}"
        # Some units name the ends themselves.
        if self.scale and f"{self.scale.far:g} m" not in text:
            text += f", from {self.scale.near:g} m to {self.scale.far:g} m"
        return text


class TableLayout(StrictRecord):
    """How a score table is laid out: a block for each value of `blocks`, a row for `rows`."""

    blocks: str
    rows: str | None = None


class Exclusion(StrictRecord):
    """Pairs left out, and why; an axis that is not named stands for all its values."""

    scenes: list[str]
    coordinates: dict[str, list[int]] = Field(default_factory=dict)
    pairs: Count
    reason: Annotated[str, Field(min_length=1)]


class Split(StrictRecord):
    """Scenes that are used together; splits of one partition share no scene."""

    name: Name
    partition: str
    scenes: list[str]
    pairs: Count


class Fold(StrictRecord):
    """One fold of a cross validation: these scenes test, all others train."""

    name: Name
    test_scenes: list[str]


class Recording(StrictRecord):
    """How a camera recorded the set: lens steps, frames averaged, and the crops in pixels."""

    voltage_step: list[int]
    infocus_step: int
    defocus_step: int
    sharpest_step: int
    frames: Count
    lidar_scans: Count
    frame_size: Annotated[list[int], Field(min_length=2, max_length=2)]
    frame_offset: Annotated[list[int], Field(min_length=2, max_length=2)]
    crop_size: Count


@dataclass(frozen=True, order=True)
class Pair:
    """One in-focus and defocus pair, named by its scene and its place on each axis.

    Examples
    --------
    >>> pair = Pair("Art", (("view", 1), ("illumination", 3), ("exposure", 0)))
    >>> pair.id
    'Art/view1/illumination3/exposure0'
    >>> pair.at["exposure"]
    0
    """

    scene: str
    coordinates: tuple[tuple[str, int], ...]

    @property
    def id(self) -> str:
        """The pair's name in lists, results and messages."""
        return "/".join([self.scene, *(f"{axis}{value}" for axis, value in self.coordinates)])

    @property
    def at(self) -> dict[str, int]:
        """The value on each axis."""
        return dict(self.coordinates)


def simulated_label(name: str, simulated: bool) -> str:
    """Return a data set's name, marked where its captures are simulated.

    Examples
    --------
    >>> simulated_label("realworld-sim-1", True), simulated_label("demo-1", False)
    ('realworld-sim-1 (SIMULATED)', 'demo-1')
    """
    return f"{name} (SIMULATED)" if simulated else name


class Manifest(StrictRecord):
    """A data set in full: sources, scenes, axes, exclusions, splits, folds, recipe.

    `degradation` is ``clean`` in every file; `dfdbench.datasets.catalog.with_track` names another.
    With `find_scenes` it lists no scenes: see `dfdbench.building.new_manifest.with_found_scenes`.
    `pair_images` are the two images of a stack that a method of pairs gets, the in-focus one first.
    `simulated` is set where a simulator made what stands for a camera's captures.
    Obtained from `dfdbench.datasets.manifest_file.read_manifest` or
    `dfdbench.datasets.catalog.find_manifest`, which check it.
    """

    schema_version: Literal[1]
    name: Name
    short: Name
    version: Count
    title: str
    description: str
    reader: str
    recipe: str | None = None
    simulated: bool = False
    degradation: Annotated[str, Field(pattern=f"^{CLEAN}$")]
    network_crop: Count
    axes: dict[str, Annotated[list[int], Field(min_length=1)]]
    depth: Depth
    table: TableLayout
    scene_count: Count
    pair_count: Count
    sources: list[Origin]
    find_scenes: bool = False
    scenes: list[Scene] = Field(default_factory=list)
    exclusions: list[Exclusion] = Field(default_factory=list)
    pair_images: Annotated[list[int], Field(min_length=2, max_length=2)] | None = None
    splits: list[Split] = Field(default_factory=list)
    folds: list[Fold] = Field(default_factory=list)
    capture: Recording | None = None
    rig: Rig | None = None
    files: CapturedFiles | None = None
    checksums: dict[str, Sha256] = Field(default_factory=dict)
    toml: str

    @property
    def sha256(self) -> str:
        """The SHA-256 of the manifest's file."""
        return hashlib.sha256(self.toml.encode()).hexdigest()

    @property
    def written_sha256(self) -> str:
        """The SHA-256 of what a person wrote of it: all but scenes that were found."""
        return hashlib.sha256(self.toml.partition(FOUND)[0].encode()).hexdigest()

    @property
    def substance(self) -> dict[str, Any]:
        """What decides images and scores: no words, no track, and no scenes that were found."""
        words = {"toml", "title", "description", "sources", "degradation", "short"}
        found = {"scenes", "splits"} if self.find_scenes else set[str]()
        return self.model_dump(exclude=words | found)

    @property
    def file_stem(self) -> str:
        """Name and version, as in the manifest's file name: the same for every track."""
        return f"{self.name}-{self.version}"

    @property
    def stem(self) -> str:
        """Name and version, and the track if there is one, as in stores and results."""
        return self.file_stem + (f"@{self.degradation}" if self.on_track else "")

    @property
    def label(self) -> str:
        """What tables and figures call it: simulated ones are marked."""
        return simulated_label(self.stem, self.simulated)

    @property
    def has_truth(self) -> bool:
        """Whether there is depth to score against."""
        return self.files is None or self.files.depth is not None

    @property
    def on_track(self) -> bool:
        """Whether a track makes the images; then methods get the blur only by ``--given-blur``."""
        return self.degradation != CLEAN

    @property
    def scene_names(self) -> tuple[str, ...]:
        """Every scene's name, in the manifest's order."""
        return tuple(scene.name for scene in self.scenes)

    @property
    def groups(self) -> dict[str, str]:
        """The group of each scene that shares one; every other scene is its own group."""
        return {scene.name: scene.group for scene in self.scenes if scene.group}

    def scenes_of(self, split: str) -> tuple[str, ...]:
        """Return the names of the scenes in a split, in the manifest's order.

        Parameters
        ----------
        split : str
            A split's name, a fold's name (its test scenes), a scene's name, or ``"all"``.

        Raises
        ------
        UnknownNameError
            If the manifest has no such split; near misses are named.
        """
        chosen = {name: {name} for name in self.scene_names}
        chosen |= {ALL_PAIRS: set(self.scene_names)}
        chosen |= {item.name: set(item.scenes) for item in self.splits}
        chosen |= {fold.name: set(fold.test_scenes) for fold in self.folds}
        if split not in chosen:
            raise unknown_name(f"split of {self.stem}", split, chosen)
        return tuple(name for name in self.scene_names if name in chosen[split])

    def pairs(self, split: str = ALL_PAIRS) -> tuple[Pair, ...]:
        """Return the pairs of a split, exclusions left out, in the manifest's order.

        `split` is anything that `scenes_of` takes, such as a scene's name.
        """
        excluded = set(excluded_pairs(self.exclusions, self.axes))
        scenes = self.scenes_of(split)
        return tuple(pair for pair in grid_of_pairs(scenes, self.axes) if pair not in excluded)


def grid_of_pairs(scenes: tuple[str, ...], axes: dict[str, list[int]]) -> Iterator[Pair]:
    """Yield every pair of some scenes, before exclusions, in the manifest's order."""
    for scene in scenes:
        for values in itertools.product(*axes.values()):
            yield Pair(scene, tuple(zip(axes, values, strict=True)))


def excluded_pairs(exclusions: list[Exclusion], axes: dict[str, list[int]]) -> Iterator[Pair]:
    """Yield the pairs that exclusions name, whether or not they exist."""
    for exclusion in exclusions:
        narrowed = {axis: exclusion.coordinates.get(axis, axes[axis]) for axis in axes}
        yield from grid_of_pairs(tuple(exclusion.scenes), narrowed)


def training_of(manifest: Manifest, fold: str) -> tuple[str, ...]:
    """Return the scenes that train when a fold, or a single scene, tests.

    These are all scenes that are not tested; for a single scene, without the rest of its group.

    Raises
    ------
    InputError
        If all other scenes are of its group.

    Examples
    --------
    >>> from dfdbench.datasets.catalog import find_manifest
    >>> manifest = find_manifest("middlebury")
    >>> len(training_of(manifest, "K03")), len(training_of(manifest, "Baby1"))
    (24, 24)
    """
    tested, groups = set(manifest.scenes_of(fold)), manifest.groups
    others = [scene for scene in manifest.scene_names if scene not in tested]
    left = [s for s in others if fold not in groups or groups.get(s) != groups[fold]]
    if others and not left:
        what = f"{fold} is tested, and all other scenes are of its group, {groups[fold]}"
        raise InputError(what, where=manifest.stem, fix="take a split, or a set of more groups")
    return tuple(left)


def require_fold(manifest: Manifest, fold: str) -> None:
    """Refuse what is neither a fold nor a single scene of a data set.

    Raises
    ------
    UnknownNameError
        If it is neither.
    """
    known = (*(item.name for item in manifest.folds), *manifest.scene_names)
    if fold not in known:
        raise unknown_name(f"fold or scene of {manifest.stem}", fold, known)
