from dfdbench.building.sources.demo_scenes import SCENES
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest import Manifest


def test_training_and_test_share_no_photograph(demo_store: Dataset) -> None:
    manifest: Manifest = demo_store.manifest
    used = {
        split: {
            surface.texture.photograph
            for scene in manifest.scenes_of(split)
            for surface in SCENES[scene]
        }
        for split in ("train", "test")
    }
    assert not used["train"] & used["test"]
    assert set(SCENES) == set(manifest.scene_names)
