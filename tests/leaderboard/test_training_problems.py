"""Weights are not ranked on what they were trained on."""

from pathlib import Path

import pytest

from dfdbench.errors import ResultError
from dfdbench.leaderboard.submission import submit
from dfdbench.leaderboard.training_problems import training_problems
from tests.leaderboard.made_boards import WHEN
from tests.made_results import make_demo_result

WEIGHTS = "5" * 64


@pytest.mark.parametrize(
    ("trained_on", "dataset", "split", "scenes"),
    [
        ("demo-1, split train", "demo-1", "all", "Attic, Barn, Cabin, Depot, Forge, Garage"),
        ("demo-1, all but Attic", "demo-1", "test", "Kitchen, Library, Market"),
        ("middlebury-default-1, split train", "middlebury-default-1", "Aloe", "Aloe"),
        ("middlebury-third-1, split train", "middlebury-default-1", "Aloe", "Aloe"),
        ("demo-1, split train", "demo-1", "test", None),
        ("demo-1, all but Attic", "demo-1", "Attic", None),
        ("demo-1, split train", "middlebury-default-1", "all", None),
        ("photographs of my own", "demo-1", "all", None),
        ("mine-1, split train", "demo-1", "all", None),
        (None, "demo-1", "all", None),
    ],
)
def test_scenes_that_weights_were_trained_on_are_named(
    trained_on: str | None, dataset: str, split: str, scenes: str | None
) -> None:
    problems = training_problems(trained_on, WEIGHTS, dataset, split, "here")
    assert [problem.got for problem in problems] == ([scenes] if scenes else [])


def test_a_method_without_weights_may_know_the_training_mean() -> None:
    assert not training_problems("demo-1, split train", None, "demo-1", "all", "here")


def test_such_a_result_is_not_taken(tmp_path: Path) -> None:
    result = make_demo_result(lambda pair: 0.1)
    method = result.method.model_copy(
        update={"trained_on": "demo-1, all but Attic", "weights_sha256": WEIGHTS}
    )
    with pytest.raises(ResultError, match="trained on scenes of the test"):
        submit(result.model_copy(update={"method": method}), tmp_path, WHEN)
    assert not list(tmp_path.rglob("*.json"))
