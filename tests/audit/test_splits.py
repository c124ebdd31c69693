import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from dfdbench.audit import splits
from dfdbench.audit.coverage import USUAL, Rule
from dfdbench.datasets.catalog import find_manifest
from dfdbench.errors import InputError


def make(
    number: int = 8, seed: int = 0, groups: tuple[tuple[str, ...], ...] = (), rule: Rule = USUAL
) -> splits.Scenes:
    random = np.random.default_rng(seed)
    names = tuple("ABCDEFGHIJKLMNOP"[:number])
    counts = np.zeros((number, 256), np.int64)
    for row in counts:
        first = random.integers(0, 150)
        row[first : first + 100] = random.integers(1, 500, 100)
    return splits.Scenes(names, counts, groups or tuple((name,) for name in names), rule)


def test_every_choice_is_judged_as_one_by_one() -> None:
    scenes = make()
    ranking = splits.rank_tests(scenes, 3)
    assert ranking.exhaustive
    assert len(ranking.candidates) == 56
    for candidate in ranking.candidates:
        rows = [scenes.names.index(name) for name in candidate.test]
        test = scenes.counts[rows].sum(axis=0)
        train = scenes.counts.sum(axis=0) - test
        levels = Rule().uncovered(train, test)
        assert candidate.uncovered == pytest.approx(test[levels].sum() / test.sum())
        assert 0 <= candidate.overlap <= 1
        assert candidate.covered == (not levels.any())
    order = [(c.uncovered, -c.overlap) for c in ranking.candidates]
    assert order == sorted(order)
    assert ranking.rank(ranking.candidates[-1].test[::-1]) == 56
    assert ranking.rank(("A",)) is None
    lenient = splits.rank_tests(make(rule=Rule(allowed_share=1.0)), 3, 0)
    assert lenient.covered == 56 > ranking.covered


def test_groups_are_never_parted_but_a_given_test_is_ranked_as_it_is() -> None:
    scenes = make(6, groups=(("A", "D"), ("B",), ("C", "E"), ("F",)))
    ranking = splits.rank_tests(scenes, 3, also=("A", "B", "C"))
    for candidate in ranking.candidates:
        if set(candidate.test) != {"A", "B", "C"}:
            assert ("A" in candidate.test) == ("D" in candidate.test)
            assert ("C" in candidate.test) == ("E" in candidate.test)
    assert ranking.rank(("A", "B", "C")) is not None
    assert len(ranking.candidates) == 5
    with pytest.raises(InputError, match="--test-scenes 2; A and B stay together; C and"):
        splits.rank_tests(make(4, groups=(("A", "B"), ("C", "D"))), 3)
    with pytest.raises(InputError, match="no such split"):
        splits.rank_tests(scenes, 6)


def test_all_choices_of_uneven_groups_are_found_and_no_others_tried() -> None:
    # Of 30 groups of 3 there are 2^30 others.
    names = tuple(f"{place}{frame}" for place in range(30) for frame in "abc")
    groups = (("one",), *(names[n : n + 3] for n in range(0, 90, 3)))
    counts = np.ones((91, 256), np.int64)
    scenes = splits.Scenes(("one", *names), counts, groups, USUAL)
    ranking = splits.rank_tests(scenes, 12)
    assert ranking.exhaustive
    assert len({candidate.test for candidate in ranking.candidates}) == math.comb(30, 4)
    assert all(len(candidate.test) == 12 for candidate in ranking.candidates)


def test_of_too_many_choices_some_are_drawn_by_seed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(splits, "EXHAUSTIVE_LIMIT", 30)
    scenes = make(10)
    first, again, other = (splits.rank_tests(scenes, 4, seed=seed) for seed in (1, 1, 2))
    assert not first.exhaustive
    assert first == again
    assert first != other
    assert len(first.candidates) <= 30


def test_folds_part_the_scenes_and_repeat_for_a_seed() -> None:
    scenes = make(9, seed=3)
    proposals = splits.propose_folds(scenes, 3, seed=5)
    assert proposals == splits.propose_folds(scenes, 3, seed=5)
    for proposal in proposals:
        assert sorted(itertools.chain(*(fold.test for fold in proposal))) == list("ABCDEFGHI")
        assert {len(fold.test) for fold in proposal} == {3}
    costs = [splits.cost(proposal) for proposal in proposals]
    assert costs == sorted(costs)
    with pytest.raises(InputError, match="10 folds of 9 groups"):
        splits.propose_folds(scenes, 10)


def test_the_search_finds_the_best_of_all_partitions() -> None:
    scenes = make(6, seed=1)
    best = min(
        (sum(not c.covered for c in judged), round(sum(c.uncovered for c in judged), 12))
        for a in itertools.combinations(scenes.names, 2)
        for b in itertools.combinations([n for n in scenes.names if n not in a], 2)
        for judged in [scenes.judge([a, b, tuple(n for n in scenes.names if n not in a + b)])]
    )
    assert splits.cost(splits.propose_folds(scenes, 3)[0]) == pytest.approx(best)


def test_a_scene_that_no_fold_covers_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    counts = np.full((6, 256), 100, np.int64)
    counts[2, 36:39] = 5_000
    scenes = splits.Scenes(tuple("ABCDEF"), counts, tuple((name,) for name in "ABCDEF"))
    (found,) = splits.hopeless_scenes(scenes, {2})
    assert (found.scene, found.levels) == ("C", "36-38")
    assert found.least > 0
    # Where there are too many choices to try, the scene alone is the proof.
    monkeypatch.setattr(splits, "EXHAUSTIVE_LIMIT", 10)
    (proven,) = splits.hopeless_scenes(scenes, {2})
    assert (proven.scene, 0 < proven.least <= found.least) == ("C", True)
    lenient = replace(scenes, rule=Rule(allowed_share=0.3))
    assert splits.hopeless_scenes(lenient, {2}) == []
    uncovered_folds = [fold for fold in splits.propose_folds(scenes, 3)[0] if not fold.covered]
    assert [("C" in fold.test) for fold in uncovered_folds] == [True]


def test_folds_are_compared_with_as_many_published_ones_only() -> None:
    counts = np.full((6, 256), 100, np.int64)
    scenes = splits.Scenes(tuple("ABCDEF"), counts, tuple((name,) for name in "ABCDEF"))
    proposals = splits.propose_folds(scenes, 3)
    for number, compared in ((3, True), (6, False)):
        published = splits.propose_folds(scenes, number)[0]
        table = splits.folds_table(find_manifest("demo"), proposals, [], published)
        assert any("found are better" in note for note in table.notes) == compared
