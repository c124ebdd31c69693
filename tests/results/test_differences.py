import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dfdbench.errors import ResultError, UnknownNameError
from dfdbench.results.differences import (
    PairChange,
    PairedDifference,
    changes,
    check_comparable,
    paired_difference,
)
from dfdbench.results.record import Result
from tests.made_results import limited, make_result

PLACES = [(scene, 1, i, e) for scene in "abcdefg" for i in (1, 2) for e in (0, 1)]


def difference(found: tuple[PairChange, ...], metric: str) -> PairedDifference | None:
    scenes = [change.first.scene for change in found]
    return paired_difference([change.difference for change in found], scenes, metric)


def result(value: float, name: str = "mine", scenes: str = "abcdefg") -> Result:
    values: dict[tuple[str, int, int, int], float | None] = {
        place: value + 0.001 * n for n, place in enumerate(PLACES) if place[0] in scenes
    }
    return make_result(values, name)


def test_the_mean_difference_is_that_of_the_means() -> None:
    first, second = result(0.2), result(0.15)
    found = difference(changes(first, second, "thesis", "nrmse"), "nrmse")
    assert found is not None
    assert found.mean == pytest.approx(-0.05)
    assert (found.wins, found.losses, found.ties) == (len(PLACES), 0, 0)
    assert found.verdict == "real"
    ssim = difference(changes(first, second, "thesis", "ssim"), "ssim")
    assert ssim is not None
    assert ssim.mean == pytest.approx(0.05)
    assert ssim.wins == len(PLACES)


@pytest.mark.parametrize(
    ("scenes", "verdict"),
    [
        ("a", "too few scenes to tell"),
        ("abc", "too few scenes to tell"),
        ("abcde", "too few scenes to tell"),
        ("abcdef", "real"),
    ],
)
def test_below_six_scenes_there_is_no_verdict(scenes: str, verdict: str) -> None:
    both = (result(0.2, scenes=scenes), result(0.1, scenes=scenes))
    found = difference(changes(*both, "thesis", "nrmse"), "nrmse")
    assert found is not None
    assert found.verdict == verdict
    assert str(found).endswith(f", {verdict}")
    assert (found.low is None) == (len(scenes) == 1)


def test_a_run_and_itself_are_the_same() -> None:
    found = difference(changes(result(0.2), result(0.2), "thesis", "nmae"), "nmae")
    assert found is not None
    assert (found.mean, found.ties, found.verdict) == (0, len(PLACES), "may be chance")


@given(st.lists(st.floats(0, 1), min_size=28, max_size=28))
def test_the_other_way_round_changes_the_sign(values: list[float]) -> None:
    first = result(0.5)
    second = make_result(dict(zip(PLACES, values, strict=True)))
    there = difference(changes(first, second, "thesis", "nrmse"), "nrmse")
    back = difference(changes(second, first, "thesis", "nrmse"), "nrmse")
    assert there is not None
    assert back is not None
    assert math.isclose(there.mean, -back.mean, abs_tol=1e-12)
    assert (there.wins, there.ties) == (back.losses, back.ties)
    assert there.low is not None
    assert there.high is not None
    assert there.low <= there.mean + 1e-12
    assert there.mean <= there.high + 1e-12


def test_only_pairs_scored_in_both_count() -> None:
    assert len(changes(limited(result(0.2), 5), result(0.1), "thesis", "nrmse")) == 5
    undefined = make_result(dict.fromkeys(PLACES))
    assert changes(undefined, result(0.1), "thesis", "nrmse") == ()
    assert paired_difference((), (), "nrmse") is None


def test_other_data_and_other_protocols_are_not_compared() -> None:
    first, second = result(0.2), result(0.1)
    other = second.dataset.model_copy(update={"fingerprint": "7" * 64, "split": "train"})
    with pytest.raises(ResultError, match="fingerprint") as raised:
        check_comparable(first, second.model_copy(update={"dataset": other}), "thesis")
    assert len(raised.value.problems) == 2
    edited = second.dataset.model_copy(update={"manifest_sha256": "7" * 64})
    with pytest.raises(ResultError, match="manifest_sha256"):
        check_comparable(first, second.model_copy(update={"dataset": edited}), "thesis")
    with pytest.raises(UnknownNameError, match="valid"):
        check_comparable(first, second, "valid")
    redefined = [{**second.protocols[0], "pixels": "known"}]
    with pytest.raises(ResultError, match="defined differently"):
        check_comparable(first, second.model_copy(update={"protocols": redefined}), "thesis")
