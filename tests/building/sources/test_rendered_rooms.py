from pathlib import Path

import numpy as np
import pytest

from dfdbench.building.build import build_store
from dfdbench.building.sources import SceneImages
from dfdbench.building.sources.rendered_rooms import Rooms
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest_file import parse_manifest
from dfdbench.datasets.rendered import unseen_manifest
from dfdbench.errors import SourceError, StoreError
from dfdbench.system.parallel import Threads


@pytest.mark.slow
def test_a_seed_builds_the_same_rooms_with_one_thread_and_two(tmp_path: Path) -> None:
    manifest = unseen_manifest("unseen", 5)
    scenes = [scene for scene in manifest.scenes if scene.name in ("test-01", "train-01")]
    manifest = manifest.model_copy(update={"scenes": scenes})
    one = build_store(manifest, Rooms(manifest), tmp_path / "one.zarr")
    two = build_store(manifest, Rooms(manifest), tmp_path / "two.zarr", pool=Threads(2))
    assert one.fingerprint == two.fingerprint
    store = Dataset(tmp_path / "one.zarr")
    capture = store.read(store.pairs("all")[0])
    assert capture.infocus.shape == (480, 640, 3)
    assert 0.6 <= np.nanmin(capture.depth) < np.nanmax(capture.depth) <= 6.0
    stack = capture.stack
    assert stack["f_number"].values[0] == 8
    assert stack["f_number"].values[1] < 3
    assert stack.attrs["unit"] == "metres"
    assert stack.attrs["focal_length"] > 0


def test_a_set_of_another_generator_is_refused(tmp_path: Path) -> None:
    text = unseen_manifest("unseen", 5).toml.replace("by generator 1", "by generator 0")
    older = parse_manifest(text.encode(), "unseen-5-1.toml")
    older = older.model_copy(update={"scenes": older.scenes[:1]})

    class Blank(Rooms):
        def read(self, scene: str) -> SceneImages:
            image, depth = np.zeros((1, 2, 4, 4, 3), np.uint8), np.ones((4, 4), np.float32)
            return SceneImages(image, depth, np.ones(1, bool))

    build_store(older, Blank(older), tmp_path / "old.zarr")
    with pytest.raises(StoreError, match="built from another manifest"):
        Dataset(tmp_path / "old.zarr")
    with pytest.raises(SourceError, match="the manifest's name has none"):
        Rooms(older.model_copy(update={"name": "mine"}))
