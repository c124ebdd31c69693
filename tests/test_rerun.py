"""`make leaderboard`: it runs all cards on a seed's rooms, and says what it could not run."""

import json
import subprocess
from pathlib import Path
from runpy import run_path
from types import SimpleNamespace
from typing import Any

import pytest

from dfdbench.api import run as run_constant
from dfdbench.board.board import Draw, read_draws
from dfdbench.errors import InputError, ResultError
from leaderboard.rerun import draw_seed
from tests.board.made_boards import add_card
from tests.made_results import edited, make_demo_result
from tests.process import python

SCRIPT = Path(__file__).parents[1] / "leaderboard/rerun.py"


@pytest.fixture
def rerun(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    monkeypatch.chdir(tmp_path)
    found: dict[str, Any] = run_path(str(SCRIPT))["run_seed"].__globals__

    drawn = '{"seed": SEED, "drawn": false, "date": "2026-11-24", "commit": "abc"}'
    monkeypatch.setitem(
        found,
        "draw_seed",
        lambda folder, seed: Draw.model_validate_json(drawn.replace("SEED", seed)),
    )
    board = tmp_path / "leaderboard"
    add_card(board, "wide", "local", parameters={"window": 9, "name": "9"})
    add_card(board, "planes", "mine:planes", takes=["stack"])
    add_card(board, "given", "local", given_blur=True)
    return found


@pytest.fixture
def commands(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The commands that are asked for; none is run."""
    asked = []

    def run(words: list[str], **options: Any) -> SimpleNamespace:
        assert options["timeout"] in (None, 90)
        asked.append(" ".join(words[3:]))
        return SimpleNamespace(returncode=0)

    monkeypatch.setattr(subprocess, "run", run)
    return asked


def test_every_card_runs_on_the_set_that_it_takes(
    rerun: dict[str, Any], commands: list[str]
) -> None:
    assert list(rerun["run_seed"]("7", 1.5)) == []
    run = "run --no-predictions --no-figures --dataset {} --submit --method {}"
    assert commands == [
        "build unseen --seed 7",
        run.format("unseen-7", "local") + ' --param=window=9 --param=name="9"',
        "build unseen-stack --seed 7",
        run.format("unseen-stack-7", "mine:planes"),
    ]


def test_each_ranking_of_a_row_is_run_as_it_was(
    rerun: dict[str, Any], commands: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(rerun, "_lacking", lambda name, split: "")
    row = Path("leaderboard/results/demo-1-test/wide.json")
    row.parent.mkdir(parents=True)
    suites = ["clean", "tracks-1", "stack-9"]
    row.write_text(json.dumps({"dataset": "demo-1", "split": "test", "suites": suites}))
    assert list(rerun["run_rows"](1.5)) == []
    assert [command.partition(" --split test")[0] for command in commands] == [
        "run --no-predictions --no-figures --dataset demo-1",
        "tracks --dataset demo-1",
        "run --no-predictions --no-figures --dataset demo-1@stack-9",
    ]


@pytest.mark.slow
def test_rows_that_are_there_are_run_anew(
    demo_built: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    add_card(tmp_path / "leaderboard", "mean", "constant")
    (tmp_path / "leaderboard/results").mkdir()
    run_constant("constant", "demo", "Market").submit()
    row = tmp_path / "leaderboard/results/demo-1-Market/mean.json"
    text = row.read_text("utf-8")
    row.write_text(text.replace('"nrmse":[0.', '"nrmse":[0.9'))
    done = python(SCRIPT, "--rows")
    assert (done.returncode, done.stderr.count("left out")) == (0, 0), done.stderr
    scores = [line for line in text.splitlines() if '"nrmse":' in line]
    assert [line for line in row.read_text("utf-8").splitlines() if '"nrmse":' in line] == scores
    assert "| 1 | mean | mean depth |" in (tmp_path / "leaderboard/README.md").read_text("utf-8")
    (demo_built / "stores/demo-1.zarr").unlink()
    told = python(SCRIPT, "--rows").stderr.splitlines()
    (left,) = [line for line in told if line.startswith("left out")]
    assert "demo-1-Market/mean.json, clean: " in left
    assert "dfdbench build demo" in left


def at_commit(monkeypatch: pytest.MonkeyPatch, commit: str | None) -> None:
    environment = edited(make_demo_result(lambda pair: 0.1).environment, git=commit)
    monkeypatch.setattr("dfdbench.results.environment.describe_environment", lambda: environment)


def test_a_seed_is_drawn_and_written_down(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    at_commit(monkeypatch, "abc")
    first, second = draw_seed(tmp_path), draw_seed(tmp_path)
    assert first.seed != second.seed
    assert (first.drawn, first.commit) == (True, "abc")
    assert read_draws(tmp_path) == [second, first]


def test_a_seed_stays_as_it_was_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    at_commit(monkeypatch, "abc")
    first = draw_seed(tmp_path)
    named = draw_seed(tmp_path, 7)
    assert not named.drawn
    assert draw_seed(tmp_path, first.seed) == first
    at_commit(monkeypatch, "abd")
    assert draw_seed(tmp_path, str(first.seed)) == first
    assert read_draws(tmp_path) == [named, first]


def test_what_no_commit_holds_is_not_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for commit in (None, "abc-dirty"):
        at_commit(monkeypatch, commit)
        with pytest.raises(ResultError, match="in no commit"):
            draw_seed(tmp_path)
    at_commit(monkeypatch, None)
    with monkeypatch.context() as without_git:
        without_git.setenv("PATH", "")
        with pytest.raises(ResultError, match="no git checkout"):
            draw_seed(tmp_path)
    at_commit(monkeypatch, "abc")
    for seed in ("x", -1, "1.5", "007"):
        with pytest.raises(InputError, match="not a seed"):
            draw_seed(tmp_path, seed)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["leaderboard/methods/new.toml", "new.py"])
def test_cards_and_modules_are_code_too(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    at_commit(monkeypatch, "abc")
    subprocess.run(["git", "init", "--quiet", str(tmp_path)], check=True)
    add_card(tmp_path / "leaderboard", "old")
    subprocess.run(["git", "-C", str(tmp_path), "add", "leaderboard"], check=True)
    commit = ["-c", "user.name=x", "-c", "user.email=x@example.org", "commit", "--quiet", "-m", "x"]
    subprocess.run(["git", "-C", str(tmp_path), *commit], check=True)
    (tmp_path / "results.json").write_text("")
    draw_seed(tmp_path / "leaderboard", 7)
    (tmp_path / name).write_text("")
    with pytest.raises(ResultError, match=rf"in no commit \({name}\)"):
        draw_seed(tmp_path / "leaderboard", 7)
