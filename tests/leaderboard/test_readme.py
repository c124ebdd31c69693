"""The README of the leaderboard, and the one that this repository holds."""

import json
import os
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from dfdbench.errors import ResultError
from dfdbench.leaderboard.boards import collect
from dfdbench.leaderboard.folder import MARKER, README, RESULTS
from dfdbench.leaderboard.readme import check_readme, write_readme
from dfdbench.leaderboard.submission import submit
from dfdbench.metrics.protocol import RELEASED
from tests.made_results import make_demo_result

HERE = Path(__file__).parents[2]
NAMES = ("a b \"c\" 'd'", "x|y", "<script>alert(1)</script>", "**bold**", "🐟", "[a](b)", "$x$")


def test_a_name_is_text_whatever_it_holds(tmp_path: Path) -> None:
    for name in NAMES:
        submit(make_demo_result(lambda pair: 0.1, name), tmp_path)
    text = write_readme(tmp_path).read_text("utf-8")
    assert "<script>" not in text
    assert "🐟" in text
    rows = [line for line in text.splitlines() if re.match(r"\| 1 \|", line)]
    assert len(rows) == len(NAMES)
    assert {len(re.findall(r"(?<!\\)\|", row)) for row in rows} == {11}
    for target in re.findall(r"\[result\]\((.*?)\)", text):
        assert (tmp_path / target).exists()


def test_what_was_written_is_up_to_date_until_something_changes(tmp_path: Path) -> None:
    submit(make_demo_result(lambda pair: 0.1), tmp_path)
    with pytest.raises(ResultError, match="stale"):
        check_readme(tmp_path)
    path = write_readme(tmp_path)
    assert check_readme(tmp_path) == 1
    path.write_text(path.read_text("utf-8").replace("0.1000", "0.0100", 1))
    with pytest.raises(ResultError, match=r"README.md, line \d+"):
        check_readme(tmp_path)


def test_what_only_some_rows_need_is_explained_where_there_are_such_rows(tmp_path: Path) -> None:
    submit(make_demo_result(lambda pair: 0.1), tmp_path)
    text = write_readme(tmp_path).read_text("utf-8")
    assert "lens told" not in text
    assert "in metres" not in text
    submit(make_demo_result(lambda pair: 0.1, "lens", {"recipe": "rig"}), tmp_path)
    assert "| lens told | the lens, from" in write_readme(tmp_path).read_text("utf-8")
    result = make_demo_result(lambda pair: 0.1, "far")
    scores = dict.fromkeys(("abs_rel", "rmse_m", "delta_1", "delta_2", "delta_3"), 0.25)
    pairs = [pair.model_copy(update={"scores": {"metric": scores}}) for pair in result.pairs]
    changes = {
        "pairs": pairs,
        "averages": {"metric": scores},
        "protocols": [RELEASED["metric"].as_dict()],
    }
    submit(result.model_copy(update=changes), tmp_path)
    text = write_readme(tmp_path).read_text("utf-8")
    assert "ties by NMAE; in metres, by AbsRel." in text
    assert check_readme(tmp_path) == 3


def test_somebody_elses_readme_is_left_as_it_is(tmp_path: Path) -> None:
    submit(make_demo_result(lambda pair: 0.1), tmp_path)
    readme = tmp_path / README
    readme.write_text("# My project\n")
    for refused in (write_readme, check_readme):
        with pytest.raises(ResultError, match="left as it is"):
            refused(tmp_path)
    assert readme.read_text() == "# My project\n"


def test_a_folder_that_is_no_leaderboard_becomes_none(tmp_path: Path) -> None:
    with pytest.raises(ResultError, match="no leaderboard here"):
        write_readme(tmp_path)
    assert not list(tmp_path.iterdir())


def test_without_results_it_says_so(tmp_path: Path) -> None:
    (tmp_path / RESULTS).mkdir()
    assert "No results yet" in write_readme(tmp_path).read_text("utf-8")


@pytest.mark.slow
def test_the_committed_leaderboard_holds() -> None:
    assert check_readme(HERE / "leaderboard") >= 18


@pytest.mark.slow
@pytest.mark.parametrize("name", ["demo-1", "middlebury-default-1"])
def test_the_committed_leaderboard_says_what_the_mismatch_does(name: str) -> None:
    scores = {
        entry.label: entry.score("thesis", "nrmse")
        for entry in collect(HERE / "leaderboard")
        if entry.result.protocol_names == ("thesis",)
        and (entry.result.dataset.name, entry.result.dataset.split) == (name, "test")
    }
    matched, text = scores["graph-cuts"], scores["graph-cuts (recipe=text)"]
    assert matched is not None
    assert text is not None
    assert text > 2 * matched
    assert "What the blur mismatch does" in (HERE / "leaderboard" / README).read_text("utf-8")


@pytest.mark.slow
def test_a_score_edited_in_the_committed_results_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "leaderboard"
    shutil.copytree(HERE / "leaderboard", folder)
    path = folder / "results/demo-1-test/thesis/local.json"
    content = json.loads(path.read_text("utf-8"))
    content["pairs"][3]["scores"]["thesis"]["nrmse"] /= 2
    path.write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(ResultError, match="average does not follow from the pairs"):
        check_readme(folder)


def test_the_workflow_runs_the_check() -> None:
    text = (HERE / ".github/workflows/leaderboard.yml").read_text("utf-8")
    assert "pull_request" in text
    assert "run: dfdbench leaderboard --check" in text


@pytest.mark.parametrize(
    "name",
    [
        "README.md",
        "note.md",
        "fingerprints.json",
        "undefined.json",
        "published/a.json",
        "results/demo-1-test/thesis/z.json",
        "results/demo-1-test/thesis/mine.reproduced.json",
    ],
)
def test_what_is_no_text_file_in_the_folder_is_told(tmp_path: Path, name: str) -> None:
    folder = tmp_path / "board"
    submit(make_demo_result(lambda pair: 0.1), folder)
    path = folder / name
    path.parent.mkdir(exist_ok=True)
    (tmp_path / "elsewhere.txt").write_text(MARKER)
    makes: dict[str, Callable[[], object]] = {
        "Is a directory": path.mkdir,
        "not a regular file": lambda: os.mkfifo(path),
        "a link": lambda: path.symlink_to("../elsewhere.txt"),
        "utf-8": lambda: path.write_bytes(MARKER.encode() + b"\xff\xfe"),
    }
    for told, make in makes.items():
        make()
        with pytest.raises(ResultError, match=told if name.endswith("md") else None) as caught:
            check_readme(folder)
        assert str(path) in caught.value.problems[0].where
        path.rmdir() if path.is_dir() else path.unlink()
