import pytest

from dfdbench.store import Store
from dfdbench.trained_on import coverage_warnings, training_side


def test_the_text_names_scenes_of_the_store(tiny_store: Store) -> None:
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
        ("cats", "trained_on is not"),
        ("tiny-1, split tarin", "unknown split"),
        ("nosuch-1, split train", "unknown data set"),
        ("middlebury-third-1, split train", "not built"),
        ("tiny-1, split train", "known pixels lie on depth levels that tiny-1, train, leaves"),
    ],
)
def test_what_is_uncovered_or_cannot_be_told_is_said(
    tiny_store: Store, text: str, told: str
) -> None:
    (warning,) = coverage_warnings(text, tiny_store, "test")
    assert told in warning


def test_nothing_is_said_where_nothing_is_lacking(tiny_store: Store) -> None:
    assert coverage_warnings("tiny-1, split all", tiny_store, "test") == []
    assert coverage_warnings(None, tiny_store, "test") == []
