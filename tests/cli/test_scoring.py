from pathlib import Path

import numpy as np
import pytest

from dfdbench.datasets.dataset import Dataset
from dfdbench.results.record_file import load_result
from tests.cli.command import Command


@pytest.mark.slow
@pytest.mark.usefixtures("built")
def test_a_folder_named_by_info_is_scored_and_submitted(
    dfdbench: Command, demo_store: Dataset, tmp_path: Path
) -> None:
    ids = dfdbench("info", "demo", "--pairs", "test").out.split()
    pairs = {pair.id: pair for pair in demo_store.pairs("test")}
    for name in ids:
        path = tmp_path / "work/elsewhere" / f"{name}.npy"
        path.parent.mkdir(parents=True, exist_ok=True)
        np.save(path, demo_store.read_levels(pairs[name])[0])
    (tmp_path / "work/leaderboard/results").mkdir(parents=True)
    asked = ["score", "--predictions", "elsewhere", "--dataset", "demo", "--submit"]
    done = dfdbench(*asked)
    assert done.status == 0
    assert "elsewhere (scored, not run) on demo-1, split test" in done.out
    folder = tmp_path / "work/results/demo-1-test/elsewhere-scored"
    result = load_result(folder)
    assert (result.averages or {})["thesis"]["nrmse"] == 0
    assert (folder / "figures/worst.png").is_file()
    rows = sorted((tmp_path / "work/leaderboard/results").rglob("*.json"))
    assert [path.name for path in rows] == ["elsewhere-scored-not_run.json"]
    board = dfdbench("leaderboard")
    assert board.status == 0
    assert "elsewhere (scored, not run)" in board.out
    left = dfdbench("leaderboard", "verify", str(rows[0]))
    assert "nothing to run again" in left.err
    assert "moved to" in dfdbench(*asked, "--method", "elsewhere").err


@pytest.mark.usefixtures("built")
def test_what_cannot_be_scored_is_told_with_status_2(dfdbench: Command, tmp_path: Path) -> None:
    (tmp_path / "work/empty").mkdir()
    told = dfdbench("score", "--predictions", "empty", "--dataset", "demo")
    assert told.status == 2
    assert "pairs without a depth map: 54" in told.err
    assert "Traceback" not in told.err
    told = dfdbench("score", "--predictions", "empty", "--dataset", "demo", "--unit", "metres")
    assert "does not say how levels become metres" in told.err
