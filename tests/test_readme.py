"""The examples of the README and of the first pages run; numbers are what commands print."""

import json
import re
import shutil
import subprocess
import textwrap
from pathlib import Path
from typing import Any

import pytest

import dfdbench
from tests.process import python

ROOT = Path(__file__).parents[1]


def blocks(page: str, language: str) -> list[str]:
    text = (ROOT / page).read_text("utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.S | re.M)


@pytest.fixture
def place(demo_built: Path, tmp_path: Path) -> Path:
    (tmp_path / "mymodule.py").write_text(blocks("README.md", "python")[0])
    return tmp_path


def say(place: Path, command: str) -> subprocess.CompletedProcess[str]:
    program, *arguments = command.split()
    assert program == "dfdbench"
    return python("-m", "dfdbench", *arguments, cwd=place)


@pytest.mark.slow
def test_ten_lines_run(place: Path) -> None:
    build, check, run = blocks("README.md", "console")[0].splitlines()
    assert build == "dfdbench build demo"
    assert "fit for a run" in say(place, check).stdout
    outcome = say(place, run)
    assert outcome.returncode == 0, outcome.stderr
    assert "18 of 18 pairs" in outcome.stdout
    # The page shows what the program says, letter by letter.
    assert outcome.stderr.endswith(blocks("README.md", "text")[0])
    assert (place / "results/demo-1-Market/mymodule-predict/result.json").exists()


@pytest.mark.usefixtures("small_demo_built")
def test_the_ten_lines_beat_a_constant_on_every_test_scene() -> None:
    names: dict[str, Any] = {}
    exec(blocks("README.md", "python")[0], names)
    runs = [dfdbench.run(method, "demo", "test") for method in (names["predict"], "constant")]
    for protocol in ("valid", "thesis"):
        frames = (run.to_frame(protocol).groupby("scene") for run in runs)
        own, constant = (frame[["nrmse", "nmae"]].mean() for frame in frames)
        assert len(own) == 3
        assert (own < constant).all(axis=None), protocol


def test_the_ten_lines_are_the_same_wherever_they_are_shown() -> None:
    (lines,) = blocks("README.md", "python")
    assert lines in blocks("docs/tutorial.md", "python")
    cells = json.loads((ROOT / "docs/notebooks/data_and_method.ipynb").read_text("utf-8"))["cells"]
    body = re.sub(r'    """.+"""\n\n', "", lines)
    assert body.strip() in ["".join(cell["source"]) for cell in cells]


@pytest.mark.slow
def test_the_tracks_commands_run(place: Path) -> None:
    build, run, *_ = blocks("docs/tracks.md", "")[0].splitlines()
    built = say(place, build.partition("  #")[0])
    assert built.returncode == 0, built.stderr
    (fingerprint,) = re.findall(r"fingerprint +(\w+)", built.stdout)
    pinned = json.loads((ROOT / "leaderboard/fingerprints.json").read_text("utf-8"))
    assert fingerprint in pinned["demo-1@camera-2"]
    outcome = say(place, run)
    assert outcome.returncode == 0, outcome.stderr
    assert (place / "results/demo-1@camera-2-test/mymodule-predict/result.json").exists()
    assert "not given: a track" in say(place, "dfdbench info demo@camera-2").stdout


@pytest.mark.usefixtures("place")
def test_the_python_examples_run(capsys: pytest.CaptureFixture[str]) -> None:
    shown = blocks("docs/python.md", "python")
    for block, out in zip(shown[:3], ("54 (240, 320, 3) (32, 32) 3", None, "2"), strict=True):
        exec(block, {})
        expected = out or re.findall(r"^print.*nrmse.*# (.+)$", block, re.M)[0]
        assert capsys.readouterr().out == f"{expected}\n"


@pytest.mark.slow
def test_the_fitted_method_runs(place: Path) -> None:
    (place / "fitted.py").write_text(blocks("docs/methods.md", "python")[0])
    shown = blocks("docs/methods.md", "console")[0]
    outcome = say(place, f"{shown.strip()} --limit 2 --no-predictions")
    assert outcome.returncode == 0, outcome.stderr
    assert "fitted on demo-1, split train" in outcome.stdout
    assert (place / "results/demo-1-test/fitted-Fitted/fit.npz").exists()


@pytest.mark.slow
def test_a_submission_and_its_review_go_as_contributing_says(place: Path) -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
    submit, review = text.partition("## Submit a result")[2].split("## Review a submission")
    board = place / "leaderboard"
    (board / "results").mkdir(parents=True)
    shutil.copy(ROOT / "leaderboard/fingerprints.json", board)
    (card,) = re.findall(r"```toml\n(.*?)```", submit, re.S)
    (board / "methods").mkdir()
    (board / "methods/newcomer.toml").write_text(textwrap.dedent(card))
    steps = "".join(re.findall(r"^[34]\. .*?(?=^\d\. )", submit, re.S | re.M))
    commands = [" ".join(line.split()) for line in re.findall(r"`(dfdbench [^`]+)`", steps)]
    commands += re.findall(r"^    (dfdbench export .+?) &&", review, re.M)
    commands += re.findall(r"^ +(dfdbench predict .+)", review, re.M)
    commands += re.findall(r"^    (dfdbench score .+)", review, re.M)
    assert len(commands) == 6
    scores: list[list[str]] = []
    for command in commands:
        done = say(place, command.replace(" /", " "))
        assert done.returncode == 0, done.stderr
        if " run " in command or " score " in command:
            scores.append(re.findall(r"^score +NRMSE [\d.]+", done.stderr + done.stdout, re.M))
    assert scores[0] == scores[1] != []
    assert "| newcomer |" in (board / "README.md").read_text("utf-8")
