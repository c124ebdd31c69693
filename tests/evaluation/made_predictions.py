"""Depth maps made elsewhere, for the tests of what scores them."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.depth_scale import DepthScale
from dfdbench.datasets.manifest import Pair


def write_all(
    store: Dataset,
    split: str,
    folder: Path,
    write: Callable[[Path, NDArray[Any]], Any],
    flat: bool = False,
) -> dict[Pair, NDArray[np.float32]]:
    """Write a depth map for each pair of a split; return them in levels."""
    random = np.random.default_rng(5)
    made = {}
    for pair in store.pairs(split):
        made[pair] = random.uniform(1, 255, store.shape_of(pair.scene)).astype(np.float32)
        stem = folder / (pair.id.replace("/", "_") if flat else pair.id)
        stem.parent.mkdir(parents=True, exist_ok=True)
        write(stem, made[pair])
    return made


def in_metres(store: Dataset) -> tuple[Dataset, DepthScale]:
    """The store as it were if its manifest said how levels become metres."""
    scale = DepthScale(law="inverse", near=0.5, far=2.0)
    depth = store.manifest.depth.model_copy(update={"scale": scale})
    store.manifest = store.manifest.model_copy(update={"depth": depth})
    return store, scale
