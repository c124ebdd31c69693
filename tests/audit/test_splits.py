import pytest

from dfdbench.audit import splits
from dfdbench.audit.coverage import Criterion, DensityBound, uncovered
from dfdbench.audit.splits import rank_tests
from dfdbench.errors import InputError
from tests.audit.made_scenes import make


def test_every_choice_is_judged_as_one_by_one() -> None:
    scenes = make()
    ranking = rank_tests(scenes, 3)
    assert ranking.exhaustive
    assert len(ranking.candidates) == 56
    for candidate in ranking.candidates:
        rows = [scenes.names.index(name) for name in candidate.test]
        test = scenes.counts[rows].sum(axis=0)
        train = scenes.counts.sum(axis=0) - test
        levels = uncovered(train, test, Criterion.either, DensityBound())
        assert candidate.uncovered == pytest.approx(test[levels].sum() / test.sum())
        assert 0 <= candidate.overlap <= 1
        assert candidate.covered == (not levels.any())
    order = [(c.uncovered, -c.overlap) for c in ranking.candidates]
    assert order == sorted(order)
    worst = ranking.candidates[-1].test
    assert ranking.rank(worst[::-1]) == 56
    assert ranking.rank(("A",)) is None


def test_groups_are_never_parted_but_a_given_test_is_ranked_as_it_is() -> None:
    scenes = make(6, groups=(("A", "D"), ("B",), ("C", "E"), ("F",)))
    ranking = rank_tests(scenes, 3, also=("A", "B", "C"))
    for candidate in ranking.candidates:
        if set(candidate.test) != {"A", "B", "C"}:
            assert ("A" in candidate.test) == ("D" in candidate.test)
            assert ("C" in candidate.test) == ("E" in candidate.test)
    assert ranking.rank(("A", "B", "C")) is not None
    assert len(ranking.candidates) == 5
    with pytest.raises(InputError, match="--test-scenes 2; A and B stay together; C and"):
        rank_tests(make(4, groups=(("A", "B"), ("C", "D"))), 3)
    with pytest.raises(InputError, match="no such split"):
        rank_tests(scenes, 6)


def test_of_too_many_choices_some_are_drawn_the_same_for_a_seed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(splits, "EXHAUSTIVE_LIMIT", 30)
    scenes = make(10)
    first, again, other = (rank_tests(scenes, 4, seed=seed) for seed in (1, 1, 2))
    assert not first.exhaustive
    assert first == again
    assert first != other
    assert len(first.candidates) <= 30


def test_an_allowed_share_counts_as_covered() -> None:
    assert rank_tests(make(), 3, 0).covered < rank_tests(make(allowed=1.0), 3, 0).covered == 56
