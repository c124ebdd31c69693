"""All 27 scenes at default lighting: seconds per pair for reading, blur and writing.

The shared Middlebury images are used where they are found; scenes that are not there, and all
of them where none is, are random images of the same size.
"""

import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from dfdbench.blur.recipe import RECIPES
from dfdbench.blur.synthesis import synthesize
from dfdbench.building.build import scene_dataset
from dfdbench.building.sources import Source, open_source
from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.manifest import Manifest
from dfdbench.datasets.store_writer import StoreWriter
from tests.conftest import shared_data_folder, write_png
from tests.process import python

RECIPE = RECIPES["published"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """27 scenes in the site's layout, both views at default lighting."""
    place = tmp_path_factory.mktemp("site")
    shared = shared_data_folder()
    random = np.random.default_rng(0)
    for scene in find_manifest("middlebury").scene_names:
        real = shared / "middlebury/ThirdSize" / scene if shared else None
        if real and real.is_dir():
            (place / scene).symlink_to(real)
            continue
        for view in (1, 5):
            noise = random.integers(0, 256, (370, 443, 3)).astype(np.uint8)
            smooth = cv2.GaussianBlur(noise, (0, 0), 2)
            write_png(place / scene / f"view{view}.png", np.asarray(smooth, np.uint8))
            depth = cv2.GaussianBlur(noise[..., 0], (0, 0), 30) * 3 % 200 + 20
            write_png(place / scene / f"disp{view}.png", depth.astype(np.uint8))
    return place


def time_steps(manifest: Manifest, source: Source, store: Path) -> tuple[dict[str, float], int]:
    """Seconds in all for each step, and how many pairs there were."""
    seconds = {"reading": 0.0, "blur": 0.0, "writing": 0.0}
    pairs = 0
    with StoreWriter(store, manifest, {}) as writer:
        for scene in manifest.scene_names:
            times = [time.perf_counter()]
            signature, images = source.signature(scene), source.read(scene)
            times.append(time.perf_counter())
            dataset = scene_dataset(manifest, scene, images, RECIPE)
            times.append(time.perf_counter())
            writer.scenes.write(scene, dataset, signature)
            times.append(time.perf_counter())
            for step, taken in zip(seconds, np.diff(times), strict=True):
                seconds[step] += float(taken)
            pairs += int(images.available.sum())
    return seconds, pairs


@pytest.mark.usefixtures("one_thread")
@pytest.mark.benchmark(group="build 27 scenes at default lighting, step by step")
def test_seconds_a_pair(
    benchmark: Any, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    manifest = find_manifest("middlebury-default")
    source = open_source(manifest, folder)
    synthesize(np.zeros((8, 8, 3), np.uint8), np.zeros((8, 8), np.uint8), RECIPE)
    store = tmp_path / "steps.zarr"
    seconds, pairs = benchmark.pedantic(time_steps, (manifest, source, store), rounds=1)
    with capsys.disabled():
        print(f"\n{pairs} pairs of {len(manifest.scene_names)} scenes, one thread, ms a pair:")
        for step, taken in seconds.items():
            print(f"  {step:<28}{1000 * taken / pairs:8.1f}")
    assert pairs >= 54


_BUILD = """
import resource, sys
from pathlib import Path
from dfdbench.building.build import build_store
from dfdbench.datasets.catalog import find_manifest
from dfdbench.building.sources import open_source
manifest = find_manifest("middlebury-default")
source = open_source(manifest, Path(sys.argv[1]))
build_store(manifest, source, sys.argv[2])
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


def peak(folder: Path, store: Path) -> float:
    """Megabytes that a build has in memory at most."""
    return int(python("-c", _BUILD, folder, store).stdout) / 1024


@pytest.mark.benchmark(group="peak memory of a build of 27 scenes")
def test_memory_does_not_grow_with_the_scenes(
    benchmark: Any, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    few = tmp_path / "few"
    few.mkdir()
    for scene in sorted(folder.iterdir())[:3]:
        (few / scene.name).symlink_to(scene)
    least = peak(few, tmp_path / "few.zarr")
    most = benchmark.pedantic(peak, (folder, tmp_path / "all.zarr"), rounds=1)
    with capsys.disabled():
        print(f"\npeak memory: 3 scenes {least:.0f} MB, 27 scenes {most:.0f} MB")
    assert most < 1.25 * least
