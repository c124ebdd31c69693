"""What a ranking's tables show, each number recomputed from the pairs."""

from pathlib import Path
from typing import Any

import pytest

from dfdbench.board import ranking, tables
from dfdbench.results.record import Result
from tests.board.made_boards import ALL, add, entry_of, make_tracks, only_board, scored, submit
from tests.made_results import edited, limited, make_demo_result, make_result

HERE = Path(__file__)


def board_of(*results: Result) -> ranking.ScoreBoard:
    (board,) = ranking.boards([entry_of(result, HERE) for result in results])
    return board


@pytest.mark.parametrize("scenes", ["abc", "abcdefg", "abcdefgh"])
def test_few_scenes_are_no_95_per_cent(scenes: str) -> None:
    values = {(scene, 1, 1, 0): 0.1 * (1 + n) for n, scene in enumerate(scenes)}
    table = tables.standings_table(board_of(make_result(values)), HERE.parent)
    name = "95 %" if len(scenes) > 7 else "range of group means"
    assert (table.columns[4], table.records[0]["interval"]) == (name, name)
    assert ("fewer than 8 for an interval" in table.notes[1]) == (len(scenes) < 8)
    assert table.rows[0][4] != f"0.1000 to 0.{len(scenes)}000" or len(scenes) < 8
    # A scene whose score the truth leaves undefined does not count.
    flat = make_result(values | {("z", 1, 1, 0): None})
    assert tables.standings_table(board_of(flat), HERE.parent).columns[4] == name


def test_records_hold_numbers_in_full_and_links_lead_to_the_file(tmp_path: Path) -> None:
    add(tmp_path, "mine", 0.1, parameters={"window": 9, "recipe": "text"})
    board = only_board(tmp_path)
    (record,) = tables.standings_table(board, tmp_path).records
    assert record["nrmse"] == board.standings[0].scores["nrmse"]
    assert record["nrmse exposure 2"] == pytest.approx(0.102 + 0.002 / 3)
    assert record["result"] == "results/demo-1-test/mine-9-text.json"
    assert (tmp_path / str(record["result"])).exists()
    (row,) = tables.runs_table(board, tmp_path).rows
    assert row[:3] == ("mine-9-text", "window=9, recipe=text", "nothing")
    assert getattr(row[0], "target", "") == record["result"]
    assert tables.link_to(tmp_path / "a/b.json", tmp_path / "c") == "../a/b.json"


def test_notes_say_what_a_constant_reaches_and_what_other_data_sets_trained() -> None:
    constant = make_demo_result(lambda pair: 0.2, "constant")
    net = make_demo_result(lambda pair: 0.1, "net")
    net = edited(net, method={"trained_on": "middlebury-default-1, split train"})
    table = tables.standings_table(board_of(constant, net), HERE.parent)
    assert any(note.startswith("Compare SSIM with 0.80, which a constant") for note in table.notes)
    assert any(note.startswith("middlebury-default-1: ") for note in table.notes)
    assert [row[2] for row in table.rows] == ["trained on middlebury-default-1", "nothing"]
    alone = tables.standings_table(board_of(net), HERE.parent)
    assert not any("constant" in note for note in alone.notes)


def test_why_a_row_has_no_rank_is_said() -> None:
    part = limited(make_demo_result(lambda pair: 0.1, "part"), 7)
    table = tables.standings_table(board_of(part), HERE.parent)
    assert table.rows[0][:4] == ("–", "part", "nothing", "(0.1000)")
    assert table.records[0]["nrmse"] is None
    assert any(note.startswith("part: not ranked: 7 of 54 pairs evaluated") for note in table.notes)
    flat = make_result({("a", 1, 1, 0): None})
    notes = tables.standings_table(board_of(flat), HERE).notes
    assert "mine: not ranked: NRMSE is defined for no pair" in notes
    given = make_tracks(labels=["gain-1"], uses=["recipe"])["gain-1"]
    notes = tables.standings_table(board_of(given), HERE).notes
    assert any("given a blur" in note for note in notes)


def test_lightings_are_means_of_their_pairs() -> None:
    result = make_demo_result(lambda pair: 0.1 * pair.at["exposure"])
    table = tables.lighting_table(board_of(result))
    assert table.rows[0] == ("mine", "NRMSE ↓", "0.0000", "0.1000", "0.2000", "0.1000")
    assert [row[0] for row in table.rows] == ["mine", "", ""]
    assert table.records[1]["overall"] == pytest.approx(0.05)


def test_depth_maps_made_elsewhere_are_one_table_with_links() -> None:
    (board,) = ranking.boards([entry_of(scored("theirs", 0.01), HERE)], ranked=False)
    table = tables.ranking_table(board, HERE.parent)
    assert table.title.endswith("protocol valid: scored, not run")
    assert table.rows[0][:4] == ("–", "theirs (scored, not run)", "not known", "0.0100")
    assert getattr(table.rows[0][1], "target", "") == HERE.name
    results = scored("theirs", 0.01), make_demo_result(lambda _: 0.02)
    (board,) = ranking.boards([entry_of(result, HERE) for result in results])
    assert tables.ranking_table(board, HERE.parent).title.endswith("protocol valid")


def tracked(folder: Path, *rows: tuple[str, dict[str, Any]]) -> ranking.ScoreBoard:
    for name, facts in rows:
        submit(list(make_tracks(name, 0.25, **facts).values()), folder)
    return only_board(folder)


def test_a_row_shows_clean_beside_the_mean_of_each_track(tmp_path: Path) -> None:
    table = tables.tracks_table(tracked(tmp_path, ("mine", {})), tmp_path)
    assert table.title == "demo-1, split test, tracks-1, protocol valid: NRMSE ↓"
    assert table.columns[2:11] == (
        "clean", "noise", "psf", "law", "occlusion", "shift", "gain", "camera", "mean of tracks",
    )  # fmt: skip
    assert table.rows[0][:11] == ("1", "mine", "0.0000", *["0.2500"] * 8)
    record = table.records[0]
    parts = ("", " camera-3", " camera", " clean")
    assert [record[f"nmae{part}"] for part in parts] == [0.125, 0.125, 0.125, 0.0]


def test_what_a_method_was_fitted_and_trained_on_is_told_by_track(tmp_path: Path) -> None:
    weights: dict[str, Any] = {"weights_sha256": "3" * 64}
    board = tracked(
        tmp_path,
        ("fitted", {"fitted_on": "demo-1@{label}, split train"}),
        ("clean", {"trained_on": "demo-1, split train", **weights}),
        ("other", {"trained_on": "middlebury-default-1, split train", **weights}),
        ("robust", {"trained_on": "demo-1, split train, random tracks", **weights}),
    )
    assert {row[1]: row[13:] for row in tables.tracks_table(board, tmp_path).rows} == {
        "fitted": ("this track", "–"),
        "clean": ("–", "clean"),
        "other": ("–", "clean middlebury-default-1"),
        "robust": ("–", "demo-1, split train, random tracks"),
    }


def test_why_a_row_on_tracks_has_no_rank_is_said(tmp_path: Path) -> None:
    board = tracked(tmp_path, ("solver", {"uses": ["recipe"]}), ("part", {"labels": ALL[:-1]}))
    notes = "\n".join(tables.tracks_table(board, tmp_path).notes)
    assert "solver-given: no rank." in notes
    assert "part: no rank without all of camera" in notes
