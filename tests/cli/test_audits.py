from __future__ import annotations

import json
import tomllib
from pathlib import Path

import pytest

from dfdbench.datasets.manifest_file import parse_manifest
from tests.cli.command import Command
from tests.conftest import TINY_TOML


def test_depths_are_counted_and_drawn(dfdbench: Command, uneven: str) -> None:
    whole = dfdbench("audit", "depths", uneven, "--format", "csv", "--figure", "figures/depths.png")
    lines = whole.out.splitlines()
    assert lines[0] == "level,pixels,share"
    assert len(lines) == 257
    # Three: 3 pairs of 4 rows of 32 pixels, of which 11 columns are 36.
    assert lines[37].split(",")[:2] == ["36", str(3 * 4 * 11)]
    assert Path("figures/depths.png").stat().st_size > 10_000
    scene = dfdbench("audit", "depths", uneven, "--split", "One", "--format", "markdown")
    assert "| 96-111 | 2,760 | 100.0 % | 96-99, 101-111 |" in scene.out
    assert "| 32-47 | 0 | 0 % | all |" in scene.out
    wrong = dfdbench("audit", "depths", uneven, "--split", "Ome")
    assert wrong.status == 2
    assert "did you mean One" in wrong.err


@pytest.mark.slow
def test_errors_by_depth_stand_beside_a_constants(dfdbench: Command, uneven: str) -> None:
    for level in ("90", "40"):
        ran = dfdbench(
            *("run", "--dataset", uneven, "--split", "all", "--method", "constant"),
            *("--param", f"training_mean={level}", "--out", f"runs/{level}"),
        )
        assert ran.status == 0, ran.err
    one = dfdbench("audit", "depths", uneven, "--result", "runs/90", "--figure", "errors.png")
    assert one.status == 0, one.err
    assert "mean absolute error by depth" in one.out
    assert "constant (training_mean=90)" in one.out
    assert Path("errors.png").stat().st_size > 10_000
    both = dfdbench(
        *("audit", "depths", uneven, "--result", "runs/90", "--result", "runs/40/result.json"),
        *("--format", "csv"),
    )
    heading, *rows = both.out.splitlines()
    assert heading.startswith("levels,of all,constant (training_mean=90),")
    # 11 columns of 36, 11 of 37 and 10 of 38 are answered with 90, and with 40.
    (near,) = [row.split(",") for row in rows if row.startswith("36-38,")]
    assert near[2:4] == ["53.03", "3.03"]
    wrong = dfdbench("audit", "depths", uneven, "--split", "all", "--result", "runs/90")
    assert wrong.status == 2
    assert "a run says itself which split" in wrong.err


@pytest.mark.slow
def test_difficulty_has_a_row_a_scene_and_lighting(dfdbench: Command, uneven: str) -> None:
    outcome = dfdbench("audit", "difficulty", uneven, "--split", "all")
    assert outcome.status == 0
    rows = json.loads(Path("results/uneven-difficulty/all/difficulty.json").read_text())["rows"]
    assert len(rows) == 6
    assert all(0 <= row["neighbours"] <= 1 for row in rows)
    harder = dfdbench(
        "audit", "difficulty", uneven, "--split", "all", "--noise", "20", "--format", "json"
    )
    for quiet, noisy in zip(rows, json.loads(harder.out)["rows"], strict=True):
        assert quiet["neighbours"] < noisy["neighbours"]
    assert Path("results/uneven-difficulty/all/difficulty.png").exists()


def test_a_proposed_split_is_a_fragment_of_a_manifest(dfdbench: Command, uneven: str) -> None:
    outcome = dfdbench("audit", "split", uneven, "--test-scenes", "2", "--criterion", "thesis")
    assert outcome.status == 0
    assert "(published)" in outcome.out
    fragment = Path("results/uneven-splits/test-2/split.toml").read_text()
    manifest = parse_manifest((TINY_TOML + fragment).encode(), "tiny-1.toml")
    assert set(manifest.scenes_of("train-covered")).isdisjoint(manifest.scenes_of("test-covered"))
    assert len(manifest.scenes_of("test-covered")) == 2
    single = dfdbench("audit", "split", uneven, "--test-scenes", "1", "--format", "json")
    found = json.loads(single.out)
    assert (found["choices"], found["exhaustive"], found["published"]["rank"]) == (3, True, None)
    assert found["candidates"][-1]["test"] == ["Three"]
    folds = dfdbench("audit", "split", uneven, "--folds", "3")
    assert "Three: rare in all other scenes: 36-38" in folds.out
    assert (
        len(tomllib.loads(Path("results/uneven-splits/folds-3/folds.toml").read_text())["folds"])
        == 3
    )
