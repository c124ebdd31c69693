"""Reading pairs and crops from a store against reading the PNG files with OpenCV, in one run."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import zarr

from dfdbench.building.export import export_png
from dfdbench.datasets.dataset import Dataset, open_dataset
from tests.benchmarks.ledger import Ledger, cpu

CROP = (slice(100, 132), slice(150, 182))


def read_png(folder: Path) -> list[Any]:
    """Both images and the depth map of each pair of one lighting."""
    names = ("Illum2/Exp2/view1.png", "Illum2/Exp2/view1_lin_0.32_2.88.png", "disp1.png")
    return [
        [cv2.imread(str(folder / scene / name), cv2.IMREAD_UNCHANGED) for name in names]
        for scene in ("Kitchen", "Library", "Market")
    ]


def read_png_crops(folder: Path) -> list[Any]:
    return [[image[CROP].copy() for image in images] for images in read_png(folder)]


@pytest.fixture(scope="module")
def ways(
    demo_store: Dataset, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, Callable[[], Any]]:
    folder = tmp_path_factory.mktemp("png")
    export_png(demo_store, folder, "test")
    data = open_dataset("demo", demo_store.path).captures("test")
    wanted = {"view": 1, "illumination": 2, "exposure": 2}
    chosen = [number for number, pair in enumerate(data.pairs) if pair.at == wanted]
    return {
        "store, pairs": lambda: [data[number] for number in chosen],
        "PNG, pairs": lambda: read_png(folder),
        "store, crops": lambda: [data.crop(number, CROP) for number in chosen],
        "PNG, crops": lambda: read_png_crops(folder),
    }


@pytest.mark.benchmark(group="read three pairs of 240 x 320")
@pytest.mark.parametrize("way", ["store, pairs", "PNG, pairs", "store, crops", "PNG, crops"])
def test_reading(benchmark: Any, ways: dict[str, Callable[[], Any]], way: str) -> None:
    result = benchmark.pedantic(ways[way], rounds=20, warmup_rounds=2)
    assert len(result) == 3


@pytest.mark.benchmark(timer=time.process_time)
def test_against_zarr(benchmark: Any, ledger: Ledger, demo_store: Dataset) -> None:
    data = open_dataset("demo", demo_store.path).captures("test")
    axes = demo_store.manifest.axes

    def plain() -> list[tuple[Any, Any]]:
        found = []
        for pair in data.pairs:
            scene: Any = zarr.open_group(str(demo_store.path), path=pair.scene, mode="r")
            at = tuple(axes[axis].index(value) for axis, value in pair.coordinates)
            found.append((scene["images"][at], scene["depth"][at[0]]))
        return found

    ours = benchmark.pedantic(lambda: list(data), rounds=5, warmup_rounds=1)
    for capture, (images, depth) in zip(ours, plain(), strict=True):
        assert np.array_equal(capture.images, images)
        assert np.array_equal(capture.depth, depth, equal_nan=True)
    title, peer = f"reading of {len(ours)} pairs of 240 x 320", "open_group and indexing"
    ledger.note(title, benchmark.stats["min"], "zarr", peer, cpu(plain, 5), "equal")
