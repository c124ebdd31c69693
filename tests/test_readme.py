"""The README's examples run, and its numbers are what its commands print."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from dfdbench.datasets.store import Store

README = Path(__file__).parents[1] / "README.md"


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", README.read_text("utf-8"), re.S | re.M)


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
    (tmp_path / "mymodule.py").write_text(blocks("python")[0])
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
        timeout=300,
        check=False,
    )


def test_the_tutorial_runs(place: Path) -> None:
    build, check, run = blocks("console")[0].splitlines()
    assert build == "dfdbench build demo"
    assert "fit for a run" in dfdbench(place, check).stdout
    outcome = dfdbench(place, run)
    assert outcome.returncode == 0, outcome.stderr
    assert "54 of 54 pairs" in outcome.stdout
    assert (place / "results/demo-1-test/mymodule-predict/result.json").exists()


def test_the_table_is_what_the_command_prints(place: Path) -> None:
    shown = table_rows(README.read_text("utf-8"))
    assert len(shown) == 13
    outcome = dfdbench(place, blocks("console")[1].strip())
    assert outcome.returncode == 0, outcome.stderr
    found = table_rows(outcome.stdout)
    assert found.keys() == shown.keys()
    for key, values in shown.items():
        # Float32 filters differ in the last digits between processors.
        assert found[key] == pytest.approx(values, abs=5e-4), key
    assert (place / "results/demo-1-test/local/figures/worst.png").exists()


@pytest.mark.slow
def test_the_tracks_commands_run(place: Path) -> None:
    (shown,) = (block for block in blocks("console") if "demo@camera-2" in block)
    build, run, info = shown.splitlines()
    built = dfdbench(place, build)
    assert built.returncode == 0, built.stderr
    (fingerprint,) = re.findall(r"fingerprint +(\w+)", built.stdout)
    pinned = json.loads((README.parent / "leaderboard/fingerprints.json").read_text("utf-8"))
    assert fingerprint in pinned["demo-1@camera-2"]
    outcome = dfdbench(place, run)
    assert outcome.returncode == 0, outcome.stderr
    assert (place / "results/demo-1@camera-2-test/constant/result.json").exists()
    assert "not told: a track" in dfdbench(place, info).stdout


def test_the_python_example_runs(capsys: pytest.CaptureFixture[str]) -> None:
    exec(blocks("python")[3], {})
    assert float(capsys.readouterr().out) < 0.01


def test_pairs_are_read_as_shown(
    place: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DFDBENCH_CACHE", str(place / "cache"))
    exec(blocks("python")[2], {})
    assert capsys.readouterr().out == "54 (240, 320, 3) (32, 32) 3\n"


def test_the_fitted_method_runs(place: Path) -> None:
    (place / "fitted.py").write_text(blocks("python")[1])
    outcome = dfdbench(place, blocks("console")[2].strip() + " --limit 2 --no-predictions")
    assert outcome.returncode == 0, outcome.stderr
    assert "fitted       on demo-1, split train" in outcome.stderr
    assert (place / "results/demo-1-test/fitted-Fitted/fit.npz").exists()
