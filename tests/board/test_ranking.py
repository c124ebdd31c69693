"""Who is ranked where, and with whom."""

from pathlib import Path
from statistics import fmean

import numpy as np
import pandas as pd
import pytest

from dfdbench.blur.tracks import SUITES
from dfdbench.board.board import leaderboard
from dfdbench.board.ranking import ScoreBoard, boards, over_tracks
from dfdbench.datasets.manifest import Pair
from dfdbench.results.record import Result
from tests.board.made_boards import ALL, add, entry_of, make_tracks, only_board, scored, submit
from tests.made_results import edited, limited, make_demo_result


def ranks(board: ScoreBoard) -> list[tuple[int | None, str]]:
    return [(standing.rank, standing.entry.label) for standing in board.standings]


def test_the_ranking_is_by_nrmse_with_an_interval_and_the_row_above(tmp_path: Path) -> None:
    add(tmp_path, "worse", 0.2)
    add(tmp_path, "better", 0.1)
    first, second = only_board(tmp_path).standings
    assert [(s.rank, s.entry.label) for s in (first, second)] == [(1, "better"), (2, "worse")]
    assert first.above is None
    assert first.entry.seconds == 0.25
    assert second.above is not None
    assert second.above.mean == pytest.approx(0.1)
    assert (second.above.losses, second.above.verdict) == (54, "too few scenes to tell")
    assert first.interval is not None
    score = first.scores["nrmse"]
    assert score is not None
    assert first.interval[0] < score < first.interval[1]


def test_ties_go_to_nmae_and_full_ties_share_a_rank(tmp_path: Path) -> None:
    for name in ("c", "a", "b"):
        add(tmp_path, name, 0.1)
    add(tmp_path, "last", 0.3)
    made = make_demo_result(lambda p: 0.3 + 0.0001 * len(p.scene) + 0.001 * p.at["exposure"], "z")
    scores = [pair.scores["valid"] | {"nmae": 0.0} for pair in made.pairs]
    pairs = [edited(p, scores={"valid": s}) for p, s in zip(made.pairs, scores, strict=True)]
    submit(edited(made, pairs=pairs), tmp_path)
    found = ranks(only_board(tmp_path))
    assert found == [(1, "a"), (1, "b"), (1, "c"), (4, "z"), (5, "last")]


def test_each_protocol_ranks_by_its_own_scores(tmp_path: Path) -> None:
    def under(protocol: str, name: str, value: float) -> Result:
        return make_demo_result(lambda pair: value, name, protocols=(protocol,))

    for name, thesis, valid in (("a", 0.1, 0.4), ("b", 0.2, 0.2)):
        made, other = under("thesis", name, thesis), under("valid", name, valid)
        both = zip(made.pairs, other.pairs, strict=True)
        pairs = [edited(pair, scores=pair.scores | also.scores) for pair, also in both]
        submit(edited(made, pairs=pairs, protocols=made.protocols + other.protocols), tmp_path)
    found = {board.protocol: board for board in leaderboard(tmp_path).boards}
    assert ranks(found["thesis"]) == [(1, "a"), (2, "b")]
    assert ranks(found["valid"]) == [(1, "b"), (2, "a")]
    assert found["valid"].standings[1].scores["nrmse"] == pytest.approx(0.4)


def test_other_data_or_protocol_is_another_ranking(tmp_path: Path) -> None:
    one = make_demo_result(lambda pair: 0.1, "one", protocols=("thesis", "valid"))
    others = make_demo_result(lambda pair: 0.1, "others", fingerprint="5" * 64)
    # A set of one's own whose crop was changed has the same images and other scores.
    changed = edited(one, dataset={"manifest_sha256": "7" * 64}, protocols=one.protocols[:1])
    found = boards([entry_of(run, tmp_path) for run in (one, others, changed)])
    of = [(b.protocol, b.result.dataset.fingerprint[0], len(b.standings)) for b in found]
    assert of == [("valid", "2", 1), ("valid", "5", 1), ("thesis", "2", 1), ("thesis", "2", 1)]


def test_what_was_not_run_is_apart_and_has_no_rank(tmp_path: Path) -> None:
    add(tmp_path, "mine", 0.2)
    submit(scored("elsewhere", 0.01), tmp_path)
    run, apart = leaderboard(tmp_path).boards
    assert ranks(run) == [(1, "mine")]
    assert ranks(apart) == [(None, "elsewhere")]


def test_a_suite_is_ranked_by_the_mean_over_its_tracks(tmp_path: Path) -> None:
    for name, value in (("b", 0.2), ("a", 0.1), ("c", 0.2)):
        submit(list(make_tracks(name, value).values()), tmp_path)
    submit(list(make_tracks("told", 0.01, uses=["recipe"]).values()), tmp_path)
    submit(list(make_tracks("part", 0.01, labels=ALL[:-1]).values()), tmp_path)
    board = only_board(tmp_path)
    assert (board.suite, board.protocol) == ("tracks-1", "valid")
    assert ranks(board) == [(1, "a"), (2, "b"), (2, "c"), (None, "part"), (None, "told-given")]
    assert board.standings[0].scores["nmae"] == pytest.approx(0.05)


def test_a_suite_has_intervals_over_scenes_of_each_capture_s_mean(tmp_path: Path) -> None:
    changes = {"better": 0.0, "worse": 0.1}
    for name, change in changes.items():
        runs = make_tracks(name)
        for at, (label, run) in enumerate(runs.items()):
            pairs = []
            for pair in run.pairs:
                value = change + 0.01 * len(pair.scene) + 0.001 * at * (label != "clean")
                scores = {"valid": dict.fromkeys(("nrmse", "nmae", "ssim"), value)}
                pairs.append(edited(pair, scores=scores))
            runs[label] = edited(run, pairs=pairs)
        submit(list(runs.values()), tmp_path)
    best, other = only_board(tmp_path).standings
    scenes = {len(pair.scene) for pair in best.entry.result.pairs}
    # 21 runs on tracks, the first of them the second of all.
    ends = [0.01 * length + 0.011 for length in (min(scenes), max(scenes))]
    assert best.interval == pytest.approx(ends)
    assert other.above is not None
    assert (other.above.mean, other.above.low) == pytest.approx((0.1, 0.1))


def test_groups_of_a_row_are_its_manifest_s(tmp_path: Path) -> None:
    def run(name: str, value: float) -> Result:
        def score(pair: Pair) -> float:
            return value + 0.003 * (len(pair.scene) % 4)

        return make_demo_result(score, name, dataset="middlebury-default", split="all")

    runs = [run("a", 0.1), run("b", 0.101), run("c", 0.18)]
    (found,) = boards([entry_of(each, tmp_path) for each in runs])
    assert found.groups == 17
    # A rank counts only rows whose whole interval is lower.
    assert ranks(found) == [(1, "a"), (1, "b"), (3, "c")]
    assert [s.above and s.above.verdict for s in found.standings] == [None, "real", "real"]


def test_a_suite_needs_every_severity_of_every_track() -> None:
    places = [(label.split("-")[0], int(label.split("-")[1])) for label in SUITES["tracks-1"]]
    index = pd.MultiIndex.from_tuples([(0, *place) for place in places])
    means = pd.Series(range(21), index.set_names(["row", "track", "severity"]), float)
    by_track = over_tracks(means, "tracks-1").to_numpy()[0]
    assert (list(by_track), fmean(by_track)) == ([1, 4, 7, 10, 13, 16, 19], 10)
    lacking = over_tracks(means.drop(index=(0, "camera", 3)), "tracks-1").to_numpy()[0]
    assert np.isnan(lacking).tolist() == [False] * 6 + [True]
    assert np.isnan(fmean(lacking))


def test_a_suite_of_one_track_is_of_its_runs_alone(tmp_path: Path) -> None:
    submit(list(make_tracks(labels=["stack-9"]).values()), tmp_path)
    (standing,) = only_board(tmp_path).standings
    assert [run.dataset.degradation for run in standing.entry.runs] == ["stack-9"]


def test_a_new_track_takes_no_rank_away(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    submit(list(make_tracks("old", 0.2, labels=ALL[:-3]).values()), tmp_path)
    smaller = {"tracks-1": tuple(ALL[:-3]), "tracks-2": tuple(ALL)}
    for module in ("row_file", "submission", "ranking", "board"):
        monkeypatch.setattr(f"dfdbench.board.{module}.SUITES", smaller)
    submit(list(make_tracks("new", 0.1).values()), tmp_path)
    found = {board.suite: ranks(board) for board in leaderboard(tmp_path).boards}
    assert found == {"tracks-1": [(1, "new"), (2, "old")], "tracks-2": [(1, "new")]}


def test_an_incomplete_run_is_listed_without_rank(tmp_path: Path) -> None:
    add(tmp_path, "whole", 0.3)
    submit(limited(make_demo_result(lambda pair: 0.001, "stopped"), 7), tmp_path)
    board = only_board(tmp_path)
    assert ranks(board) == [(1, "whole"), (None, "stopped")]
    assert board.standings[1].scores["nrmse"] is None
    assert board.shown(1, "nrmse") == "(0.0010)"
