"""Scores by scene and fold, each recomputed from the pairs."""

from pathlib import Path

import pytest

from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.manifest import Pair
from dfdbench.leaderboard.boards import Entry, ScoreBoard, boards
from dfdbench.leaderboard.by_scene import folds_table, scenes_table
from dfdbench.results.record import PairResult, Result, average
from tests.made_results import make_demo_result


def by_name(pair: Pair) -> float:
    return 0.01 * len(pair.scene)


def board_of(*results: Result) -> ScoreBoard:
    (board,) = boards([Entry(result, Path(__file__), None) for result in results])
    return board


def default_lighting(name: str, split: str) -> Result:
    manifest = find_manifest("middlebury-default")
    pairs = []
    for pair in manifest.pairs(split):
        value = by_name(pair) + pair.at["view"]
        scores: dict[str, dict[str, float | None]] = {
            "thesis": {"nrmse": value, "nmae": value, "ssim": 0.5}
        }
        pairs.append(
            PairResult(
                id=pair.id, scene=pair.scene, coordinates=pair.at, status="ok", seconds=1.0,
                prediction_sha256="0" * 64, scores=scores,
            )
        )  # fmt: skip
    made = make_demo_result(by_name, name)
    dataset = made.dataset.model_copy(
        update={
            "name": manifest.stem, "short": manifest.short, "split": split, "axes": ["view"],
            "blocks": "view", "rows": None, "expected": len(pairs), "evaluated": len(pairs),
        }
    )  # fmt: skip
    means = average(pairs, ["thesis"])
    return made.model_copy(update={"dataset": dataset, "pairs": pairs, "averages": means})


def test_a_row_is_the_mean_of_a_scene_and_a_column_a_method() -> None:
    worse = make_demo_result(lambda pair: by_name(pair) + 0.1 * pair.at["exposure"], "worse")
    table = scenes_table(board_of(make_demo_result(by_name, "better"), worse))
    assert table.columns == ("scene", "better", "worse")
    assert table.rows[0] == ("Kitchen", "0.0700", "0.1700")
    assert [row[0] for row in table.rows] == ["Kitchen", "Library", "Market"]
    assert table.records[0]["worse"] == pytest.approx(0.17)


def test_a_scene_with_a_failed_pair_has_no_mean() -> None:
    result = make_demo_result(by_name)
    first = result.pairs[0].model_copy(update={"status": "failed", "scores": {}})
    table = scenes_table(board_of(result.model_copy(update={"pairs": [first, *result.pairs[1:]]})))
    assert [row[1] for row in table.rows] == ["–", "0.0700", "0.0600"]


def test_folds_are_those_that_the_split_holds_whole() -> None:
    manifest = find_manifest("middlebury-default")
    table = folds_table(board_of(default_lighting("mine", "all")))
    assert [row[0] for row in table.rows] == [fold.name for fold in manifest.folds]
    for fold, record in zip(manifest.folds, table.records, strict=True):
        expected = sum(0.01 * len(scene) for scene in fold.test_scenes) / len(fold.test_scenes)
        assert record["mine"] == pytest.approx(expected + 3)


@pytest.mark.parametrize("result", [default_lighting("mine", "Art"), make_demo_result(by_name)])
def test_without_folds_there_is_no_row(result: Result) -> None:
    assert not folds_table(board_of(result)).rows
