from pathlib import Path
from typing import Any

from dfdbench.leaderboard.readme import check_readme, readme_text, write_readme
from dfdbench.leaderboard.track_board_tables import tracks_board_table
from dfdbench.leaderboard.track_boards import collect_tracks, track_boards
from dfdbench.leaderboard.tracks_submission import submit_tracks
from dfdbench.tables.table import Table
from tests.leaderboard.made_tracks import ALL, make_tracks


def table_of(folder: Path) -> Table:
    (board,) = track_boards(collect_tracks(folder))
    return tracks_board_table(board, folder)


def test_a_row_shows_clean_beside_the_mean_of_each_track(tmp_path: Path) -> None:
    submit_tracks(make_tracks(value=0.25), tmp_path)
    table = table_of(tmp_path)
    assert table.columns[2:11] == (
        "clean", "noise", "psf", "law", "occlusion", "shift", "gain", "camera", "mean of tracks",
    )  # fmt: skip
    assert table.rows[0][:11] == ("1", "mine", "0.0000", *["0.2500"] * 8)
    record = table.records[0]
    assert (record["nrmse camera-3"], record["nmae mean of tracks"]) == (0.25, 0.125)


def test_what_a_method_was_fitted_and_trained_on_is_told_by_track(tmp_path: Path) -> None:
    weights: dict[str, Any] = {"weights_sha256": "3" * 64}
    for name, facts in (
        ("fitted", {"fitted_on": "demo-1@{label}, split train"}),
        ("clean", {"trained_on": "demo-1, split train", **weights}),
        ("other", {"trained_on": "middlebury-default-1, split train", **weights}),
        ("robust", {"trained_on": "demo-1, split train, random tracks", **weights}),
    ):
        submit_tracks(make_tracks(name, **facts), tmp_path)
    seen = {row[1]: row[11:13] for row in table_of(tmp_path).rows}
    assert seen == {
        "fitted": ("this track", "–"),
        "clean": ("–", "clean"),
        "other": ("–", "clean middlebury-default-1"),
        "robust": ("–", "demo-1, split train, random tracks"),
    }


def test_why_a_row_has_no_rank_is_said(tmp_path: Path) -> None:
    submit_tracks(make_tracks("solver", uses=["recipe"]), tmp_path)
    submit_tracks(make_tracks("part", labels=ALL[:-1]), tmp_path)
    submit_tracks(make_tracks("little", labels=ALL[:3]), tmp_path)
    notes = "\n".join(table_of(tmp_path).notes)
    assert "solver, given the blur: no rank." in notes
    assert "bound" not in notes
    assert "part: no rank without camera-3" in notes
    assert "little: no rank without 18 of the runs" in notes
    assert [row[0] for row in table_of(tmp_path).rows] == ["–"] * 3


def test_the_readme_has_the_table_once_there_are_runs_on_tracks(tmp_path: Path) -> None:
    (tmp_path / "results").mkdir()
    assert "Tracks" not in readme_text(tmp_path, [])
    submit_tracks(make_tracks(), tmp_path)
    text = write_readme(tmp_path).read_text("utf-8")
    assert "## Tracks: nobody tells the blur" in text
    assert "No results yet" not in text
    assert "(results/demo-1-test/tracks/mine.json)" in text
    assert check_readme(tmp_path) == 1
