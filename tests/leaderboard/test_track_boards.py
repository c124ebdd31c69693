import json
from pathlib import Path

import pytest

from dfdbench.errors import ResultError
from dfdbench.leaderboard.boards import boards, collect
from dfdbench.leaderboard.submission import submit
from dfdbench.leaderboard.track_boards import TracksBoard, collect_tracks, track_boards
from dfdbench.leaderboard.tracks_submission import submit_tracks
from tests.leaderboard.made_tracks import ALL, make_tracks


def board_of(folder: Path) -> TracksBoard:
    (board,) = track_boards(collect_tracks(folder))
    return board


def test_methods_are_ranked_by_their_mean_over_tracks_not_by_clean(tmp_path: Path) -> None:
    for name, value in (("worse", 0.3), ("better", 0.1), ("alike", 0.1)):
        submit_tracks(make_tracks(name, value), tmp_path)
    rows = [(rank, entry.label) for rank, entry in board_of(tmp_path).rows]
    assert rows == [(1, "alike"), (1, "better"), (3, "worse")]
    assert board_of(tmp_path).rows[2][1].mean("nrmse") == pytest.approx(0.3)


def test_a_track_is_the_mean_over_its_severities(tmp_path: Path) -> None:
    results = make_tracks(value=0.1)
    results |= {"gain-3": make_tracks(value=0.4)["gain-3"]}
    submit_tracks(results, tmp_path)
    (entry,) = collect_tracks(tmp_path)
    assert entry.means("nrmse")["gain"] == pytest.approx(0.2)
    assert entry.means("nrmse")["psf"] == pytest.approx(0.1)
    assert entry.mean("nrmse") == pytest.approx((6 * 0.1 + 0.2) / 7)


@pytest.mark.slow
def test_who_was_told_or_lacks_a_track_has_no_rank(tmp_path: Path) -> None:
    submit_tracks(make_tracks("told", 0.01, uses=["recipe"]), tmp_path)
    submit_tracks(make_tracks("given", 0.02, parameters={"recipe": "text"}), tmp_path)
    submit_tracks(make_tracks("part", 0.03, ALL[:-1]), tmp_path)
    submit_tracks(make_tracks("whole", 0.2), tmp_path)
    rows = [(rank, entry.clean.method.name) for rank, entry in board_of(tmp_path).rows]
    assert rows == [(1, "whole"), (None, "part"), (None, "given"), (None, "told")]
    part = board_of(tmp_path).rows[1][1]
    assert (part.lacking, part.mean("nrmse")) == (["camera-3"], None)
    assert part.means("nrmse")["camera"] is None


def test_on_the_board_of_one_track_too(tmp_path: Path) -> None:
    for name, uses in (("told", ["recipe"]), ("fair", [])):
        submit(make_tracks(name, uses=uses)["psf-3"], tmp_path)
    (board,) = boards(collect(tmp_path))
    ranks = [(s.rank, s.entry.label) for s in board.standings]
    assert ranks == [(1, "fair"), (None, "told")]


def test_single_results_and_runs_on_tracks_lie_side_by_side(tmp_path: Path) -> None:
    submit(make_tracks()["clean"], tmp_path)
    path = submit_tracks(make_tracks(), tmp_path)
    assert len(collect(tmp_path)) == len(collect_tracks(tmp_path)) == 1
    content = json.loads(path.read_text("utf-8"))
    content["seed"] = 5
    path.write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(ResultError, match="edited after"):
        collect_tracks(tmp_path)
