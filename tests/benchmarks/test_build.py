"""What a build of 27 scenes has in memory at most.

The shared Middlebury images are used where they are found; scenes that are not there, and all
of them where none is, are random images of the same size.
"""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from dfdbench.datasets.catalog import find_manifest
from tests.conftest import shared_data_folder, write_png
from tests.process import python


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
            write_png(place / scene / f"view{view}.png", noise)
            depth = cv2.GaussianBlur(noise[..., 0], (0, 0), 30) * 3 % 200 + 20
            write_png(place / scene / f"disp{view}.png", depth.astype(np.uint8))
    return place


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
def test_memory_does_not_grow_with_the_scenes(benchmark: Any, folder: Path, tmp_path: Path) -> None:
    few = tmp_path / "few"
    few.mkdir()
    for scene in sorted(folder.iterdir())[:3]:
        (few / scene.name).symlink_to(scene)
    least = peak(few, tmp_path / "few.zarr")
    most = benchmark.pedantic(peak, (folder, tmp_path / "all.zarr"), rounds=1)
    print(f"\npeak memory: 3 scenes {least:.0f} MB, 27 scenes {most:.0f} MB")
    assert most < 1.25 * least
