import itertools

import numpy as np
import pytest

from dfdbench.audit import splits
from dfdbench.audit.fold_proposals import propose_folds
from dfdbench.audit.splits import Scenes, hopeless_scenes
from dfdbench.errors import InputError
from tests.audit.made_scenes import make


def test_folds_part_the_scenes_and_repeat_for_a_seed() -> None:
    scenes = make(9, seed=3)
    proposals = propose_folds(scenes, 3, seed=5)
    assert proposals == propose_folds(scenes, 3, seed=5)
    for proposal in proposals:
        assert sorted(itertools.chain(*(fold.test for fold in proposal.folds))) == list("ABCDEFGHI")
        assert {len(fold.test) for fold in proposal.folds} == {3}
    costs = [proposal.cost for proposal in proposals]
    assert costs == sorted(costs)
    with pytest.raises(InputError, match="no such folds"):
        propose_folds(scenes, 10)


def test_the_search_finds_the_best_of_all_partitions() -> None:
    scenes = make(6, seed=1)
    best = min(
        (sum(not c.covered for c in judged), round(sum(c.uncovered for c in judged), 12))
        for a in itertools.combinations(scenes.names, 2)
        for b in itertools.combinations([n for n in scenes.names if n not in a], 2)
        for judged in [scenes.judge([a, b, tuple(n for n in scenes.names if n not in a + b)])]
    )
    assert propose_folds(scenes, 3)[0].cost == pytest.approx(best)


def test_a_scene_that_no_fold_covers_is_named_with_its_levels(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    counts = np.full((6, 256), 100, np.int64)
    counts[2, 36:39] = 5_000
    scenes = Scenes(tuple("ABCDEF"), counts, tuple((name,) for name in "ABCDEF"))
    (found,) = hopeless_scenes(scenes, {2})
    assert (found.scene, found.levels) == ("C", "36-38")
    assert found.least > 0
    # Where there are too many choices to try, the scene alone is the proof.
    monkeypatch.setattr(splits, "EXHAUSTIVE_LIMIT", 10)
    assert [item.scene for item in hopeless_scenes(scenes, {2})] == ["C"]
    uncovered_folds = [fold for fold in propose_folds(scenes, 3)[0].folds if not fold.covered]
    assert [("C" in fold.test) for fold in uncovered_folds] == [True]
