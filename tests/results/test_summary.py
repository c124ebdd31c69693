from pathlib import Path

import numpy as np
import pytest

from dfdbench.board.ranking import Entry, boards
from dfdbench.metrics.metric import SURENESS
from dfdbench.metrics.protocol import RELEASED
from dfdbench.results.record import Result
from dfdbench.results.summary import median_seconds, ranked, summarise
from tests.made_results import edited, make_demo_result, make_result

# Table 5.3 of the thesis, exposure 0: mean and std of the NRMSE of 6 pairs an illumination.
CELLS = {1: (0.0582, 0.0126), 2: (0.0522, 0.0068), 3: (0.0603, 0.0152)}
OVERALL = (0.0569, 0.0119)


def six_with(mean: float, std: float) -> list[float]:
    """Six numbers of that mean and that sample standard deviation."""
    raw = np.array([-1.0, 1.0] * 3)
    return list(mean + raw / raw.std(ddof=1) * std)


def test_the_overall_row_of_table_5_3_follows_from_its_cells() -> None:
    # It does with the sample standard deviation, and does not with the population's (0.0125).
    values = {
        (f"s{number}", 1 if number % 2 else 5, illumination, 0): value
        for illumination, (mean, std) in CELLS.items()
        for number, value in enumerate(six_with(mean, std))
    }
    groups = summarise(make_result(values), "thesis").groups
    cells = [group for group in groups if group.block == 0 and group.row is not None]
    for group, (mean, std) in zip(cells, CELLS.values(), strict=True):
        assert group.metrics["nrmse"].mean == pytest.approx(mean)
        assert group.metrics["nrmse"].std == pytest.approx(std)
    overall = next(group for group in groups if group.block == 0 and group.row is None)
    assert overall.metrics["nrmse"].mean == pytest.approx(OVERALL[0], abs=6e-5)
    assert overall.metrics["nrmse"].std == pytest.approx(OVERALL[1], abs=6e-5)


def test_rank_is_by_nrmse_and_ties_by_nmae() -> None:
    result = make_result({("a", 1, 1, 0): 0.2, ("b", 1, 1, 0): 0.1, ("c", 1, 1, 0): 0.1})
    first, second, third = result.pairs
    second = edited(second, scores={"thesis": {"nrmse": 0.1, "nmae": 0.09, "ssim": 1.0}})
    order = ranked(edited(result, pairs=[first, second, third]), "thesis")
    assert [pair.scene for pair in order] == ["c", "b", "a"]
    # What has no NMAE comes last among equals.
    second = edited(second, scores={"thesis": {"nrmse": 0.1, "nmae": None, "ssim": 1.0}})
    order = ranked(edited(result, pairs=[first, second, third]), "thesis")
    assert [pair.scene for pair in order] == ["c", "b", "a"]


def test_an_undefined_score_is_counted_and_in_no_mean() -> None:
    result = make_result({("a", 1, 1, 0): 0.2, ("b", 1, 1, 0): None})
    whole = summarise(result, "thesis").groups[-1]
    assert whole.metrics["nrmse"].mean == 0.2
    assert (whole.evaluated, whole.undefined, whole.metrics["nrmse"].defined) == (2, 1, 1)
    assert [pair.scene for pair in ranked(result, "thesis")] == ["a"]


def test_of_chosen_pairs_no_mean_of_the_surest_is_shown_and_a_sigma_that_lacks_is_no_flat_truth(
    tmp_path: Path,
) -> None:
    made = make_demo_result(lambda _: 0.1)
    whole = dict.fromkeys(SURENESS) | {"density": 1.0, "nrmse_50": 0.1, "nrmse_90": 0.1}
    part = dict.fromkeys(SURENESS) | {"density": 0.3}
    pairs = [
        edited(pair, answered=0.3 if few else 1.0, scores={"sure": part if few else whole})
        for few, pair in zip([True] * 20 + [False] * 34, made.pairs, strict=True)
    ]
    result = edited(made, pairs=pairs, protocols=[RELEASED["sure"].as_dict()])
    overall = summarise(result, "sure").groups[-1]
    surest = overall.metrics["nrmse_50"]
    assert (surest.mean, surest.of_what_ran, surest.defined, overall.undefined) == (
        None,
        None,
        34,
        0,
    )
    (board,) = boards([Entry((result,), tmp_path, "mine")])
    told = "not ranked: 20 pairs without an answer for half of the known pixels"
    assert board.standings[0].entry.unranked("sure") == told


def broken(result: Result, status: str) -> Result:
    """The result, as if there were no scores of its first pair."""
    first = edited(result.pairs[0], status=status, scores={})
    return edited(result, pairs=[first, *result.pairs[1:]])


def means_of(result: Result) -> dict[object, float | None]:
    groups = summarise(result, "thesis").groups
    return {(group.block, group.row): group.metrics["nrmse"].mean for group in groups}


def test_a_failed_pair_leaves_its_groups_without_a_mean() -> None:
    result = make_result({("a", 1, 1, 0): 0.2, ("b", 1, 1, 0): 0.1, ("a", 1, 1, 1): 0.3})
    cells = {(0, 1): None, (0, None): None, (1, 1): 0.3, (1, None): 0.3, (None, None): None}
    assert means_of(broken(result, "failed")) == cells


def test_a_missing_pair_leaves_cells_but_no_overall_mean() -> None:
    result = make_result({("a", 1, 1, 0): 0.2, ("b", 1, 1, 0): 0.1})
    cells = {(0, 1): 0.1, (0, None): None, (None, None): None}
    assert means_of(broken(result, "missing")) == cells


def with_seconds(*seconds: float, cpu: str = "one", alone: bool = True) -> Result:
    result = make_result({("a", 1, 1, number): 0.1 for number in range(len(seconds))})
    timed = zip(result.pairs, seconds, strict=True)
    pairs = [edited(pair, seconds=value, timed_alone=alone) for pair, value in timed]
    return edited(result, pairs=pairs, environment={"cpu": cpu})


def test_one_slow_pair_does_not_move_the_seconds() -> None:
    assert median_seconds([with_seconds(1.0, 1.1, 2519.0)]) == 1.1
    assert median_seconds([with_seconds(1.0, 2.0), with_seconds(9.0)]) == 2.0


def test_seconds_of_several_machines_or_of_pairs_run_together_are_none() -> None:
    assert median_seconds([with_seconds(1.0), with_seconds(1.0, cpu="two")]) is None
    assert median_seconds([with_seconds(1.0, alone=False)]) is None
    moved, other = with_seconds(1.0, 9.0), with_seconds(1.0, cpu="two").environment
    first, second = moved.pairs
    pairs = [first, edited(second, machine=1)]
    assert median_seconds([edited(moved, pairs=pairs, other_environments=[other])]) is None
    assert median_seconds([with_seconds()]) is None
