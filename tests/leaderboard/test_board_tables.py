import os
from pathlib import Path

import pytest

from dfdbench.leaderboard.board_tables import runs_table, standings_table
from dfdbench.leaderboard.boards import Entry, boards
from dfdbench.leaderboard.submission import submit
from tests.leaderboard.made_boards import WHEN, add, only_board
from tests.made_results import make_demo_result, make_result


@pytest.mark.parametrize("scenes", ["abc", "abcdef"])
def test_few_scenes_are_no_95_per_cent(tmp_path: Path, scenes: str) -> None:
    (tmp_path / "r.json").touch()
    values = {(scene, 1, 1, 0): 0.1 * (1 + n) for n, scene in enumerate(scenes)}
    (board,) = boards([Entry(make_result(values), tmp_path / "r.json", None)])
    table = standings_table(board, tmp_path)
    name = "95 %" if len(scenes) > 5 else "range of scene means"
    assert table.columns[4] == name
    assert table.records[0]["interval"] == name
    assert ("too few for a 95 % interval" in table.notes[0]) == (len(scenes) < 6)
    assert (table.rows[0][4] == "0.1000 to 0.3000") == (len(scenes) < 6)


def test_runs_that_give_way_are_named_by_their_folders(tmp_path: Path) -> None:
    paths = [tmp_path / place / "result.json" for place in ("old", "new", "a/run", "b/run")]
    for path in paths:
        path.parent.mkdir(parents=True)
        path.write_text("")
    for first, second, told in (
        (paths[0], paths[1], "old gives way to the newer new"),
        (paths[2], paths[3], "a/run gives way to the newer b/run"),
    ):
        entries = [
            Entry(make_result({("a", 1, 1, 0): 0.1}), path, None) for path in (first, second)
        ]
        os.utime(first, (0, 0))
        (board,) = boards(entries)
        assert told in standings_table(board, tmp_path).notes[-1]


@pytest.mark.slow
def test_a_hundred_results(tmp_path: Path) -> None:
    result = make_demo_result(lambda pair: 0.1)
    for number in range(100):
        method = result.method.model_copy(update={"name": f"method {number:02}"})
        submit(result.model_copy(update={"method": method}), tmp_path, WHEN)
    board = only_board(tmp_path)
    assert [s.rank for s in board.standings] == [1] * 100
    assert board.standings[99].entry.label == "method 99"
    assert len(standings_table(board, tmp_path).rows) == 100


def test_records_hold_numbers_in_full_and_links_lead_to_the_file(tmp_path: Path) -> None:
    add(tmp_path, "mine", 0.1, parameters={"window": 9, "recipe": "text"})
    board = only_board(tmp_path)
    (record,) = standings_table(board, tmp_path).records
    assert record["nrmse"] == board.standings[0].entry.score("thesis", "nrmse")
    assert record["nrmse exposure 2"] != record["nrmse exposure 0"]
    assert record["result"] == "results/demo-1-test/thesis/mine-window=9-recipe=text.json"
    assert (tmp_path / str(record["result"])).exists()
    table = runs_table(board, tmp_path)
    assert table.rows[0][:3] == ("mine", "window=9, recipe=text", "nothing")


def test_notes_say_the_floor_of_ssim_and_what_other_data_sets_trained(tmp_path: Path) -> None:
    constant = make_demo_result(lambda pair: 0.2, "constant")
    method = make_demo_result(lambda pair: 0.1, "net").method
    trained = method.model_copy(update={"trained_on": "middlebury-default-1, split train"})
    net = make_demo_result(lambda pair: 0.1).model_copy(update={"method": trained})
    (tmp_path / "r.json").touch()
    (board,) = boards([Entry(result, tmp_path / "r.json", None) for result in (constant, net)])
    table = standings_table(board, tmp_path)
    assert "SSIM is to be read from its floor: a constant has 0.80 here." in table.notes
    assert any(note.startswith("middlebury-default-1: ") for note in table.notes)
    assert [row[2] for row in table.rows] == ["trained on middlebury-default-1", "nothing"]
    (alone,) = boards([Entry(net, tmp_path / "r.json", None)])
    assert not any("floor" in note for note in standings_table(alone, tmp_path).notes)


def test_an_incomplete_run_shows_the_means_of_its_pairs_in_brackets(tmp_path: Path) -> None:
    whole = make_result({("a", 1, 1, 0): 0.1, ("a", 1, 1, 1): 0.3})
    failed = whole.pairs[1].model_copy(update={"status": "failed", "scores": {}})
    update = {
        "pairs": [whole.pairs[0], failed],
        "dataset": whole.dataset.model_copy(update={"evaluated": 1}),
        "averages": None,
    }
    part = whole.model_copy(update=update)
    (tmp_path / "r.json").touch()
    (board,) = boards([Entry(part, tmp_path / "r.json", None)])
    table = standings_table(board, tmp_path)
    assert (table.rows[0][0], table.rows[0][3]) == ("–", "(0.1000)")
    assert table.records[0]["nrmse"] is None
    assert any("1 of 2 pairs evaluated, whose means stand in brackets" in n for n in table.notes)
