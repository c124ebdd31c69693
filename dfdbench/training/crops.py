"""Draw patches for training, and count which pairs they came from."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from dfdbench.blur.formation import LOBES, form_pair, kernel_size_of, law_of
from dfdbench.blur.recipe import LAST_LEVEL, LEVELS, BlurRecipe
from dfdbench.blur.tracks import TRACKS, Degradation
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest import Pair
from dfdbench.system.parallel import OnDone, one_by_one
from dfdbench.training.configuration import Expansion

#: Forms a patch if no track is drawn.
CLEAN = Degradation(TRACKS["noise"], 0)
#: The label that cross-entropy ignores.
IGNORED = -100


@dataclass(frozen=True)
class TrainingImages:
    """The pairs of a training, in memory.

    Parameters
    ----------
    pixels : list of Tensor
        uint8 (6, y, x): in-focus RGB, then defocus RGB.
    levels : list of Tensor
        int16 (y, x), depth levels; `IGNORED` where a pixel is left out.
    """

    pixels: list[Tensor]
    levels: list[Tensor]

    @classmethod
    def read(cls, store: Dataset, pairs: tuple[Pair, ...], ignore_unknown: bool) -> TrainingImages:
        """Read pairs of a store; a depth map that several pairs share is kept once."""
        pixels = []
        levels: list[Tensor] = []
        kept: dict[tuple[tuple[int, ...], bytes], Tensor] = {}
        for pair in pairs:
            images = store.read(pair).two_of(store.manifest.pair_images)
            both = np.concatenate([images.infocus, images.defocus], axis=2)
            pixels.append(torch.from_numpy(np.ascontiguousarray(both.transpose(2, 0, 1))))
            depth = images.levels.astype(np.int16)
            if ignore_unknown:
                depth[~images.valid] = IGNORED
            key = depth.shape, depth.tobytes()
            levels.append(kept.setdefault(key, torch.from_numpy(depth)))
        return cls(pixels, levels)

    def channel_means(self) -> list[float]:
        """Return the mean of each channel over all pixels of all pairs."""
        totals = torch.stack([pixels.double().mean((1, 2)) for pixels in self.pixels])
        weights = torch.tensor([float(levels.numel()) for levels in self.levels]).double()
        means = (totals * weights[:, None]).sum(0) / weights.sum()
        return [round(float(mean), 4) for mean in means]

    def count_levels(self) -> NDArray[np.int64]:
        """Return how often each depth level occurs, shape (256,)."""
        return sum((count_levels(levels) for levels in self.levels), np.zeros(LEVELS, np.int64))


@dataclass(frozen=True)
class PatchPlace:
    """Where a patch is taken from.

    Parameters
    ----------
    index : int
        The index of the image in the training.
    top, left : int
        The patch's first row and column in it.
    orientation : int
        One of eight, if patches are not given in all of them.
    depth : tuple of float, optional
        Slope down, slope to the right and mean level, if patches get other depths.
    degradation : Degradation
        The track and its severity that form the patch, if its depth is another.
    name : str
        Determines direction, gain and noise on the track. It begins with ``training``, unlike any
        pair's name, so that a data set's noise is never drawn again.
    """

    index: int
    top: int
    left: int
    orientation: int = 0
    depth: tuple[float, float, float] | None = None
    degradation: Degradation = CLEAN
    name: str = ""


@dataclass(frozen=True)
class Redraw:
    """Gives a patch another depth map.

    Parameters
    ----------
    recipe : BlurRecipe
        How the data set's defocus images were made.
    lowest, highest : int
        The limits of a patch's mean level.
    tilt : float
        The steepest slope added along rows and columns, in levels per pixel.
    unknown : int
        The level that stays as it is.
    tracks : tuple of Degradation
        One is drawn for each patch, with equal probability, and forms both of its images.
    """

    recipe: BlurRecipe
    lowest: int
    highest: int
    tilt: float
    unknown: int
    tracks: tuple[Degradation, ...] = ()

    @property
    def margin(self) -> int:
        """How many pixels around a patch affect its blur, on any of the tracks."""
        return max(margin_of(self.recipe, track) for track in (CLEAN, *self.tracks))

    def choose(self, random: np.random.Generator) -> tuple[float, float, float]:
        """Draw a patch's slope down, its slope to the right and its mean level."""
        down, right = random.uniform(-self.tilt, self.tilt, 2)
        return float(down), float(right), float(random.uniform(self.lowest, self.highest))

    def levels(
        self, depth: NDArray[np.uint8], chosen: tuple[float, float, float]
    ) -> NDArray[np.uint8]:
        """Return another depth map, uint8 (y, x)."""
        known = depth != self.unknown
        mean = depth[known].mean() if known.any() else 0.0
        down, right, level = chosen
        rows, columns = np.ogrid[: depth.shape[0], : depth.shape[1]]
        plane = down * (rows - depth.shape[0] / 2) + right * (columns - depth.shape[1] / 2)
        moved = depth + (level - mean) + plane
        levels = np.clip(np.rint(moved), self.unknown + 1, LAST_LEVEL)
        return np.where(known, levels, depth).astype(np.uint8)


@dataclass
class Cropper:
    """Draw the patches of each step.

    Parameters
    ----------
    images : TrainingImages
        The images to draw from.
    size : int
        Rows and columns of a patch.
    count : int
        Patches per step, before expansion.
    expansion : {"eight", "basic", "one"}
        Each in its eight orientations, in one of the four by mirroring alone, or in one of all.
    noise : float
        Standard deviation in grey levels.
    seed : int
        A step's patches depend only on seed and step.
    redraw : Redraw, optional
        Gives patches another depth, and draws a track for each.
    """

    images: TrainingImages
    size: int
    count: int
    expansion: Expansion
    noise: float
    seed: int
    redraw: Redraw | None = None

    def __post_init__(self) -> None:
        self._margin = self.redraw.margin if self.redraw else 0
        #: Rows and columns of each pair's images.
        self.shapes = tuple((levels.shape[0], levels.shape[1]) for levels in self.images.levels)
        self._expand = self.expansion == "eight"
        self._to_draw = (0, 4, 6, 2) if self.expansion == "basic" else tuple(range(8))

    def draw(self, step: int) -> tuple[Tensor, Tensor]:
        """Return pixels, float32 (n, 6, size, size), and levels, int64 (n, size, size)."""
        random = np.random.default_rng((self.seed, step))
        pixels, levels = [], []
        for place in self._places(random, step):
            patch, truth = self._patch(place)
            chosen = range(8) if self._expand else [place.orientation]
            pixels += [oriented(patch, orientation) for orientation in chosen]
            levels += [oriented(truth, orientation) for orientation in chosen]
        batch = torch.stack(pixels)
        if self.noise:
            drawn = random.standard_normal(batch.shape, np.float32)
            batch = (batch + self.noise * torch.from_numpy(drawn)).clamp(0, 255)
        return batch, torch.stack(levels)

    def places(self, step: int) -> list[PatchPlace]:
        """Return where the patches of a step come from, without reading them."""
        return self._places(np.random.default_rng((self.seed, step)), step)

    def _places(self, random: np.random.Generator, step: int) -> list[PatchPlace]:
        places = []
        for number in range(self.count):
            index = int(random.integers(len(self.shapes)))
            # A patch that gets another depth needs all surroundings that affect its blur.
            side = self.size + 2 * self._margin
            top, left = (
                int(random.integers(extent - side + 1)) + self._margin
                for extent in self.shapes[index]
            )
            depth = self.redraw.choose(random) if self.redraw else None
            drawn = 0 if self._expand else int(random.integers(len(self._to_draw)))
            tracks = self.redraw.tracks if self.redraw else ()
            track = tracks[int(random.integers(len(tracks)))] if tracks else CLEAN
            name = f"training/{self.seed}/{step}/{number}"
            places.append(PatchPlace(index, top, left, self._to_draw[drawn], depth, track, name))
        return places

    def _patch(self, place: PatchPlace) -> tuple[Tensor, Tensor]:
        def around(margin: int) -> tuple[slice, ...]:
            starts = (place.top, place.left)
            return tuple(slice(start - margin, start + self.size + margin) for start in starts)

        pixels, levels = self.images.pixels[place.index], self.images.levels[place.index]
        if self.redraw is None or place.depth is None:
            return pixels[:, *around(0)].float(), levels[around(0)].long()
        track, recipe = place.degradation, self.redraw.recipe
        margin = margin_of(recipe, track)
        infocus = pixels[:3, *around(margin)].permute(1, 2, 0).contiguous().numpy()
        truth = levels[around(margin)]
        depth = truth.clamp(min=0).byte().numpy()
        redrawn = self.redraw.levels(depth, place.depth)
        pair = form_pair(infocus, redrawn, recipe, track, place.name)
        both = torch.from_numpy(np.concatenate(pair, axis=2)).permute(2, 0, 1)
        found = torch.from_numpy(redrawn).long()
        found[truth == IGNORED] = IGNORED
        kept = slice(margin, margin + self.size)
        return both[:, kept, kept].float(), found[kept, kept]


def severities_of(names: Iterable[str]) -> tuple[Degradation, ...]:
    """Return each track with every severity from 0, which is clean.

    Examples
    --------
    >>> [found.label for found in severities_of(["psf"])]
    ['clean', 'psf-1', 'psf-2', 'psf-3']
    """
    return tuple(
        Degradation(TRACKS[name], severity)
        for name in names
        for severity in range(len(TRACKS[name].severities) + 1)
    )


def margin_of(recipe: BlurRecipe, track: Degradation) -> int:
    """Return how many pixels around a patch affect its blur, on a track."""
    formation = track.formation
    radius = kernel_size_of(law_of(recipe, formation), formation.layers) // 2
    return radius + (LOBES + math.ceil(formation.shift) if formation.shift else 0)


def oriented(image: Tensor, orientation: int) -> Tensor:
    """Return an image in one of eight orientations: quarter turns, mirrored from 4 on.

    Examples
    --------
    >>> image = torch.tensor([[1, 2], [3, 4]])
    >>> [oriented(image, orientation).tolist() for orientation in (1, 4)]
    [[[2, 4], [1, 3]], [[2, 1], [4, 3]]]
    """
    turned = torch.rot90(image, orientation % 4, (-2, -1))
    return turned.flip(-1) if orientation >= 4 else turned


def count_levels(levels: Tensor) -> NDArray[np.int64]:
    """Return how often each depth level occurs, shape (256,)."""
    return np.asarray(torch.bincount(levels[levels >= 0], minlength=LEVELS).numpy())


@dataclass(frozen=True)
class Selections:
    """The patches of a training; each counts once, however many orientations it was given in.

    Parameters
    ----------
    pairs : tuple of str
        The training pairs' names.
    shapes : tuple of (int, int)
        Rows and columns of each pair's images.
    size : int
        Rows and columns of a patch.
    places : ndarray of int32, shape (patches, 3)
        For each patch: the pair's index, its first row and its first column.
    """

    pairs: tuple[str, ...]
    shapes: tuple[tuple[int, int], ...]
    size: int
    places: NDArray[np.int32]

    @property
    def patches(self) -> NDArray[np.int64]:
        """How many patches were drawn from each pair, shape (pairs,)."""
        return np.asarray(np.bincount(self.places[:, 0], minlength=len(self.pairs)))

    def uses(self, pair: int) -> NDArray[np.int64]:
        """Return how many patches contained each pixel of a pair, shape (y, x).

        Examples
        --------
        >>> drawn = Selections(("a",), ((2, 4),), 2, np.array([[0, 0, 0], [0, 0, 1]], np.int32))
        >>> drawn.uses(0).tolist()
        [[1, 2, 1, 0], [1, 2, 1, 0]]
        """
        rows, columns = self.shapes[pair]
        _, top, left = self.places[self.places[:, 0] == pair].T
        # Mark each patch at its corners; cumulative sums along both axes give its pixels.
        corners = np.zeros((rows + 1, columns + 1), np.int64)
        for row, column, sign in (
            (top, left, 1),
            (top + self.size, left, -1),
            (top, left + self.size, -1),
            (top + self.size, left + self.size, 1),
        ):
            np.add.at(corners, (row, column), sign)
        return np.asarray(corners.cumsum(0).cumsum(1)[:rows, :columns])

    def rows(self) -> list[dict[str, object]]:
        """Return a row per pair: its patches, and the least, mean and most patches per pixel."""
        found: list[dict[str, object]] = []
        for number, (pair, patches) in enumerate(zip(self.pairs, self.patches, strict=True)):
            uses = self.uses(number)
            ends, mean = (int(uses.min()), int(uses.max())), round(float(uses.mean()), 3)
            of_pixels = {"pixel_least": ends[0], "pixel_mean": mean, "pixel_most": ends[1]}
            found.append({"pair": pair, "patches": int(patches), **of_pixels})
        return found


def selections_of(
    cropper: Cropper, pairs: Sequence[str], steps: int, on_step: OnDone | None = None
) -> Selections:
    """Return what a training of this many steps drew: a step's patches follow from its number.

    Parameters
    ----------
    cropper : Cropper
        The training's cropper.
    pairs : sequence of str
        The names of its pairs.
    steps : int
        Steps done.
    on_step : callable, optional
        Called with (steps counted, total steps).
    """
    drawn = (place for step in one_by_one(range(steps), on_step) for place in cropper.places(step))
    places = np.fromiter((n for p in drawn for n in (p.index, p.top, p.left)), np.int32)
    return Selections(tuple(pairs), cropper.shapes, cropper.size, places.reshape(-1, 3))
