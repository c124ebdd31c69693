"""How far apart two depth levels must be before a pixel's blur shows the difference."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfdbench.audit.sides import depth_maps
from dfdbench.blur.recipe import LAST_LEVEL, LEVELS, BlurRecipe
from dfdbench.blur.synthesis import synthesize
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest import Manifest, Pair
from dfdbench.errors import InputError
from dfdbench.results.wording import NOTHING
from dfdbench.system.parallel import one_by_one
from dfdbench.system.text import as_json
from dfdbench.tables.table import Table, percent

#: A step that is a useful depth difference: an eighth of the range that 256 levels span.
COARSE = 32
#: The steps tried, in depth levels.
STEPS = (1, 2, 4, 8, 16, 32, 64, 128)
#: Stands for no step that is seen.
UNSEEN = LEVELS
_SEEN = (
    "a step is seen where the defocus pixel, as stored in whole grey levels, differs in some "
    "channel by more than {noise} grey levels at the level that much nearer and at the level that "
    "much farther"
)


@dataclass(frozen=True)
class Difficulty:
    """What a pair's blur shows of its depth.

    Parameters
    ----------
    step : ndarray of int64, shape (y, x)
        The smallest of `STEPS` that is seen, nearer and farther; or `UNSEEN`.
    valid : ndarray of bool, shape (y, x)
        True where the depth is known; only these count.
    """

    step: NDArray[np.int64]
    valid: NDArray[np.bool_]

    def share_above(self, step: int) -> float:
        """Return the share of known pixels that need a larger step than this one.

        For step 1: pixels whose blur does not show the difference between neighbouring levels.
        """
        return float((self.step[self.valid] > step).mean()) if self.valid.any() else float("nan")


def median_step(parts: Sequence[Difficulty]) -> int | None:
    """Return the median step over the known pixels of some pairs.

    One of `STEPS`, or `UNSEEN` if no step is seen for most pixels; None without a known pixel.
    """
    steps = np.concatenate([part.step[part.valid] for part in parts])
    return int(np.percentile(steps, 50, method="inverted_cdf")) if steps.size else None


def smallest_step(
    infocus: NDArray[np.uint8],
    depth: NDArray[np.uint8],
    valid: NDArray[np.bool_],
    recipe: BlurRecipe,
    noise: int = 0,
) -> Difficulty:
    """Find the smallest level step that each pixel's blur shows.

    The in-focus image is blurred at each pixel's own level and at levels a step nearer and
    farther. A step is seen if the defocus pixel, as stored in whole grey levels, differs in some
    channel by more than the noise from both. At the ends of the scale only one of the two exists.

    Parameters
    ----------
    infocus : ndarray of uint8, shape (y, x, 3)
        The in-focus image.
    depth : ndarray of uint8, shape (y, x)
        Depth levels in the recipe's sense, brighter for nearer.
    valid : ndarray of bool, shape (y, x)
        True where the depth is known.
    recipe : BlurRecipe
        How the defocus image was made.
    noise : int
        Grey levels that a difference must exceed; by default any difference counts.

    Raises
    ------
    InputError
        If noise is not a whole number from 0 up.

    Notes
    -----
    In a synthetic pair each defocus pixel is made from the in-focus image and its own depth
    alone (Eq. 3.1 to 3.4). So what is not seen here is in no pixel of the pair: a method can
    only guess it from the depth around. Both sides must differ: a level that looks like one of
    its neighbours cannot be told from it.

    Examples
    --------
    >>> from dfdbench.blur import RECIPES
    >>> flat = np.full((30, 30, 3), 90, np.uint8)
    >>> depth = np.full((30, 30), 120, np.uint8)
    >>> smallest_step(flat, depth, depth > 0, RECIPES["published"]).share_above(1)
    1.0
    """
    here = synthesize(infocus, depth, recipe).astype(np.int16)
    found = np.full(depth.shape, UNSEEN, np.int64)
    for step in STEPS:
        seen = np.ones(depth.shape, bool)
        tried = np.zeros(depth.shape, bool)
        for move in (-step, step):
            level = depth.astype(np.int64) + move
            inside = (level >= 0) & (level < recipe.levels)
            moved = np.where(inside, level, depth).astype(np.uint8)
            change = np.abs(synthesize(infocus, moved, recipe).astype(np.int16) - here).max(axis=2)
            seen &= ~inside | (change > noise)
            tried |= inside
        found[seen & tried & (found == UNSEEN)] = step
    return Difficulty(found, valid)


def split_difficulty(
    store: Dataset, split: str, noise: int, on_pair: Callable[[int, int], None]
) -> dict[Pair, Difficulty]:
    """Find the smallest step that each pixel's blur shows, for each pair of a split.

    Raises
    ------
    InputError
        If no blur recipe is known, or the store holds no pair of the split.
    StoreError
        If a depth map is damaged.
    """
    manifest, recipe = store.manifest, store.recipe
    pairs = store.pairs(split)
    if recipe is None:
        why = "its track gives none" if manifest.on_track else "captured images"
        raise InputError(f"no blur recipe is known: {why}", where=str(store.path))
    if not pairs:
        raise InputError(f"no pair of split {split}", where=str(store.path))
    for scene in dict.fromkeys(pair.scene for pair in pairs):
        depth_maps(store, scene)
    found = {}
    for pair in one_by_one(pairs, on_pair):
        images = store.read(pair)
        far = manifest.depth.grows_with == "distance"
        depth = LAST_LEVEL - images.levels if far else images.levels
        found[pair] = smallest_step(images.infocus, depth, images.valid, recipe, noise)
    return found


def difficulty_rows(manifest: Manifest, found: Mapping[Pair, Difficulty]) -> list[dict[str, Any]]:
    """Return mean shares and median steps by scene and lighting, views taken together."""
    lighting = _lighting(manifest)
    groups: dict[tuple[str, tuple[int, ...]], list[Difficulty]] = {}
    for pair, difficulty in found.items():
        key = (pair.scene, tuple(pair.at[axis] for axis in lighting))
        groups.setdefault(key, []).append(difficulty)
    return [
        {
            "scene": scene,
            **dict(zip(lighting, values, strict=True)),
            "neighbours": _mean([d.share_above(STEPS[0]) for d in group]),
            "coarse": _mean([d.share_above(COARSE) for d in group]),
            "median_step": median_step(group),
        }
        for (scene, values), group in groups.items()
    ]


def difficulty_table(manifest: Manifest, rows: list[dict[str, Any]], noise: int) -> Table:
    """Return the rows as a table."""
    lighting = _lighting(manifest)
    columns = ("scene", *lighting, "1 apart", f"{COARSE} apart", "median step")
    cells = tuple(
        (
            str(row["scene"]),
            *(str(row[axis]) for axis in lighting),
            _percent(row["neighbours"]),
            _percent(row["coarse"]),
            _step(row["median_step"]),
        )
        for row in rows
    )
    notes = (
        f"1 apart, {COARSE} apart: share of the pixels whose blur cannot tell levels that far "
        "from each other",
        _SEEN.format(noise=noise),
        "steps tried: " + ", ".join(map(str, STEPS)),
    )
    title = f"what blur does not show of depth in {manifest.label}"
    return Table(title, columns, cells, "l" + "r" * (len(columns) - 1), notes)


def difficulty_as_json(
    manifest: Manifest, fingerprint: str, noise: int, rows: list[dict[str, Any]]
) -> str:
    """Return the rows as JSON."""
    return as_json(
        "difficulty",
        dataset=manifest.stem,
        fingerprint=fingerprint,
        noise=noise,
        steps=STEPS,
        coarse_step=COARSE,
        rows=[
            row | {"median_step": None if row["median_step"] == UNSEEN else row["median_step"]}
            for row in rows
        ],
    )


def _lighting(manifest: Manifest) -> list[str]:
    return [axis for axis in manifest.axes if axis not in manifest.depth.axes]


def _mean(values: list[float]) -> float:
    defined = [value for value in values if not math.isnan(value)]
    return math.fsum(defined) / len(defined) if defined else math.nan


def _percent(value: float) -> str:
    return NOTHING if math.isnan(value) else percent(value)


def _step(value: int | None) -> str:
    return NOTHING if value is None else "none" if value == UNSEEN else str(value)
