import json
import re
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest

from dfdbench.errors import ResultError
from dfdbench.leaderboard.board_tables import lighting_table, standings_table
from dfdbench.leaderboard.boards import Entry, boards, collect
from dfdbench.leaderboard.folder import file_stems
from dfdbench.leaderboard.submission import submit
from dfdbench.results.record_file import seal_of
from tests.leaderboard.made_boards import WHEN, add, only_board
from tests.made_results import limited, make_demo_result


def test_the_ranking_is_by_nrmse_with_an_interval_and_the_row_above(tmp_path: Path) -> None:
    add(tmp_path, "worse", 0.2)
    add(tmp_path, "better", 0.1)
    board = only_board(tmp_path)
    first, second = board.standings
    assert [(s.rank, s.entry.label) for s in board.standings] == [(1, "better"), (2, "worse")]
    assert first.above is None
    assert second.above is not None
    assert second.above.mean == pytest.approx(0.1)
    assert second.above.verdict == "too few scenes to tell"
    assert first.interval is not None
    score = first.entry.score("thesis", "nrmse")
    assert score is not None
    assert first.interval[0] < score < first.interval[1]


def test_ties_go_to_nmae_and_full_ties_share_a_rank(tmp_path: Path) -> None:
    for name in ("c", "a", "b"):
        add(tmp_path, name, 0.1)
    add(tmp_path, "last", 0.3)
    better_nmae = make_demo_result(lambda pair: 0.3, "first of the last")
    pairs = [
        pair.model_copy(update={"scores": {"thesis": pair.scores["thesis"] | {"nmae": 0.0}}})
        for pair in make_demo_result(
            lambda p: 0.3 + 0.0001 * len(p.scene) + 0.001 * p.at["exposure"]
        ).pairs
    ]
    nrmse = sum(pair.scores["thesis"]["nrmse"] or 0 for pair in pairs) / len(pairs)
    averages = {"thesis": {"nrmse": nrmse, "nmae": 0.0, "ssim": 1 - nrmse}}
    submit(better_nmae.model_copy(update={"pairs": pairs, "averages": averages}), tmp_path, WHEN)
    found = [(s.rank, s.entry.label) for s in only_board(tmp_path).standings]
    assert found[:3] == [(1, "a"), (1, "b"), (1, "c")]
    assert [label for _, label in found[3:]] == ["first of the last", "last"]


def test_other_data_split_or_protocol_is_another_board(tmp_path: Path) -> None:
    add(tmp_path, "mine", 0.1, protocols=("thesis", "valid"))
    add(tmp_path, "other", 0.1, fingerprint="5" * 64)
    found = [(b.protocol, b.fingerprint[0], len(b.standings)) for b in boards(collect(tmp_path))]
    assert found == [("thesis", "2", 1), ("thesis", "5", 1), ("valid", "2", 1)]


def test_the_same_images_under_another_manifest_are_another_board(tmp_path: Path) -> None:
    # A set of one's own whose network_crop was changed has the same images and other scores.
    first, second = make_demo_result(lambda pair: 0.1, "a"), make_demo_result(lambda pair: 0.2, "b")
    dataset = second.dataset.model_copy(update={"manifest_sha256": "7" * 64})
    second = second.model_copy(update={"dataset": dataset})
    (tmp_path / "result.json").touch()
    found = boards([Entry(result, tmp_path / "result.json", None) for result in (first, second)])
    assert [len(board.standings) for board in found] == [1, 1]


def test_an_incomplete_run_is_listed_without_rank(tmp_path: Path) -> None:
    add(tmp_path, "whole", 0.3)
    submit(limited(make_demo_result(lambda pair: 0.001, "stopped"), 7), tmp_path, WHEN)
    board = only_board(tmp_path)
    assert [(s.rank, s.entry.label) for s in board.standings] == [(1, "whole"), (None, "stopped")]
    table = standings_table(board, tmp_path)
    assert table.rows[1][:4] == ("–", "stopped", "nothing", "(0.0010)")
    assert "7 of 54 pairs evaluated" in " ".join(table.notes)
    lighting_table(board)


def test_the_newer_of_two_results_of_a_method_wins_and_that_is_said(tmp_path: Path) -> None:
    old = add(tmp_path, "mine", 0.1)
    kept = old.rename(old.with_stem(file_stems("mine", "2" * 64)[1]))
    newer = make_demo_result(lambda pair: 0.2, "mine")
    submit(newer, tmp_path, WHEN + timedelta(seconds=1))
    board = only_board(tmp_path)
    assert [s.entry.path.name for s in board.standings] == ["mine.json"]
    assert f"{kept.name} gives way to the newer mine.json" in " ".join(
        standings_table(board, tmp_path).notes
    )


def test_every_wrong_file_is_told_at_once(tmp_path: Path) -> None:
    first, second = add(tmp_path, "a", 0.1), add(tmp_path, "b", 0.1)
    first.write_text(first.read_text().replace('"schema_version": 1', '"schema_version": 9', 1))
    second.write_text(re.sub('"nmae": [0-9.]+', '"nmae": NaN', second.read_text(), count=1))
    (first.parent / "gone.reproduced.json").write_text("{}")
    with pytest.raises(ResultError) as raised:
        collect(tmp_path)
    told = str(raised.value)
    for part in ("another version", "a.json", "b.json", "finite", "without its result"):
        assert part in told, part


def test_no_folder_is_told() -> None:
    with pytest.raises(ResultError, match="--folder"):
        collect(Path("/no/such/folder"))


def test_new_sets_are_headed_by_known_pixels_and_the_thesis_s_by_its_protocol() -> None:
    def headed(short: str, name: str) -> list[str]:
        result = make_demo_result(lambda pair: 0.1, protocols=("thesis", "valid"))
        dataset = result.dataset.model_copy(update={"short": short, "name": name})
        entry = Entry(result.model_copy(update={"dataset": dataset}), Path(__file__), None)
        return [board.protocol for board in boards([entry]) if board.headline]

    assert headed("demo", "demo-1") == ["thesis"]
    assert headed("middlebury-default", "middlebury-default-1") == ["valid"]


def test_the_headline_comes_first() -> None:
    result = make_demo_result(lambda pair: 0.1, protocols=("thesis", "valid"))
    dataset = result.dataset.model_copy(update={"short": "middlebury-default"})
    entry = Entry(result.model_copy(update={"dataset": dataset}), Path(__file__), None)
    assert [board.protocol for board in boards([entry])] == ["valid", "thesis"]


def test_no_row_takes_anothers_place_by_reading_alike(tmp_path: Path) -> None:
    given: list[tuple[str, dict[str, Any]]] = [
        ("mine", {"w": 9}),
        ("mine", {"w": "9"}),
        ("mine", {"w": 9.0}),
        ("mine (w=9)", {}),
    ]
    for name, parameters in given:
        add(tmp_path, name, 0.1, parameters=parameters)
    board = only_board(tmp_path)
    assert not board.superseded
    assert len({standing.entry.label for standing in board.standings}) == len(given)


def test_the_order_of_parameters_makes_no_other_method(tmp_path: Path) -> None:
    add(tmp_path, "mine", 0.1, parameters={"a": 1, "b": 2})
    add(tmp_path, "mine", 0.2, parameters={"b": 2, "a": 1})
    board = only_board(tmp_path)
    assert (len(board.standings), len(board.superseded)) == (1, 1)


def test_ranks_are_by_the_pairs_scores_whatever_a_file_says_of_their_mean(tmp_path: Path) -> None:
    add(tmp_path, "a", 0.1)
    path = add(tmp_path, "b", 0.1)
    content = json.loads(path.read_text())
    content["averages"]["thesis"]["nrmse"] -= 9e-10
    content["submission"]["seal"] = seal_of(content)
    path.write_text(json.dumps(content))
    assert [standing.rank for standing in only_board(tmp_path).standings] == [1, 1]
