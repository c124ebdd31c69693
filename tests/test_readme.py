"""The examples of the README and of the first pages run; numbers are what commands print."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from dfdbench.datasets.store import Store
from dfdbench.leaderboard.row_file import read_row
from dfdbench.metrics.metric import METRICS, mean_of

ROOT = Path(__file__).parents[1]


def blocks(page: str, language: str) -> list[str]:
    text = (ROOT / page).read_text("utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.S | re.M)


def table_rows(text: str) -> dict[tuple[str, str], list[float]]:
    rows = {}
    for line in text.splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if len(cells) == 8 and re.fullmatch(r"\d\.\d{4}", cells[2]):
            rows[cells[0], cells[1]] = [float(cell) for cell in cells[2:]]
    return rows


@pytest.fixture
def place(demo_store: Store, tmp_path: Path) -> Path:
    # The demo store of the session stands in for the one that `build demo` would make.
    stores = tmp_path / "cache/stores"
    stores.mkdir(parents=True)
    (stores / "demo-1.zarr").symlink_to(str(demo_store.path))
    (tmp_path / "mymodule.py").write_text(blocks("README.md", "python")[0])
    return tmp_path


def dfdbench(place: Path, command: str) -> subprocess.CompletedProcess[str]:
    program, *arguments = command.split()
    assert program == "dfdbench"
    return subprocess.run(
        [sys.executable, "-m", "dfdbench", *arguments],
        cwd=place,
        capture_output=True,
        text=True,
        env={**os.environ, "DFDBENCH_CACHE": str(place / "cache")},
        timeout=1200,
        check=False,
    )


def test_the_demos_table_holds_the_scores_of_the_leaderboards_rows() -> None:
    text = (ROOT / "README.md").read_text("utf-8")
    rows = re.findall(r"^\| `([\w-]+)` \|[^|]+\| ([\d.]+) \| ([\d.]+) \| ([\d.]+) \|", text, re.M)
    assert [name for name, *_ in rows] == ["graph-cuts", "local", "s-transform", "constant"]
    for name, *shown in rows:
        result = read_row(ROOT / f"leaderboard/results/demo-1-test/{name}.json").results[0]
        pairs = [pair for pair in result.pairs if pair.scene == "Market"]
        assert len(pairs) == 18
        for metric, printed in zip(METRICS, shown, strict=True):
            mean = mean_of(
                [found for p in pairs if (found := p.score("thesis", metric)) is not None]
            )
            assert float(printed) == pytest.approx(mean, abs=5e-4), (name, metric)


@pytest.mark.slow
def test_ten_lines_run(place: Path) -> None:
    build, check, run = blocks("README.md", "console")[0].splitlines()
    assert build == "dfdbench build demo"
    assert "fit for a run" in dfdbench(place, check).stdout
    outcome = dfdbench(place, run)
    assert outcome.returncode == 0, outcome.stderr
    assert "18 of 18 pairs" in outcome.stdout
    assert (place / "results/demo-1-Market/mymodule-predict/result.json").exists()


def test_the_ten_lines_run_where_make_demo_leaves_its_methods() -> None:
    (split,) = re.findall(r"^DEMO_SPLIT := (\w+)$", (ROOT / "Makefile").read_text("utf-8"), re.M)
    text = (ROOT / "README.md").read_text("utf-8")
    shown = re.findall(r"^dfdbench run .*--dataset demo(?!@).*$|^dfdbench report .*$", text, re.M)
    assert len(shown) == 4
    for line in shown:
        assert f"--split {split}" in line or f"results/demo-1-{split}/*" in line


@pytest.mark.slow
def test_the_table_is_what_the_command_prints(place: Path) -> None:
    shown = table_rows((ROOT / "docs/runs.md").read_text("utf-8"))
    assert len(shown) == 13
    outcome = dfdbench(place, blocks("docs/runs.md", "console")[0].strip())
    assert outcome.returncode == 0, outcome.stderr
    found = table_rows(outcome.stdout)
    assert found.keys() == shown.keys()
    for key, values in shown.items():
        # Float32 filters differ in the last digits between processors.
        assert found[key] == pytest.approx(values, abs=5e-4), key
    assert (place / "results/demo-1-test/local/figures/worst.png").exists()


@pytest.mark.slow
def test_the_tracks_commands_run(place: Path) -> None:
    build, run, info = blocks("README.md", "console")[1].splitlines()
    built = dfdbench(place, build)
    assert built.returncode == 0, built.stderr
    (fingerprint,) = re.findall(r"fingerprint +(\w+)", built.stdout)
    pinned = json.loads((ROOT / "leaderboard/fingerprints.json").read_text("utf-8"))
    assert fingerprint in pinned["demo-1@camera-2"]
    outcome = dfdbench(place, run)
    assert outcome.returncode == 0, outcome.stderr
    assert (place / "results/demo-1@camera-2-test/constant/result.json").exists()
    assert "not told: a track" in dfdbench(place, info).stdout


def test_the_python_example_runs(capsys: pytest.CaptureFixture[str]) -> None:
    exec(blocks("docs/python.md", "python")[1], {})
    assert float(capsys.readouterr().out) < 0.01


def test_pairs_are_read_as_shown(
    place: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DFDBENCH_CACHE", str(place / "cache"))
    exec(blocks("docs/python.md", "python")[0], {})
    assert capsys.readouterr().out == "54 (240, 320, 3) (32, 32) 3\n"


def test_a_run_from_python_is_as_shown(
    place: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DFDBENCH_CACHE", str(place / "cache"))
    exec(blocks("docs/python.md", "python")[2], {})
    assert capsys.readouterr().out == "2\n"


@pytest.mark.slow
def test_the_fitted_method_runs(place: Path) -> None:
    (place / "fitted.py").write_text(blocks("docs/methods.md", "python")[0])
    (shown,) = blocks("docs/methods.md", "console")
    outcome = dfdbench(place, f"{shown.strip()} --limit 2 --no-predictions")
    assert outcome.returncode == 0, outcome.stderr
    assert "fitted       on demo-1, split train" in outcome.stderr
    assert (place / "results/demo-1-test/fitted-Fitted/fit.npz").exists()
