"""A leaderboard as a whole: read, checked, shown, and the one that this repository holds."""

import json
import re
from pathlib import Path

import pytest

from dfdbench.board.board import leaderboard
from dfdbench.datasets.catalog import find_manifest
from dfdbench.errors import ResultError, UnknownNameError
from tests.board.made_boards import add, add_card, make_tracks, submit
from tests.made_results import make_demo_result

NAMES = ("a b \"c\" 'd'", "x|y", "<script>alert(1)</script>", "**bold**", "🐟", "[a](b)", "$x$")


def test_its_scores_are_one_table_and_its_rankings_frames(tmp_path: Path) -> None:
    add(tmp_path, "mine", 0.1, protocols=("thesis", "valid"))
    submit(list(make_tracks("solver", 0.5, ["gain-1"], uses=["recipe"]).values()), tmp_path)
    board = leaderboard(tmp_path)
    # One of another data set must not be ranked for it, which takes seconds of hundreds of rows.
    only = leaderboard(tmp_path)
    assert only.table("demo").equals(board.table("demo-1"))
    assert "boards" not in vars(only)
    said = "<demo-1, split test, clean, protocol valid: 1 method>"
    assert said in map(repr, board.boards)
    assert len(repr(board.boards[0].standings)) < 3000
    scores = board.scores
    assert len(scores) == 54 * 3 * (2 + 2)
    means = scores.groupby(["method", "track", "severity", "metric"])["value"].mean()
    assert means["solver-given", "gain", 1, "nmae"] == 0.25
    ranked = board.table("demo")
    assert ranked[["rank", "method", "protocol"]].to_numpy().tolist() == [[1, "mine", "valid"]]
    numbers = ranked.filter(regex="^nrmse_(low|high|difference)")
    assert [*numbers.dtypes] == [float] * 6
    assert board.table("demo-1", protocol="thesis")["nrmse"][0] == ranked["nrmse"][0]
    assert board.table("demo", suite="tracks-1")["rank"].isna().all()
    with pytest.raises(UnknownNameError, match="did you mean demo-1 test clean"):
        board.table("dem", protocol="thesis")
    assert repr(board) == f"<leaderboard {tmp_path}: 2 rows on 1 data set>"
    assert "<b>demo-1, split test, protocol valid</b>" in board._repr_html_()


def test_a_name_is_text_whatever_it_holds(tmp_path: Path) -> None:
    for number, name in enumerate(NAMES):
        add_card(tmp_path, f"mine-{number}", name, title=name)
        submit(make_demo_result(lambda pair: 0.1, name), tmp_path)
    text = leaderboard(tmp_path).write().read_text("utf-8")
    assert "<script>" not in text
    assert "🐟" in text
    rows = [line for line in text.splitlines() if line.startswith("| [mine-")]
    assert len(rows) == len(NAMES)
    assert {len(re.findall(r"(?<!\\)\|", row)) for row in rows} == {7}
    targets = leaderboard(tmp_path).table("demo")["result"]
    assert len(targets) == len(NAMES)
    assert all((tmp_path / target).exists() for target in targets)


def test_what_was_written_is_up_to_date_until_something_changes(tmp_path: Path) -> None:
    add(tmp_path, "mine", 0.1)
    with pytest.raises(ResultError, match="stale"):
        leaderboard(tmp_path).require_written()
    path = leaderboard(tmp_path).write()
    leaderboard(tmp_path).require_written()
    before, score, after = path.read_text("utf-8").partition("0.1016")
    path.write_text(before + score[::-1] + after)
    with pytest.raises(ResultError, match=rf"README.md, line {before.count(chr(10)) + 1}\b"):
        leaderboard(tmp_path).require_written()


def test_the_readme_starts_with_the_newest_seed_and_has_headlines_alone(tmp_path: Path) -> None:
    add(tmp_path, "mine", 0.1, protocols=("thesis", "valid"))
    text = leaderboard(tmp_path).write().read_text("utf-8")
    assert "## Rooms nobody has seen: not run yet" in text
    assert "make leaderboard" in text
    for seed, value in ((7, 0.2), (12, 0.3)):
        scores = dict.fromkeys(find_manifest(f"unseen-{seed}").pairs("test"), value)
        submit(make_demo_result(scores.__getitem__, dataset=f"unseen-{seed}"), tmp_path)
    draws = [
        {"seed": 31, "drawn": True, "date": "2026-11-25", "commit": "abd"},
        {"seed": 12, "drawn": True, "date": "2026-11-24", "commit": "abc"},
        {"seed": 7, "drawn": False, "date": "2026-11-23", "commit": "abb"},
    ]
    (tmp_path / "seeds.json").write_text(json.dumps(draws))
    text = leaderboard(tmp_path).write().read_text("utf-8")
    leaderboard(tmp_path).require_written()
    first, public = text.split("## Public truth")
    assert text.index("seed 12") < text.index("## Methods")
    assert "2026-11-24, after the code was fixed at commit `abc`" in first
    late = "nobody can tell what they knew of the rooms: mine ("
    assert late in first
    commit = leaderboard(tmp_path).boards[-1].result.environment.git
    (tmp_path / "seeds.json").write_text(json.dumps([draws[1] | {"commit": commit}]))
    assert late not in leaderboard(tmp_path).readme()
    assert re.search(r"^\| 1 \| mine \|.* 0\.3000 \| 0\.3000 to 0\.3000 ", first, re.M)
    assert "unseen-7-1" not in text
    assert "### demo-1, split test, protocol valid: public truth" in public
    assert "protocol thesis" not in public
    assert "unseen-7-1" in {one.result.dataset.name for one in leaderboard(tmp_path).boards}


def test_without_rows_it_says_so(tmp_path: Path) -> None:
    (tmp_path / "results").mkdir()
    board = leaderboard(tmp_path)
    assert board.scores.empty
    assert "No results yet" in board.write().read_text("utf-8")


def test_somebody_elses_readme_is_left_as_it_is(tmp_path: Path) -> None:
    add(tmp_path, "mine", 0.1)
    (tmp_path / "README.md").write_text("# My project\n")
    with pytest.raises(ResultError, match="left as it is"):
        leaderboard(tmp_path)
    assert (tmp_path / "README.md").read_text() == "# My project\n"


def test_everything_that_is_wrong_is_told_at_once(tmp_path: Path) -> None:
    first, second, third = (add(tmp_path, name, 0.1) for name in ("one", "two", "three"))
    first.write_text("{")
    second.rename(second.with_name("elsewhere.json"))
    content = json.loads(third.read_text("utf-8"))
    content["manifest_sha256"] = "9" * 64
    third.write_text(json.dumps(content))
    with pytest.raises(ResultError) as caught:
        leaderboard(tmp_path)
    assert [str(problem).splitlines()[0].split(" (")[0] for problem in caught.value.problems] == [
        "the row has no card",
        "broken JSON: EOF while parsing an object at line 1 column 1",
        "made from another manifest than demo-1",
    ]


def test_all_rows_of_a_seed_are_on_the_same_rooms(tmp_path: Path) -> None:
    scores = dict.fromkeys(find_manifest("unseen-7").pairs("test"), 0.2)
    for name in ("one", "two", "easy"):
        path = submit(make_demo_result(scores.__getitem__, name, dataset="unseen-7"), tmp_path)
    leaderboard(tmp_path)
    content = json.loads(path.read_text("utf-8"))
    content["runs"][0]["fingerprint"] = "9" * 64
    path.write_text(json.dumps(content))
    told = r"other data than other rows of unseen-7-1 .*easy\.json.*\n.*cache clear unseen-7-1"
    with pytest.raises(ResultError, match=told):
        leaderboard(tmp_path)


def test_a_score_that_other_rows_have_may_not_be_left_out(tmp_path: Path) -> None:
    # A pair that no row has a score of is undefined for its ground truth, and no mistake.
    for name in ("one", "two"):
        path = add(tmp_path, name, 0.1)
        content = json.loads(path.read_text("utf-8"))
        content["runs"][0]["scores"]["valid"]["nmae"][0] = None
        path.write_text(json.dumps(content))
    leaderboard(tmp_path)
    content["runs"][0]["scores"]["valid"]["nrmse"][5] = None
    # A method may leave pixels without an answer; it has no rank then.
    content["runs"][0]["answered"] = [1.0] * 5 + [0.9] + [1.0] * (len(content["pairs"]) - 6)
    path.write_text(json.dumps(content))
    assert "two: not ranked: 1 pair without an answer" in leaderboard(tmp_path).write().read_text()
    del content["runs"][0]["answered"]
    path.write_text(json.dumps(content))
    with pytest.raises(ResultError, match=r"two has no nrmse under valid.*illumination2/exposure2"):
        leaderboard(tmp_path)
