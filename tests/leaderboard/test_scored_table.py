from pathlib import Path

import pytest

from dfdbench.errors import ResultError
from dfdbench.leaderboard.boards import collect, parted
from dfdbench.leaderboard.readme import write_readme
from dfdbench.leaderboard.scored_table import scored_table
from dfdbench.leaderboard.submission import submit
from dfdbench.leaderboard.verification import claim_of
from dfdbench.results.record import Result
from tests.leaderboard.made_boards import WHEN, add
from tests.made_results import make_demo_result


def scored(name: str, value: float) -> Result:
    made = make_demo_result(lambda pair: value, name)
    pairs = [pair.model_copy(update={"seconds": None}) for pair in made.pairs]
    method = made.method.model_copy(update={"scored": "levels", "entry": "scored, not run"})
    return made.model_copy(update={"pairs": pairs, "method": method})


def test_what_was_not_run_stands_apart_without_rank(tmp_path: Path) -> None:
    add(tmp_path, "mine", 0.2)
    submit(scored("elsewhere", 0.01), tmp_path, WHEN)
    (run,), (apart,) = parted(collect(tmp_path))
    assert [(s.rank, s.entry.label) for s in run.standings] == [(1, "mine")]
    table = scored_table(apart, tmp_path)
    assert [row[:2] for row in table.rows] == [("elsewhere (scored, not run)", "0.0100")]
    assert (table.rows[0][-2], table.records[0]["rank"]) == ("unverified", None)
    assert len(table.rows[0]) == len(table.columns) == len(table.align)
    text = write_readme(tmp_path).read_text("utf-8")
    ranked, below = text.split("## Scored, not run")
    assert "| elsewhere" not in ranked
    assert "| unverified |" in ranked
    assert "elsewhere (scored, not run)" in below


def test_a_board_of_nothing_but_such_rows_is_written(tmp_path: Path) -> None:
    submit(scored("elsewhere", 0.01), tmp_path, WHEN)
    text = write_readme(tmp_path).read_text("utf-8")
    assert "No results yet." in text
    assert "| elsewhere (scored, not run) | 0.0100 |" in text


def test_without_such_rows_nothing_is_said_of_them(tmp_path: Path) -> None:
    add(tmp_path, "mine", 0.2)
    text = write_readme(tmp_path).read_text("utf-8")
    assert "unverified" not in text
    assert "not run" not in text


def test_a_methods_name_replaces_no_run_of_it_and_is_not_verified(tmp_path: Path) -> None:
    # Named as a method of ours: neither its file nor its row.
    first = add(tmp_path, "mine", 0.2)
    (second,) = submit(scored("mine", 0.01), tmp_path, WHEN)
    assert first.exists()
    assert second.name == "mine-scored-not_run.json"
    (built_in,) = submit(scored("local", 0.01), tmp_path, WHEN)
    assert len(collect(tmp_path)) == 3
    with pytest.raises(ResultError, match="nothing to run again"):
        claim_of(scored("local", 0.01), built_in)
