"""Sources of images and depth maps: one module per data set, and what they have in common."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from dfdbench.datasets.captures import PAIR, ImageFacts
from dfdbench.datasets.manifest import FOLDER, Manifest, Pair
from dfdbench.errors import Problem, SourceError, refuse_both
from dfdbench.system.packages import offered_as
from dfdbench.tables.table import listed

#: Packages register their own readers here; a reader is called with the manifest and the folder or
#: None.
ENTRY_POINT_GROUP = "dfdbench.sources"
#: Where each reader is defined, and the layout of its folder; generated sets have none. Only the
#: one in use is imported: all together take a second.
_OURS: Mapping[str, tuple[str, str]] = {
    "demo": ("demo:DemoScenes", ""),
    "realworld-sim": ("simulated_rig:SimulatedRig", ""),
    "unseen": ("rendered_rooms:Rooms", ""),
    FOLDER: ("folder:FolderScenes", "the files of its manifest"),
    "middlebury": ("middlebury:MiddleburyScenes", "Aloe/Illum1/Exp0/view1.png, or Aloe-2views.zip"),
    "realworld": (
        "realworld:RealworldFolder",
        "k33/left/exp_30/image_141_30.00.png and k33/lidar/..., or raw captures as "
        "dfdbench rig simulate realworld writes them: docs/realworld.md",
    ),
}


@contextmanager
def gathered(problems: list[Problem]) -> Iterator[None]:
    """Append the problems of a SourceError in the block to a list, and continue."""
    try:
        yield
    except SourceError as error:
        problems.extend(error.problems)


class SceneError(SourceError):
    """A scene that cannot be built from its files; reported once the others are built."""


@dataclass(frozen=True)
class SceneImages:
    """What a source returns for one scene.

    Parameters
    ----------
    images : ndarray of uint8 or uint16, shape (*pair axes, image, y, x, channel)
        RGB; zero where a capture is not available. Only in-focus images if the build makes the
        others by a recipe.
    depth : ndarray of float32, shape (*depth axes, y, x)
        In the manifest's unit, NaN if unknown.
    available : ndarray of bool, shape (*pair axes,)
        True if the capture is there.
    facts : ImageFacts, optional
        What is known of each image, shapes (image,) or (*pair axes, image).
    found : mapping, optional
        What the source found out about the scene, as JSON data: the store keeps it.
    warnings : tuple of str, optional
        What looks odd but was built anyway.
    """

    images: NDArray[Any]
    depth: NDArray[np.float32]
    available: NDArray[np.bool_]
    facts: ImageFacts = field(default_factory=ImageFacts)
    found: Mapping[str, Any] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    @property
    def valid(self) -> NDArray[np.bool_]:
        """True where the depth is known, same shape as `depth`."""
        return np.isfinite(self.depth)

    @property
    def infocus(self) -> NDArray[Any]:
        """The in-focus images, shape (*pair axes, y, x, channel)."""
        return np.asarray(self.images[..., self.facts.roles.index("infocus"), :, :, :])

    @property
    def defocus(self) -> NDArray[Any]:
        """The first defocus images, shape (*pair axes, y, x, channel)."""
        return np.asarray(self.images[..., self.facts.roles.index("defocus"), :, :, :])

    @classmethod
    def of_pairs(
        cls,
        infocus: NDArray[np.uint8],
        levels: NDArray[np.uint8],
        valid: NDArray[np.bool_],
        available: NDArray[np.bool_],
        defocus: NDArray[np.uint8] | None = None,
    ) -> Self:
        """Return a scene of pairs from images (*pair axes, y, x, channel) and depth levels.

        Without `defocus` the build makes it.
        """
        images = [infocus] if defocus is None else [infocus, defocus]
        depth = np.where(valid, levels, np.nan).astype(np.float32)
        return cls(np.stack(images, axis=-4), depth, available, ImageFacts(PAIR[: len(images)]))


def laid_out(
    manifest: Manifest, found: Mapping[Pair, NDArray[Any]]
) -> tuple[NDArray[Any], NDArray[np.bool_]]:
    """Return the available arrays in one array, zero elsewhere, and a mask of which are there.

    Parameters
    ----------
    manifest : Manifest
        Its axes come first in the results, shapes (*pair axes, ...) and (*pair axes,).
    found : mapping of Pair to ndarray
        Arrays of one shape, for pairs of one scene.
    """
    extent = tuple(map(len, manifest.axes.values()))
    first = next(iter(found.values()))
    whole, there = np.zeros((*extent, *first.shape), first.dtype), np.zeros(extent, bool)
    for pair, values in found.items():
        at = tuple(manifest.axes[axis].index(value) for axis, value in pair.coordinates)
        whole[at], there[at] = values, True
    return whole, there


class Whole:
    """Base of sources that have every pair, or report scene by scene what is missing."""

    options: Mapping[str, Any] = {}

    def __init__(self, manifest: Manifest) -> None:
        self._manifest = manifest

    def available_pairs(self) -> tuple[Pair, ...]:
        """Return every pair of the manifest."""
        return self._manifest.pairs()

    def missing_help(self, missing: tuple[Pair, ...]) -> str:
        """Return an empty text: generated data cannot be missing."""
        return ""


class Source(Protocol):
    """A data set's files, or its generator."""

    @property
    def options(self) -> Mapping[str, Any]:
        """Requested options that change the arrays; the store records them."""

    @property
    def captures_defocus(self) -> bool:
        """Whether `read` returns defocus images; if not, the build makes them by a recipe."""

    def available_pairs(self) -> tuple[Pair, ...]:
        """Return the pairs whose image and depth map are there, in the manifest's order."""

    def signature(self, scene: str) -> str:
        """Return a SHA-256 that changes whenever the scene's inputs change.

        Raises
        ------
        SceneError, SourceError
            As `read`.
        """

    def read(self, scene: str) -> SceneImages:
        """Read one scene.

        Raises
        ------
        SceneError
            With everything that is wrong with the scene's files, if the other scenes may be built
            without it.
        SourceError
            The same, if nothing may be built.
        """

    def missing_help(self, missing: tuple[Pair, ...]) -> str:
        """Return what to do to get the pairs that are missing."""


def is_made(manifest: Manifest) -> bool:
    """Return whether the package generates a data set itself, without files."""
    return manifest.reader in _OURS and not _OURS[manifest.reader][1]


def open_source(
    manifest: Manifest,
    folder: Path | None = None,
    checksums: Mapping[str, str] | None = None,
    pair: tuple[int, int] | None = None,
) -> Source:
    """Return the source that a manifest names as its `reader`.

    A package offers a reader in the entry-point group ``dfdbench.sources``. A reader is a callable
    that takes the manifest and the folder, or None, and returns a `Source`.

    Parameters
    ----------
    manifest : Manifest
        The data set.
    folder : Path, optional
        Where its files are, for a data set that is read from disk.
    checksums : mapping of str to str, optional
        See `MiddleburyScenes`.
    pair : tuple of int, optional
        Two voltage steps; see `RealworldFolder`.

    Raises
    ------
    InputError
        If the data set takes no folder or no voltage steps.
    SourceError
        If it needs a folder, or cannot be built by this version.
    """
    refuse_both({manifest.short: manifest.reader != "realworld"}, {"--pair": pair})
    if manifest.reader not in _OURS:
        return _offered(manifest, folder)
    place, layout = _OURS[manifest.reader]
    module, _, name = place.partition(":")
    reader: Callable[..., Source] = getattr(import_module(f"{__name__}.{module}"), name)
    if is_made(manifest):
        refuse_both({manifest.short: True}, {"--source": folder})
        return reader(manifest)
    if folder is None:
        layouts = manifest.files.patterns.values() if manifest.files else [layout]
        what = f"{manifest.short} is read from a folder, and none is named"
        command = "" if manifest.files else f"dfdbench build {manifest.short} "
        fix = f"name the folder: {command}--source DIR"
        raise SourceError(what, expected=listed(layouts), fix=fix)
    return reader(manifest, folder, pair if manifest.reader == "realworld" else checksums)


def _offered(manifest: Manifest, folder: Path | None) -> Source:
    offered = offered_as(ENTRY_POINT_GROUP)
    if manifest.reader not in offered:
        known = ", ".join(sorted({*_OURS, *offered}))
        what = f"no reader {manifest.reader} for the files of {manifest.stem}; there are {known}"
        raise SourceError(what)
    point = offered[manifest.reader]
    try:
        reader = point.load()
    except (Exception, SystemExit) as error:
        where = f"{ENTRY_POINT_GROUP}: {point.name} = {point.value}"
        got = str(error) or type(error).__name__
        raise SourceError("the reader cannot be imported", where=where, got=got) from error
    source: Source = reader(manifest, folder)
    return source
