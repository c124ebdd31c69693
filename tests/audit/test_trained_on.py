import copy
from typing import Any

import pytest

from dfdbench.audit.trained_on import Training, coverage_warnings, sides_of_run, training_side
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.depth_scale import DepthScale
from dfdbench.errors import InputError


def test_the_text_names_scenes_of_the_store(tiny_store: Dataset) -> None:
    for text, scenes in (
        ("tiny-1, split train", ["One"]),
        ("tiny, all but K2, 30 epochs", ["One", "Two"]),
        ("tiny-1, all but Two", ["One", "Three"]),
    ):
        side = training_side(text, tiny_store)
        assert side is not None
        assert list(side.scenes) == scenes
    assert training_side("photographs of cats", tiny_store) is None


def test_what_is_uncovered_or_unknown_and_training_on_the_test_is_said(tiny_store: Dataset) -> None:
    for text, told in (
        ("cats", 'training, "cats": only "MANIFEST, split NAME"'),
        ("tiny-1, split tarin", "unknown split"),
        ("nosuch-1, split train", "unknown data set"),
        ("middlebury-third-1, split train", "not built"),
        ("tiny-1, split train", "known pixels lie on depth levels that tiny-1, train, leaves"),
        ("tiny-1, split all", "leak: trained on scenes or textures of the test: Two"),
    ):
        (warning,) = coverage_warnings(text, tiny_store, "test")
        assert told in warning
    assert coverage_warnings(None, tiny_store, "test") == []
    # The same depths, as if they were metres.
    about = tiny_store.manifest.depth
    scale = DepthScale(law="linear", near=1, far=255, near_level=1, far_level=255)
    depth = about.model_copy(update={"unit": "metres", "scale": scale})
    tiny_store.manifest = tiny_store.manifest.model_copy(update={"depth": depth})
    (warning,) = coverage_warnings("tiny-1, split train", tiny_store, "test")
    assert "lie on distances that tiny-1, train, leaves" in warning
    assert warning.endswith(" m")


def test_levels_that_are_other_distances_than_those_of_the_training_are_told(
    tiny_store: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    def at(far: float, **levels: Any) -> Dataset:
        store, manifest = copy.copy(tiny_store), tiny_store.manifest
        scale = DepthScale(near=0.5, far=far, **levels)
        depth = manifest.depth.model_copy(update={"scale": scale})
        store.manifest = manifest.model_copy(update={"depth": depth})
        return store

    told = "levels of tiny-1 are other distances: 0.5 to 4 m (inverse), here 0.5 to 9 m (inverse)"
    monkeypatch.setattr("dfdbench.audit.trained_on.open_dataset", lambda _: at(4))
    assert told in coverage_warnings("middlebury-1, split train", at(9), "test")
    monkeypatch.setattr("dfdbench.audit.trained_on.open_dataset", lambda _: at(9))
    for same in (at(9), at(9, near_level=1, far_level=255)):
        (warning,) = coverage_warnings("middlebury-1, split train", same, "test")
        assert "lie on depth levels" in warning


def test_a_run_is_held_against_what_is_named_else_against_the_usual(tiny_store: Dataset) -> None:
    for split, trained_on, train, fold, held_against, training in (
        ("test", "tiny-1, all but Two", None, None, "all but Two", Training.known),
        ("test", "tiny-1, all but Two", "One", None, "One", Training.known),
        ("test", None, None, "K2", "all but K2", Training.known),
        ("test", None, None, None, "train", Training.none),
        ("test", "a lot of images", None, None, "train", Training.unknown),
        ("One", None, None, None, "all but One", Training.none),
    ):
        side, test, known = sides_of_run(tiny_store, split, trained_on, train, fold)
        assert (side.name, test.name, known) == (held_against, split, training)
    with pytest.raises(InputError, match="tested every scene"):
        sides_of_run(tiny_store, "all", None, None, None)
