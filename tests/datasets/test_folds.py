from dfdbench.datasets.folds import training_of
from dfdbench.datasets.manifest import Manifest


def test_training_is_all_other_scenes(tiny_manifest: Manifest) -> None:
    assert training_of(tiny_manifest, "K2") == ("One", "Two")
