import pytest

from dfdbench.audit.trained_on import Training, coverage_warnings, sides_of_run, training_side
from dfdbench.datasets.dataset import Dataset
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


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("cats", 'trained_on is "cats", not "MANIFEST, split NAME"'),
        ("tiny-1, split tarin", "unknown split"),
        ("nosuch-1, split train", "unknown data set"),
        ("middlebury-third-1, split train", "not built"),
        ("tiny-1, split train", "known pixels lie on depth levels that tiny-1, train, leaves"),
    ],
)
def test_what_is_uncovered_or_unknown_is_said(tiny_store: Dataset, text: str, told: str) -> None:
    (warning,) = coverage_warnings(text, tiny_store, "test")
    assert told in warning


def test_training_on_the_test_is_said(tiny_store: Dataset) -> None:
    assert coverage_warnings(None, tiny_store, "test") == []
    (warning,) = coverage_warnings("tiny-1, split all", tiny_store, "test")
    assert warning.startswith("leak: trained on scenes or textures of the test: Two")


@pytest.mark.parametrize(
    ("split", "trained_on", "named", "train", "training"),
    [
        ("test", "tiny-1, all but Two", {}, "all but Two", Training.known),
        ("test", "tiny-1, all but Two", {"train": "One"}, "One", Training.known),
        ("test", None, {"fold": "K2"}, "all but K2", Training.known),
        ("test", None, {}, "train", Training.none),
        ("test", "a lot of images", {}, "train", Training.unknown),
        ("One", None, {}, "all but One", Training.none),
    ],
)
def test_a_run_is_held_against_what_is_named_else_against_the_usual(
    tiny_store: Dataset,
    split: str,
    trained_on: str | None,
    named: dict[str, str],
    train: str,
    training: Training,
) -> None:
    side, test, known = sides_of_run(
        tiny_store, split, trained_on, named.get("train"), named.get("fold")
    )
    assert (side.name, test.name, known) == (train, split, training)


def test_a_run_on_every_scene_leaves_none_to_compare_with(tiny_store: Dataset) -> None:
    with pytest.raises(InputError, match="tested every scene"):
        sides_of_run(tiny_store, "all", None, None, None)
