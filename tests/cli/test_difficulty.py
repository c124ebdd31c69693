import json
from pathlib import Path

import pytest

from tests.cli.command import Command


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
