"""Coverage of the whole Middlebury layout from a built store, against reading every pair."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dfdbench.audit.coverage import compare_depths
from dfdbench.audit.sides import sides_of
from dfdbench.blur.recipe import RECIPES
from dfdbench.building.build import scene_dataset
from dfdbench.building.sources import SceneImages
from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest import Pair
from dfdbench.datasets.store_writer import StoreWriter


@pytest.fixture(scope="module")
def store_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """27 scenes of third size and their depth maps, 458 pairs; one lighting has an image."""
    manifest, random = find_manifest("middlebury"), np.random.default_rng(0)
    path = tmp_path_factory.mktemp("coverage") / "middlebury-third-1.zarr"
    recipe = RECIPES["published"]
    about = {
        "recipe": {"name": "published", "parameters": recipe.as_dict()},
        "degradation": "clean",
        "depth_unit": manifest.depth.unit,
        "options": {},
    }
    extent = tuple(len(values) for values in manifest.axes.values())
    with StoreWriter(path, manifest, about) as writer:
        digests = {}
        for scene in manifest.scene_names:
            ramp = np.linspace(random.integers(20, 90), random.integers(120, 230), 463)
            depth = np.broadcast_to(ramp, (2, 370, 463)).astype(np.uint8).copy()
            available = np.zeros(extent, bool)
            available[0, 0, 0] = True
            infocus = np.zeros((*extent, 370, 463, 3), np.uint8)
            infocus[0, 0, 0] = random.integers(0, 256, (370, 463, 3))
            images = SceneImages.of_pairs(infocus, depth, depth > 0, available)
            digests[scene] = writer.scenes.write(
                scene, scene_dataset(manifest, scene, images, recipe), "0" * 64
            )
        writer.finish(digests, [])
    return path


def coverage_of_all(path: Path) -> int:
    return compare_depths(*sides_of(Dataset(path), "train", "all")).test.known_pixels


def pair_by_pair(path: Path) -> int:
    store, counts = Dataset(path), np.zeros(256, np.int64)
    pairs: tuple[Pair, ...] = store.manifest.pairs("all")
    for pair in pairs:
        depth, valid = store.read_levels(pair)
        counts += np.bincount(depth[valid], minlength=256)
    return int(counts.sum())


@pytest.mark.benchmark(group="coverage of 458 pairs, 27 scenes")
@pytest.mark.parametrize("way", [coverage_of_all, pair_by_pair], ids=["ours", "pair by pair"])
def test_coverage(benchmark: Any, store_path: Path, way: Any) -> None:
    known = benchmark.pedantic(way, args=(store_path,), rounds=3)
    assert known == coverage_of_all(store_path)
